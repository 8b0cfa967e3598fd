"""`pip install ./python` gives a package that imports, is typed, and whose tutorial runs."""

import os
import pathlib
import subprocess
import venv

import pytest

PACKAGE = pathlib.Path(__file__).resolve().parents[1]
# Modules that need Blender; the others must import without it.
BLENDER = {"blender", "bpy_scene", "cycles", "noise", "padding"}
# Modules that need another package, which is tested in an environment of its own.
OTHERS = {"jax", "torch"}
MODULES = sorted(p.stem for p in (PACKAGE / "cumulo").glob("*.py") if p.stem not in BLENDER | OTHERS | {"__init__", "__main__"})
# Modules that were written with types; each function of theirs is annotated.
TYPED = ["arrays", "capture", "commands", "errors", "exr", "fields", "options", "pictures", "plots", "progress"]
TYPED += ["reconstruct", "report", "results", "testing", "transfer", "usd"]

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
    # The native module is built where that of the checkout is, of which little is left to do.
    pip = [found, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", f"{PACKAGE}[plots,testing]"]
    pip += ["--requirement", PACKAGE / "requirements-tutorial.txt"]
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
    assert run(python, "-c", list_modules, folder=tmp_path).split() == sorted([*MODULES, *BLENDER, *OTHERS, "_native", "testing", "__main__"])
    where = "import cumulo, pathlib; print((pathlib.Path(cumulo.__file__).parent / 'py.typed').exists())"
    assert run(python, "-c", where, folder=tmp_path).strip() == "True"


def test_the_version_is_that_of_the_program_which_comes_with_it(python, tmp_path):
    installed = "import cumulo, importlib.metadata; print(cumulo.__version__, importlib.metadata.version('cumulo'))"
    [version, again] = run(python, "-c", installed, folder=tmp_path).split()
    program = [python.parent / "cumulo", "--version"]
    stated = subprocess.run(program, capture_output=True, text=True, check=True).stdout.split()
    assert version == again == stated[1] and stated[0] == "cumulo", stated


def test_the_program_ends_as_it_does_elsewhere(python, tmp_path):
    def ends(*words):
        return subprocess.run([python.parent / "cumulo", *words], cwd=tmp_path, capture_output=True, text=True)

    missing = ends("info", "missing.vdb")
    assert missing.returncode == 2 and "missing.vdb: No such file" in missing.stderr and not missing.stdout, missing
    assert ends("info", "--help").returncode == 0 and ends("inform").returncode == 2


def test_importing_is_quick(python, tmp_path):
    clock = "import time; t = time.process_time(); import cumulo; print(time.process_time() - t)"
    seconds = min(float(run(python, "-c", clock, folder=tmp_path)) for _ in range(5))
    loaded = "import sys, cumulo; print('numpy' in sys.modules)"
    assert seconds < 0.1 and run(python, "-c", loaded, folder=tmp_path).strip() == "False", seconds


def test_stubs_are_those_of_the_module(python, tmp_path):
    run(python, "-m", "mypy.stubtest", "cumulo._native", "--ignore-disjoint-bases", folder=tmp_path)


def test_types_are_right(python, tmp_path):
    names = [word for module in TYPED for word in ("-p" if module == "testing" else "-m", f"cumulo.{module}")]
    options = ["--strict", "--ignore-missing-imports", "--follow-imports=silent", "--config-file", PACKAGE / "pyproject.toml"]
    run(python, "-m", "mypy", *options, *names, folder=tmp_path)


def test_pytest_finds_the_plugin(python, tmp_path):
    assert "--cumulo-regenerate" in run(python, "-m", "pytest", "--help", folder=tmp_path)


def test_the_tutorial_runs(python, tmp_path):
    said = run(python, "-c", TUTORIAL, str(PACKAGE / "tutorial.ipynb"), folder=tmp_path)
    # 40³ voxels from 14 views of 64² pixels are known well; the numbers are printed by the notebook.
    fitted = float(said.split("fitted views ")[1].split()[0])
    assert fitted > 35 and "another seed: no difference found" in said and "a tenth denser: they differ" in said, said
    assert "No such file" in said and "advice: check the spelling" in said and said.split()[-2:] == ["figures", "4"], said
