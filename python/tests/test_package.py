"""`pip install ./python` gives a package that imports."""

import pathlib
import subprocess
import venv

import pytest

PACKAGE = pathlib.Path(__file__).resolve().parents[1]
# Modules that need Blender; the others must import without it.
BLENDER = {"blender", "bpy_scene", "cycles", "noise", "padding"}
MODULES = sorted(p.stem for p in (PACKAGE / "cumulo").glob("*.py") if p.stem not in BLENDER | {"__init__"})

PICTURE = """
import pathlib, sys
import numpy as np
from cumulo.exr import read_exr, write_exr
path = pathlib.Path(sys.argv[1])
pixels = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
write_exr(path, pixels, "a test", {"seed": 1})
assert np.array_equal(read_exr(path), pixels)
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """The Python of a new environment with the package and what it names as its dependencies."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=True)
    found = folder / "bin" / "python"
    # A copy: setuptools writes beside the sources.
    sources = tmp_path_factory.mktemp("sources")
    subprocess.run(["cp", "-r", PACKAGE / "cumulo", PACKAGE / "pyproject.toml", sources], check=True)
    pip = [found, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", sources]
    done = subprocess.run(pip, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return found


def run(python, *arguments, folder):
    """Runs it in a folder where nothing of the checkout is found."""
    done = subprocess.run([python, "-I", *arguments], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("module", MODULES)
def test_modules_import_without_blender(python, tmp_path, module):
    where = run(python, "-c", f"import cumulo.{module} as m; print(m.__file__)", folder=tmp_path)
    assert pathlib.Path(where.strip()).is_relative_to(python.parents[1]), where


def test_pictures_are_written_and_read(python, tmp_path):
    run(python, "-c", PICTURE, str(tmp_path / "a.exr"), folder=tmp_path)


def test_every_module_is_in_the_package(python, tmp_path):
    list_modules = "import cumulo, pkgutil; print(*sorted(m.name for m in pkgutil.iter_modules(cumulo.__path__)))"
    assert run(python, "-c", list_modules, folder=tmp_path).split() == sorted([*MODULES, *BLENDER])
