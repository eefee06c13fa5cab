"""Makes the HDF5 miniatures beside this script: python3 tests/samples/hdf5/make.py (h5py 3.16.0 with HDF5 2.0.0, NumPy 2.4.6, Pillow 13.0.0).

The person, the camera and the poses follow the formulas of tests/common/mini_person.rs, written here a second time. h5py writes
the files in the forms in which captures are published:

  snapshot_4     PeopleSnapshot as published: signed bytes compressed by LZF, poses in single precision, superblock 0
  snapshot_11    the same for 11 frames, with deflate and libver="latest" (superblock 3, new groups and chunk indices)
  snapshot_101   the same for 101 frames, with deflate, superblock 0
  standing_4     four equal frames, stored contiguously, double precision
  dna            a performance of DNA-Rendering: nested groups with encoded pictures (superblock 0), annotations (superblock 3)
"""

import io
import math
from pathlib import Path

import h5py
import numpy as np
from PIL import Image

HERE = Path(__file__).parent
SMPL_PARENTS = [0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21]
SMPL_JOINTS = [
    [0.0, -0.2, 0.0], [0.1, -0.3, 0.0], [-0.1, -0.3, 0.0], [0.0, -0.1, 0.0], [0.12, -0.7, 0.0], [-0.12, -0.7, 0.0],
    [0.0, 0.05, 0.02], [0.12, -1.1, -0.02], [-0.12, -1.1, -0.02], [0.0, 0.1, 0.0], [0.13, -1.15, 0.1], [-0.13, -1.15, 0.1],
    [0.0, 0.3, 0.0], [0.08, 0.2, 0.0], [-0.08, 0.2, 0.0], [0.0, 0.45, 0.05], [0.2, 0.22, 0.0], [-0.2, 0.22, 0.0],
    [0.45, 0.2, 0.0], [-0.45, 0.2, 0.0], [0.7, 0.2, 0.0], [-0.7, 0.2, 0.0], [0.8, 0.2, 0.0], [-0.8, 0.2, 0.0],
]  # fmt: skip
SHAPES = 10
DISTORTION = [-0.08, 0.01, 0.002, -0.001, 0.003]
PERSON = (200, 120, 60)


def noise(i):
    """A number in -1..1 that depends on its index alone."""
    word = 2**64 - 1
    x = (i + 1) * 0x9E37_79B9_7F4A_7C15 & word
    x = (x ^ (x >> 29)) * 0xBF58_476D_1CE4_E5B9 & word
    return (x >> 11) / 2**52 - 1.0


def rotation(v):
    """The matrix of an axis-angle."""
    angle = math.sqrt(sum(c * c for c in v))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = (c / angle for c in v)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


class Body:
    """Two points per joint: 24 joints as SMPL, 55 as SMPL-X."""

    def __init__(self, joints):
        parents, places = list(SMPL_PARENTS), [list(p) for p in SMPL_JOINTS]
        if joints == 55:
            del parents[22:], places[22:]
            for x in (0.0, 0.03, -0.03):
                parents.append(15)
                places.append([x, 0.5, 0.1])
            for wrist, side in ((20, 1.0), (21, -1.0)):
                for joint in range(15):
                    finger, phalanx = divmod(joint, 3)
                    parents.append(wrist if phalanx == 0 else len(parents) - 1)
                    places.append([side * (0.76 + 0.03 * phalanx), 0.2, 0.04 - 0.02 * finger])
        self.parents, points = parents, 2 * joints
        offset = lambda p: 0.05 if p < joints else -0.05
        self.template = np.array(
            [np.array(places[p % joints]) + offset(p) * np.array([0.3, 0.4, 1.0]) for p in range(points)]
        )
        self.shapes = np.array([0.02 * noise(i) for i in range(points * 3 * SHAPES)]).reshape(points, 3, SHAPES)
        size = points * 3 * 9 * (joints - 1)
        self.pose_shapes = np.array([0.01 * noise(i + 77) for i in range(size)]).reshape(points, 3, -1)
        self.regressor = np.zeros((joints, points))
        self.weights = np.zeros((points, joints))
        for p in range(points):
            self.regressor[p % joints, p] = 0.5
            self.weights[p, p % joints] += 0.75
            self.weights[p, parents[p % joints]] += 0.25

    def shaped(self, betas):
        return self.template + self.shapes @ betas

    def posed(self, body, rest, thetas):
        """Points at rest that turn about the joints of a body."""
        joints, turns = self.regressor @ body, [rotation(v) for v in thetas]
        features = np.concatenate([(r - np.eye(3)).ravel() for r in turns[1:]])
        rest = rest + self.pose_shapes @ features
        out = np.zeros_like(rest)
        for k in range(len(joints)):
            x, j = rest, k
            while True:
                x = (x - joints[j]) @ turns[j].T + joints[j]
                if j == 0:
                    break
                j = self.parents[j]
            out += self.weights[:, k : k + 1] * x
        return out


class Camera:
    """Turned by an angle about y, 'away' metres from the origin."""

    def __init__(self, side, angle, away, distortion):
        f, c = 1.1 * side, 0.5 * side - 0.5
        self.side, self.d = side, list(distortion)
        self.k = np.array([[f, 0.0, c], [0.0, f, c + 0.25], [0.0, 0.0, 1.0]])
        self.r = np.array([rotation([0.0, angle, 0.0]) @ e for e in np.eye(3)])
        self.t = np.array([0.0, 0.0, away])

    def photograph(self, points):
        """The person in one colour on green, and the mask of 0 and 1."""
        v = points @ self.r.T + self.t
        a, b = v[:, 0] / v[:, 2], v[:, 1] / v[:, 2]
        d, r2 = self.d + [0.0] * (5 - len(self.d)), a * a + b * b
        g = 1.0 + d[0] * r2 + d[1] * r2**2 + d[4] * r2**3
        x = a * g + 2.0 * d[2] * a * b + d[3] * (r2 + 2.0 * a * a)
        y = b * g + d[2] * (r2 + 2.0 * b * b) + 2.0 * d[3] * a * b
        u, w = (self.k[i, i] * p + self.k[i, 2] + 0.5 for i, p in ((0, x), (1, y)))
        rgb, mask = [], []
        for i in range(self.side**2):
            px, py = i % self.side + 0.5, i // self.side + 0.5
            on = bool(((u - px) ** 2 + (w - py) ** 2 < (0.09 * self.side) ** 2).any())
            mask.append(int(on))
            rgb.append(PERSON if on else (10, 200, i % 256))
        size = (self.side, self.side)
        return np.array(rgb, np.uint8).reshape(*size, 3), np.array(mask, np.uint8).reshape(size)


def thetas(joints, frame, root):
    """Axis-angles of a frame."""
    rest = [[0.25 * noise(1000 * frame + 3 * k + c) for c in range(3)] for k in range(1, joints)]
    return np.array([root] + rest)


BETAS = np.array([noise(b + 5) for b in range(SHAPES)])


def snapshot(name, frames, libver, as_published):
    """masks.hdf5 and reconstructed_poses.hdf5 of PeopleSnapshot: a person that turns in front of a camera."""
    body, camera, side = Body(24), Camera(16, 0.0, 0.0, DISTORTION), 16
    shaped = body.shaped(BETAS)
    clothed = shaped * [1.02, 1.0, 1.05]
    masks, poses, trans = [], [], []
    for f in range(frames):
        turns = thetas(24, f, [math.pi, 0.2 * f, 0.0])
        trans.append([0.02 * f, 0.1, 3.0])
        masks.append(camera.photograph(body.posed(shaped, clothed, turns) + trans[-1])[1])
        poses.append(turns.ravel())
    folder = HERE / name
    folder.mkdir(exist_ok=True)
    packed = {"compression": "lzf"} if as_published else {"compression": "gzip", "compression_opts": 4}
    with h5py.File(folder / "masks.hdf5", "w", libver=libver) as f:
        data = np.array(masks, np.int8 if as_published else np.uint8)
        f.create_dataset("masks", data=data, chunks=(1, side, side), **packed)
    with h5py.File(folder / "reconstructed_poses.hdf5", "w", libver=libver) as f:
        f["pose"] = np.array(poses, np.float32)
        f["trans"] = np.array(trans, np.float32)
        f["betas"] = BETAS


def standing():
    """Four equal frames."""
    body, camera = Body(24), Camera(16, 0.0, 0.0, [])
    rest, turns = body.shaped(BETAS), thetas(24, 0, [math.pi, 0.0, 0.0])
    mask = camera.photograph(body.posed(rest, rest, turns) + [0.0, 0.0, 3.0])[1]
    folder = HERE / "standing_4"
    folder.mkdir(exist_ok=True)
    with h5py.File(folder / "masks.hdf5", "w") as f:
        f["masks"] = np.array([mask] * 4)
    with h5py.File(folder / "reconstructed_poses.hdf5", "w") as f:
        f["pose"] = np.array([turns.ravel()] * 4)
        f["trans"] = np.array([[0.0, 0.0, 3.0]] * 4)
        f["betas"] = BETAS


def encoded(pixels, kind, **options):
    """A picture as the bytes of its file."""
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, kind, **options)
    return np.frombuffer(out.getvalue(), np.uint8)


def store(file, path, value):
    """A data set in groups that carry no time, so that the bytes are the same whenever they are made."""
    *groups, name = path.split("/")
    plain = h5py.h5p.create(h5py.h5p.GROUP_CREATE)
    plain.set_obj_track_times(False)
    for g in groups:
        if g not in file:
            h5py.h5g.create(file.id, g.encode(), gcpl=plain)
        file = file[g]
    file[name] = value


def dna():
    """A performance of DNA-Rendering of three frames by five cameras."""
    body, side, frames = Body(55), 32, 3
    hands = np.array([0.4 * noise(start + i) for start in (300, 400) for i in range(45)]).reshape(30, 3)
    rest = body.shaped(BETAS)
    points, poses, transl = [], [], []
    for f in range(frames):
        turns = thetas(55, f, [math.pi, 0.3, 0.0])
        poses.append(turns.copy())
        transl.append([0.0, 0.05 * f, 0.1])
        turns[-30:] += hands
        points.append(1.1 * body.posed(rest, rest, turns) + transl[-1])
    folder = HERE / "dna"
    folder.mkdir(exist_ok=True)
    main = h5py.File(folder / "0012_09.smc", "w")
    annots = h5py.File(folder / "0012_09_annots.smc", "w", libver="latest")
    for c in range(24, 29):
        camera = Camera(side, 0.8 * c, 3.0, DISTORTION)
        for f in range(frames):
            rgb, mask = camera.photograph(points[f])
            store(main, f"Camera_5mp/{c}/color/{f}", encoded(rgb, "jpeg", quality=98, subsampling=0))
            store(annots, f"Mask/{c}/mask/{f}", encoded(255 * mask, "png"))
        world_from_camera = np.eye(4)
        world_from_camera[:3, :3] = camera.r.T
        world_from_camera[:3, 3] = -camera.r.T @ camera.t
        for key, value in (("K", camera.k), ("D", np.array(camera.d)), ("RT", world_from_camera)):
            store(annots, f"Camera_Parameter/{c:02}/{key}", value)
    store(annots, "SMPLx/fullpose", np.array(poses))
    store(annots, "SMPLx/transl", np.array(transl))
    store(annots, "SMPLx/betas", BETAS[None])
    store(annots, "SMPLx/expression", np.zeros((frames, 10)))
    store(annots, "SMPLx/scale", np.array([1.1]))
    main.close()
    annots.close()


snapshot("snapshot_4", 4, None, True)
snapshot("snapshot_11", 11, "latest", False)
snapshot("snapshot_101", 101, None, False)
standing()
dna()
