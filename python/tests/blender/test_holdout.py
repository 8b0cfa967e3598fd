"""Holdouts: a picture of a volume before the depths of Blender's objects is the one in which Cycles holds them out."""

import bpy
import pytest
import reference
import smoke_scene
from cumulo import bpy_scene
from cumulo.cycles.objects import box_mesh
from cumulo.cycles.stage import quiet
from cumulo.exr import read_exr

FINER = 4


def blocks(scene):
    """Two boxes, one before the middle of the plume and one in it, that hide what is behind them and nothing else."""
    made = [box_mesh(scene, *corners) for corners in (((1.4, 0.2, 0.4), (2.4, 0.9, 1.6)), ((0.6, 1.0, 0.9), (1.2, 1.5, 2.0)))]
    for box in made:
        for kind in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
            setattr(box, f"visible_{kind}", False)
    return made


def hold_out(scene, made, held):
    """Lets the boxes hold the smoke out, or be seen without it."""
    scene.objects["Smoke"].hide_render = not held
    for box in made:
        box.is_holdout = held


def render_depths(scene, path):
    """Writes the scene's pass Depth, in more pixels than its pictures, as Blender does."""
    layer, render, image = scene.view_layers[0], scene.render, scene.render.image_settings
    layer.use_pass_z, samples, percentage = True, scene.cycles.samples, render.resolution_percentage
    scene.cycles.samples, render.resolution_percentage = 1, 100 * FINER
    image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format, image.color_depth = "OPEN_EXR_MULTILAYER", "32"
    with quiet():
        render.filepath = str(path)
        bpy.ops.render.render(write_still=True)
    scene.cycles.samples, render.resolution_percentage = samples, percentage


def write_mesh(made, path):
    """Writes the boxes as one mesh, in Blender's world."""
    bpy.ops.object.select_all(action="DESELECT")
    for box in made:
        box.select_set(True)
    bpy.ops.wm.ply_export(filepath=str(path), export_selected_objects=True, forward_axis="Y", up_axis="Z")


def test_a_holdout_is_that_of_cycles(fixtures, cumulo, cumulo_parity, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb", density=8.0)
    exported = bpy_scene.export(tmp_path / "scene")
    made = blocks(scene)
    depth = tmp_path / "depth.exr"
    hold_out(scene, made, False)
    render_depths(scene, depth)
    mesh = tmp_path / "boxes.ply"
    write_mesh(made, mesh)
    hold_out(scene, made, True)
    of_cycles = reference.of_cycles(
        "holdout", lambda seed: smoke_scene.film(scene, seed), [fixtures / "plume.vdb", __file__]
    )

    def rendered(seed, path, *options):
        folder = tmp_path / str(len(options)) / str(seed)
        cumulo(*exported.arguments(folder, 64), "--seed", seed, *options)
        picture = folder / f"frame.{exported.frames[0]:04}.exr"
        assert read_exr(picture)[..., :3].max() > 0.1
        return picture

    assert cumulo_parity.statistical(of_cycles, lambda seed, path: rendered(seed, path, "--holdout", depth))
    assert cumulo_parity.statistical(of_cycles, lambda seed, path: rendered(seed, path, "--holdout", mesh, "--quiet"))
    with pytest.raises(pytest.fail.Exception, match="expected values differ"):
        cumulo_parity.statistical(of_cycles, rendered)
