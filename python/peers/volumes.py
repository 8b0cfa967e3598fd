"""The volumes of B1, each float32 `[z, y, x]` in whole multiples of 1/255, so that bytes hold them exactly.

    volumes.py NAME OUT.npy [HEAD.nii.gz]

`plume` is smooth, `cloud` has sharp edges, `wisps` are fine, `ct` is a phantom of a head with 2 % of noise, and `head` is
an MRI (`ch2` of Debian's mricron-data). Debian's Python, for `head.py`.
"""

import sys

import numpy as np
from field import smoke

VOXELS = 192
NOISE, BLUR = 0.02, 0.7
# Ellipsoids of the phantom, the later ones in front: half axes, middle, density.
ELLIPSOIDS = [
    ((0.85, 0.90, 0.90), (0.0, 0.0, 0.0), 0.25),
    ((0.80, 0.85, 0.85), (0.0, 0.0, 0.0), 0.75),
    ((0.72, 0.77, 0.77), (0.0, 0.0, 0.0), 0.32),
    ((0.12, 0.30, 0.25), (0.25, 0.1, 0.0), 0.05),
    ((0.12, 0.30, 0.25), (-0.25, 0.1, 0.0), 0.05),
    ((0.20, 0.15, 0.20), (0.0, -0.5, -0.2), 0.42),
]


def frequencies(n):
    """Magnitudes of the frequencies of a real transform, in waves along an edge."""
    f = np.fft.fftfreq(n) * n
    return np.sqrt(sum(axis**2 for axis in np.meshgrid(f, f, np.fft.rfftfreq(n) * n, indexing="ij")))


def fractal(n, exponent, lowest, seed):
    """Noise of deviation 1 whose amplitudes follow a power of the frequency from the lowest one on."""
    k = frequencies(n)
    amplitudes = np.where(k >= lowest, np.maximum(k, 1) ** exponent, 0)
    noise = np.random.default_rng(seed).standard_normal((n, n, n))
    values = np.fft.irfftn(np.fft.rfftn(noise) * amplitudes, s=(n, n, n), axes=(0, 1, 2))
    return values / values.std()


def axes():
    """Coordinates z, y, x from -1 to 1."""
    c = np.linspace(-1, 1, VOXELS)
    return np.meshgrid(c, c, c, indexing="ij")


def cloud():
    """A body of billows."""
    z, y, x = axes()
    inside = 1 - np.sqrt((x / 0.8) ** 2 + (y / 0.8) ** 2 + (z / 0.55) ** 2)
    return 3 * (inside + 0.28 * fractal(VOXELS, -2.0, 2, 5))


def wisps():
    """Sheets within a plume."""
    z, y, x = axes()
    sheets, bend = fractal(VOXELS, -1.7, 3, 9), 0.2 * fractal(VOXELS, -2.2, 2, 10)
    away = (x + bend) ** 2 + (y + np.roll(bend, 50, 1)) ** 2
    return np.clip(1 - away / (0.12 + 0.1 * (z + 1) ** 2), 0, 1) * np.exp(-((sheets / 0.5) ** 2)) * (np.abs(z) < 0.93)


def ct():
    """Skull, brain and cavities, blurred and noisy."""
    z, y, x = axes()
    values = np.zeros_like(x)
    for (a, b, c), (u, v, w), density in ELLIPSOIDS:
        values[((x - u) / a) ** 2 + ((y - v) / b) ** 2 + ((z - w) / c) ** 2 < 1] = density
    blur = np.exp(-0.5 * (2 * np.pi * BLUR / VOXELS * frequencies(VOXELS)) ** 2)
    blurred = np.fft.irfftn(np.fft.rfftn(values) * blur, s=values.shape, axes=(0, 1, 2))
    return blurred + NOISE * np.random.default_rng(3).standard_normal(values.shape)


def head(path):
    """An MRI."""
    from head import voxels  # needs OpenVDB's bindings

    return voxels(path).transpose(2, 1, 0)


def main(name, target, *given):
    make = {"plume": lambda: smoke(256), "cloud": cloud, "wisps": wisps, "ct": ct, "head": head}[name]
    np.save(target, np.round(255 * np.clip(make(*given), 0, 1)).astype(np.float32) / np.float32(255))


if __name__ == "__main__":
    main(*sys.argv[1:])
