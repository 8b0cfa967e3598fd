"""Depth of field and motion blur of the scene's camera: the pictures are those of Cycles."""

import json
import math
import pathlib
import tempfile

import bmesh
import bpy
import numpy as np
import pytest
import reference
import smoke_scene
from cumulo import bpy_scene
from cumulo.capture import look_at
from cumulo.cycles.objects import link_object
from cumulo.exr import read_exr
from mathutils import Matrix

import openvdb  # isort: skip  `cumulo.cycles` brings it


def in_focus(scene, distance, f_stop, **options):
    """Opens the camera's aperture: the plume's extent is about 2 m, and the lens measures 50 mm."""
    dof = scene.camera.data.dof
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, distance, f_stop
    for name, value in options.items():
        setattr(dof, name, value)


def front(scene):
    in_focus(scene, 3.0, 0.05)


def blades(scene):
    in_focus(scene, 6.0, 0.05, aperture_blades=3, aperture_rotation=0.6, aperture_ratio=2.0)


def on_an_object(scene):
    scene.camera.data.lens = 80
    marker = link_object(scene, "Marker", None, np.array(Matrix.Translation((1.5, 1.0, 1.6))))
    in_focus(scene, 100.0, 0.1, focus_object=marker, aperture_blades=6)


def orthographic(scene):
    data = scene.camera.data
    data.type, data.ortho_scale = "ORTHO", 3.0
    in_focus(scene, 2.5, 1.5)


def moving(scene, position="CENTER", shutter=1.0):
    """Lets the camera move, turn and roll through the frame."""
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, shutter
    scene.render.motion_blur_position = position
    for frame, (x, roll) in enumerate(((-0.5, -0.2), (0.0, 0.0), (0.6, 0.3))):
        pose = np.array(look_at((4.2 + 0.2 * x, 3.0 + x, 2.6), (1.0, 1.0 - 0.3 * x, 1.0)))
        pose[:3, :3] = pose[:3, :3] @ np.array(Matrix.Rotation(roll, 3, "Z"))
        scene.camera.matrix_world = Matrix(pose.tolist())
        for path in ("location", "rotation_euler"):
            scene.camera.keyframe_insert(path, frame=frame)
    scene.frame_set(1)


def opening(scene):
    moving(scene, "START", 0.8)


def closing_before_a_lens(scene):
    moving(scene, "END", 0.9)
    in_focus(scene, 3.0, 0.1)


def keyed(thing, scene, poses):
    """Lets an object go through poses, (place, turn about z), at the frames 0, 1 and 2, evenly between them."""
    for frame, (place, turn) in enumerate(poses):
        thing.location, thing.rotation_euler = place, (0, 0, turn)
        for path in ("location", "rotation_euler"):
            thing.keyframe_insert(path, frame=frame)
    for curve in action_curves(thing):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    scene.frame_set(1)


def action_curves(thing):
    """The curves of an object's keys, which Blender 4.4 has put into layers."""
    action = thing.animation_data.action
    if hasattr(action, "fcurves"):
        return action.fcurves
    return [curve for layer in action.layers for strip in layer.strips for bag in strip.channelbags for curve in bag.fcurves]


def open_for(scene, shutter, position="CENTER"):
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, shutter
    scene.render.motion_blur_position = position


def smoke_that_moves(scene):
    open_for(scene, 1.0)
    keyed(scene.objects["Smoke"], scene, [((-0.4, 0, 0), -0.1), ((0, 0, 0), 0), ((0.3, 0, 0.2), 0.2)])


def smoke_that_follows(scene):
    open_for(scene, 0.8, "START")
    keyed(scene.objects["Smoke"], scene, [((-0.4, 0, 0), 0), ((0, 0, 0), 0), ((0.3, 0.3, 0.2), 0)])


def smoke_that_is_blown(scene, position="CENTER"):
    """Gives the smoke velocities, which turn it and carry it on, by about a quarter of its width. It is thin: where Cycles
    takes a place for empty before it moves, it shows less of a dense smoke than there is."""
    smoke_scene.medium_node()[0].inputs["Density"].default_value = 2.0
    volume = bpy.data.volumes["Smoke"]
    density = openvdb.read(volume.filepath, "density")
    low, high = (np.array(corner) for corner in density.evalActiveVoxelBoundingBox())
    index = np.stack(np.meshgrid(*(np.arange(a - 12, b + 13) for a, b in zip(low, high)), indexing="ij"), axis=-1)
    zero = np.array(density.transform.indexToWorld((0, 0, 0)))
    step = np.array(density.transform.indexToWorld((1, 0, 0)))[0] - zero[0]
    world = zero + step * index
    speed = np.stack([6 - 8 * (world[..., 1] - 1), 8 * (world[..., 0] - 1), 4 * world[..., 2]], axis=-1).astype(np.float32)
    velocity = openvdb.Vec3SGrid()
    velocity.name, velocity.transform = "velocity", density.transform
    velocity.copyFromArray(speed, ijk=(low - 12).tolist())
    path = pathlib.Path(tempfile.mkdtemp()) / "blown.vdb"
    openvdb.write(str(path), grids=[density, velocity])
    volume.filepath = str(path)
    volume.velocity_grid, volume.velocity_unit = "velocity", "SECOND"
    open_for(scene, 0.9, position)
    scene.frame_set(1)


def smoke_that_will_be_blown(scene):
    smoke_that_is_blown(scene, "START")


def ball_that_moves(scene):
    open_for(scene, 1.0)
    mesh, shape = bpy.data.meshes.new("Ball"), bmesh.new()
    bmesh.ops.create_icosphere(shape, subdivisions=2, radius=0.4)
    shape.to_mesh(mesh)
    shape.free()
    ball = link_object(scene, "Ball", mesh)
    keyed(ball, scene, [((1.2, 0.9, 0.5), 0), ((1.4, 1.1, 0.9), 0.3), ((1.9, 1.3, 1.0), 0.5)])
    moving(scene)


SHARP = ["--aperture", "0", "--shutter", "0"]


@pytest.mark.parametrize("change", [front, blades, on_an_object, orthographic, moving, opening, closing_before_a_lens, smoke_that_moves,
                                    smoke_that_follows, smoke_that_is_blown, smoke_that_will_be_blown, ball_that_moves])  # fmt: skip
def test_blur_is_that_of_cycles(fixtures, cumulo, cumulo_parity, tmp_path, change):
    scene = smoke_scene.smoke(fixtures / "plume.vdb", density=12.0)
    change(scene)
    exported = bpy_scene.export(tmp_path / "scene")
    assert exported.left_out == ()
    of_cycles = reference.of_cycles(
        f"blur_{change.__name__}",
        lambda seed: smoke_scene.film(scene, seed),
        [fixtures / "plume.vdb", __file__],
    )

    def rendered(seed, path, *options):
        folder = tmp_path / str(len(options)) / str(seed)
        cumulo(*exported.arguments(folder, 64), "--seed", seed, *options)
        picture = folder / f"frame.{exported.frames[0]:04}.exr"
        assert read_exr(picture)[..., :3].max() > 0.1
        return picture

    assert cumulo_parity.statistical(of_cycles, rendered)
    # Sharp pictures are others.
    with pytest.raises(pytest.fail.Exception, match="expected values differ"):
        cumulo_parity.statistical(of_cycles, lambda seed, path: rendered(seed, path, *SHARP))


def test_velocities_at_the_end_of_a_frame_are_told(fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    smoke_that_is_blown(scene, "END")
    with pytest.raises(bpy_scene.Refused, match="later time") as refused:
        bpy_scene.export(tmp_path / "out")
    assert refused.value.can_be_left_out
    exported = bpy_scene.export(tmp_path / "out", ignore=True)
    frame = json.loads(exported.cameras.read_text())["frames"][0]
    assert frame["shutter_open"] == pytest.approx(-0.9) and frame["shutter_close"] == 0
    # Without motion blur of its own the smoke stands still.
    scene.objects["Smoke"].cycles.use_motion_blur = False
    exported = bpy_scene.export(tmp_path / "still")
    assert "velocity" not in json.loads(exported.scene.read_text())["volumes"][0]


def test_apertures_and_motion_are_stated_in_the_capture(fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    blades(scene)
    moving(scene, shutter=0.5)
    bpy_scene.export(tmp_path / "scene")
    (frame,) = json.loads((tmp_path / "scene/transforms.json").read_text())["frames"]
    assert math.isclose(frame["aperture_radius"], 0.05 / (2 * 0.05), rel_tol=1e-6)
    assert (frame["focus_distance"], frame["aperture_blades"], frame["aperture_ratio"]) == (6.0, 3, 2.0)
    start, end, middle = (np.array(frame[f"transform_matrix{name}"])[:3, 3] for name in ("_start", "_end", ""))
    assert start[1] < middle[1] < end[1] and np.allclose(middle, (4.2, 3.0, 2.6), atol=1e-5)
    # A camera at rest has no motion.
    scene.camera.animation_data_clear()
    bpy_scene.export(tmp_path / "still")
    (frame,) = json.loads((tmp_path / "still/transforms.json").read_text())["frames"]
    assert not any(key.startswith("transform_matrix_") for key in frame)
    assert bpy.context.scene.frame_current == 1
