"""`cumulo.testing` without Blender: references by functions, commands as candidates, the store."""

import json
import os
import pathlib
import shlex
import shutil
import subprocess
import sys

import numpy as np
import pytest
from cumulo import arrays
from cumulo.capture import Camera, look_at
from cumulo.testing import Parity, Reference, ReferenceProblem, rounding, volume
from cumulo.testing.reference import Store, changes

PACKAGE = pathlib.Path(__file__).resolve().parents[1]
EXPECTED = np.linspace(0, 1, 20 * 30 * 4, dtype=np.float32).reshape(20, 30, 4)


def noisy(seed, offset=0.0):
    return EXPECTED + np.float32(offset) + 0.1 * np.random.default_rng(seed).standard_normal(EXPECTED.shape).astype(np.float32)


def plain(path=None, **options):
    return Reference("ramp", lambda seed, path: EXPECTED, renderer=None, **options)


@pytest.fixture
def parity(tmp_path):
    return Parity(Store(tmp_path / "references", tmp_path, "render"), tmp_path / "failures", tmp_path / "scratch", "a test")


def test_exact_pictures_agree_within_the_tolerance(parity):
    assert rounding(4, 2.0) == 2.0**-21
    assert parity.exact(plain(), lambda seed, path: EXPECTED, tolerance=0.0)
    assert parity.exact(plain(), lambda seed, path: EXPECTED + np.float32(1e-3), tolerance=1.1e-3)
    with pytest.raises(pytest.fail.Exception, match="a sample differs by 1.0.*e-03"):
        parity.exact(plain(), lambda seed, path: EXPECTED + np.float32(1e-3), tolerance=1e-4)
    page = parity.pages[0].read_text()
    assert "largest difference" in page and "the function" in page and "a test" in page
    with pytest.raises(ValueError, match="tolerance"):
        parity.exact(plain(), lambda seed, path: EXPECTED, tolerance=float("nan"))


def test_noisy_pictures_are_tested_by_seeds_or_against_a_truth(parity):
    reference = Reference("noisy", lambda seed, path: noisy(seed), renderer=None)
    assert parity.statistical(reference, lambda seed, path: noisy(seed + 10))
    assert parity.statistical(plain(), lambda seed, path: noisy(seed + 20), seeds=[1], noiseless="reference")
    with pytest.raises(pytest.fail.Exception, match="expected values differ"):
        parity.statistical(reference, lambda seed, path: noisy(seed + 10, 0.01))
    assert "mean" in parity.pages[0].read_text()
    assert parity.statistical(reference, lambda seed, path: noisy(seed + 10, 0.01), tolerance=0.01)
    with pytest.raises(ValueError, match="noiseless"):
        parity.statistical(reference, lambda seed, path: noisy(seed), noiseless="both")


def test_pictures_of_other_sizes_are_refused(parity):
    from cumulo import CumuloError

    with pytest.raises(CumuloError, match="different sizes"):
        parity.exact(plain(), lambda seed, path: EXPECTED[:5], tolerance=0.0)


def test_commands_are_candidates(parity, tmp_path):
    arrays.write_picture(tmp_path / "made.exr", EXPECTED)
    copy = "import shutil, sys; shutil.copy(sys.argv[1], sys.argv[2])"
    assert parity.exact(plain(), [sys.executable, "-c", copy, tmp_path / "made.exr", "{output}"], tolerance=0.0)
    with pytest.raises(pytest.fail.Exception, match="exit code 3.*\n.*too bad"):
        parity.exact(plain(), [sys.executable, "-c", "import sys; print('too bad', file=sys.stderr); sys.exit(3)"], tolerance=0.0)
    with pytest.raises(pytest.fail.Exception, match="wrote no picture"):
        parity.exact(plain(), [sys.executable, "-c", "pass"], tolerance=0.0)
    with pytest.raises(ReferenceProblem, match="was not written"):
        parity.exact(plain(), lambda seed, path: None, tolerance=0.0)


def test_files_that_only_the_renderer_finds_count_wherever_they_are(tmp_path):
    root, elsewhere = tmp_path / "project", tmp_path / "elsewhere"
    for folder in (root, elsewhere, elsewhere / "other"):
        folder.mkdir()
        (folder / "smoke.vdb").write_text(folder.name)
    linked, named = [], [elsewhere / "smoke.vdb", elsewhere / "other" / "smoke.vdb"]

    def render(seed, path):
        linked[:] = [root / "smoke.vdb", elsewhere / "sky.exr", named[0]]
        return EXPECTED

    def reference():
        return Reference("linked", render, named, renderer=None, discover=lambda: linked)

    (elsewhere / "sky.exr").write_text("blue")
    store = Store(root / "references", root)
    _, made, _ = Store(store.folder, root, "render").pictures(reference(), [1])
    assert len(made["inputs"]) == 4 and None not in made["inputs"].values(), made
    assert not store.pictures(reference(), [1])[2]
    for file in (root / "smoke.vdb", elsewhere / "sky.exr", *named):
        kept = file.read_text()
        file.write_text("another")
        with pytest.raises(ReferenceProblem, match="it is of other inputs"):
            store.pictures(reference(), [1])
        file.write_text(kept)
    manifest = root / "references" / "linked" / "reference.json"
    manifest.write_text(json.dumps({key: value for key, value in made.items() if key == "pictures"}))
    with pytest.raises(ReferenceProblem, match="inputs"):
        store.pictures(reference(), [1])


def test_references_are_kept_until_something_that_they_depend_on_changes(tmp_path):
    calls = []
    scene = tmp_path / "scene.txt"
    scene.write_text("one")

    def reference(**settings):
        def render(seed, path):
            calls.append(seed)
            return EXPECTED

        return Reference("kept", render, [scene], settings, renderer=None)

    store = Store(tmp_path / "references", tmp_path)
    with pytest.raises(ReferenceProblem, match="there is none.*\n.*--cumulo-regenerate"):
        store.pictures(reference(a=1), [1])
    Store(store.folder, tmp_path, regenerate=True).pictures(reference(a=1), [1, 2])
    assert calls == [1, 2]
    paths, made, rendered = store.pictures(reference(a=1), [2])
    assert calls == [1, 2] and [p.name for p in paths] == ["seed_2.exr"] and not rendered
    assert made["inputs"].keys() == {"scene.txt"} and json.loads((paths[0].parent / "reference.json").read_text()) == made
    for problem, change in (
        ("settings.a: 1 then, 2 now", lambda: reference(a=2)),
        ("settings.b: absent then, 3 now", lambda: reference(a=1, b=3)),
    ):
        with pytest.raises(ReferenceProblem, match=problem):
            store.pictures(change(), [1])
    with pytest.raises(ReferenceProblem, match="seed 5"):
        store.pictures(reference(a=1), [5])
    scene.write_text("two")
    with pytest.raises(ReferenceProblem, match="inputs.scene.txt"):
        store.pictures(reference(a=1), [1])
    # A cache renders what it lacks.
    assert Store(store.folder, tmp_path, "render").pictures(reference(a=1), [1])[2] and calls == [1, 2, 1]
    assert not list(store.folder.glob(".rendering-*"))
    assert changes({"a": {"b": 1}}, {"a": {"b": 1}}) == []


def test_a_wrong_camera_or_settings_are_refused_with_advice():
    camera = Camera(look_at((3, 3, 3), (0, 0, 0)), 20.0, 20.0, 8.0, 8.0, 16, 16)
    settings = {"model": "scattering", "albedo": (0.8,) * 3, "sky": (1, 1, 1)}
    assert volume("smoke.vdb", camera, settings).name == "smoke"
    with pytest.raises(TypeError, match=r"camera is of type dict, and a cumulo.capture.Camera is expected; take one of a capture"):
        volume("smoke.vdb", {"fl_x": 20.0}, settings)
    with pytest.raises(TypeError, match=r"settings is of type str, and a cumulo.blender.Settings or a dict .* is expected"):
        volume("smoke.vdb", camera, "scattering")


def test_names_of_references_stay_within_their_folder(tmp_path):
    (tmp_path / "x").mkdir()
    kept = tmp_path / "x" / "seed_1.exr"
    kept.write_text("another's")
    for name in ("../x", "..", ".", "", "a/b", "a\\b", "/x", ".hidden", "c:x"):
        with pytest.raises(ValueError, match="give a plain name such as 'smoke'"):
            Store(tmp_path / "references", tmp_path, regenerate=True).pictures(Reference(name, lambda seed, path: EXPECTED), [1])
    assert kept.read_text() == "another's"
    assert Reference("smoke v2 (wide)", lambda seed, path: EXPECTED).name == "smoke v2 (wide)"


def test_the_example_of_the_guide_runs_as_it_is_written_and_without_bpy(program, fixtures, tmp_path):
    page = (PACKAGE.parent / "src/guide/python.md").read_text().split("## Regression tests with pytest")[1]
    shots, test = page.split("```")[1], page.split("```")[3]
    assert shots.startswith("sh\n") and test.startswith("text\n# test_smoke.py\n")
    shutil.copy(fixtures / "plume.vdb", tmp_path / "smoke.vdb")
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "test_smoke.py").write_text(test.removeprefix("text\n"))
    # Wherever bpy is installed, it is not to be imported.
    (tmp_path / "bpy.py").write_text("raise ImportError('this environment has no bpy')\n")
    for line in shots.splitlines()[1:]:
        words = shlex.split(line)
        subprocess.run([program, *words[1:]], cwd=tmp_path, check=True, capture_output=True)
    paths = os.pathsep.join([str(tmp_path), str(PACKAGE)])
    environment = {**os.environ, "PYTHONPATH": paths}
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "cumulo.testing.plugin"]
    for options, code, words in ((["--cumulo-regenerate"], 1, "rendered again: smoke"), ([], 0, "1 passed")):
        done = subprocess.run([*command, *options], cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == code and words in done.stdout, done.stdout + done.stderr
