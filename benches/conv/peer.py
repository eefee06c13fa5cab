"""The layers of the image-to-point model by PyTorch on the CPU: python peer.py THREADS RUNS

Prints a line per case and memory layout: name, layout, seconds forward, seconds forward and adjoint (medians). Photographs and codes of coordinates need no
gradient.
"""
import statistics
import sys
import time

import torch
from torch import nn

threads, runs = int(sys.argv[1]), int(sys.argv[2])
torch.set_num_threads(threads)
torch.manual_seed(1)
LAYOUTS = [("contiguous", torch.contiguous_format), ("channels_last", torch.channels_last)]


def report(name, layout, model, inputs, bar):
    def forward():
        with torch.no_grad():
            model(*inputs)

    def both():
        model.zero_grad(set_to_none=True)
        for x in inputs:
            x.grad = None
        model(*inputs).backward(bar)

    medians = []
    for f in (forward, both):
        f()
        times = []
        for _ in range(runs):
            start = time.perf_counter()
            f()
            times.append(time.perf_counter() - start)
        medians.append(statistics.median(times))
    print(name, layout, *medians, flush=True)


def encoder():
    layers, channels = [], 3
    for outputs in (32, 32, 64, 64):
        layers += [nn.Conv2d(channels, outputs, 4, stride=2, padding=1), nn.LeakyReLU(0.2)]
        channels = outputs
    return nn.Sequential(*layers, nn.Flatten(), nn.Linear(1024, 256), nn.LeakyReLU(0.2), nn.Linear(256, 32))


class Decoder(nn.Module):
    def __init__(self):
        super().__init__()
        self.point, self.latent = nn.Linear(27, 128), nn.Linear(16, 128, bias=False)
        self.rest = nn.Sequential(
            nn.LeakyReLU(0.2), nn.Linear(128, 128), nn.LeakyReLU(0.2), nn.Linear(128, 64), nn.LeakyReLU(0.2), nn.Linear(64, 6)
        )

    def forward(self, codes, z):
        return self.rest(self.point(codes) + self.latent(z)[:, None, :])


B = 192
for layout, memory_format in LAYOUTS:
    for name, side, c, o in [("64x3", 64, 3, 32), ("32x32", 32, 32, 32), ("16x32", 16, 32, 64), ("8x64", 8, 64, 64)]:
        x = torch.randn(B, c, side, side).to(memory_format=memory_format).requires_grad_(c != 3)
        bar = torch.randn(B, o, side // 2, side // 2).to(memory_format=memory_format)
        report(name, layout, nn.Conv2d(c, o, 4, stride=2, padding=1).to(memory_format=memory_format), [x], bar)
    x = torch.randn(B, 3, 64, 64).to(memory_format=memory_format)
    report("encoder", layout, encoder().to(memory_format=memory_format), [x], torch.randn(B, 32))
codes, z = torch.randn(256, 256, 27), torch.randn(256, 16, requires_grad=True)
report("decoder", "rows", Decoder(), [codes, z], torch.randn(256, 256, 6))
