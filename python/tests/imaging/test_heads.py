"""MRI of heads (Debian's mricron-data): every voxel where nibabel has it, there and back."""

import pathlib

import nibabel
import numpy as np
import pytest

HEADS = sorted(pathlib.Path("/usr/share/mricron/templates").glob("*.nii.gz"))


def test_heads_are_there():
    assert HEADS, "run python/setup.sh imaging, or install Debian's mricron-data"


@pytest.mark.parametrize("head", HEADS, ids=lambda path: path.name)
def test_head(cumulo, tmp_path, head):
    image = nibabel.load(head)
    wanted = np.asarray(image.dataobj)
    report = cumulo("convert", head, tmp_path / "head.vdb")
    assert (np.array(report["grid"]["transform"]) == image.affine).all()
    assert report["grid"]["active_voxels"] == np.count_nonzero(wanted)
    for ending in ("nii.gz", "npy"):
        made = cumulo("convert", tmp_path / "head.vdb", tmp_path / f"back.{ending}")
        low = made["grid"]["index_origin"]
        if ending == "npy":
            found, map = np.load(tmp_path / "back.npy"), np.array(made["grid"]["transform"])
        else:
            back = nibabel.load(tmp_path / "back.nii.gz")
            found, map = np.asarray(back.dataobj), back.affine
        part = tuple(slice(start, start + size) for start, size in zip(low, found.shape))
        assert (found == wanted[part]).all(), ending
        # The maps differ by where index 0 is; NIfTI-1 rounds positions of some hundred millimetres to single precision.
        shifted = image.affine @ np.array([[1, 0, 0, low[0]], [0, 1, 0, low[1]], [0, 0, 1, low[2]], [0, 0, 0, 1]])
        assert np.abs(map - shifted).max() <= 512 * np.finfo(np.float32).eps
