"""Makes nn_softmax.npz, nn_tokens.npz, nn_fuse.npz and nn_unpatch.npz: layers of LIRM, in PyTorch and float64.

    python3 tests/golden/lirm_layers.py [FOLDER]

Written from the layers of torch.nn.functional alone. Images are (B, H, W, C) and weights (D, P, P, C), so that they are permuted
before and after. Inputs are rounded to float32. Gradients are those of autograd, for random cotangents.
"""

import os
import sys

import numpy as np
import torch
import torch.nn.functional as F


def first(x):
    """Channels before rows."""
    return x.permute(0, 3, 1, 2)


def last(x):
    return x.permute(0, 2, 3, 1)


def softmax(x, base):
    """Rows of base * exp(x), over their sum."""
    return {"y": torch.softmax(x + torch.log(base), 1)}


def tokens(image, rays, photo, w_image, w_rays, w_photo, bias, norm_gain, norm_bias):
    """A linear layer over squares of pixels, one for all three kinds, then a LayerNorm."""
    pixels, weights = torch.cat([image, rays, photo], 3), torch.cat([w_image, w_rays, w_photo], 3)
    z = last(F.conv2d(first(pixels), first(weights), bias, stride=weights.shape[1]))
    return {"tokens": F.layer_norm(z, bias.shape, norm_gain, norm_bias, 1e-6)}


def fuse(state, position, w1, b1, w2, b2):
    """Two linear layers over the joined rows, with the exact GELU between them."""
    hidden = F.gelu(F.linear(torch.cat([state, position], 1), w1, b1))
    return {"tokens": F.linear(hidden, w2, b2)}


def unpatch(tokens, weight, bias):
    """A transposed convolution with a stride as long as its kernel."""
    y = F.conv_transpose2d(first(tokens), first(weight), bias, stride=weight.shape[1])
    return {"y": last(y)}


SHAPES = {
    softmax: {"x": (9, 13), "base": (9, 13)},
    tokens: {
        "image": (2, 16, 16, 3),
        "rays": (2, 16, 16, 6),
        "photo": (2, 16, 16, 3),
        "w_image": (12, 8, 8, 3),
        "w_rays": (12, 8, 8, 6),
        "w_photo": (12, 8, 8, 3),
        "bias": (12,),
        "norm_gain": (12,),
        "norm_bias": (12,),
    },
    fuse: {"state": (11, 24), "position": (11, 24), "w1": (32, 48), "b1": (32,), "w2": (24, 32), "b2": (24,)},
    unpatch: {"tokens": (6, 3, 2, 12), "weight": (12, 8, 8, 4), "bias": (4,)},
}


def main():
    folder = sys.argv[1] if len(sys.argv) > 1 else os.path.dirname(os.path.abspath(__file__))
    for seed, (layer, shapes) in enumerate(SHAPES.items()):
        rng = np.random.default_rng(seed)
        drawn = {name: rng.standard_normal(shape).astype(np.float32) for name, shape in shapes.items()}
        if layer is softmax:
            # Weights are positive; logits of one row are far apart.
            drawn["base"] = np.abs(drawn["base"])
            drawn["x"][0] *= 40.0
        x = {name: torch.from_numpy(a).double().requires_grad_() for name, a in drawn.items()}
        made = layer(**x)
        file = dict(drawn)
        for name, y in made.items():
            bar = rng.standard_normal(tuple(y.shape)).astype(np.float32)
            y.backward(torch.from_numpy(bar).double())
            file[name] = y.detach().numpy()
            file[f"{name}_bar"] = bar
        for name, a in x.items():
            # Prior weights are constants.
            if name != "base":
                file[f"{name}_bar"] = a.grad.numpy()
        path = os.path.join(folder, f"nn_{layer.__name__}.npz")
        np.savez_compressed(path, **{name: np.asarray(a, np.float64) for name, a in file.items()})
        print(path, os.path.getsize(path))


if __name__ == "__main__":
    main()
