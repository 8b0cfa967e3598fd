"""The program for clusters: the same bits with any number of processes, and no process that waits for ever."""

import json
import os
import pathlib
import shutil
import signal
import subprocess
import time

import cumulo
import numpy as np
import pytest
from cumulo import arrays

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = pathlib.Path(os.environ.get("CUMULO_MPI") or ROOT / "target" / "release" / "cumulo-mpi")
COUNTS = (1, 2, 3, 5)
# Commands whose sums have few parts: with more processes than parts some have none.
MANY = {"colors": 7, "density": 17}
# Commands whose passes over rays the processes share; their outputs are `found.vdb`.
COMMANDS = {
    "density": "reconstruct density {0}/depths --resolution 20 --iterations 4 -o {1}/found.vdb",
    "density of noise": "reconstruct density {0}/noisy --resolution 20 --iterations 6 -o {1}/found.vdb",
    "descent": "reconstruct density {0}/glow --resolution 16 --iterations 3 -o {1}/found.vdb",
    "colors": "reconstruct color {0}/bone --resolution 16 --iterations 3 -o {1}/found.vdb",
    "transfer function": "reconstruct density {0}/bone --resolution 16 --iterations 2 -o {1}/found.vdb",
    "cameras": "reconstruct density {0}/depths --refine-cameras --resolution 16 --iterations 3 -o {1}/found.vdb",
    "gradient": "gradient {0}/plume.vdb --views 3 --size 40x32 --density-scale 2 --wrt density,extinction --loss mean -o {1}/found.vdb",
}


@pytest.fixture(scope="module")
def world(tmp_path_factory, fixtures):
    """Pictures of a plume, and where the test may write."""
    assert PROGRAM.is_file() and shutil.which("mpirun"), f"{PROGRAM} or mpirun is missing: run `make mpi`"
    folder = tmp_path_factory.mktemp("mpi")
    shutil.copy(fixtures / "plume.vdb", folder / "plume.vdb")
    shots = {"views": 9, "size": "40x36", "density_scale": "auto", "background": "1,1,1"}
    cumulo.render(folder / "plume.vdb", folder / "depths", **shots)
    cumulo.render(folder / "plume.vdb", folder / "glow", emission="1,0.6,0.2", emission_model="linear", **shots)
    cumulo.render(folder / "plume.vdb", folder / "bone", views=9, size="40x36", tf="ct-bone", tf_range="0,1")
    cumulo.render(folder / "plume.vdb", folder / "noisy", albedo=0.5, samples=4, **shots)
    return folder


def words(count, line, *more):
    """A command line on so many processes of one thread each."""
    start = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-n", str(count), str(PROGRAM)]
    return [*start, *line.split(), *more, "--threads", "1"]


def run(count, line, *more):
    """Runs a command on so many processes and returns its document."""
    done = subprocess.run(words(count, line, *more, "--json", "-q"), capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def grids_of(path):
    """Arrays of all grids of a VDB, by name."""
    names = [grid["name"] for file in cumulo.call("info", path)["files"] for grid in file["grids"]]
    return {name: np.asarray(arrays.read_volume(path, grid=name).values) for name in names}


@pytest.mark.parametrize("name", COMMANDS)
def test_results_do_not_depend_on_the_number_of_processes(world, tmp_path, name):
    results = []
    for count in (*COUNTS, *([MANY[name]] if name in MANY else [])):
        folder = tmp_path / str(count)
        folder.mkdir()
        report = run(count, COMMANDS[name].format(world, folder))
        results.append((report, grids_of(folder / "found.vdb")))
        assert sorted(p.name for p in folder.iterdir()) == ["found.cameras.json", "found.vdb"][name != "cameras" :]
    # One process has what the program has that knows nothing of others.
    alone = tmp_path / "alone"
    alone.mkdir()
    cumulo.call(*COMMANDS[name].format(world, alone).split())
    expected = grids_of(alone / "found.vdb")
    assert all(np.ptp(values) > 0 for values in expected.values())
    for report, found in results:
        assert found.keys() == expected.keys()
        assert all(np.array_equal(found[grid], expected[grid]) for grid in expected)
        assert report.get("iterations") == results[0][0].get("iterations")


def test_a_killed_process_loses_nothing_that_was_kept(world, tmp_path):
    line = f"reconstruct density {world}/depths --resolution 24 --held-out 0 --smoothing 1 -o {tmp_path}/found.vdb"
    begun = subprocess.Popen(words(3, line, "--iterations", "100000", "--checkpoint", "0.2"), stderr=subprocess.PIPE, stdout=subprocess.PIPE)
    deadline = time.monotonic() + 120
    while not (tmp_path / "found.vdb").exists():
        assert begun.poll() is None and time.monotonic() < deadline, begun.communicate()
        time.sleep(0.05)
    time.sleep(1)
    children = pathlib.Path(f"/proc/{begun.pid}/task/{begun.pid}/children").read_text(encoding="ascii").split()
    assert len(children) == 3
    os.kill(int(children[-1]), signal.SIGKILL)
    begun.communicate(timeout=60)
    assert begun.returncode != 0
    on = run(2, line, "--iterations", "2", "--resume")
    (tmp_path / "found.vdb").unlink()
    anew = run(2, line, "--iterations", "2")
    assert on["history"][0]["loss"] < 0.5 * anew["history"][-1]["loss"]
    assert [p.name for p in tmp_path.iterdir()] == ["found.vdb"]


def test_a_process_that_reads_other_pictures_is_refused(world, tmp_path):
    for number, source in enumerate(("depths", "glow")):
        shutil.copytree(world / source, tmp_path / f"{number}" / "shots")
    script = tmp_path / "own.sh"
    script.write_text(f'#!/bin/sh\ncd {tmp_path}/$OMPI_COMM_WORLD_RANK && exec {PROGRAM} "$@"\n', encoding="ascii")
    script.chmod(0o755)
    line = words(2, f"reconstruct density shots --resolution 8 --iterations 1 -o {tmp_path}/found.vdb")
    line[line.index(str(PROGRAM))] = str(script)
    done = subprocess.run(line, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2 and "process 1" in done.stderr and "other pictures" in done.stderr, done.stderr


def test_mistakes_are_said_once_and_end_all(world, tmp_path):
    for line in ("reconstruct density nothing -o found.vdb", "reconstruct density --nonsense"):
        done = subprocess.run(words(3, line), capture_output=True, text=True, timeout=60, cwd=tmp_path, check=False)
        assert done.returncode == 2 and not list(tmp_path.iterdir())
        assert done.stderr.count("nothing") + done.stderr.count("'--nonsense'") in (1, 2), done.stderr
