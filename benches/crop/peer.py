"""The crops by PyTorch on the CPU: python peer.py ARRAYS.npz THREADS RUNS

Renders the scene of the file and computes the gradients of mean((value - 0.5)²), with the corners, the box entry, the
signed distance and the quadrature of `field.render`. Prints: samples, median seconds forward, median seconds forward
and gradients, relative L2 of the values, of the planes' gradient, of the last weights of all networks, and of β.
"""
import statistics
import sys
import time

import numpy as np
import torch
import torch.nn.functional as F

arrays = {name: torch.from_numpy(x) for name, x in np.load(sys.argv[1]).items()}
torch.set_num_threads(int(sys.argv[2]))
runs = int(sys.argv[3])
R, STEPS, SAMPLES = float(arrays["half_size"]), int(arrays["steps"]), int(arrays["samples"])
origins, directions = arrays["origins"], arrays["directions"]
count = arrays["planes"].shape[0]
summed = bool(arrays["summed"])
NETS = ["sdf", "color", "albedo", "material", "normal"]


def layers(net):
    return [arrays[f"{net}_w{i}"].requires_grad_() for i in range(4) if f"{net}_w{i}" in arrays]


nets = {net: layers(net) for net in NETS if f"{net}_w0" in arrays}
planes = arrays["planes"].permute(0, 3, 1, 2).contiguous().requires_grad_()
beta = arrays["beta"].requires_grad_()
PAIRS = [(0, 1, 2), (0, 2, 1), (1, 2, 0)]


def positions():
    """Middles of the steps from where the rays enter the box, and their lengths."""
    near = torch.minimum((-R - origins) / directions, (R - origins) / directions).amax(1).clamp(min=0.0)
    far = torch.maximum((-R - origins) / directions, (R - origins) / directions).amin(1)
    h = 2.0 * 3.0**0.5 * R / STEPS
    begin = near[:, None] + h * torch.arange(SAMPLES)
    end = torch.minimum(begin + h, far[:, None])
    t = 0.5 * (begin + end)
    assert bool((begin < far[:, None]).all()), "all samples are inside the box"
    return origins[:, None] + t[..., None] * directions[:, None], end - begin


def network(weights, x):
    for w in weights[:-1]:
        x = F.relu(F.linear(x, w))
    return F.linear(x, weights[-1])


def features(x):
    """Bilinear, aligned corners; six planes: by the sign of the missing coordinate."""
    p, made = x / R, []
    for pair, (a, b, missing) in enumerate(PAIRS):
        at = torch.stack([p[:, b], p[:, a]], -1)

        def read(plane, at):
            read = F.grid_sample(plane[None], at[None, None], mode="bilinear", padding_mode="border", align_corners=True)
            return read[0, :, 0].T

        if count == 3:
            made.append(read(planes[pair], at))
        else:
            plus = p[:, missing] > 0
            rows = torch.cat([torch.nonzero(~plus)[:, 0], torch.nonzero(plus)[:, 0]])
            sides = torch.cat([read(planes[2 * pair], at[~plus]), read(planes[2 * pair + 1], at[plus])])
            made.append(torch.empty_like(sides).index_copy(0, rows, sides))
    return made[0] + made[1] + made[2] if summed else torch.cat(made, -1)


def render():
    x, delta = positions()
    flat = x.reshape(-1, 3)
    f = features(flat)
    z = network(nets["sdf"], f)
    s = 1.5 * 1.732 * R * torch.tanh(z[:, 0]) + (flat.norm(dim=1) - 0.1 * R)
    sigma = (0.5 + 0.5 * torch.sign(s) * torch.expm1(-s.abs() / beta)) / beta
    values = []
    if z.shape[1] == 4:
        values.append(torch.sigmoid(z[:, 1:]))
    for net in NETS[1:]:
        if net in nets and net != "normal":
            values.append(torch.sigmoid(network(nets[net], f)))
        elif net in nets:
            n = network(nets[net], f) + F.normalize(flat, dim=1)
            values.append(F.normalize(n, dim=1))
    depth = sigma.view(delta.shape) * delta
    behind = torch.exp(-torch.cumsum(depth, 1))
    before = torch.cat([torch.ones_like(behind[:, :1]), behind[:, :-1]], 1)
    w = before * -torch.expm1(-depth)
    v = torch.cat(values, -1).view(*delta.shape, -1)
    return (w[..., None] * v).sum(1) + behind[:, -1:], delta.numel()


def both():
    for x in [planes, beta, *(w for net in nets.values() for w in net)]:
        x.grad = None
    value, taken = render()
    ((value - 0.5) ** 2).mean().backward()
    return value, taken


def forward():
    with torch.no_grad():
        return render()


def relative(x, name):
    want = arrays[name].flatten()
    return float((x.detach().flatten() - want).norm() / want.norm())


medians = []
for f in (forward, both):
    f()
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        value, taken = f()
        times.append(time.perf_counter() - start)
    medians.append(statistics.median(times))
last = torch.cat([net[-1].grad.flatten() for net in nets.values()])
print(
    taken,
    *medians,
    relative(value, "values"),
    relative(planes.grad.permute(0, 2, 3, 1), "planes_bar"),
    relative(last, "last_bar"),
    relative(beta.grad, "beta_bar"),
)
