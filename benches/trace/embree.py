"""The peer of the bench: embreex (Embree 4) on one thread, told what to do line by line.

argv[1] is a folder with vertices.f32 (V,3), triangles.i32 (T,3) and NAME.f32 (R,6: origin, direction) for every ray set. Each line
of the input is `closest NAME` or `occluded NAME`; the answer is the seconds of one pass and the number of hits.
"""

import sys
import time
from pathlib import Path

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

folder = Path(sys.argv[1])
vertices = np.fromfile(folder / "vertices.f32", np.float32).reshape(-1, 3)
triangles = np.fromfile(folder / "triangles.i32", np.int32).reshape(-1, 3)
start = time.perf_counter()
scene = rtcore_scene.EmbreeScene()
TriangleMesh(scene, vertices, triangles)
sets = {}
for name in sys.argv[2:]:
    rays = np.fromfile(folder / f"{name}.f32", np.float32).reshape(-1, 6)
    sets[name] = [np.ascontiguousarray(rays[:, :3]), np.ascontiguousarray(rays[:, 3:])]
scene.run(*(x[:1] for x in next(iter(sets.values()))))  # builds the tree
print(f"ready {time.perf_counter() - start:.6f}", flush=True)
for line in sys.stdin:
    query, name = line.split()
    origins, directions = sets[name]
    start = time.perf_counter()
    if query == "closest":
        hits = scene.run(origins, directions)
    else:
        hits = scene.run(origins, directions, query="OCCLUDED")
    seconds = time.perf_counter() - start
    found = int((hits >= 0).sum()) if query == "closest" else int((hits != -1).sum())
    print(f"{seconds:.6f} {found}", flush=True)
