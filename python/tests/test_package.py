"""`pip install ./python` gives a package that imports, is typed, and whose tutorial runs."""

import os
import pathlib
import shutil
import subprocess
import venv

import pytest
from cumulo.run import program

PACKAGE = pathlib.Path(__file__).resolve().parents[1]
# Modules that need Blender; the others must import without it.
BLENDER = {"blender", "bpy_scene", "cycles", "noise", "padding"}
MODULES = sorted(p.stem for p in (PACKAGE / "cumulo").glob("*.py") if p.stem not in BLENDER | {"__init__"})
# Modules that were written with types; each function of theirs is annotated.
TYPED = ["arrays", "capture", "commands", "exr", "options", "plots", "reconstruct", "report", "results", "run"]
TYPED += ["testing", "transfer", "usd"]

TUTORIAL = """
import sys
import nbclient, nbformat
book = nbformat.read(sys.argv[1], as_version=4)
nbclient.NotebookClient(book, timeout=120, resources={"metadata": {"path": "."}}).execute()
outputs = [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs]
print("".join(output.get("text", "") for output in outputs))
print("figures", sum("image/png" in output.get("data", {}) for output in outputs))
"""

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
    shutil.copytree(PACKAGE / "cumulo", sources / "cumulo", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(PACKAGE / "pyproject.toml", sources)
    pip = [found, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", f"{sources}[plots,testing]"]
    pip += ["--requirement", PACKAGE / "requirements-tutorial.txt"]
    done = subprocess.run(pip, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return found


def run(python, *arguments, folder):
    """Runs it in a folder where nothing of the checkout is found."""
    environment = {**os.environ, "CUMULO": program()}
    done = subprocess.run([python, "-I", *arguments], cwd=folder, env=environment, capture_output=True, text=True)
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
    assert run(python, "-c", list_modules, folder=tmp_path).split() == sorted([*MODULES, *BLENDER, "testing"])
    where = "import cumulo, pathlib; print((pathlib.Path(cumulo.__file__).parent / 'py.typed').exists())"
    assert run(python, "-c", where, folder=tmp_path).strip() == "True"


def test_the_version_is_that_of_the_program(python, tmp_path):
    import cumulo

    stated = subprocess.run([program(), "--version"], capture_output=True, text=True, check=True).stdout.split()
    assert stated[:2] == ["cumulo", cumulo.__version__], stated
    installed = "import cumulo, importlib.metadata; print(cumulo.__version__, importlib.metadata.version('cumulo'))"
    assert run(python, "-c", installed, folder=tmp_path).split() == 2 * [cumulo.__version__]


def test_types_are_right(python, tmp_path):
    names = [word for module in TYPED for word in ("-p" if module == "testing" else "-m", f"cumulo.{module}")]
    run(python, "-m", "mypy", "--strict", "--ignore-missing-imports", "--follow-imports=silent", *names, folder=tmp_path)


def test_pytest_finds_the_plugin(python, tmp_path):
    assert "--cumulo-regenerate" in run(python, "-m", "pytest", "--help", folder=tmp_path)


def test_the_tutorial_runs(python, tmp_path):
    said = run(python, "-c", TUTORIAL, str(PACKAGE / "tutorial.ipynb"), folder=tmp_path)
    # 40³ voxels from 14 views of 64² pixels are known well; the numbers are printed by the notebook.
    fitted = float(said.split("fitted views ")[1].split()[0])
    assert fitted > 35 and "another seed: no difference found" in said and "a tenth denser: they differ" in said, said
    assert "No such file" in said and "advice: check the spelling" in said and said.split()[-2:] == ["figures", "4"], said
