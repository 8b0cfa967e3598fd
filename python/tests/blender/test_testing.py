"""`cumulo.testing` in a project of its own: a good change passes, planted regressions fail, and their page shows them."""

import dataclasses
import json
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys

import bpy
import numpy as np
import pytest
from cumulo import arrays
from cumulo.testing import Parity, ReferenceProblem, blend_file, rounding
from cumulo.testing.reference import Store

PACKAGE = pathlib.Path(__file__).resolve().parents[2]

# A small pipeline: frames of a rising smoke, and Cycles' picture of frame 2 as what is believed.
SHOT = '''
import json, os, pathlib
import numpy as np
from cumulo import arrays
from cumulo.capture import Camera, Capture, look_at

HERE = pathlib.Path(__file__).parent
CAMERA = Camera(look_at((3.2, 2.2, 2.6), (1, 1, 1), (0, 0, 1)), 85.0, 85.0, 32.0, 24.0, 64, 48)
SETTINGS = {"model": "scattering", "density_scale": 2.0, "albedo": (0.6, 0.6, 0.6), "sky": (1.0, 1.0, 1.0), "unbiased": True,
            "background": (0, 0, 0), "emission": (0, 0, 0), "samples": int(os.environ.get("SAMPLES", 512))}

def frame(number):
    x, y, z = np.meshgrid(*3 * [np.linspace(-1, 1, 24)], indexing="ij")
    ball = np.clip(1 - 1.8 * ((x + 0.2) ** 2 + y**2 + (z + 0.5 - 0.2 * number) ** 2), 0, 1)
    return (ball * (1 + 0.4 * np.sin(9 * x) * np.cos(7 * y) * np.sin(8 * z))).astype(np.float32)

def smoke(number=2, shift=0.0):
    path = HERE / f"smoke.{number:04d}.{shift}.vdb"
    if not path.exists():
        arrays.write_volume(path, frame(number), voxel_size=2 / 23, origin=(shift * 2 / 23, 0.0, 0.0))
    return path
'''
TEST = '''
import json, os
import cumulo
import shot
from cumulo.capture import Capture
from cumulo.testing import volume

CHANGE = json.loads(os.environ.get("CHANGE", "{}"))

def candidate(seed, path):
    folder = path.with_suffix("")
    folder.mkdir(exist_ok=True)
    Capture([(shot.CAMERA, folder / "view.exr")]).write(folder / "cameras.json")
    vdb = shot.smoke(CHANGE.get("frame", 2), CHANGE.get("shift", 0.0))
    made = cumulo.render(vdb, folder / "out", cameras=folder / "cameras.json", density_scale=2.0 * CHANGE.get("density", 1.0),
                         albedo=0.6, sky=(1, 1, 1), background=(0, 0, 0), samples=512, seed=seed + CHANGE.get("seed", 0), overwrite=True)
    return made.output / "view_000.exr"

def test_smoke(cumulo_parity):
    reference = volume(shot.smoke(), shot.CAMERA, shot.SETTINGS, name="smoke")
    assert cumulo_parity.statistical(reference, candidate)
'''


@pytest.fixture(scope="module")
def project(tmp_path_factory, cumulo):
    """The project's folder, with its reference."""
    folder = tmp_path_factory.mktemp("project")
    (folder / "pytest.ini").write_text("[pytest]\npythonpath = .\n")
    (folder / "shot.py").write_text(SHOT)
    (folder / "test_shot.py").write_text(TEST)
    code, said = ran(folder)
    assert code == 1 and "there is none" in said and "--cumulo-regenerate" in said, said
    code, said = ran(folder, "--cumulo-regenerate")
    assert code == 1 and "rendered again: smoke" in said and "passed" not in said, said
    made = json.loads((folder / "references" / "smoke" / "reference.json").read_text())
    assert made["renderer"] == "bpy 5.0.1" and set(made["pictures"]) == {"seed_1.exr", "seed_2.exr"}
    assert made["inputs"].keys() >= {"smoke.0002.0.0.vdb", "cumulo/blender.py", "cumulo/padding.py", "cumulo/cycles/stage.py"}
    return folder


def ran(folder, *options, **environment):
    """Exit code and output of the project's tests."""
    command = [sys.executable, "-m", "pytest", "-p", "cumulo.testing.plugin", "-p", "no:cacheprovider", "-q", *options]
    settings = {**os.environ, "PYTHONPATH": str(PACKAGE), **environment}
    done = subprocess.run(command, cwd=folder, env=settings, capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


def test_a_good_change_passes(project):
    for change in ({}, {"seed": 10}):
        code, said = ran(project, CHANGE=json.dumps(change))
        assert code == 0 and "1 passed" in said, said
    assert not (project / "cumulo-failures").exists()


@pytest.mark.parametrize("change", [{"density": 1.01}, {"shift": 0.5}, {"frame": 3}], ids=["density", "shift", "frame"])
def test_planted_regressions_fail_and_their_page_shows_them(project, change):
    code, said = ran(project, CHANGE=json.dumps(change))
    assert code == 1 and "the expected values differ" in said, said
    folder = project / "cumulo-failures" / "test_shot" / "test_smoke" / "smoke"
    assert f"page: {folder / 'index.html'}" in said
    page = (folder / "index.html").read_text()
    for words in ("smoke differs from its reference", "test_shot.py::test_smoke", "the function candidate of test_shot", "bpy 5.0.1", "smoke.0002.0.0.vdb",
                  "--cumulo-regenerate", "class=found", 'class="mark"'):  # fmt: skip
        assert words in page, words
    assert len(re.findall(r'src="data:image/png;base64,', page)) == 4 and "http" not in page
    expected, actual, difference = (arrays.read_picture(folder / f"{name}.exr").values for name in ("expected", "actual", "difference"))
    assert expected.shape == (48, 64, 4) and abs(actual - expected - difference).max() < 1e-6
    # More density absorbs more: alpha is above the reference's.
    if "density" in change:
        assert 0.0005 < difference[..., 3].mean() < 0.005
    assert {p.name for p in folder.glob("*.png")} == {"expected.png", "actual.png", "difference.png", "difference_blocks.png"}


def test_a_reference_of_other_inputs_is_no_reference(project):
    code, said = ran(project, SAMPLES="256")
    assert code == 1 and "settings.settings.samples: 512 then, 256 now" in said and "--cumulo-regenerate" in said, said
    picture = project / "references" / "smoke" / "seed_1.exr"
    kept = picture.read_bytes()
    try:
        picture.write_bytes(kept[:-1] + bytes([kept[-1] ^ 1]))
        code, said = ran(project)
        assert code == 1 and "not those that were rendered" in said, said
    finally:
        picture.write_bytes(kept)


def test_the_example_with_cycles_of_the_guide_runs_as_it_is_written(program, fixtures, tmp_path):
    page = (PACKAGE.parent / "src/guide/python.md").read_text().split("## Regression tests with pytest")[1]
    shots, test = page.split("```")[1], page.split("```")[5]
    assert shots.startswith("sh\n") and test.startswith("text\n# test_cycles.py\n")
    shutil.copy(fixtures / "plume.vdb", tmp_path / "smoke.vdb")
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "test_cycles.py").write_text(test.removeprefix("text\n"))
    path = f"{pathlib.Path(program).parent}{os.pathsep}{os.environ['PATH']}"
    for line in shots.splitlines()[1:]:
        subprocess.run(shlex.split(line), cwd=tmp_path, env={**os.environ, "PATH": path}, check=True, capture_output=True)
    code, said = ran(tmp_path, "--cumulo-regenerate", PATH=path)
    assert code == 1 and "rendered again: smoke_cycles" in said, said
    code, said = ran(tmp_path, PATH=path)
    assert code == 0 and "1 passed" in said, said


def test_a_blend_is_rendered_as_its_scene_is(cumulo, fixtures, tmp_path):
    blend = tmp_path / "scene.blend"
    shutil.copy(fixtures / "plume.vdb", tmp_path / "linked.vdb")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.view_layers[0].samples, scene.cycles.time_limit = 1000, 3600.0
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.25, 0.5, 1.0, 1.0)
    # Behind the camera, which looks down -Z.
    smoke = bpy.data.volumes.new("smoke")
    smoke.filepath = str(tmp_path / "linked.vdb")
    for name, data, height in (("eye", bpy.data.cameras.new("eye"), 0.0), ("smoke", smoke, 50.0)):
        thing = bpy.data.objects.new(name, data)
        thing.location = (0, 0, height)
        scene.collection.objects.link(thing)
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    store = Store(tmp_path / "references", tmp_path)
    parity = Parity(dataclasses.replace(store, missing="render"), tmp_path / "failures", tmp_path / "scratch")
    reference = blend_file(blend, camera="eye", size=(8, 6), samples=4)
    # A constant, summed over four samples and divided.
    sky = np.broadcast_to(np.float32((0.25, 0.5, 1.0, 1.0)), (6, 8, 4))
    assert parity.exact(reference, lambda seed, path: sky, tolerance=rounding(8, 1.0))
    cycles = bpy.context.scene.cycles
    assert (cycles.samples, cycles.use_layer_samples, cycles.time_limit) == (4, "IGNORE", 0.0)
    _, made, rendered = store.pictures(blend_file(blend, camera="eye", size=(8, 6), samples=4), [1])
    assert made["inputs"].keys() == {"scene.blend", "linked.vdb", "cumulo/testing/blend.py"} and not rendered
    (tmp_path / "linked.vdb").write_bytes(b"another")
    with pytest.raises(ReferenceProblem, match="inputs.linked.vdb"):
        store.pictures(blend_file(blend, camera="eye", size=(8, 6), samples=4), [1])
    with pytest.raises(ValueError, match="no camera 'nose'; the scene has eye"):
        parity.exact(blend_file(blend, camera="nose", name="other"), lambda seed, path: sky, tolerance=0.0)
