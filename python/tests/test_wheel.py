"""`make wheel` gives a wheel that works where OpenVDB is not installed."""

import os
import pathlib
import shutil
import subprocess
import sys
import venv
import zipfile

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
# What the native module needs beside the system's own libraries.
LIBRARIES = ("libopenvdb", "libtbb", "libblosc", "libboost_iostreams", "libImath", "liblog4cplus")

USE = """
import pathlib, sys
import cumulo, numpy
from cumulo import arrays, pictures

folder = pathlib.Path(sys.argv[1])
values = numpy.random.default_rng(1).uniform(0.1, 1, (9, 10, 11)).astype(numpy.float32)
arrays.write_volume(folder / "a.vdb", values, voxel_size=0.1, origin=(0.0, 0.0, 0.0))
assert numpy.array_equal(arrays.read_volume(folder / "a.vdb").values, values)
shots = cumulo.render(folder / "a.vdb", folder / "shots", views=2, size=(16, 16), density_scale=2)
lattice = cumulo.Lattice.box(values.shape, voxel_size=0.1, origin=(0.0, 0.0, 0.0))
seen = pictures.render(values, cumulo.Cameras.around(lattice, 2, (8, 8)), lattice=lattice)
assert seen.shape == (2, 8, 8, 4) and seen[..., 3].max() > 0.1
loaded = {line.split()[-1] for line in open("/proc/self/maps") if ".so" in line}
print(*sorted(path for path in loaded if any(pathlib.Path(path).name.startswith(name) for name in sys.argv[2:])))
"""


@pytest.fixture(scope="module")
def wheel():
    """The wheel, made anew."""
    made = subprocess.run([ROOT / "python" / "wheel.sh"], capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    [found] = (ROOT / "target" / "wheels").glob("*.whl")
    return found


@pytest.fixture(scope="module")
def python(wheel, tmp_path_factory):
    """The Python of an environment in which the wheel alone was installed."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=True)
    python = folder / "bin" / "python"
    pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel]
    done = subprocess.run(pip, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return python


def test_the_wheel_is_for_every_python_from_311_and_states_its_licenses(wheel):
    assert "-cp311-abi3-manylinux_2_" in wheel.name, wheel.name
    names = zipfile.ZipFile(wheel).namelist()
    assert all(any(pathlib.Path(name).name.startswith(library) for name in names) for library in LIBRARIES), names
    assert sum(name.startswith("cumulo/licenses/libopenvdb") for name in names) == 1, names
    assert not any(name.startswith(("addon", "tests", "peers")) for name in names)


def test_it_works_without_openvdb(python, tmp_path):
    words = [python, "-I", "-c", USE, tmp_path, *LIBRARIES]
    hidden = [path for name in LIBRARIES for path in pathlib.Path("/usr/lib/x86_64-linux-gnu").glob(f"{name}*.so*")]
    if os.geteuid() == 0 and shutil.which("unshare") and sys.platform == "linux":
        # In a file system of its own the libraries of the system are gone.
        gone = " && ".join(f"mount --bind /dev/null {path}" for path in hidden if not path.is_symlink())
        words = ["unshare", "--mount", "sh", "-c", f'{gone or "true"} && exec "$@"', "sh", *words]
    done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    loaded = done.stdout.split()
    assert len(loaded) >= len(LIBRARIES) and all("cumulo.libs/" in path for path in loaded), loaded


def test_its_program_is_there(python, tmp_path):
    done = subprocess.run([python.parent / "cumulo", "selftest", "dvr"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done
    done = subprocess.run([python.parent / "cumulo", "--version"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0 and done.stdout.startswith("cumulo "), done
