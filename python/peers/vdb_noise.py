"""Writes the 256-cubed noise volume of the VDB benchmark: vdb_noise.py OUT.vdb [--n 256].

Smooth noise cut at 0.6, so that about half of the leaves stay; blosc-compressed floats, 0.6..1.
Runs under the Python that has OpenVDB's bindings (Debian: python3-openvdb, python3-numpy).
"""

import argparse

import numpy as np
import pyopenvdb as vdb


def noise(n, seed=11):
    """Float32 `[x, y, z]`: random values on a lattice 32 voxels apart joined linearly, plus white noise, so
    that the bytes compress as badly as simulated smoke does; 0 where below the cut."""
    rng = np.random.default_rng(seed)
    coarse = rng.random((n // 32 + 1,) * 3)
    at = np.arange(n) / 32
    low = at.astype(int)
    smooth = coarse
    for axis in range(3):
        part = (at - low).reshape([-1 if a == axis else 1 for a in range(3)])
        smooth = np.take(smooth, low, axis) * (1 - part) + np.take(smooth, low + 1, axis) * part
    v = 0.9 * smooth + 0.1 * rng.random((n, n, n))
    return np.where(v > 0.6, v, 0).astype(np.float32)


p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
p.add_argument("out")
p.add_argument("--n", type=int, default=256)
a = p.parse_args()
grid = vdb.FloatGrid()
grid.copyFromArray(noise(a.n))
grid.name, grid.gridClass = "density", vdb.GridClass.FOG_VOLUME
vdb.write(a.out, grids=[grid])
print(f"{a.out}: {grid.leafCount()} leaves, {grid.activeVoxelCount()} active voxels")
