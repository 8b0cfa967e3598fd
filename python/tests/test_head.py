"""`python/peers/head.py` puts each voxel of an MRI where its indices say."""

import gzip
import pathlib
import struct
import subprocess

import pytest

HEAD = pathlib.Path(__file__).resolve().parents[1] / "peers" / "head.py"
# pyopenvdb is Debian's, and so is its Python.
PYTHON = "/usr/bin/python3"
SHAPE = (5, 7, 9)


def value(x, y, z):
    """No two voxels are alike, and the largest is the last one."""
    return 1 + x + 5 * y + 27 * z


@pytest.fixture
def volume(tmp_path):
    """A NIfTI-1 of 8-bit numbers, x fastest."""
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<4h", header, 40, 3, *SHAPE)
    struct.pack_into("<h", header, 70, 2)
    struct.pack_into("<f", header, 108, 352.0)
    xs, ys, zs = (range(n) for n in SHAPE)
    data = bytes(value(x, y, z) for z in zs for y in ys for x in xs)
    path = tmp_path / "volume.nii.gz"
    path.write_bytes(gzip.compress(bytes(header) + data))
    return path


def test_voxels_lie_where_their_indices_say(volume, tmp_path):
    out, function = tmp_path / "head.vdb", tmp_path / "head.tf.json"
    subprocess.run([PYTHON, HEAD, volume, out, function], check=True)
    read = (
        "import pyopenvdb, sys\n"
        "of = pyopenvdb.read(sys.argv[1], 'density').getConstAccessor()\n"
        f"print(*(of.getValue((x, y, z)) for x in range({SHAPE[0]}) for y in range({SHAPE[1]}) for z in range({SHAPE[2]})))"
    )
    text = subprocess.run([PYTHON, "-c", read, out], check=True, capture_output=True, text=True).stdout
    top = value(*(n - 1 for n in SHAPE))
    expected = [value(x, y, z) / top for x in range(SHAPE[0]) for y in range(SHAPE[1]) for z in range(SHAPE[2])]
    # Values are 32-bit floats, printed to 7 digits and more.
    assert [float(word) for word in text.split()] == pytest.approx(expected, rel=2e-7)
