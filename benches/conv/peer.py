"""The encoder's convolutions by PyTorch on the CPU: python peer.py THREADS RUNS

Prints one line per layer: name, seconds forward, seconds forward and adjoint (medians). The first layer needs no gradient of its picture.
"""
import statistics
import sys
import time

import torch

threads, runs = int(sys.argv[1]), int(sys.argv[2])
torch.set_num_threads(threads)
torch.manual_seed(1)
B = 64
for name, side, c, o in [("64x3", 64, 3, 32), ("32x32", 32, 32, 32), ("16x32", 16, 32, 64), ("8x64", 8, 64, 64)]:
    conv = torch.nn.Conv2d(c, o, 4, stride=2, padding=1)
    x = torch.randn(B, c, side, side, requires_grad=c != 3)
    bar = torch.randn(B, o, side // 2, side // 2)

    def forward():
        with torch.no_grad():
            conv(x)

    def both():
        conv.weight.grad = conv.bias.grad = x.grad = None
        conv(x).backward(bar)

    medians = []
    for f in (forward, both):
        f()
        times = []
        for _ in range(runs):
            start = time.perf_counter()
            f()
            times.append(time.perf_counter() - start)
        medians.append(statistics.median(times))
    print(name, *medians)
