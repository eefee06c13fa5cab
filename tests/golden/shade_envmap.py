"""Makes shade_envmap.npz: a point under a whole environment map, in numpy and float64.

    python3 tests/golden/shade_envmap.py [OUT.npz]

Written from the equations alone: radiance = sum over texels of env * f(normal, view, l) * max(n.l, 0) * (2 pi / W) *
(cos(theta_top) - cos(theta_bottom)), with the BRDF f = (1-m) a / pi + D F G / (4 n.l n.v), alpha = r^2, F0 = 0.04 (1-m) + m a,
Schlick's F of v.h, Smith's height-correlated G. Directions: u = atan2(x, y) / 2 pi + 1/2, v = acos(z) / pi, z up.

Gradients are complex steps, f'(x) = Im f(x + ih) / h with h = 1e-30: exact to rounding, derived by nobody. The radiance is linear
in the map, whose gradient is therefore the coefficient itself. No point lies near a kink (n.l = 0 or n.v = 0).
"""

import os
import sys

import numpy as np

POINTS, ROWS, COLUMNS, STEP = 60, 9, 16, 1e-30


def directions(rows, columns):
    """Unit vectors (H*W, 3) to texel centres and their solid angles (H*W), in row-major order."""
    theta = (np.arange(rows) + 0.5) / rows * np.pi
    phi = ((np.arange(columns) + 0.5) / columns - 0.5) * 2.0 * np.pi
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    towards = np.stack([np.sin(theta) * np.sin(phi), np.sin(theta) * np.cos(phi), np.cos(theta)], -1)
    edge = np.arange(rows + 1) / rows * np.pi
    of_row = 2.0 * np.pi / columns * (np.cos(edge[:-1]) - np.cos(edge[1:]))
    return towards.reshape(-1, 3), np.repeat(of_row, columns)


def dot(a, b):
    return (a * b).sum(-1)


def transport(normal, view, albedo, roughness, metallic):
    """(P, H*W, 3): f * max(n.l, 0) * solid angle. Arguments may be complex; decisions look at real parts."""
    light, solid = directions(ROWS, COLUMNS)
    n = (normal / np.sqrt(dot(normal, normal))[:, None])[:, None, :]
    v, l = view[:, None, :], light[None]
    a, r, m = albedo[:, None, :], roughness[:, None], metallic[:, None]
    h = v + l
    h = h / np.sqrt(dot(h, h))[..., None]
    nl, nv, nh, vh = dot(n, l), dot(n, v), dot(n, h), dot(v, h)
    lit = (nl.real > 0) & (nv.real > 0)
    nl, nv = np.where(lit, nl, 1.0), np.where(lit, nv, 1.0)
    square = (r * r) ** 2
    d = square / (np.pi * (nh * nh * (square - 1.0) + 1.0) ** 2)
    lam = lambda c: (np.sqrt(1.0 + square * (1.0 - c * c) / (c * c)) - 1.0) / 2.0
    g = 1.0 / (1.0 + lam(nl) + lam(nv))
    f0 = 0.04 * (1.0 - m)[..., None] + m[..., None] * a
    fresnel = f0 + (1.0 - f0) * ((1.0 - vh) ** 5)[..., None]
    f = (1.0 - m)[..., None] * a / np.pi + fresnel * (d * g / (4.0 * nl * nv))[..., None]
    return np.where(lit[..., None], f * (nl * solid)[..., None], 0.0)


def radiance(env, **points):
    return (transport(**points) * env.reshape(1, -1, 3)).sum(1)


def single(x):
    return np.asarray(x, np.float32).astype(np.float64)


def draw(rng):
    """Inputs that float32 holds exactly; one point in eight looks away."""
    unit = lambda x: x / np.sqrt(dot(x, x))[:, None]
    light, _ = directions(ROWS, COLUMNS)
    normals, views = [], []
    while len(normals) < POINTS:
        n, v = unit(rng.normal(size=(2, 3)))
        away = len(normals) % 8 == 7
        seen = dot(n, v)
        if np.abs(light @ n).min() > 0.01 and (seen < -0.05 if away else seen > 0.05):
            normals.append(n * rng.uniform(0.5, 2.0))
            views.append(v)
    sky = np.exp(rng.normal(size=(ROWS, COLUMNS, 3)))
    sky[2, 11] *= 40.0  # a sun
    return single(sky), {
        "normal": single(normals),
        "view": single(views),
        "albedo": single(rng.uniform(0.05, 0.95, (POINTS, 3))),
        "roughness": single(rng.uniform(0.15, 0.95, POINTS)),
        "metallic": single(rng.uniform(0.05, 0.95, POINTS)),
    }


def main(out):
    rng = np.random.default_rng(20260101)
    env, points = draw(rng)
    bar = single(rng.normal(size=(POINTS, 3)))
    arrays = {**points, "env": env, "radiance": radiance(env, **points), "radiance_bar": bar}
    for name in ["normal", "albedo", "roughness", "metallic"]:
        x = points[name]
        gradient = np.empty_like(x)
        # Points do not know of each other: one entry of all of them is moved at a time.
        for entry in range(x[0].size):
            moved = x.astype(complex)
            moved.reshape(POINTS, -1)[:, entry] += 1j * STEP
            change = radiance(env, **{**points, name: moved}).imag / STEP
            gradient.reshape(POINTS, -1)[:, entry] = (change * bar).sum(-1)
        arrays[f"{name}_bar"] = gradient
    arrays["env_bar"] = (transport(**points) * bar[:, None, :]).sum(0).reshape(env.shape)
    np.savez(out, **arrays)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else os.path.join(os.path.dirname(__file__), "shade_envmap.npz"))
