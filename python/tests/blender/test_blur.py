"""Depth of field and motion blur of the scene's camera: the pictures are those of Cycles."""

import json
import math

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


SHARP = ["--aperture", "0", "--shutter", "0"]


@pytest.mark.parametrize("change", [front, blades, on_an_object, orthographic, moving, opening, closing_before_a_lens])
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
