"""The guide's shot, in few and small frames: export, render, denoise, and composite in Blender's compositor."""

import pathlib
import sys

import bpy
import numpy as np
from cumulo.exr import read_exr

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import shot  # noqa: E402


def test_a_shot_goes_through_blender_and_cumulo(program, tmp_path, monkeypatch):
    monkeypatch.setenv("CUMULO", str(program))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    sheet = tmp_path / "sheet.png"
    folders = shot.shoot(tmp_path / "shot", frames=3, size=(64, 40), samples=16, sheet=sheet)
    theirs, ours = (np.stack([read_exr(folder / f"frame.{i:04}.exr") for i in (1, 2, 3)]) for folder in folders)
    # Both show the same light, and ours has less noise.
    means = [pictures[..., :3].mean(axis=(1, 2)) for pictures in (theirs, ours)]
    assert np.abs(means[1] / means[0] - 1).max() < 0.03, means
    assert np.abs(theirs[..., 3] - ours[..., 3]).mean() < 0.02
    composites = [np.stack([shot.pixels(tmp_path / f"shot/composite/{by}.{i:04}.png") for i in (1, 2, 3)])
                  for by in ("cycles", "cumulo")]  # fmt: skip
    assert np.abs(composites[0] - composites[1]).mean() < 0.02
    # The backdrop shows above the floor, in both alike.
    assert np.abs(composites[0][:, 0] - composites[1][:, 0]).max() < 0.02
    assert shot.pixels(sheet).shape == (80, 192, 4)
