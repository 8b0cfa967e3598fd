"""Captures whose pictures Cycles would show otherwise are refused, before anything is rendered."""

import dataclasses

import pytest
from cumulo import blender
from cumulo.capture import Capture, sphere_cameras

TRANSFER = {"kind": "identity", "domain": [0.0, 1.0], "color": [1.0, 0.5, 0.25]}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"model": "pre-shaded"}, "pre-shaded"),
        ({"transfer": TRANSFER}, "transfer function"),
        ({"emission_model": "linear"}, "'linear'"),
    ],
)
def test_other_models_are_refused(fixtures, tmp_path, changes, message):
    camera = sphere_cameras(1, (0, 0, 0), (2, 2, 2), 4, 4)[0]
    capture = Capture([(camera, tmp_path / "a.exr")], model="emission-absorption")
    dataclasses.replace(capture, **changes).write(tmp_path / "transforms.json")
    words = ["render", str(fixtures / "cube.vdb"), "--capture", str(tmp_path), "-o", str(tmp_path / "out")]
    with pytest.raises(ValueError, match=message):
        blender.main(words)
    assert not (tmp_path / "out").exists()
    # What they absorb is the same for every model.
    blender.main([*words, "--model", "absorption", "--samples", "1"])
    assert (tmp_path / "out" / "view_000.exr").exists()
