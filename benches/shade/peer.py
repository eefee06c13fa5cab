"""The picture of the bench by Mitsuba 3 in LLVM mode: python peer.py OUT_DIR THREADS [high]

Prints one line per integrator: name, samples per second. Writes OUT_DIR/<name>.f32, (512, 512, 3) f32 little endian. With `high`, one
picture of many samples instead of timing.
"""
import sys
import time

import drjit as dr
import mitsuba as mi
import numpy as np

out, threads = sys.argv[1], int(sys.argv[2])
high = len(sys.argv) > 3
mi.set_variant("llvm_ad_rgb")
dr.set_thread_count(threads)

U, V = 1000, 500
u = 2 * np.pi * np.arange(U)[:, None] / U
v = 2 * np.pi * np.arange(V)[None, :] / V
d = 0.05 * np.sin(9 * u) * np.cos(7 * v) + 0.02 * np.sin(31 * u + 17 * v) + 0.008 * np.sin(97 * u - 61 * v)
r = 0.45 + d
p = np.stack([(1 + r * np.cos(v)) * np.cos(u), (1 + r * np.cos(v)) * np.sin(u), r * np.sin(v)], -1)
p = p.reshape(-1, 3).astype(np.float32)
i, j = np.meshgrid(np.arange(U), np.arange(V), indexing="ij")
at = lambda i, j: (i % U) * V + j % V
a, b, c, e = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
t = np.stack([np.stack([a, b, c], -1), np.stack([a, c, e], -1)], 2).reshape(-1, 3).astype(np.uint32)

mesh = mi.Mesh("torus", vertex_count=len(p), face_count=len(t), has_vertex_normals=False)
params = mi.traverse(mesh)
params["vertex_positions"] = p.ravel()
params["faces"] = t.ravel()
params.update()
mesh.write_ply(out + "/torus.ply")

samples = 16
scene = mi.load_dict({
    "type": "scene",
    "sensor": {
        "type": "perspective", "fov": 45, "fov_axis": "y", "near_clip": 1e-3, "far_clip": 1e3,
        "to_world": mi.ScalarTransform4f().look_at([0, -2.8, 1.9], [0, 0, 0], [0, 0, 1]),
        "film": {"type": "hdrfilm", "width": 512, "height": 512, "rfilter": {"type": "box"}, "pixel_format": "rgb",
                 "component_format": "float32"},
        "sampler": {"type": "independent", "sample_count": samples},
    },
    "mesh": {"type": "ply", "filename": out + "/torus.ply", "face_normals": True,
             "bsdf": {"type": "twosided", "b": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.7}}}},
    "sky": {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}},
    "lamp": {"type": "point", "position": [2, -3, 4], "intensity": {"type": "rgb", "value": 20.0}},
})
for name, integrator in [("direct", {"type": "direct"}), ("path", {"type": "path", "max_depth": 4})]:
    integrator = mi.load_dict(integrator)
    if high:
        total = np.zeros((512, 512, 3))
        for seed in range(8):
            total += np.array(mi.render(scene, integrator=integrator, spp=64, seed=seed))
        picture = total / 8
    else:
        times = []
        for seed in range(6):
            start = time.perf_counter()
            image = mi.render(scene, integrator=integrator, spp=samples, seed=seed)
            dr.eval(image)
            dr.sync_thread()
            times.append(time.perf_counter() - start)
        picture = np.array(image)
        print(name, 512 * 512 * samples / sorted(times[1:])[2], flush=True)
    picture.astype("<f4").tofile(f"{out}/{name}.f32")
