"""Cycles against plain sums and against the program: all kinds of camera, all kinds of transform.

Cycles marches with a tenth of a voxel and gathers within 0.005 pixels of each centre, so that its
pictures are point samples with little noise; two seeds tell how much (`reference.excess`).
"""

import dataclasses

import numpy as np
import pytest
import reference
from cumulo import blender, padding
from cumulo.capture import Camera, look_at, sphere_cameras

SAMPLES = 16


def camera(eye, width=40, height=32, target=(1.0, 1.0, 1.0), **options):
    """A camera at the plume (a box from 0 to 2, up is z) that sees all of it."""
    defaults = {"fl_x": 44.0, "fl_y": 44.0, "cx": width / 2, "cy": height / 2}
    return Camera(look_at(eye, target, (0, 0, 1)), width=width, height=height, **{**defaults, **options})


CAMERAS = {
    "perspective": camera((3.6, 2.2, 2.9)),
    "shifted": camera((3.6, 2.2, 2.9), cx=15.25, cy=21.5),
    "wide pixels": camera((3.6, 2.2, 2.9), fl_x=30.0, cx=18.0),
    "tall pixels": camera((3.6, 2.2, 2.9), fl_y=28.0, cy=12.5),
    "tall picture": camera((3.6, 2.2, 2.9), width=24, height=48, fl_x=50.0, fl_y=52.0),
    "from above": camera((1.2, 5.0, 0.9)),
    "orthographic": camera((3.0, 2.2, 4.0), fl_x=12.0, fl_y=12.0, orthographic=True),
    "orthographic, shifted, tall pixels": camera((3.0, 2.2, 4.0), fl_x=14.0, fl_y=9.0, cx=24.0, cy=13.75, orthographic=True),
    "inside": camera((1.02, 1.2, 0.96), target=(0.2, 1.9, 0.1), fl_x=25.0, fl_y=25.0),
}


def render_twice(stage, view):
    """The picture by two seeds."""
    return stage.picture(view, seed=1), stage.picture(view, seed=2)


def test_every_camera_sees_the_plume_alike(fixtures, expected, subtests):
    vdb = fixtures / "plume.vdb"
    settings = blender.Settings(density_scale=6.0, samples=SAMPLES, step_rate=0.1, pixel_filter="point")
    stage = blender.Stage(settings, vdb)
    for name, view in CAMERAS.items():
        with subtests.test(name):
            first, second = (picture[..., 3] for picture in render_twice(stage, view))
            wanted = expected(vdb, view, settings)[..., 3]
            assert wanted.max() > 0.5, "the plume is in the picture"
            assert reference.excess(1 - first, 1 - second, 1 - wanted, SAMPLES) <= 1.0


def test_the_near_plane_cuts_alike(fixtures, expected):
    vdb, view = fixtures / "plume.vdb", CAMERAS["inside"]
    settings = blender.Settings(density_scale=6.0, samples=SAMPLES, step_rate=0.1, pixel_filter="point", near=0.3)
    first, second = (picture[..., 3] for picture in render_twice(blender.Stage(settings, vdb), view))
    wanted = expected(vdb, view, settings)[..., 3]
    assert reference.excess(1 - first, 1 - second, 1 - wanted, SAMPLES) <= 1.0
    uncut = reference.optical_depth(vdb, "density", view)
    assert np.abs(np.exp(-6.0 * uncut) - (1 - wanted)).max() > 0.05, "the plane does cut something off"


@pytest.mark.parametrize("name", ["blob_sheared", "blob_stretched", "tiles", "cube"])
def test_every_transform_is_placed_alike(fixtures, expected, name):
    vdb = fixtures / f"{name}.vdb"
    view = sphere_cameras(5, *padding.world_box(*padding.lattice(vdb, "density")), 40, 40)[1]
    depth = reference.optical_depth(vdb, "density", view)
    # The thickest part lets a twentieth of the light through.
    settings = blender.Settings(density_scale=3.0 / depth.max(), samples=SAMPLES, step_rate=0.1, pixel_filter="point")
    first, second = (picture[..., 3] for picture in render_twice(blender.Stage(settings, vdb), view))
    wanted = expected(vdb, view, settings)[..., 3]
    assert reference.excess(1 - first, 1 - second, 1 - wanted, SAMPLES) <= 1.0


def test_a_wrong_camera_would_be_found(fixtures):
    """The judge itself: a tenth of a pixel, or a density 0.5 % off, is seen."""
    vdb, view = fixtures / "plume.vdb", CAMERAS["perspective"]
    settings = blender.Settings(density_scale=6.0, samples=SAMPLES, step_rate=0.1, pixel_filter="point")
    first, second = (1 - picture[..., 3] for picture in render_twice(blender.Stage(settings, vdb), view))
    moved = dataclasses.replace(view, cx=view.cx + 0.1)
    shifted = np.exp(-6.0 * reference.optical_depth(vdb, "density", moved))
    thicker = np.exp(-6.03 * reference.optical_depth(vdb, "density", view))
    assert reference.excess(first, second, shifted, SAMPLES) > 2.0
    assert reference.excess(first, second, thicker, SAMPLES) > 2.0
