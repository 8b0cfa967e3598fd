"""The commands of the guide's page on Blender, one after the other."""

import os
import pathlib
import shlex
import subprocess
import sys

import bpy
import numpy as np
import smoke_scene
from cumulo.capture import Capture
from cumulo.cycles.stage import quiet
from cumulo.exr import read_exr

ROOT = pathlib.Path(__file__).resolve().parents[3]
PYTHON = "PYTHONPATH=python .venvs/bpy/bin/python "


def commands():
    """The lines of the page's `sh` fences."""
    fences = (ROOT / "src/guide/blender.md").read_text().split("```")[1::2]
    return [line for fence in fences if fence.startswith("sh\n") for line in fence.splitlines()[1:] if line]


def test_a_smoke_goes_through_all_commands_and_back(fixtures, cumulo, program, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb", color=(0.8, 0.8, 0.8))
    smoke_scene.orbit(scene, (1, 2, 3))
    with quiet():
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "smoke.blend"))
    environment = dict(
        os.environ, PYTHONPATH=str(ROOT / "python"), PATH=f"{pathlib.Path(program).parent}:{os.environ['PATH']}"
    )
    assert len(commands()) == 5
    for line in commands():
        words = shlex.split(line.removeprefix(PYTHON))
        words = [sys.executable, *words] if line.startswith(PYTHON) else words
        done = subprocess.run(
            words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
        )
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
        if "export" in words:
            assert done.stdout == "cumulo render scene/scene.json --cameras scene/transforms.json --frames 1-3 --samples 64 " \
                "--max-bounces 3 --background 0,0,0 -o scene/render\n"  # fmt: skip
        if "capture" in words:
            assert done.stdout == "shots/transforms.json: 16 views, density scale 4\n"
        if "load" in words:
            assert done.stdout == "both.blend: the object 'found' shows found.vdb, with the medium of 'Smoke'\n"
    assert read_exr(tmp_path / "pictures/frame.0003.exr")[..., :3].max() > 0.1
    assert len(Capture.read(tmp_path / "shots").frames) == 16
    (grid,) = cumulo("diff", fixtures / "plume.vdb", tmp_path / "found.vdb")["grids"]
    assert grid["psnr_db"] > 25
    with quiet():
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "both.blend"))
    bpy.context.view_layer.update()
    names = {thing.name: np.array(thing.matrix_world) for thing in bpy.data.objects if thing.type == "VOLUME"}
    assert names.keys() == {"Smoke", "found"} and np.array_equal(names["Smoke"], names["found"])


def test_commands_say_what_is_wrong(fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    scene.camera.data.type = "PANO"
    with quiet():
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "wide.blend"))
    (tmp_path / "text.blend").write_text("no Blender file")
    for words, expected in (
        (["export", tmp_path / "wide.blend"], "camera 'Camera': its type is pano; make it perspective or orthographic"),
        (["export", tmp_path / "none.blend"], "none.blend: no such file"),
        (["capture", tmp_path / "text.blend"], "text.blend: Blender cannot open it"),
        (["load", fixtures / "README.md", "--into", tmp_path / "wide.blend"], "README.md: Blender cannot read it"),
    ):
        done = subprocess.run(
            [sys.executable, "-m", "cumulo.bpy_scene", *map(str, words), "-o", str(tmp_path / "out")],
            cwd=ROOT / "python", capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        assert done.returncode == 2 and done.stderr.startswith("error: ") and expected in done.stderr, done.stderr
        assert not (tmp_path / "out").exists()


def test_no_input_is_overwritten(fixtures, tmp_path):
    smoke_scene.smoke(fixtures / "plume.vdb")
    blend, vdb = tmp_path / "smoke.blend", tmp_path / "found.vdb"
    with quiet():
        bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    vdb.write_bytes((fixtures / "cube.vdb").read_bytes())
    (tmp_path / "link.blend").symlink_to(blend)
    kept = blend.read_bytes(), vdb.read_bytes()
    for output in ("smoke.blend", "./link.blend", "found.vdb"):
        done = subprocess.run(
            [sys.executable, "-m", "cumulo.bpy_scene", "load", "found.vdb", "--into", "smoke.blend", "-o", output], cwd=tmp_path,
            env=dict(os.environ, PYTHONPATH=str(ROOT / "python")), capture_output=True, text=True, check=False,
        )  # fmt: skip
        given = "found.vdb" if output == "found.vdb" else "smoke.blend"
        expected = f"error: {output}: it is the input {given}, and inputs are not overwritten; give another name by -o\n"
        assert done.returncode == 2 and done.stderr == expected and not done.stdout
        assert (blend.read_bytes(), vdb.read_bytes()) == kept
