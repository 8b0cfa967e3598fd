"""Deep renders, as OpenEXR's and OpenImageIO's own libraries read them and hold them out."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

OIIOTOOL = Path(sys.executable).with_name("oiiotool")
SIZE = WIDTH, HEIGHT = 48, 40
ERROR = 0.01

WORDS = {
    "straight": "--density-scale 4 --model emission-absorption --emission 0.9,0.5,0.2 --supersample 2",
    "paths": "--density-scale 4 --albedo 0.9 --sun 1,1,2 --samples 64",
}


def pixels(path):
    """RGBA of a flat picture, [height, width, 4]."""
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return np.stack([channels[name].pixels for name in "RGBA"], axis=-1)


def write(path, channels):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


@pytest.mark.parametrize("words", WORDS.values(), ids=WORDS)
def test_any_depth_is_held_out_within_the_error(cumulo, fixtures, tmp_path, words):
    command = ["render", fixtures / "plume.vdb", "--views", 1, "--size", f"{WIDTH}x{HEIGHT}", "--background", "0,0,0"]
    command += words.split()
    cumulo(*command, "--deep", ERROR, "-o", tmp_path / "smoke.deep.exr")
    cumulo(*command, "-o", tmp_path / "flat.exr")

    def oiiotool(*words):
        subprocess.run([OIIOTOOL, tmp_path / "smoke.deep.exr", *words], check=True, cwd=tmp_path)

    # All samples together.
    oiiotool("--flatten", "-o", "whole.exr")
    assert np.abs(pixels(tmp_path / "whole.exr") - pixels(tmp_path / "flat.exr")).max() < 2e-5
    channels = OpenEXR.File(str(tmp_path / "smoke.deep.exr"), separate_channels=True).channels()
    assert sorted(channels) == ["A", "B", "G", "R", "Z", "ZBack"]
    fronts, backs = (
        np.concatenate([pixel for pixel in channels[name].pixels.flat if pixel is not None])
        for name in ["Z", "ZBack"]
    )
    shown = sum(pixel is not None and len(pixel) > 0 for pixel in channels["Z"].pixels.flat)
    # Users of other renderers report 10 to 55 samples a pixel at this error.
    assert 1 < len(fronts) / shown <= 5.5
    # As many random depths as there are pixels.
    rng = np.random.default_rng(1)
    depths = rng.uniform(fronts.min(), backs.max(), (HEIGHT, WIDTH)).astype(np.float32)
    black, opaque = np.zeros_like(depths), np.ones_like(depths)
    write(tmp_path / "prop.exr", {"R": black, "G": black, "B": black, "A": opaque, "Z": depths})
    write(tmp_path / "depth.exr", {"Z": depths})
    oiiotool("prop.exr", "--deepen", "--deepholdout", "--flatten", "-o", "before.exr")
    cumulo(*command, "--holdout", tmp_path / "depth.exr", "-o", tmp_path / "held.exr")
    before, held = pixels(tmp_path / "before.exr"), pixels(tmp_path / "held.exr")
    assert 0.1 < (held[..., 3] > 0.05).mean() and (np.abs(held - pixels(tmp_path / "flat.exr")) > 0.05).any()
    off = np.abs(before - held)
    assert off.max() <= ERROR, off.max()
    # The error is used, not wasted.
    assert off.max() > ERROR / 4
