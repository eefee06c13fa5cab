"""Numbers of tests/systems/last/metrics.rs by scikit-image: python tests/systems/last/ssim_sk.py (scikit-image 0.26.0, NumPy 2.4.6)."""
import numpy as np
from skimage.metrics import structural_similarity


def image(height, width, seed):
    i = np.arange(height * width * 3, dtype=np.int64)
    noise = (i * 7919 + seed * 104729) % 251
    slope = (i // 3 % width) * 3 + (i // (3 * width)) * 2
    return ((noise // (1 + seed) + slope) % 256 / 256.0).reshape(height, width, 3)


for height, width in [(7, 7), (24, 31), (40, 19)]:
    x = image(height, width, 1)
    y = (7 * x + image(height, width, 2)) / 8
    for data_range in (1.0, 2.0):
        s = structural_similarity(x, y, channel_axis=-1, data_range=data_range)
        print(f"({height}, {width}, {data_range}, {float(s)!r}),")
