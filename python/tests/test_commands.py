"""Commands in this process: reports, errors, progress, interrupts, threads, forks, arrays; and `python -m cumulo`."""

import concurrent.futures
import dataclasses
import json
import os
import pathlib
import pickle
import runpy
import signal
import subprocess
import sys
import time

import cumulo as package
import numpy as np
import pytest
from cumulo import CumuloError, arrays, options, results

PACKAGE = pathlib.Path(__file__).resolve().parents[1]
# What would render for minutes.
LONG = {"views": 1, "size": (512, 512), "albedo": 0.99, "density_scale": 50, "sky": (1, 1, 1), "samples": 4096}


def unknown(report):
    """Keys of a report and of its parts that no field knows."""
    found = [f"{type(report).__name__}.{key}" for key in report.extra]
    for field in dataclasses.fields(report):
        value = getattr(report, field.name)
        for part in value if isinstance(value, (list, tuple)) else [value]:
            if isinstance(part, results.Report):
                found += unknown(part)
    return found


@pytest.fixture(scope="module")
def plume():
    return pathlib.Path(__file__).resolve().parents[2] / "fixtures" / "plume.vdb"


@pytest.fixture(scope="module")
def shots(plume, tmp_path_factory):
    folder = tmp_path_factory.mktemp("commands")
    return package.render(plume, folder / "shots", views=4, size=(32, 32), density_scale="auto")


def test_reports_are_dataclasses_that_know_every_key(plume, shots, tmp_path):
    found = package.reconstruct.density(shots.output, tmp_path / "found.vdb", resolution=12, iterations=2)
    lit = package.render(plume, tmp_path / "lit", views=2, size=(24, 24), albedo=0.9, sun=(-1, 0.6, 0.7), samples=4,
                         aov=("variance", "samples"))  # fmt: skip
    glow = package.render(plume, tmp_path / "glow", views=4, size=(24, 24), model="emission-absorption", density_scale="auto")
    pattern = str(lit.output / "view_%03d.exr")
    one, two = (lit.output / f"view_00{k}.exr" for k in (0, 1))
    reports = [
        shots, lit, found,
        glow, package.reconstruct.tf(glow.output, plume, tmp_path / "found.tf.json", texels=8, rays=2000),
        package.reconstruct.color(glow.output, tmp_path / "color.vdb", resolution=8, iterations=1),
        package.pose(shots.output, plume, tmp_path / "posed.json", iterations=1),
        package.viewpoint(plume, tmp_path / "best.json", density_scale="auto", size=(16, 16), iterations=1),
        package.motion(plume, shots.output, tmp_path / "motion.%04d.exr", frames="0-1"),
        package.figure([one, two], tmp_path / "figure.svg", title="Plume", label=["A", "B"], scale_bar=True),
        package.merge([one], tmp_path / "joined.exr"), package.denoise(pattern, tmp_path / "quiet" / "f.%04d.exr"),
        package.compare(one, two), package.compare(pattern, pattern),
        package.compare_statistical(one, two), package.diff(plume, found.output), package.validate(plume),
        package.convert(plume, tmp_path / "copy.vdb"), package.convert(plume, tmp_path / "copy.npy"),
        package.plan(plume, views=1, size=(16, 16)),
        package.plan_reconstruction(shots.output, resolution=8, iterations=1, machines=(1, 2)),
        package.gradient(plume, wrt="camera", loss="mean", views=1, size=(8, 8), check=True),
        package.transfer.convert("viridis"), *package.transfer.presets(), package.transfer.suggest(plume),
        package.usd.author(plume, tmp_path / "a.usda", camera=shots.output), package.usd.lint(tmp_path / "a.usda"),
    ]  # fmt: skip
    assert [key for report in reports for key in unknown(report)] == []
    assert shots.views == 4 and shots.output.is_dir() and shots.json["views"] == 4
    assert found.history[-1].iteration == 2 and found.output == tmp_path / "found.vdb" and found.stages[0].seconds >= 0
    assert package.info(plume).grids[0]["name"] == "density"


def test_a_difference_is_a_result(plume, shots):
    one, two = (shots.output / f"view_00{k}.exr" for k in (0, 1))
    assert package.compare(one, one) and not package.compare(one, two)
    assert package.compare(one, two, tolerance=1.0)
    assert package.diff(plume, plume).same and package.validate(plume)


def test_files_are_viewed(plume, shots, tmp_path):
    (sheet,) = package.view(plume, output=tmp_path / "plume.png", size=64).sheets
    assert (sheet.input, sheet.output, sheet.shows) == (plume, tmp_path / "plume.png", "volume") and sheet.extra["grid"] == "density"
    assert sheet.output.read_bytes().startswith(b"\x89PNG")
    both = package.view(plume, shots.output, output=tmp_path / "sheets", size=32)
    assert [sheet.shows for sheet in both.sheets] == ["volume", "capture"] and all(sheet.output.is_file() for sheet in both.sheets)
    with pytest.raises(TypeError, match="output"):
        package.view(plume)


def test_transfer_functions_are_listed_and_converted(tmp_path):
    assert {"viridis", "ct-bone"} <= {function.name for function in package.transfer.presets()}
    made = package.transfer.convert("viridis", tmp_path / "a.tf.json", range=(0, 0.5), extinction=8)
    assert (made.output, made.range, made.peak_extinction) == (tmp_path / "a.tf.json", (0, 0.5), 8)
    again = package.transfer.convert(tmp_path / "a.tf.json")
    assert again.output is None and (again.range, again.peak_extinction) == (made.range, made.peak_extinction)


def test_transfer_functions_are_suggested(plume, tmp_path):
    made = package.transfer.suggest(plume, tmp_path / "a.tf.json", candidate=1, sheet=tmp_path / "sheet.png")
    assert made.output == tmp_path / "a.tf.json" and made.sheet.read_bytes().startswith(b"\x89PNG")
    assert made.candidates[-1].name == "ramp" and len(made.materials) == (len(made.boundaries) + 1)
    assert package.transfer.convert(made.output).name == made.candidates[0].name


def test_stages_are_written_and_checked(plume, tmp_path):
    made = package.usd.author(plume, tmp_path / "a.usda", renderer="arnold", albedo=0.9)
    assert made.output == tmp_path / "a.usda" and made.volumes[0].fields == ["density"] and made.up.axis == "Z"
    assert 'string renderer = "arnold"' in made.output.read_text()
    assert package.usd.lint(made.output)
    text = made.output.read_text().replace('defaultPrim = "World"', 'defaultPrim = "Nothing"')
    (tmp_path / "b.usda").write_text(text)
    found = package.usd.lint(made.output, tmp_path / "b.usda")
    assert not found and [finding.id for stage in found.stages for finding in stage.findings] == ["default-prim"]
    fixed = package.usd.lint(tmp_path / "b.usda", fix=tmp_path / "fixed.usda")
    assert fixed and fixed.layer == tmp_path / "fixed.usda" and fixed.stages[0].findings[0].fixed
    with pytest.raises(CumuloError, match="nothing.usda"):
        package.usd.lint(tmp_path / "nothing.usda")


def test_a_list_is_no_path(plume):
    for call in (package.info, package.validate, package.usd.lint, package.transfer.convert):
        with pytest.raises(TypeError, match=r"is of type list, and the path of one file is expected .*call the function for each"):
            call([plume, plume])
    assert len(package.validate(plume, plume).files) == 2


def test_what_is_refused_is_an_exception_with_its_remedy(plume, tmp_path):
    with pytest.raises(CumuloError) as caught:
        package.info(tmp_path / "nothing.vdb")
    assert caught.value.code == "not-found" and caught.value.what.startswith("No such file")
    assert caught.value.path == tmp_path / "nothing.vdb" and caught.value.part is None
    assert caught.value.remedy.startswith("check the spelling")
    assert str(tmp_path / "nothing.vdb: No such file") in str(caught.value)
    with pytest.raises(CumuloError) as caught:
        package.render(plume, tmp_path / "out", views=1, size=(8, 8), max_memory="1K")
    assert (caught.value.code, caught.value.path, caught.value.part) == ("memory-limit", plume, "grid 'density'")
    assert "`max_memory`" in caught.value.remedy
    again = pickle.loads(pickle.dumps(caught.value))
    assert (vars(again), str(again)) == (vars(caught.value), str(caught.value))
    # A name that begins with a dash is a name.
    with pytest.raises(CumuloError, match="No such file"):
        package.info("--help.vdb")


def test_mistakes_name_the_argument_as_python_does(plume, tmp_path):
    for wrong, expected in (
        ({"no_such_option": 3}, "unexpected argument 'no_such_option'"),
        ({"density_scale": "thick"}, "invalid value 'thick' for 'density_scale"),
        ({"samples": 0}, "invalid value '0' for 'samples"),
        ({"max_bounces": 1, "sun": (0, 0)}, "'sun"),
    ):
        with pytest.raises(CumuloError) as caught:
            package.render(plume, tmp_path / "out", views=1, **wrong)
        assert caught.value.code == "usage" and expected in caught.value.what, caught.value
        assert "--" not in str(caught.value)
    assert not (tmp_path / "out").exists()
    with pytest.raises(CumuloError, match="`overwrite`") as caught:
        for edge in (4, 5):
            package.render(plume, tmp_path / "twice", views=1, size=(edge, edge))
    assert caught.value.code == "output-exists"
    with pytest.raises(CumuloError, match="unrecognized subcommand 'nonsense'"):
        package.call("nonsense")


def test_work_of_which_parts_fail_tells_them_in_its_report(plume, tmp_path):
    with pytest.raises(CumuloError, match="a part of the work failed") as caught:
        package.validate(plume, tmp_path / "nothing.vdb")
    assert caught.value.code == "frames-failed"
    good, missing = caught.value.report["files"]
    assert good["valid"] and missing["error"]["code"] == "not-found"


def test_texts_are_no_documents(plume):
    said = package.help("reconstruct density")
    assert "Usage: cumulo reconstruct density" in said and "--held-out" in said
    assert package.call("info", plume)["files"][0]["format"] == "vdb"
    for words in (["--version"], ["completions", "bash"], ["info", "--help"]):
        with pytest.raises(CumuloError, match="no document"):
            package.call(*words)


def test_options_become_words():
    made = options.words({"a_b": 1, "flag": True, "off": False, "none": None, "list": ["x", "y"], "xyz": (1, -2, 0.5)})
    assert made == ["--a-b=1", "--flag", "--list=x", "--list=y", "--xyz=1,-2,0.5"]
    assert options.extent((64, 48)) == "64x48" and options.extent("8x8") == "8x8"


def test_keys_of_a_newer_program_are_kept():
    made = results.Noise.of({"source": "halves", "pictures": 1, "freedom": None, "colour": "pink"})
    assert made.extra == {"colour": "pink"} and made.json["colour"] == "pink" and made.freedom is None
    with pytest.raises(TypeError, match="pictures"):
        results.Noise.of({"source": "halves"})


def test_progress_is_told_of_events(shots, tmp_path):
    heard = []
    package.reconstruct.density(shots.output, tmp_path / "a.vdb", resolution=8, iterations=2, progress=heard.append)
    begun = {event["stage"]: event["name"] for event in heard if event["event"] == "began"}
    assert begun.keys() == {event["stage"] for event in heard if event["event"] == "ended"}
    assert "reading pictures" in begun.values() and any("unknowns" in event.get("text", "") for event in heard)
    advanced = [event for event in heard if event["event"] == "advanced"]
    assert advanced and all(event["done"] <= event["total"] for event in advanced if event["total"] is not None)


def test_progress_is_shown_on_standard_error(plume, tmp_path, capfd):
    package.render(plume, tmp_path / "out", views=2, size=(16, 16), progress=True)
    said = capfd.readouterr()
    assert "render" in said.err and not said.out
    package.render(plume, tmp_path / "quiet", views=2, size=(16, 16))
    assert capfd.readouterr() == ("", "")


def test_an_exception_of_the_listener_stops_the_work_and_is_raised(plume, tmp_path):
    class Enough(Exception):
        pass

    heard = []

    def refuse(event):
        heard.append(event)
        if event["event"] == "advanced":
            raise Enough(event["name"] if "name" in event else "advanced")

    start = time.monotonic()
    with pytest.raises(Enough, match="advanced"):
        package.render(plume, tmp_path / "out", progress=refuse, **LONG)
    assert time.monotonic() - start < 20 and heard[-1]["event"] == "advanced"
    assert not list(tmp_path.rglob("*.exr"))
    # The next command is not stopped.
    assert package.render(plume, tmp_path / "out", views=1, size=(8, 8)).views == 1


def child(script, *words, **options):
    """A Python process with the package, which obeys interrupts: a shell that runs the tests in the background has them
    ignored, which children inherit."""
    return subprocess.Popen(
        [sys.executable, "-c", script, *map(str, words)], env={**os.environ, "PYTHONPATH": str(PACKAGE)}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        **options,
    )  # fmt: skip


def test_an_interrupt_stops_the_work_within_a_second_or_so(plume, tmp_path):
    script = f"""
import cumulo, sys, time
begun = lambda event: event["event"] == "advanced" and print("works", flush=True)
try:
    cumulo.render(*sys.argv[1:], progress=begun, **{LONG!r})
except KeyboardInterrupt:
    print("interrupted", cumulo.info(sys.argv[1]).format)
    raise
"""
    process = child(script, plume, tmp_path / "out")
    try:
        assert process.stdout.readline() == "works\n"
        start = time.monotonic()
        process.send_signal(signal.SIGINT)
        out, said = process.communicate(timeout=60)
    finally:
        process.kill()
    # The machine may have more to do.
    assert time.monotonic() - start < 5
    assert "interrupted vdb" in out and said.rstrip().endswith("KeyboardInterrupt")
    assert process.returncode == -signal.SIGINT
    assert not list(tmp_path.rglob("*.exr"))


def test_threads_do_not_change_what_the_program_gives(program, plume, tmp_path):
    words = ["--views=1", "--size=24x16", "--albedo=0.8", "--sky=1,1,1", "--density-scale=4", "--samples=8", "--seed=5"]
    subprocess.run([program, "render", plume, *words, "-o", tmp_path / "program"], check=True, capture_output=True)
    expected = arrays.read_picture(tmp_path / "program" / "view_000.exr").values
    for threads in (1, 2):
        made = package.call("render", plume, *words, "-o", tmp_path / str(threads), threads=threads)
        assert np.array_equal(arrays.read_picture(pathlib.Path(made["output"]) / "view_000.exr").values, expected)
    document = subprocess.run([program, "info", plume, "--json"], check=True, capture_output=True, text=True).stdout
    assert json.loads(document) == package.call("info", plume)


def test_threads_of_python_call_at_once(plume, tmp_path):
    def work(seed):
        options = {"views": 1, "size": (16, 16), "albedo": 0.8, "sky": (1, 1, 1), "density_scale": 4, "samples": 8}
        made = package.render(plume, tmp_path / f"{seed}", seed=seed % 2, **options)
        return package.info(plume).format, arrays.read_picture(made.output / "view_000.exr").values

    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        found = list(pool.map(work, range(8)))
    assert {form for form, _ in found} == {"vdb"}
    assert all(np.array_equal(picture, found[k % 2][1]) for k, (_, picture) in enumerate(found))
    assert not np.array_equal(found[0][1], found[1][1])


SPAWNED = """
import multiprocessing, sys
import cumulo

def work(output):
    made = cumulo.render(sys.argv[1], output, views=1, size=(16, 16), density_scale="auto")
    try:
        cumulo.info("nothing.vdb")
    except cumulo.CumuloError as error:
        return made.views, error.code

if __name__ == "__main__":
    work(sys.argv[2] + "first")
    with multiprocessing.get_context(sys.argv[3]).Pool(2) as pool:
        print(pool.map(work, [sys.argv[2] + name for name in "abcd"]))
"""


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
def test_processes_of_multiprocessing_work(plume, tmp_path, method):
    """They do after the process itself has worked, and has threads that a fork lacks."""
    script = tmp_path / "work.py"
    script.write_text(SPAWNED)
    done = subprocess.run(
        [sys.executable, script, plume, tmp_path / "out", method], env={**os.environ, "PYTHONPATH": str(PACKAGE)},
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.stdout == f"{[(1, 'not-found')] * 4}\n", done.stdout + done.stderr


def test_a_fork_works(plume, shots, tmp_path):
    process = os.fork()
    if process == 0:
        try:
            made = package.render(plume, tmp_path / "out", views=2, size=(16, 16), density_scale="auto")
            os._exit(made.views)
        except BaseException:  # noqa: BLE001  the tests go on in the parent alone
            os._exit(99)
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 2
    # And so does what was forked.
    assert package.render(plume, tmp_path / "again", views=2, size=(16, 16), density_scale="auto").views == 2


def test_the_module_is_the_program(plume, shots, tmp_path):
    def ran(*words):
        return subprocess.run(
            [sys.executable, "-m", "cumulo", *map(str, words)], env={**os.environ, "PYTHONPATH": str(PACKAGE)},
            capture_output=True, text=True, stdin=subprocess.DEVNULL,
        )  # fmt: skip

    done = ran("info", plume)
    assert done.returncode == 0 and "density" in done.stdout and not done.stderr
    assert json.loads(ran("info", plume, "--json").stdout) == package.call("info", plume)
    one, two = (shots.output / f"view_00{k}.exr" for k in (0, 1))
    assert [ran("compare", one, other).returncode for other in (one, two)] == [0, 1]
    done = ran("info", tmp_path / "nothing.vdb")
    assert done.returncode == 2 and "nothing.vdb: No such file" in done.stderr
    done = ran("render", plume, "--no-such-option", "-o", tmp_path / "out")
    assert done.returncode == 2 and "--no-such-option" in done.stderr and "Traceback" not in done.stderr
    assert ran("--version").stdout.split()[:2] == ["cumulo", package.__version__]


def test_the_process_that_tries_grids_of_points_finds_the_package(plume, tmp_path):
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    for file, code in ((plume, 0), (plume.parent / "README.md", 2)):
        done = subprocess.run(
            [sys.executable, *package._helper, "try-grid", str(2**30)], cwd=tmp_path, env=environment,
            input=file.read_bytes(), capture_output=True,
        )  # fmt: skip
        assert done.returncode == code and b"Traceback" not in done.stderr, done.stderr


def test_volumes_and_pictures_are_arrays(plume, shots, tmp_path):
    smoke = arrays.read_volume(plume)
    assert smoke.values.shape == (33, 36, 44) and smoke.values.dtype == np.float32 and smoke.name == "density"
    assert smoke.index_origin == (8, 8, 2) and np.count_nonzero(smoke.values) == 15168
    assert np.allclose(smoke.world([0, 0, 0]), np.array([8, 8, 2]) / 24)
    arrays.write_volume(tmp_path / "again.vdb", smoke.values, transform=smoke.transform)
    again = arrays.read_volume(tmp_path / "again.vdb")
    assert np.array_equal(again.values, smoke.values) and np.allclose(again.transform, smoke.transform, rtol=1e-15)
    field = np.arange(5 * 4 * 3 * 3, dtype=np.float32).reshape(5, 4, 3, 3) + 1
    arrays.write_volume(tmp_path / "field.vdb", field[::-1], voxel_size=0.5, origin=(1, 2, 3), grid="vel")
    back = arrays.read_volume(tmp_path / "field.vdb", "vel")
    assert np.array_equal(back.values, field[::-1]) and np.allclose(back.world([1, 0, 0]), [1.5, 2, 3])
    picture = arrays.read_picture(shots.output / "view_000.exr")
    assert picture.values.shape == (32, 32, 4) and picture.channels == ("R", "G", "B", "A")
    arrays.write_picture(tmp_path / "a.exr", picture.values)
    assert package.compare(tmp_path / "a.exr", shots.output / "view_000.exr")
    with pytest.raises(CumuloError, match="no layer 'Mist'"):
        arrays.read_picture(shots.output / "view_000.exr", "Mist")
    with pytest.raises(CumuloError, match="`voxel_size`"):
        arrays.write_volume(tmp_path / "b.vdb", smoke.values)


def test_the_guides_loss_of_ones_own_has_the_derivatives_of_its_difference_quotients(plume, tmp_path, monkeypatch, capsys):
    page = (PACKAGE.parent / "src/guide/own-loss.md").read_text()
    (tmp_path / "own_loss.py").write_text(page.split("```python own_loss.py\n")[1].split("```")[0])
    package.render(plume, tmp_path / "shots", views=3, size=(24, 24), density_scale="auto")
    truth, random = arrays.read_volume(plume), np.random.default_rng(1)
    guess = truth.values * (1 + 0.5 * random.random(truth.values.shape))
    arrays.write_volume(tmp_path / "guess.vdb", guess, transform=truth.transform)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["own_loss.py", "guess.vdb", "shots"])
    example = runpy.run_path("own_loss.py", run_name="__main__")
    slopes = arrays.read_volume("slopes.vdb")

    # In double precision, in which rays do not end early.
    values = example["volume"].values.astype(np.float64)
    direction = values * random.random(values.shape)

    def loss(step):
        renders = package.pictures.render(values + step * direction, example["cameras"], **example["scene"])
        return example["own_loss"](renders, example["photos"].astype(np.float64))[0]

    assert float(capsys.readouterr().out.split()[1].strip(",")) == pytest.approx(loss(0.0), abs=2e-6)
    assert np.allclose(slopes.transform[:3, :3], truth.transform[:3, :3])
    first = np.round(np.linalg.inv(truth.transform) @ slopes.transform[:, 3]).astype(int)[:3]
    box = tuple(slice(at, at + n) for at, n in zip(first, slopes.values.shape, strict=True))
    quotient = (loss(1e-4) - loss(-1e-4)) / 2e-4
    assert abs(quotient) > 1e-4 and (direction[box] * slopes.values).sum() == pytest.approx(quotient, rel=1e-4)
