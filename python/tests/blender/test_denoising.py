"""The guide's way from Blender's noisy frames to quiet ones, command by command."""

import pathlib
import re
import shlex
import subprocess
import sys

import numpy as np
from cumulo.exr import read_exr

ROOT = pathlib.Path(__file__).resolve().parents[3]


def commands():
    """The lines of the page's block with Cycles in it, without comments."""
    page = (ROOT / "src/guide/denoising.md").read_text()
    blocks = re.findall(r"```sh\n(.*?)```", page, re.S)
    (block,) = [block for block in blocks if "cumulo.blender" in block]
    return [line.split("#")[0].strip() for line in block.splitlines()]


def test_cycles_frames_become_quiet(program, tmp_path, fixtures):
    (tmp_path / "smoke.vdb").write_bytes((fixtures / "plume.vdb").read_bytes())
    for line in commands():
        words = shlex.split(line)
        if words[0] == "cumulo":
            # Small pictures; the camera path decides on the size of all.
            words = [program, *words[1:], *(["--size", "48x36"] if words[1] == "render" else [])]
        else:
            words = [sys.executable, *words[words.index("-m") :]]
        environment = {"PYTHONPATH": str(ROOT / "python")}
        done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        # The frames differ from the noisy ones.
        assert done.returncode == (1 if words[1] == "compare" else 0), f"{line}\n{done.stderr}"
    noisy = np.stack([read_exr(tmp_path / f"cycles/view_{i:03}.exr") for i in range(24)])
    quiet = np.stack([read_exr(tmp_path / f"quiet/frame.{i:04}.exr") for i in range(24)])
    # The camera moves slowly: what changes from frame to frame is noise.
    flicker = [np.mean(np.diff(frames[..., :3], axis=0) ** 2) for frames in (noisy, quiet)]
    assert flicker[1] < 0.05 * flicker[0]
    # Light is neither lost nor won.
    light = [float(frames[..., :3].mean()) for frames in (noisy, quiet)]
    assert light[0] > 0.01 and abs(light[1] / light[0] - 1) < 0.03, light
    assert (tmp_path / "page" / "index.html").stat().st_size > 10_000
