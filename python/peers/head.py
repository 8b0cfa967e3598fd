"""An MRI of a head as VDB, and a transfer function of soft tissue and skin with 256 texels.

head.py VOLUME.nii.gz OUT.vdb OUT.tf.json; Debian's Python, for pyopenvdb. The volume is `ch2` of Debian's package
mricron-data, 181 x 217 x 181 voxels of one millimetre, under its own licence; any 3D NIfTI of 8-bit numbers will do."""
import gzip
import json
import sys

import numpy as np
import pyopenvdb

# NIfTI-1: where the header says its size, the lattice, the type of the values, and where these begin.
HEADER, UNSIGNED_CHARS = 348, 2


def voxels(path):
    """`[x, y, z]`, 0..1."""
    with gzip.open(path) as file:
        data = file.read()
    size = np.frombuffer(data, "<i4", 1)[0]
    dimensions, kind = np.frombuffer(data, "<i2", 4, 40), np.frombuffer(data, "<i2", 1, 70)[0]
    if size != HEADER or dimensions[0] < 3 or kind != UNSIGNED_CHARS:
        sys.exit(f"error: {path} is not a 3D NIfTI-1 volume of 8-bit numbers")
    begin, shape = int(np.frombuffer(data, "<f4", 1, 108)[0]), tuple(int(n) for n in dimensions[1:4])
    values = np.frombuffer(data, np.uint8, int(np.prod(shape)), begin).reshape(shape, order="F")
    # Files have x fastest; pyopenvdb takes memory for C order whatever the strides.
    return np.ascontiguousarray(values, dtype=np.float32) / np.float32(values.max())


def filled(values):
    """A fog volume of `[x, y, z]`; exits unless each voxel lies where its indices say."""
    grid = pyopenvdb.FloatGrid()
    grid.name, grid.gridClass = "density", pyopenvdb.GridClass.FOG_VOLUME
    grid.copyFromArray(values)
    back = np.zeros(values.shape, np.float32)
    grid.copyToArray(back)
    read = grid.getConstAccessor()
    places = np.random.default_rng(1).integers(0, values.shape, (1000, 3))
    apart = [at for at in places.tolist() if read.getValue(tuple(at)) != values[tuple(at)]]
    if apart or not np.array_equal(back, values):
        sys.exit(f"error: pyopenvdb put voxels elsewhere than at their indices, e.g. {apart[:1]}")
    return grid


def function():
    """Skin and fat bright and thin, brain red and denser, what is brightest white; noise around the head is clear."""
    d = (np.arange(256) + 0.5) / 256

    def lobe(mean, width):
        return np.exp(-(((d - mean) / width) ** 2))

    red = 0.1 + 0.8 * lobe(0.35, 0.12) + 0.3 * lobe(0.6, 0.1) + 0.8 * lobe(0.9, 0.12)
    green = 0.1 + 0.5 * lobe(0.35, 0.1) + 0.6 * lobe(0.6, 0.12) + 0.8 * lobe(0.9, 0.12)
    blue = 0.1 + 0.3 * lobe(0.35, 0.1) + 0.7 * lobe(0.6, 0.14) + 0.7 * lobe(0.9, 0.12)
    extinction = 0.02 * lobe(0.35, 0.08) + 0.06 * lobe(0.6, 0.08) + 0.2 * lobe(0.9, 0.1)
    texels = np.stack([red, green, blue, extinction], 1).tolist()
    return {"format": "cumulo-transfer-function", "version": 1,
            "transfer": {"kind": "texture", "domain": [0, 1], "texels": texels}}


if __name__ == "__main__":
    pyopenvdb.write(sys.argv[2], grids=[filled(voxels(sys.argv[1]))])
    with open(sys.argv[3], "w", encoding="utf-8") as out:
        json.dump(function(), out)
