"""NanoVDB's own converter (Debian's libnanovdb-tools) and Cumulo read each other's files, in every codec and type."""

import shutil
import subprocess

import pytest

CONVERTER = "nanovdb_convert"

# Quantized types lose digits, the same ones in both readers.
WAYS = ["", "--zip", "--blosc", "--fp4", "--fp8", "--fp16", "--fpN"]


def test_converter_is_there():
    assert shutil.which(CONVERTER), "run python/setup.sh imaging, or install Debian's libnanovdb-tools"


def convert(*arguments):
    done = subprocess.run([CONVERTER, "-f", *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


SOURCES = ["plume.vdb", "tiles.vdb", "sphere_level_set.vdb"]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("source", SOURCES)
def test_grids_are_read(cumulo, fixtures, tmp_path, source, way):
    convert(*[way] * bool(way), fixtures / source, tmp_path / "in.nvdb")
    cumulo("convert", tmp_path / "in.nvdb", tmp_path / "ours.vdb")
    convert(tmp_path / "in.nvdb", tmp_path / "theirs.vdb")
    report = cumulo("diff", tmp_path / "ours.vdb", tmp_path / "theirs.vdb", "--tolerance=0")
    assert report["same"], report


@pytest.mark.parametrize("source", SOURCES)
def test_grids_are_written(cumulo, fixtures, tmp_path, source):
    cumulo("convert", fixtures / source, tmp_path / "ours.nvdb")
    checked = subprocess.run(["nanovdb_validate", "-v", tmp_path / "ours.nvdb"], capture_output=True, text=True)
    assert checked.returncode == 0 and "passed" in checked.stdout, checked.stdout + checked.stderr
    convert(tmp_path / "ours.nvdb", tmp_path / "back.vdb")
    report = cumulo("diff", fixtures / source, tmp_path / "back.vdb", "--tolerance=0")
    assert report["same"], report
