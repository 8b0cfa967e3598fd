"""Stages of `cumulo usd author` in Blender: the volume lands where its own transform puts it, frame by frame, and looks
the same."""

import pathlib
import shutil
import tempfile

import bpy
import numpy as np
import reference
from cumulo import blender
from cumulo.capture import Camera, Capture, look_at
from cumulo.cycles.materials import medium_material
from cumulo.cycles.stage import empty_scene, prepare_scene, quiet
from cumulo.exr import read_exr
from mathutils import Vector

import openvdb  # noqa: E402  Blender's own, which `cumulo.blender` brings

VIEW = Camera(look_at((3.4, 2.4, 3.1), (1, 1, 1), (0, 0, 1)), 80.0, 80.0, 30.0, 26.0, 64, 48)
FRAMES = ("plume", "cube", "slab")


def imported(stage):
    """Imports a stage into the current scene; the volume's object."""
    with quiet():
        assert bpy.ops.wm.usd_import(filepath=str(stage)) == {"FINISHED"}
    volume, = (thing for thing in bpy.data.objects if thing.type == "VOLUME")
    return volume


def test_a_sequence_lands_frame_by_frame(cumulo, fixtures, tmp_path):
    for number, name in enumerate(FRAMES, 1):
        shutil.copy(fixtures / f"{name}.vdb", tmp_path / f"smoke.{number:04}.vdb")
    cumulo("usd", "author", tmp_path / "smoke.####.vdb", "-o", tmp_path / "smoke.usda")
    # Where Blender puts the VDBs themselves: the boxes of their blocks of 8³ voxels.
    boxes = [blender.where(fixtures / f"{name}.vdb")["box"] for name in FRAMES]
    with quiet():
        bpy.ops.wm.read_factory_settings(use_empty=True)
    volume = imported(tmp_path / "smoke.usda")
    scene = bpy.context.scene
    data = volume.data
    assert data.is_sequence and (data.frame_start, data.frame_duration) == (1, 3)
    assert (scene.frame_start, scene.frame_end, scene.render.fps) == (1, 3, 24)
    for number, name in enumerate(FRAMES, 1):
        scene.frame_set(number)
        shown = volume.evaluated_get(bpy.context.evaluated_depsgraph_get())
        corners = np.array([shown.matrix_world @ Vector(corner) for corner in shown.bound_box])
        assert np.allclose([corners.min(0), corners.max(0)], boxes[number - 1], atol=1e-6), name
        # The stage's extent is that of the voxels, which lie within.
        grid, = cumulo("info", fixtures / f"{name}.vdb")["files"][0]["grids"]
        assert (corners.min(0) <= np.array(grid["world_bounds"]["min"]) + 1e-5).all()
        assert (corners.max(0) >= np.array(grid["world_bounds"]["max"]) - 1e-5).all()


def test_stages_of_blender_are_clean(cumulo, fixtures, tmp_path):
    """Nothing is wrong with what Blender's exporter writes; a frame that is deleted is missed."""
    for number, name in enumerate(FRAMES, 1):
        shutil.copy(fixtures / f"{name}.vdb", tmp_path / f"smoke.{number:04}.vdb")
    with quiet():
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
        bpy.ops.object.volume_import(
            filepath=str(tmp_path / "smoke.0001.vdb"), directory=str(tmp_path), align="WORLD",
            files=[{"name": f"smoke.{number:04}.vdb"} for number in (1, 2, 3)],
        )  # fmt: skip
        scene = bpy.context.scene
        scene.frame_start, scene.frame_end = 1, 3
        for kind in ("usda", "usdc"):
            bpy.ops.wm.usd_export(filepath=str(tmp_path / f"blender.{kind}"), export_animation=True, relative_paths=True)
    for kind in ("usda", "usdc"):
        report = cumulo("usd", "lint", tmp_path / f"blender.{kind}")
        assert report["clean"] and report["stages"][0]["findings"] == [], kind
    (tmp_path / "smoke.0002.vdb").unlink()
    report = cumulo("usd", "lint", tmp_path / "blender.usda")
    assert [finding["id"] for finding in report["stages"][0]["findings"]] == ["missing-frame"]


def test_grids_of_one_name_are_told_by_their_index(cumulo, tmp_path):
    grids = []
    for corner in ((0, 0, 0), (20, 3, -4)):
        grid = openvdb.FloatGrid()
        grid.name, grid.gridClass = "density", openvdb.GridClass.FOG_VOLUME
        grid.fill(corner, tuple(c + 5 for c in corner), 1.0)
        grids.append(grid)
    openvdb.write(str(tmp_path / "pair.vdb"), grids=grids)
    cumulo("usd", "author", tmp_path / "pair.vdb", "-o", tmp_path / "pair.usda")
    report = cumulo("usd", "lint", tmp_path / "pair.usda")
    assert report["clean"] and report["stages"][0]["findings"] == []


def test_a_volume_looks_the_same(cumulo, fixtures, tmp_path):
    shutil.copy(fixtures / "plume.vdb", tmp_path / "plume.vdb")
    settings = blender.Settings(density_scale=3.0, unbiased=True, samples=64)
    Capture([(VIEW, tmp_path / "view.exr")], model="absorption", density_scale=3.0).write(tmp_path / "transforms.json")
    cumulo("usd", "author", tmp_path / "plume.vdb", "--camera", tmp_path / "transforms.json", "-o", tmp_path / "plume.usda")
    scene = empty_scene()
    prepare_scene(scene, settings)
    volume = imported(tmp_path / "plume.usda")
    volume.data.render.precision, volume.data.render.clipping, volume.data.render.space = "FULL", 0.0, "WORLD"
    volume.data.materials.append(medium_material(settings, "density"))
    scene.camera, = (thing for thing in bpy.data.objects if thing.type == "CAMERA")
    scene.render.resolution_x, scene.render.resolution_y = VIEW.width, VIEW.height

    def transmittance(seed):
        scene.cycles.seed = seed
        with tempfile.TemporaryDirectory() as folder, quiet():
            scene.render.filepath = str(pathlib.Path(folder) / "film.exr")
            bpy.ops.render.render(write_still=True)
            return 1 - read_exr(scene.render.filepath)[..., 3]

    cumulo(
        "render", tmp_path / "plume.vdb", "--cameras", tmp_path / "transforms.json", "--supersample", 4,
        "--quadrature", "exact", "-o", tmp_path / "given",
    )  # fmt: skip
    (_, picture), = Capture.read(tmp_path / "given").frames
    wanted = 1 - read_exr(picture)[..., 3]
    assert 0.02 < wanted.min() < 0.5
    assert reference.excess(transmittance(1), transmittance(2), wanted) <= 1.0
