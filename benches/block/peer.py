"""A transformer block by PyTorch on the CPU: python peer.py FILE THREADS

Reads the inputs, and the results to compare with, from FILE; then obeys a line of standard input at a time and prints a line:
forward, both: the seconds of one run (without gradients; with the gradients of all inputs); memory: the peak of the resident memory of one run with gradients, above
that before it, in MiB; compare: the relative L2 differences of y and of all gradients.
"""
import ctypes
import sys
import time

import numpy as np
import torch
import torch.nn.functional as F

arrays = np.load(sys.argv[1])
torch.set_num_threads(int(sys.argv[2]))
NAMES = [n[:-4] for n in arrays.files if n.endswith("_bar") and n != "y_bar"]
inputs = {n: torch.from_numpy(arrays[n]).requires_grad_() for n in NAMES}
y_bar, heads, eps = torch.from_numpy(arrays["y_bar"]), int(arrays["heads"]), 1e-6


def block(p):
    x = p["x"]
    t, d = x.shape
    qkv = F.linear(F.layer_norm(x, (d,), p["ln1_gain"], p["ln1_bias"], eps), p["w_qkv"], p["b_qkv"])
    q, k, v = (a.view(1, t, heads, d // heads).transpose(1, 2) for a in qkv.split(d, dim=1))
    o = F.scaled_dot_product_attention(q, k, v).transpose(1, 2).reshape(t, d)
    h = x + F.linear(o, p["w_out"], p["b_out"])
    n = F.layer_norm(h, (d,), p["ln2_gain"], p["ln2_bias"], eps)
    return h + F.linear(F.gelu(F.linear(n, p["w_fc1"], p["b_fc1"])), p["w_fc2"], p["b_fc2"])


def forward():
    with torch.no_grad():
        return block(inputs)


def both():
    y = block(inputs)
    return y, torch.autograd.grad(y, list(inputs.values()), y_bar)


def seconds(f):
    start = time.perf_counter()
    f()
    return time.perf_counter() - start


def resident(key):
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith(key)) / 1024


def memory():
    small = {n: v[:8] if n == "x" else v for n, v in inputs.items()}
    torch.autograd.grad(block(small), list(inputs.values()), y_bar[:8])  # what is allocated once does not count
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    with open("/proc/self/clear_refs", "w") as reset:
        reset.write("5")
    before = resident("VmRSS")
    both()
    return resident("VmHWM") - before


def compare():
    y, bars = both()
    pairs = {"y": y} | {f"{n}_bar": bar for n, bar in zip(inputs, bars)}
    off = lambda n, theirs: np.linalg.norm(theirs - arrays[n].astype(np.float64)) / np.linalg.norm(theirs)
    return " ".join(f"{n} {off(n, v.detach().double().numpy()):.1e}" for n, v in pairs.items())


commands = {"forward": lambda: seconds(forward), "both": lambda: seconds(both), "memory": memory, "compare": compare}
for line in sys.stdin:
    print(commands[line.strip()](), flush=True)
