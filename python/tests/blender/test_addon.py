"""The extension in Blender without a window: every operator on a real scene, and what it says when something is wrong."""

import base64
import functools
import hashlib
import importlib
import json
import os
import pathlib
import platform
import re
import shlex
import subprocess
import sys
import threading
import time
import tomllib
import types
import zipfile

import bpy
import numpy as np
import pytest
import reference
import smoke_scene
from cumulo import __version__, padding
from cumulo.capture import Capture
from cumulo.cycles.objects import box_mesh
from cumulo.cycles.stage import quiet
from cumulo.exr import read_exr
from mathutils import Vector

ADDON = pathlib.Path(__file__).resolve().parents[2] / "addon"
NAME = "bl_ext.cumulo_test.cumulo"
TOOL = pathlib.Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A wheel of the package as it is beside these tests, with its native module."""
    package = ADDON.parent / "cumulo"
    contents = {
        path.relative_to(ADDON.parent).as_posix(): path.read_bytes()
        for path in sorted(package.rglob("*"))
        if path.is_file() and "__pycache__" not in path.parts
    }
    tags, about = f"cp311-abi3-linux_{platform.machine()}", f"cumulo-{__version__}.dist-info"
    contents[f"{about}/METADATA"] = f"Metadata-Version: 2.1\nName: cumulo\nVersion: {__version__}\n".encode()
    contents[f"{about}/WHEEL"] = f"Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: false\nTag: {tags}\n".encode()
    hashes = {name: base64.urlsafe_b64encode(hashlib.sha256(content).digest()) for name, content in contents.items()}
    record = [f"{name},sha256={hashes[name].decode().rstrip('=')},{len(content)}" for name, content in contents.items()]
    contents[f"{about}/RECORD"] = "\n".join([*record, f"{about}/RECORD,,\n"]).encode()
    target = tmp_path_factory.mktemp("wheel") / f"cumulo-{__version__}-{tags}.whl"
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
        for name, content in contents.items():
            file.writestr(name, content)
    return target


def build(target, wheel):
    """Runs what `make addon` runs."""
    command = [sys.executable, ADDON / "build.py", target, "--wheel", wheel]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def archive(wheel, tmp_path_factory):
    """The installable .zip, as `make addon` builds it."""
    target = tmp_path_factory.mktemp("addon") / "cumulo.zip"
    done = build(target, wheel)
    assert done.returncode == 0 and done.stdout == f"{target}\n", done.stderr
    return target


@pytest.fixture(scope="module")
def installed(archive, tmp_path_factory):
    """The folder of a repository of extensions with the archive in it."""
    folder = tmp_path_factory.mktemp("extensions")
    with pytest.MonkeyPatch.context() as patch:
        # Where Blender unpacks wheels; not the user's.
        patch.setenv("BLENDER_USER_EXTENSIONS", str(tmp_path_factory.mktemp("wheels")))
        _repository(folder)
        with quiet():
            bpy.ops.extensions.package_install_files(filepath=str(archive), repo="cumulo_test", enable_on_install=False)
        assert (folder / "cumulo" / "blender_manifest.toml").is_file()
        yield folder


def _repository(folder):
    repositories = bpy.context.preferences.extensions.repos
    for repository in list(repositories):
        if repository.module == "cumulo_test":
            repositories.remove(repository)
    repositories.new(name="Cumulo's test", module="cumulo_test", custom_directory=str(folder), source="USER")


@pytest.fixture
def addon(installed):
    """Function that switches the extension on in the present session (a new scene ends it)."""

    def enable():
        _repository(installed)
        bpy.ops.preferences.addon_enable(module=NAME)
        return importlib.import_module(NAME)

    yield enable
    if NAME in bpy.context.preferences.addons:
        bpy.ops.preferences.addon_disable(module=NAME)


def test_the_archive_is_valid_and_the_same_each_time(archive, wheel, tmp_path):
    done = subprocess.run([sys.executable, TOOL, "validate", archive], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert build(tmp_path / "again.zip", wheel).returncode == 0
    assert (tmp_path / "again.zip").read_bytes() == archive.read_bytes()
    crate = tomllib.loads((ADDON.parents[1] / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    with zipfile.ZipFile(archive) as file:
        names, manifest = file.namelist(), tomllib.loads(file.read("blender_manifest.toml").decode())
        assert file.read(f"wheels/{wheel.name}") == wheel.read_bytes()
    assert crate == __version__ == manifest["version"]
    assert manifest["wheels"] == [f"./wheels/{wheel.name}"] and manifest["platforms"] == ["linux-x64"]
    assert "blender_manifest.toml" in names and not {"build.py", "screenshot.py"} & set(names)


def test_a_wheel_that_is_not_the_packages_is_refused(tmp_path):
    for name, expected in (
        (f"cumulo-{__version__}-py3-none-any.whl", "its name is none of a wheel of cumulo with a native module"),
        ("cumulo-0.0.9-cp311-abi3-linux_x86_64.whl", f"it is of version 0.0.9, and the extension of {__version__}"),
        (f"cumulo-{__version__}-cp311-abi3-linux_x86_64.whl", "No such file"),
    ):
        done = build(tmp_path / "a.zip", tmp_path / name)
        assert done.returncode == 1 and done.stderr.startswith("error: ") and expected in done.stderr, done.stderr
    assert not (tmp_path / "a.zip").exists()


INSTALLS = """
import sys
import bpy
archive, vdb, out = sys.argv[1:]
repositories = bpy.context.preferences.extensions.repos
repositories.new(name="Test", module="test", custom_directory=out + "/repository", source="USER")
bpy.ops.extensions.package_install_files(filepath=archive, repo="test", enable_on_install=True)
import cumulo
print(cumulo.__file__)
try:
    bpy.ops.cumulo.reconstruct(capture=out + "/none", output=out + "/found.vdb")
except RuntimeError as refused:
    print(refused)
cumulo.render(vdb, out + "/views", views=4, size=(24, 24), density_scale="auto")
print(bpy.ops.cumulo.reconstruct(capture=out + "/views", output=out + "/found.vdb", resolution=12))
print([thing.name for thing in bpy.context.scene.objects if thing.type == "VOLUME"])
"""


def test_blender_installs_the_package_with_the_extension(archive, fixtures, tmp_path):
    """In a process of its own, which does not know the package."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    environment["BLENDER_USER_EXTENSIONS"] = str(tmp_path / "extensions")
    done = subprocess.run(
        [sys.executable, "-P", "-c", INSTALLS, archive, fixtures / "plume.vdb", tmp_path], cwd=tmp_path,
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    place = tmp_path / "extensions" / ".local"
    assert str(place) in done.stdout and "none: No such file" in done.stdout, done.stdout
    assert done.stdout.splitlines()[-2:] == ["{'FINISHED'}", "['found']"], done.stdout + done.stderr


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


def test_what_is_not_supported_is_left_out_and_reported(addon, fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    addon()
    box_mesh(scene, (3, 3, 3), (4, 4, 4)).data.shade_smooth()
    scene.render.use_motion_blur, scene.cycles.rolling_shutter_type = True, "TOP"
    with pytest.raises(RuntimeError) as refused:
        bpy.ops.cumulo.export_scene(folder=str(tmp_path))
    for words in ("object 'box'", "rolling shutter", "Leave Out What Is Not Supported leaves out 2 of these 2"):
        assert words in str(refused.value)
    bpy.ops.cumulo.export_scene(folder=str(tmp_path), ignore=True)
    assert len(json.loads((tmp_path / "scene.json").read_text())["left_out"]) == 2


def test_what_cumulo_refuses_is_reported(addon, fixtures, tmp_path):
    smoke_scene.smoke(fixtures / "plume.vdb")
    addon()
    with pytest.raises(RuntimeError) as refused:
        bpy.ops.cumulo.reconstruct(capture=str(tmp_path / "none"), output=str(tmp_path / "out.vdb"))
    assert "none: No such file" in str(refused.value) and "a capture is a transforms.json" in str(refused.value)
    (tmp_path / "transforms.json").write_text("{}")
    with pytest.raises(RuntimeError, match="transforms.json"):
        bpy.ops.cumulo.reconstruct(capture=str(tmp_path), output=str(tmp_path / "out.vdb"))
    # And nothing of it is left.
    assert bpy.ops.cumulo.reconstruct.poll() and not working_threads()


def working_threads():
    """Threads of the extension that work."""
    return [thread for thread in threading.enumerate() if thread.name == "cumulo"]


def long_render(vdb, folder):
    """Words of a command that would render for minutes."""
    return ["render", vdb, "--views", 1, "--size", "256x256", "--albedo", 0.99, "--density-scale", 50, "--sky", "1,1,1",
            "--samples", 65536, "-o", folder]  # fmt: skip


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


def test_esc_ends_the_work_and_the_progress(addon, fixtures, tmp_path):
    smoke_scene.smoke(fixtures / "plume.vdb")
    package = addon()
    words, window = long_render(fixtures / "plume.vdb", tmp_path / "out"), Window()
    job = working(package, lambda: package.work.run(words))
    assert job.start(window) == {"RUNNING_MODAL"}
    assert not bpy.ops.cumulo.reconstruct.poll()
    end = time.monotonic() + 60
    while not any(re.fullmatch("Cumulo: render [0-9]+%    Esc: cancel", text or "") for text in window.status):
        assert time.monotonic() < end, window.status
        # Ticks go on to the operators of others.
        assert job.modal(window, event("TIMER")) == {"PASS_THROUGH"}
        time.sleep(0.02)
    assert job.modal(window, event("MOUSEMOVE")) == {"PASS_THROUGH"} and working_threads()
    start = time.monotonic()
    assert job.modal(window, event("ESC")) == {"CANCELLED"}
    # At once, but for a machine that has more to do.
    assert time.monotonic() - start < 3 and not working_threads()
    assert job.reports == [({"WARNING"}, "Work was cancelled")]
    assert window.shown[-1] == "end" and window.status[-1] is None
    assert not list(tmp_path.rglob("*.exr")) and bpy.ops.cumulo.reconstruct.poll()


def test_work_waits_for_stopped_work_that_has_not_ended(addon, fixtures, tmp_path, monkeypatch):
    package = addon()
    monkeypatch.setattr(package.work, "PATIENCE", 0.0)
    go_on = threading.Event()
    monkeypatch.setattr(package.work.cumulo, "call", lambda *words, progress: go_on.wait(60) and {"words": words})
    steps = package.work.run(["first"])
    next(steps)
    steps.close()
    assert len(working_threads()) == 1
    steps = package.work.run(["second"])
    assert next(steps) == (0, 0, "the work before ends") and isinstance(next(steps), package.work.Waiting)
    go_on.set()
    with pytest.raises(StopIteration) as ended:
        while next(steps):
            time.sleep(0.01)
    assert ended.value.value == {"words": ("second",)}


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
    words, window = long_render(fixtures / "plume.vdb", tmp_path / "out"), Window()
    job = working(package, lambda: package.work.run(words))
    job.start(window)
    # Blender's own window manager takes no timer of a stand-in.
    monkeypatch.setattr(package.job.Job, "stop", staticmethod(lambda _, stop=package.job.Job.stop: stop(window)))
    job.modal(window, event("TIMER"))
    assert working_threads()
    bpy.ops.preferences.addon_disable(module=NAME)
    assert not working_threads()
    assert package.job.Job.active is None and window.shown[-1] == "end" and window.status[-1] is None
    addon()
    assert bpy.ops.cumulo.reconstruct.poll()


def test_animations_are_exported_frame_by_frame(addon, fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    smoke_scene.orbit(scene, (1, 2, 3))
    package = addon()
    job = working(package, lambda: package.export.ExportScene.steps(job, bpy.context))
    job.folder, job.animation, job.ignore, window = str(tmp_path / "it's here"), True, False, Window()
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
