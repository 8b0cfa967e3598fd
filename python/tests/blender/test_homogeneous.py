"""Homogeneous media against closed forms: Cycles and the program each on their own."""

import numpy as np
import pytest
import reference
from cumulo import blender
from cumulo.capture import Camera, look_at

EPS = 2.0**-23

LOW, HIGH = (-0.5, -0.6, -0.7), (0.6, 0.5, 0.4)
# Turned, stretched and sheared, in the column convention.
SKEWED = np.array([[0.8, -0.6, 0.2, 0.3], [0.6, 0.8, 0.0, -0.1], [0.0, 0.1, 1.3, 0.2], [0, 0, 0, 1]])
GLOW = {"model": "emission-absorption", "emission": (0.25, 0.5, 2.0), "background": (0.75, 0.5, 0.0)}


def view(eye, target=(0.1, 0.0, 0.0), **options):
    """A camera of 48x40 pixels."""
    defaults = {"fl_x": 60.0, "fl_y": 60.0, "cx": 24.0, "cy": 20.0, "width": 48, "height": 40}
    return Camera(look_at(eye, target), **{**defaults, **options})


def closed_form(settings, depth):
    """Radiance and alpha of optical depths [...]: L = (1 - T) c + T b."""
    transmittance = np.exp(-np.asarray(depth, dtype=np.float64))[..., None]
    source = np.array(settings.emission if settings.model == "emission-absorption" else (0, 0, 0))
    color = (1 - transmittance) * source + transmittance * np.array(settings.background)
    return np.concatenate([color, 1 - transmittance], axis=-1)


@pytest.mark.parametrize("options", [{}, GLOW], ids=["absorption", "emission-absorption"])
def test_cycles_slab_face_on(options):
    settings = blender.Settings(density_scale=0.9, samples=4, **options)
    camera = view((0, 0, 3), (0, 0, 0), orthographic=True, fl_x=40.0, fl_y=40.0)
    stage = blender.Stage(settings, box=((-5, -5, -0.7), (5, 5, 0.8)))
    error = stage.picture(camera) - closed_form(settings, np.full((40, 48), 0.9 * 1.5))
    # The depth 1.35 is a difference of distances up to 3.7, each rounded to f32, so off by at most
    # 0.9 * 2 * 3.7 EPS/2; then exp and the sum with the background, in units of at most 2.
    assert np.abs(error).max() <= (0.9 * 3.7 + 4) * 2 * EPS


@pytest.mark.parametrize("options", [{}, GLOW], ids=["absorption", "emission-absorption"])
@pytest.mark.parametrize("matrix", [np.eye(4), SKEWED], ids=["upright", "skewed"])
@pytest.mark.parametrize("eye", [(3, 2.2, 1.7), (0.15, 0.1, -0.1)], ids=["outside", "inside"])
def test_cycles_box(options, matrix, eye):
    # Cycles sends a pixel's only sample through its centre.
    settings = blender.Settings(density_scale=0.8, samples=1, pixel_filter="point", **options)
    camera = view(eye, (0.3, -0.1, 0.0) if eye[0] > 1 else (-2.0, 0.4, 0.3), fl_x=40.0, fl_y=44.0, cx=21.5)
    # A ray's direction is rounded to f32 a few times; that moves it by some 8 EPS times the focal
    # length in pixels, which matters where faces are seen at a slant.
    reach = 0.5 + 8 * EPS * camera.fl_y * np.array([-1, 0, 1])
    chords = reference.box_chord(camera, LOW, HIGH, matrix, [(x, y) for x in reach for y in reach])
    assert chords.max() > 0.6
    possible = closed_form(settings, 0.8 * chords)
    picture = blender.Stage(settings, box=(LOW, HIGH, matrix)).picture(camera)
    outside = np.maximum(possible.min(0) - picture, picture - possible.max(0))
    # The depth is 0.8 times a difference of distances up to 5, and colors reach 2.
    assert outside.max() <= 2 * (0.8 * 2 * 5 + 4) * EPS


def test_cycles_pixels_are_means_over_their_squares():
    settings = blender.Settings(density_scale=0.8, samples=256)
    camera = view((3, 2.2, 1.7), fl_x=12.0, fl_y=12.0)
    stage = blender.Stage(settings, box=(LOW, HIGH))
    first, second = (1 - stage.picture(camera, seed)[..., 3] for seed in (1, 2))
    sub = (np.arange(16) + 0.5) / 16
    chords = reference.box_chord(camera, LOW, HIGH, offsets=[(x, y) for x in sub for y in sub])
    mean = np.exp(-0.8 * chords).mean(axis=0)
    assert reference.excess(first, second, mean) <= 1.0
    centres = np.exp(-0.8 * reference.box_chord(camera, LOW, HIGH)[0])
    assert reference.excess(first, second, centres) > 2.0, "point samples would be told apart"


def slab_views():
    """Cameras whose every ray enters and leaves the middle of slab.vdb (40x40x8 voxels of 0.1) through
    its faces, and the closed form of its optical depth there: the ramps outside make the sum of a
    column 8 x 0.75 voxels, divided by the ray's cosine."""
    cameras = {
        "orthographic": view((0, 0, 3), (0, 0, 0), orthographic=True, fl_x=40.0, fl_y=44.0),
        "perspective": view((0.2, -0.3, 3), (0.1, 0.1, 0), fl_x=70.0, fl_y=66.0, cx=22.0),
        "oblique": view((1.5, 0.8, 3), (0, 0, 0), fl_x=140.0, fl_y=130.0),
    }
    for name, camera in cameras.items():
        _, direction = camera.rays()
        yield name, camera, 8 * 0.1 * 0.75 / np.abs(direction[0, ..., 2])


@pytest.mark.parametrize("options", [{}, GLOW], ids=["absorption", "emission-absorption"])
def test_slab_of_voxels(fixtures, expected, options):
    settings = blender.Settings(density_scale=2.0, **options)
    for name, camera, depth in slab_views():
        picture = expected(fixtures / "slab.vdb", camera, settings)
        # Ten cells to sum, each rounded a few times, and a color of at most 2.
        assert np.abs(picture - closed_form(settings, 2.0 * depth)).max() <= 64 * EPS, name


def test_cycles_slab_of_voxels(fixtures):
    settings = blender.Settings(density_scale=2.0, samples=16, step_rate=0.1, pixel_filter="point")
    stage = blender.Stage(settings, fixtures / "slab.vdb")
    for name, camera, depth in slab_views():
        first, second = (1 - stage.picture(camera, seed)[..., 3] for seed in (1, 2))
        assert reference.excess(first, second, np.exp(-2.0 * depth), settings.samples) <= 1.0, name
