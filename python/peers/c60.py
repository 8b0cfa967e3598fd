"""A field like the electron density of C60, and a transfer function of three peaks with clear gaps.

c60.py OUT.vdb OUT.tf.json [N]: N³ voxels (default 128) of edge 128/N; Debian's Python, for pyopenvdb."""
import json
import sys

import numpy as np


def atoms():
    """The 60 corners of the truncated icosahedron with edges of length 2."""
    golden = (1 + 5**0.5) / 2
    found = set()
    for corner in [(0, 1, 3 * golden), (2, 1 + 2 * golden, golden), (1, 2 + golden, 2 * golden)]:
        for signs in np.ndindex(2, 2, 2):
            signed = [c * (1 - 2 * s) for c, s in zip(corner, signs)]
            found.update(tuple(np.roll(signed, turn) + 0.0) for turn in range(3))
    return np.array(sorted(found))


def field(n):
    """Gaussians of width 0.7 about the atoms, fading out towards the faces; 0..1."""
    x = (np.arange(n) + 0.5) / n * 14 - 7
    place = np.meshgrid(x, x, x, indexing="ij")
    total = sum(np.exp(-sum((p - c) ** 2 for p, c in zip(place, atom)) / (2 * 0.7**2)) for atom in atoms())
    border = np.maximum.reduce([abs(p) for p in place])
    return (total / total.max() * np.clip((6.9 - border) / 0.6, 0, 1)).astype(np.float32)


def function():
    """256 texels: red at 0.2, green at 0.5, blue at 0.8."""
    d = (np.arange(256) + 0.5) / 256

    def lobe(mean, width):
        return np.exp(-(((d - mean) / width) ** 2))

    red = 0.1 + 0.9 * lobe(0.2, 0.12) + 0.1 * lobe(0.5, 0.1)
    green = 0.1 + 0.3 * lobe(0.2, 0.1) + 0.8 * lobe(0.5, 0.12) + 0.2 * lobe(0.8, 0.1)
    blue = 0.1 + 0.9 * lobe(0.8, 0.14) + 0.2 * lobe(0.5, 0.1)
    extinction = 0.03 * lobe(0.2, 0.06) + 0.12 * lobe(0.5, 0.06) + 0.25 * lobe(0.8, 0.07)
    texels = np.stack([red, green, blue, extinction], 1).tolist()
    return {"format": "cumulo-transfer-function", "version": 1,
            "transfer": {"kind": "texture", "domain": [0, 1], "texels": texels}}


if __name__ == "__main__":
    import pyopenvdb

    n = int(sys.argv[3]) if len(sys.argv) > 3 else 128
    grid = pyopenvdb.FloatGrid()
    grid.name, grid.gridClass = "density", pyopenvdb.GridClass.FOG_VOLUME
    grid.copyFromArray(field(n))
    grid.transform = pyopenvdb.createLinearTransform(128 / n)
    pyopenvdb.write(sys.argv[1], grids=[grid])
    with open(sys.argv[2], "w", encoding="utf-8") as out:
        json.dump(function(), out)
