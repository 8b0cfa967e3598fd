"""The extension in Blender without a window: every operator on a real scene, and what it says when something is wrong."""

import functools
import importlib
import os
import pathlib
import re
import shlex
import stat
import subprocess
import sys
import time
import tomllib
import types
import zipfile

import bpy
import numpy as np
import pytest
import reference
import smoke_scene
from cumulo import padding, run
from cumulo.capture import Capture
from cumulo.cycles.stage import quiet
from cumulo.exr import read_exr
from mathutils import Vector

ADDON = pathlib.Path(__file__).resolve().parents[2] / "addon"
NAME = "bl_ext.cumulo_test.cumulo"
TOOL = pathlib.Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """The installable .zip, as `make addon` builds it."""
    target = tmp_path_factory.mktemp("addon") / "cumulo.zip"
    subprocess.run([sys.executable, ADDON / "build.py", target], check=True, stdout=subprocess.DEVNULL)
    return target


@pytest.fixture(scope="module")
def installed(archive, tmp_path_factory):
    """The folder of a repository of extensions with the archive in it."""
    folder = tmp_path_factory.mktemp("extensions")
    _repository(folder)
    with quiet():
        bpy.ops.extensions.package_install_files(filepath=str(archive), repo="cumulo_test", enable_on_install=False)
    assert (folder / "cumulo" / "blender_manifest.toml").is_file()
    return folder


def _repository(folder):
    repositories = bpy.context.preferences.extensions.repos
    for repository in list(repositories):
        if repository.module == "cumulo_test":
            repositories.remove(repository)
    repositories.new(name="Cumulo's test", module="cumulo_test", custom_directory=str(folder), source="USER")


@pytest.fixture
def addon(installed, cumulo):
    """Function that switches the extension on in the present session (a new scene ends it), with this program."""

    def enable(program=None):
        _repository(installed)
        bpy.ops.preferences.addon_enable(module=NAME)
        bpy.context.preferences.addons[NAME].preferences.program = str(program or run.program())
        return importlib.import_module(NAME)

    yield enable
    if NAME in bpy.context.preferences.addons:
        bpy.ops.preferences.addon_disable(module=NAME)


def test_the_archive_is_valid_and_the_same_each_time(archive, tmp_path):
    done = subprocess.run([sys.executable, TOOL, "validate", archive], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    subprocess.run([sys.executable, ADDON / "build.py", tmp_path / "again.zip"], check=True, stdout=subprocess.DEVNULL)
    assert (tmp_path / "again.zip").read_bytes() == archive.read_bytes()
    crate = tomllib.loads((ADDON.parents[1] / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    package = re.search(r'^__version__ = "(.+)"$', (ADDON.parent / "cumulo" / "__init__.py").read_text(), re.MULTILINE)
    manifest = tomllib.loads(zipfile.ZipFile(archive).read("blender_manifest.toml").decode())
    assert crate == package[1] == manifest["version"]
    names = zipfile.ZipFile(archive).namelist()
    assert "blender_manifest.toml" in names and "cumulo/bpy_scene/export.py" in names and "build.py" not in names


def test_nothing_is_left_when_it_is_switched_off(addon, fixtures):
    smoke_scene.smoke(fixtures / "plume.vdb")
    before = {name for name in dir(bpy.types) if "cumulo" in name.lower()}
    addon()
    assert {"VIEW3D_PT_cumulo", "CUMULO_OT_reconstruct"} <= set(dir(bpy.types))
    assert bpy.context.scene.cumulo.folder == "//cumulo"
    bpy.ops.preferences.addon_disable(module=NAME)
    assert {name for name in dir(bpy.types) if "cumulo" in name.lower()} == before
    assert not hasattr(bpy.types.Scene, "cumulo")
    # On again, after it was off.
    addon()
    assert bpy.ops.cumulo.export_scene.poll()


def test_a_smoke_with_a_camera_path_is_exported_and_rendered_like_cycles(addon, fixtures, cumulo, cumulo_parity, tmp_path):
    vdb = fixtures / "plume.vdb"
    scene = smoke_scene.smoke(vdb)
    smoke_scene.orbit(scene, (4, 24))
    scene.frame_step = 20
    addon()
    assert bpy.ops.cumulo.export_scene(folder=str(tmp_path / "scene"), animation=True) == {"FINISHED"}
    for seed in (1, 2):
        out = tmp_path / str(seed)
        cumulo("render", tmp_path / "scene/scene.json", "--cameras", tmp_path / "scene", "--frames", "4-24x20", "--max-bounces", 3,
               "--background", "0,0,0", "--samples", 64, "--seed", seed, "-o", out)  # fmt: skip
    for frame in (4, 24):
        path = functools.partial(smoke_scene.film, scene, frame=frame)
        of_cycles = reference.of_cycles(f"addon_path_{frame}", path, [vdb, __file__])
        assert cumulo_parity.statistical(of_cycles, lambda seed, _: tmp_path / str(seed) / f"frame.{frame:04}.exr")


def test_render_with_cumulo_shows_an_image(addon, fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    addon()
    assert bpy.ops.cumulo.render(folder=str(tmp_path / "render"), samples=8) == {"FINISHED"}
    picture = read_exr(tmp_path / "render" / "frame.0001.exr")
    image = bpy.data.images["Cumulo"]
    assert tuple(image.size) == (32, 24) and picture[..., :3].max() > 0.1
    # Blender's rows begin at the bottom.
    pixels = np.array(image.pixels[:]).reshape(24, 32, 4)[::-1]
    assert np.allclose(pixels[..., :3], picture[..., :3], atol=1e-6)
    # Another's image of that name is another's.
    image.name = "Renamed"
    foreign = bpy.data.images.new("Cumulo", 4, 4)
    # Again, over what is there; the image follows.
    scene.objects["Sun"].data.energy = 6.0
    assert bpy.ops.cumulo.render(folder=str(tmp_path / "render"), samples=8) == {"FINISHED"}
    brighter = np.array(image.pixels[:]).reshape(24, 32, 4)[::-1]
    assert brighter[..., :3].mean() == pytest.approx(2 * pixels[..., :3].mean(), rel=1e-3)
    assert foreign.source == "GENERATED" and tuple(foreign.size) == (4, 4)


def test_views_are_rendered_reconstructed_and_loaded_beside_the_original(addon, fixtures, cumulo, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb", color=(0.7, 0.7, 0.7))
    addon()
    assert bpy.ops.cumulo.render_views(folder=str(tmp_path / "views"), views=16, size=48, samples=16) == {"FINISHED"}
    capture = Capture.read(tmp_path / "views")
    assert (len(capture.frames), capture.density_scale) == (16, pytest.approx(4.0))
    found = tmp_path / "found.vdb"
    assert bpy.ops.cumulo.reconstruct(capture=str(tmp_path / "views"), output=str(found), like="Smoke") == {"FINISHED"}
    (grid,) = cumulo("diff", fixtures / "plume.vdb", found)["grids"]
    assert grid["psnr_db"] > 25
    # Beside the original, with its medium. Boxes are those of blocks of 8 voxels.
    thing, original = scene.objects["found"], scene.objects["Smoke"]
    bpy.context.view_layer.update()
    boxes = [np.array([one.matrix_world @ Vector(corner) for corner in one.bound_box]) for one in (thing, original)]
    assert np.abs(boxes[0].mean(axis=0) - boxes[1].mean(axis=0)).max() < 0.34
    medium = next(
        node for node in thing.data.materials[0].node_tree.nodes if node.bl_idname == "ShaderNodeVolumePrincipled"
    )
    assert medium.inputs["Density"].default_value == pytest.approx(4.0)
    assert tuple(medium.inputs["Color"].default_value)[:3] == pytest.approx((0.7, 0.7, 0.7))
    # The picture of the found one in the place of the original, beside the picture of the original.
    pictures = []
    for shown, hidden in ((original, thing), (thing, original)):
        shown.hide_render, hidden.hide_render = False, True
        pictures.append(smoke_scene.film(scene, 1))
    assert np.abs(pictures[0][..., :3].mean() / pictures[1][..., :3].mean() - 1) < 0.03


def test_a_sequence_is_denoised_along_the_motion_of_the_volume(addon, fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb", matrix=smoke_scene.place((0.2, 0, 0), 1.0))
    smoke_scene.orbit(scene, tuple(range(1, 7)))
    scene.cycles.volume_bounces = 0
    addon()
    scene.cumulo.folder = str(tmp_path)
    assert bpy.ops.cumulo.render(animation=True, samples=1) == {"FINISHED"}
    assert bpy.data.images["Cumulo"].source == "SEQUENCE"
    assert bpy.ops.cumulo.render(folder=str(tmp_path / "truth"), animation=True, samples=256) == {"FINISHED"}
    assert bpy.ops.cumulo.denoise() == {"FINISHED"}
    assert (tmp_path / "denoised" / "scene" / "volume.vdb").is_file() and (
        tmp_path / "denoised" / "motion" / "frame.0001.exr"
    ).is_file()
    errors = []
    for folder in ("render", "denoised"):
        pairs = [
            [read_exr(tmp_path / part / f"frame.{frame:04}.exr")[..., :3] for part in (folder, "truth")]
            for frame in range(1, 7)
        ]
        errors.append(np.sqrt(np.mean([(one - other) ** 2 for one, other in pairs])))
    assert errors[1] < 0.6 * errors[0]


def test_results_are_loaded_with_a_material(addon, fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    addon()
    assert bpy.ops.cumulo.load_result(filepath=str(fixtures / "cube.vdb")) == {"FINISHED"}
    assert scene.objects["cube"].data.render.space == "WORLD"
    with pytest.raises(RuntimeError, match="README.md.*Blender cannot read it"):
        bpy.ops.cumulo.load_result(filepath=str(fixtures / "README.md"))
    with pytest.raises(RuntimeError, match="volumes named 'Nobody'"):
        bpy.ops.cumulo.load_result(filepath=str(fixtures / "cube.vdb"), like="Nobody")
    assert len(bpy.data.volumes) == 2


def test_what_cannot_be_honored_is_reported_by_name(addon, fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    addon()
    # Beside a .blend that is not saved there is no folder.
    with pytest.raises(RuntimeError, match="//cumulo is beside the .blend, which is not saved yet"):
        bpy.ops.cumulo.export_scene()
    scene.cumulo.folder = ""
    with pytest.raises(RuntimeError, match="no folder or file is named"):
        bpy.ops.cumulo.export_scene()
    smoke_scene.medium_node()[0].inputs["Density Attribute"].default_value = "soot"
    scene.cumulo.folder = str(tmp_path)
    for operator in (
        bpy.ops.cumulo.export_scene,
        bpy.ops.cumulo.render,
        bpy.ops.cumulo.render_views,
        bpy.ops.cumulo.denoise,
    ):
        with pytest.raises(RuntimeError, match="material 'Smoke Material', node 'Principled Volume'.*soot"):
            operator(folder=str(tmp_path / "out"))


def test_a_missing_or_failing_program_is_reported(addon, fixtures, tmp_path, monkeypatch):
    smoke_scene.smoke(fixtures / "plume.vdb")
    addon(tmp_path / "nowhere")
    with pytest.raises(RuntimeError, match="nowhere is no program; correct its path in the preferences"):
        bpy.ops.cumulo.render(folder=str(tmp_path / "out"))
    bpy.context.preferences.addons[NAME].preferences.program = ""
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RuntimeError, match="No program cumulo on PATH"):
        bpy.ops.cumulo.reconstruct(capture=str(tmp_path), output=str(tmp_path / "out.vdb"))
    # On PATH it is found.
    os.symlink(run.program(), tmp_path / "cumulo")
    with pytest.raises(RuntimeError) as refused:
        bpy.ops.cumulo.reconstruct(capture=str(tmp_path / "none"), output=str(tmp_path / "out.vdb"))
    assert "none: No such file" in str(refused.value) and "a capture is a transforms.json" in str(refused.value)
    # One that dies without a word.
    bpy.context.preferences.addons[NAME].preferences.program = str(script(tmp_path, "kill -9 $$"))
    with pytest.raises(RuntimeError, match="ended with code -9, and said nothing"):
        bpy.ops.cumulo.reconstruct(capture=str(tmp_path), output=str(tmp_path / "out.vdb"))
    # Another program of that name.
    script(tmp_path, "echo hello")
    with pytest.raises(RuntimeError, match="gave no report; is it a cumulo of this version"):
        bpy.ops.cumulo.reconstruct(capture=str(tmp_path), output=str(tmp_path / "out.vdb"))


def script(folder, body):
    """A program of a shell's words."""
    path = folder / "program.sh"
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


class Window:
    """Stands in for Blender's window and its events, of which background mode has none."""

    def __init__(self):
        self.window, self.shown, self.status = None, [], []
        self.window_manager = types.SimpleNamespace(
            event_timer_add=lambda pause, window: "timer", event_timer_remove=lambda timer: None, modal_handler_add=lambda job: None,
            progress_begin=lambda low, high: None, progress_update=self.shown.append, progress_end=lambda: self.shown.append("end"),
        )  # fmt: skip
        self.workspace = types.SimpleNamespace(status_text_set=self.status.append)


def event(kind, value="PRESS"):
    return types.SimpleNamespace(type=kind, value=value)


def test_esc_ends_the_program_and_the_progress(addon, fixtures, tmp_path):
    smoke_scene.smoke(fixtures / "plume.vdb")
    package = addon()
    program = script(
        tmp_path, f'echo "epochs: 3 of 12 after 2s, 6s to go; 20 dB" >&2; echo $$ > {tmp_path}/pid; exec sleep 60'
    )

    class Running(package.job.Job):
        bl_label, reports = "Reconstruct", []

        def steps(self, context):
            yield from package.program.run([program, "reconstruct"])

        def report(self, kind, text):
            self.reports.append((kind, text))

    job, window = Running(), Window()
    assert job.start(window) == {"RUNNING_MODAL"}
    assert not bpy.ops.cumulo.reconstruct.poll()
    end = time.monotonic() + 20
    while "Cumulo: epochs 3 of 12    Esc: cancel" not in window.status:
        assert time.monotonic() < end, window.status
        # Ticks go on to the operators of others.
        assert job.modal(window, event("TIMER")) == {"PASS_THROUGH"}
        time.sleep(0.02)
    assert 250 in window.shown
    assert job.modal(window, event("MOUSEMOVE")) == {"PASS_THROUGH"}
    child = int((tmp_path / "pid").read_text())
    assert job.modal(window, event("ESC")) == {"CANCELLED"}
    assert job.reports == [({"WARNING"}, "Reconstruct was cancelled")]
    assert window.shown[-1] == "end" and window.status[-1] is None
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)
    assert bpy.ops.cumulo.reconstruct.poll()


def working(package, steps):
    """A job of these steps, which keeps its reports."""

    class Working(package.job.Job):
        bl_label = "Work"

        def __init__(self):
            self.reports = []

        def steps(self, context):
            yield from steps()

        def report(self, kind, text):
            self.reports.append((kind, text))

    return Working()


def test_a_job_that_fails_in_any_way_leaves_room_for_the_next(addon, fixtures):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    package = addon()

    def undone():
        thing = scene.objects["Smoke"]
        yield 0, 1, "one"
        bpy.data.objects.remove(thing)
        yield 0, 1, thing.name

    def wrong():
        yield 0, 1, "one"
        raise KeyError("iterations")

    job, window = working(package, undone), Window()
    job.start(window)
    assert job.modal(window, event("TIMER")) == {"PASS_THROUGH"}
    assert job.modal(window, event("TIMER")) == {"CANCELLED"}
    ((kind, text),) = job.reports
    assert kind == {"ERROR"} and "removed" in text and bpy.ops.cumulo.reconstruct.poll()
    job, window = working(package, wrong), Window()
    job.start(window)
    job.modal(window, event("TIMER"))
    with pytest.raises(KeyError):
        job.modal(window, event("TIMER"))
    assert bpy.ops.cumulo.reconstruct.poll() and window.status[-1] is None and window.shown[-1] == "end"


def test_switching_the_extension_off_ends_its_job(addon, fixtures, tmp_path, monkeypatch):
    smoke_scene.smoke(fixtures / "plume.vdb")
    package = addon()
    program = script(tmp_path, f"echo $$ > {tmp_path}/pid.new; mv {tmp_path}/pid.new {tmp_path}/pid; exec sleep 60")
    job, window = working(package, lambda: package.program.run([program])), Window()
    job.start(window)
    # Blender's own window manager takes no timer of a stand-in.
    monkeypatch.setattr(package.job.Job, "stop", staticmethod(lambda _, stop=package.job.Job.stop: stop(window)))
    end = time.monotonic() + 20
    while not (tmp_path / "pid").exists():
        assert time.monotonic() < end
        job.modal(window, event("TIMER"))
        time.sleep(0.02)
    bpy.ops.preferences.addon_disable(module=NAME)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)
    assert package.job.Job.active is None and window.shown[-1] == "end" and window.status[-1] is None
    addon()
    assert bpy.ops.cumulo.reconstruct.poll()


def test_animations_are_exported_frame_by_frame(addon, fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    smoke_scene.orbit(scene, (1, 2, 3))
    package = addon()
    job = working(package, lambda: package.export.ExportScene.steps(job, bpy.context))
    job.folder, job.animation, window = str(tmp_path / "it's here"), True, Window()
    job.start(window)
    for frame in (1, 2, 3):
        assert job.modal(window, event("TIMER")) == {"PASS_THROUGH"}
        assert window.status[-1] == f"Cumulo: export {frame} of 3    Esc: cancel"
    assert job.modal(window, event("TIMER")) == {"FINISHED"}
    ((kind, text),) = job.reports
    # As a shell takes it.
    assert kind == {"INFO"} and shlex.split(text)[2] == str(tmp_path / "it's here" / "scene.json")
    # Esc leaves the scene at its frame, and no file.
    scene.frame_set(1)
    job.folder = str(tmp_path / "cancelled")
    job.start(window)
    job.modal(window, event("TIMER"))
    job.modal(window, event("TIMER"))
    assert job.modal(window, event("ESC")) == {"CANCELLED"}
    assert scene.frame_current == 1 and not (tmp_path / "cancelled").exists()


def test_denoise_counts_the_pictures_that_it_wrote(addon, fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    smoke_scene.orbit(scene, (1, 2, 3))
    package = addon()
    scene.cumulo.folder = str(tmp_path)
    scene.frame_set(2)
    job = working(package, lambda: package.denoise.Denoise.steps(job, bpy.context))
    job.pictures = job.folder = ""
    for animation, words, image in ((False, "1 picture is in", ("FILE", 2)), (True, "3 pictures are in", ("SEQUENCE", 1)),
                                    (False, "1 picture is in", ("FILE", 2))):  # fmt: skip
        for old in (tmp_path / "render").glob("frame.*.exr"):
            old.unlink()
        scene.frame_set(2)
        assert bpy.ops.cumulo.render(animation=animation, samples=1) == {"FINISHED"}
        job.reports.clear()
        assert job.execute(bpy.context) == {"FINISHED"}, job.reports
        assert job.reports == [({"INFO"}, f"{words} {tmp_path / 'denoised'}")]
        shown = bpy.data.images["Cumulo"]
        assert (shown.source, pathlib.Path(shown.filepath)) == (image[0], tmp_path / "denoised" / f"frame.{image[1]:04}.exr")


def test_views_go_on_beside_events_and_leave_nothing_when_cancelled(addon, fixtures, tmp_path):
    smoke_scene.smoke(fixtures / "plume.vdb")
    package = addon()

    class Views(package.job.Job):
        bl_label = "Render Views"

        def steps(self, context):
            shots = package.views.bpy_scene.shots(tmp_path / "views", views=3, size=(8, 8), samples=1)
            for done, of in shots:
                yield done, of, "views"

        def report(self, kind, text):
            pass

    before, window, job = len(bpy.data.scenes), Window(), Views()
    job.start(window)
    assert job.modal(window, event("TIMER")) == {"PASS_THROUGH"}
    assert window.status[-1] == "Cumulo: views 1 of 3    Esc: cancel"
    assert len(bpy.data.scenes) == before + 1
    assert job.modal(window, event("ESC")) == {"CANCELLED"}
    assert len(bpy.data.scenes) == before and not (tmp_path / "views" / "transforms.json").exists()
    # To the end.
    job = Views()
    job.start(window)
    while (state := job.modal(window, event("TIMER"))) == {"PASS_THROUGH"}:
        pass
    assert state == {"FINISHED"} and len(Capture.read(tmp_path / "views").frames) == 3
    assert padding.lattice(fixtures / "plume.vdb", "density")[0] == pytest.approx(
        Capture.read(tmp_path / "views").lattice
    )
