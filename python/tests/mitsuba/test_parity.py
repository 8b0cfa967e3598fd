"""Path tracing against Mitsuba 3, against closed forms, and pictures with known errors, which must be told.

`agreement` says how pictures are judged; a table of all verdicts follows the tests' output.
"""

import agreement
import fields
import numpy as np
import pytest
import sides
from scenes import DAY, SCENES, SKY, Rectangle, Scene, Sun, View

# The terrace in the light of a rectangle and the lump by day, of which wrong pictures are made.
LIT = Scene(("terrace",), 8.0, lights=(Rectangle(),))
RIGHT = SCENES["albedo 0.9"]
# What is rendered by Cumulo in place of what Mitsuba renders; each is exactly what the error named makes of the scene.
BIASED = {
    # Delta tracking by a majorant m accepts every collision where the extinction is above m, and collides no more often
    # than m says: it renders min(extinction, m) without bias. No cell of the terrace has samples on both sides of 0.6,
    # so that clamping samples clamps what is interpolated between them too.
    "majorant of 60 %": (SCENES["terrace"], SCENES["terrace"].but(fields=("clamped_terrace",))),
    # Sampling the light and sampling the phase function each see all of its light. Added without weights they see it
    # twice, at every scattering, and the camera does not see lights: the picture is that of twice the radiance.
    "light counted by both techniques": (LIT, LIT.but(lights=(Rectangle(radiance=(8.0, 10.0, 12.0)),))),
    # Light that was scattered more than five times is left out.
    "orders of scattering dropped": (RIGHT, RIGHT.but(bounces=5)),
    # A path's weight has one factor albedo x phase function for each scattering, by whichever technique. A phase function
    # that integrates to 1.02 and an albedo that is 1.02 times as large are the same factor.
    "phase function integrates to 1.02": (RIGHT, RIGHT.but(albedo=0.918)),
}
ALLOWED = agreement.threshold(sum(agreement.comparisons(scene.view.size) for scene in SCENES.values()))
# Of the inner part of the volume, for quadrature, which takes its time; and by parallel rays.
INNER = View(angle=8.0, size=8)
ORTHOGRAPHIC = View(angle=None, size=16)


def peer_of(name, scene):
    """The scene that Mitsuba renders.

    It moves rays off surfaces by 9e-5 of a world unit, whatever the size of the world, which is a tenth of the tiny volume.
    At the size of 1 the picture is the same, because densities and lights are scaled along.
    """
    return scene.scaled(1e3) if name == "tiny" else scene


def compare(table, name, ours, theirs, paths):
    """Judges and notes it in the table."""
    verdict = agreement.judge(ours, theirs, paths)
    table.append((name, verdict, ALLOWED))
    return verdict


@pytest.mark.parametrize("name", SCENES)
def test_pictures_are_those_of_mitsuba(name, renderer, table):
    scene = SCENES[name]
    theirs = sides.by_mitsuba(peer_of(name, scene))
    assert compare(table, name, renderer.render(scene), theirs, min(scene.paths)).worst < ALLOWED


@pytest.mark.parametrize("name", BIASED)
def test_biased_pictures_are_told(name, renderer, table):
    right, biased = BIASED[name]
    verdict = compare(table, f"biased: {name}", renderer.render(biased), sides.by_mitsuba(right), min(right.paths))
    # With room to spare, so that the error is not told by luck.
    assert verdict.worst > 1.5 * ALLOWED


@pytest.mark.parametrize("g", [-0.9, 0.0, 0.9])
@pytest.mark.parametrize("field", ["lump", "shell"])
def test_a_white_furnace_is_invisible(field, g, renderer):
    """What neither absorbs nor emits changes nothing about a radiance that is 1 everywhere."""
    scene = Scene((field,), albedo=1.0, g=g, sky=(1.0, 1.0, 1.0), view=View(size=16), paths=(0, 64))
    pictures = renderer.render(scene)
    assert abs(pictures[..., :3].mean() - 1.0) < 1e-4
    # Each path brings 1 home, but for the roulette, which only paths that begin with little weight play: those of camera
    # rays that are mostly let through.
    opaque = pictures[..., 3].min(axis=0) > 0.6
    assert opaque.any() and np.abs(pictures[:, opaque, :3] - 1.0).max() < 5e-5


def test_a_medium_as_warm_as_its_sky_is_invisible(renderer, table):
    """In a sky of the radiance of its source a medium emits as much as it absorbs: radiance is the source's everywhere."""
    scene = Scene(albedo=(0.2, 0.5, 0.9), g=0.5, emission=SKY, sky=SKY, view=View(size=16), paths=(0, 64))
    exact = np.broadcast_to(SKY, (1, 16, 16, 3))
    assert compare(table, "closed form: thermal equilibrium", renderer.render(scene), exact, 64).worst < ALLOWED


@pytest.mark.parametrize("field", ["slab", "ball"])
def test_single_scattering_of_a_sun_is_that_of_quadrature(field, renderer, table):
    """The integral over the camera's ray, with optical depths of the same trilinear field."""
    sun = Sun()
    towards = np.array(sun.direction) / np.linalg.norm(sun.direction)
    scene = Scene((field,), 4.0, albedo=0.8, g=0.4, lights=(sun,), bounces=1, view=INNER, paths=(0, 64))

    def radiance(steps):
        def of_rays(origin, direction):
            phase = fields.henyey_greenstein(scene.g)
            return fields.single_scattering(field, scene.density_scale, origin, direction, towards, phase, 2 * steps, steps)

        return scene.albedo * scene.view.pixel_means(of_rays)

    shade, coarse = radiance(fields.SUN_STEPS), radiance(fields.SUN_STEPS // 2)
    # The error falls by four with each halving of the step.
    assert np.abs(shade - coarse).mean() / 3 < 1e-4 * shade.mean()
    exact = (shade[..., None] * np.array(sun.irradiance))[None]
    assert compare(table, f"closed form: {field}", renderer.render(scene), exact, 64).worst < ALLOWED


@pytest.mark.parametrize("facing", [False, True], ids=["sun behind the camera", "sun before the camera"])
def test_single_scattering_along_a_line_is_a_formula(facing, renderer, table):
    """With parallel rays and a sun along them the way of light is one line, of transmittance T whatever the field.

    Back to where it came from light passes what it passed before: L = albedo p(-1) E (1 - T²) / 2. Straight on it passes
    the rest: L = albedo p(1) E T (-ln T).
    """
    view = ORTHOGRAPHIC
    backwards = view.camera.camera_to_world[:3, 2]
    direction = tuple((-backwards if facing else backwards).tolist())
    sun = Sun(direction)
    scene = Scene(albedo=0.8, g=0.4, lights=(sun,), bounces=1, view=view, paths=(0, 256))

    def radiance(origin, direction):
        depth = scene.density_scale * fields.optical_depth("lump", origin, direction, 256)
        return np.exp(-depth) * depth if facing else 0.5 * (1.0 - np.exp(-2.0 * depth))

    phase = fields.henyey_greenstein(scene.g)(1.0 if facing else -1.0)
    exact = (scene.albedo * phase * view.pixel_means(radiance)[..., None] * np.array(sun.irradiance))[None]
    name = f"closed form: sun {'before' if facing else 'behind'} the camera"
    assert compare(table, name, renderer.render(scene), exact, 256).worst < ALLOWED
