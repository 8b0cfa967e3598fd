"""The programs of the guide's page on PyTorch run, and fit what they say."""

import os
import pathlib
import re
import subprocess
import sys

PACKAGE = pathlib.Path(__file__).resolve().parents[2]
PAGE = (PACKAGE.parent / "src" / "guide" / "torch.md").read_text(encoding="utf-8")
README = (PACKAGE.parent / "README.md").read_text(encoding="utf-8")
PROGRAMS = dict(re.findall(r"^```python (\S+)\n(.*?)^```", PAGE + README, re.DOTALL | re.MULTILINE))


def run(name, folder):
    """What a program of the page prints."""
    (folder / name).write_text(PROGRAMS[name], encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE)}
    done = subprocess.run([sys.executable, name], cwd=folder, capture_output=True, text=True, env=environment, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_first_gradient(tmp_path):
    assert run("first.py", tmp_path) == "torch.Size([4, 48, 64, 4])\ntorch.Size([32, 32, 32])\n"


def test_a_loss_of_your_own(tmp_path):
    first, last = map(float, re.search(r"loss (\S+) -> (\S+)", run("fit.py", tmp_path)).groups())
    assert last < 0.3 * first


def test_the_readme(tmp_path):
    assert run("readme.py", tmp_path) == ""


def test_every_program_is_run():
    assert sorted(PROGRAMS) == ["first.py", "fit.py", "readme.py"] and (PAGE + README).count("```python") == 3
