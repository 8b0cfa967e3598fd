"""The surfaces of gradient shading and their reflection, against Mitsuba's distribution of microfacets.

None of Mitsuba's surfaces has this form: its conductors mask and shadow independently and by another Fresnel's
formula, and its plastics refract what they leave to the diffuse part. So the lobe is composed here of Mitsuba's GGX
distribution D and of its masking G1 by Smith, of which the height-correlated masking and shadowing of both ways is
made: G = 1 / (1 + Λ + Λ') with Λ = 1 / G1 - 1. Schlick's Fresnel, the lobe's directional albedo and the diffuse part
that is left (Kelemen & Szirmay-Kalos) are plain quadrature. What a volume of such surfaces scatters once out of a sun
is an integral along the camera's ray, of the same trilinear field and of its differences over a voxel to each side,
so that there is no surface to be approached and nothing to allow but the noise.
"""

import functools

import agreement
import fields
import mitsuba as mi
import numpy as np
import pytest
from scenes import Scene, Sun, Surface, View
from scipy.interpolate import CubicSpline

VIEW = View(angle=8.0, size=8)
STEPS = 192
ALBEDO = (0.1, 0.5, 0.9)


def surface(field, specular, roughness, half=4.0, **changes):
    """A field whose surfaces reflect, in the light of a sun."""
    light = Sun(changes.pop("sun", (-0.9, -0.5, 0.8)))
    return Scene((field,), 12.0, albedo=ALBEDO, g=0.4, lights=(light,), bounces=1, view=VIEW, paths=(0, 128),
                 surface=Surface(half, specular, roughness))  # fmt: skip


SURFACES = {
    "matt": surface("lump", None, 0.3),
    "plastic": surface("lump", 0.04, 0.3),
    "metal": surface("lump", 0.9, 0.3),
    "sharp": surface("lump", 0.5, 0.15),
    "rough": surface("lump", 0.9, 0.9),
    "grazing": surface("lump", 0.3, 0.4, sun=(1.0, 0.7, -0.4)),
    "edge": surface("ball", 0.5, 0.3, half=1.0),
}
# What is rendered by Cumulo in place of the surface.
CHANGES = {"rougher": Surface(4.0, 0.9, 0.33), "less": Surface(4.0, 0.85, 0.3),
           "less of a surface": Surface(4.4, 0.9, 0.3)}  # fmt: skip
ALLOWED = agreement.threshold(agreement.comparisons(VIEW.size) * (len(SURFACES) + 3))


@functools.cache
def lobe_of(surface):
    """The lobes of a surface, prepared once."""
    return Lobe(surface)


class Lobe:
    """The specular lobe and the diffuse one beneath it, by cosines with the normal."""

    def __init__(self, surface):
        self.specular = surface.specular
        given = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, surface.roughness, True)
        angles = np.linspace(0.0, 0.5 * np.pi, 2001)[:-1]
        directions = [mi.Vector3f(float(np.sin(a)), 0.0, float(np.cos(a))) for a in angles]
        up = mi.Vector3f(0.0, 0.0, 1.0)
        distribution = CubicSpline(angles, [given.eval(direction) for direction in directions])
        masking = CubicSpline(angles, [given.smith_g1(direction, up) for direction in directions])
        self.distribution = lambda cosine: distribution(np.arccos(np.clip(cosine, -1, 1)))
        self.lambda_of = lambda cosine: 1 / masking(np.arccos(np.clip(cosine, 1e-3, 1))) - 1
        nodes, weights = np.polynomial.legendre.leggauss(64)
        self.nodes = 0.5 * (nodes + 1)
        self.albedos = CubicSpline(self.nodes, [self.integrated(cosine) for cosine in self.nodes])
        self.mean = (weights * self.nodes * self.albedos(self.nodes)).sum()

    def value(self, incident, reflected, normal, on_normal):
        """The lobe times the cosine of reflection."""
        if self.specular is None:
            return np.zeros_like(reflected * on_normal)
        fresnel = self.specular + (1 - self.specular) * (1 - on_normal) ** 5
        both = 1 / (1 + self.lambda_of(incident) + self.lambda_of(reflected))
        return fresnel * self.distribution(normal) * both / (4 * incident)

    def integrated(self, cosine):
        """The share of light of this cosine that is reflected, by quadrature over the microfacets' normals."""
        x, y = [(np.arange(400) + 0.5) / 400] * 2
        # Dense where the distribution of a smooth surface is.
        angle, turn = np.meshgrid(0.5 * np.pi * x**2, 2 * np.pi * y)
        half = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)])
        on_normal = half[0] * np.sqrt(1 - cosine**2) + half[2] * cosine
        reflected = 2 * on_normal * half[2] - cosine
        seen = (on_normal > 0) & (reflected > 0)
        value = self.value(cosine, np.where(seen, reflected, 1.0), half[2], on_normal)
        # A solid angle about the normal is a fourth of that about the reflection, over the cosine between.
        solid = np.sin(angle) * np.pi * np.sqrt(angle / (0.5 * np.pi)) * 2 * np.pi / 400**2
        return np.where(seen, value * 4 * on_normal * solid, 0.0).sum()

    def diffuse(self, incident, reflected):
        """The diffuse lobe times the cosine of reflection, at an albedo of 1."""
        left = (1 - self.albedos(incident)) * (1 - self.albedos(reflected)) / (1 - self.mean)
        return left * reflected / np.pi


def gradient(field, places):
    """Differences over a voxel to each side, by world length."""
    voxel = 1 / fields.density(field).shape[0]
    return np.stack([(fields.at(field, places + step) - fields.at(field, places - step)) / (2 * voxel)
                     for step in voxel * np.eye(3)], axis=-1)  # fmt: skip


def scattered(scene, places, direction, towards):
    """What is scattered out of a camera ray's direction towards the sun, per steradian and channel."""
    slope = gradient(scene.fields[0], places)
    length = np.linalg.norm(slope, axis=-1)
    share = length**2 / (length**2 + scene.surface.half**2)
    normal = slope / np.maximum(length, 1e-30)[..., None]
    incident = -(normal * direction[..., None, :]).sum(axis=-1)
    facing = np.where(incident < 0, -1.0, 1.0)
    incident, reflected = np.abs(incident), facing * (normal @ towards)
    half = towards - direction
    half = (half / np.linalg.norm(half, axis=-1, keepdims=True))[..., None, :]
    on_half, on_normal = facing * (normal * half).sum(axis=-1), (half @ towards)
    phase = fields.henyey_greenstein(scene.g)(direction @ towards)[..., None]
    lit = (reflected > 0) & (incident > 0)
    incident, reflected = np.where(lit, np.maximum(incident, 1e-6), 1.0), np.where(lit, reflected, 1.0)
    lobe = lobe_of(scene.surface)
    matt = (1 - share) * phase + np.where(lit, share * lobe.diffuse(incident, reflected), 0.0)
    shine = np.where(lit & (on_half > 0), share * lobe.value(incident, reflected, on_half, on_normal), 0.0)
    return np.array(ALBEDO) * matt[..., None] + shine[..., None]


def exact(scene, steps=STEPS):
    """Means over the pixels, [1, height, width, channel]."""
    sun = scene.lights[0]
    towards = np.array(sun.direction) / np.linalg.norm(sun.direction)

    def radiance(origin, direction):
        places, densities, step = fields.along(scene.fields[0], origin, direction, steps)
        extinction = scene.density_scale * densities
        depth = (np.cumsum(extinction, axis=-1) - 0.5 * extinction) * step[..., None]
        to_sun = fields.optical_depth(scene.fields[0], places, np.broadcast_to(towards, places.shape), steps // 2)
        weight = extinction * np.exp(-depth - scene.density_scale * to_sun) * step[..., None]
        return (weight[..., None] * scattered(scene, places, direction, towards)).sum(axis=-2)

    return (scene.view.pixel_means(radiance) * np.array(sun.irradiance))[None]


@functools.cache
def expected(scene):
    """The exact picture, and the relative error of its mean: it falls by four with each halving of the step."""
    right, coarse = exact(scene), exact(scene, STEPS // 2)
    return right, abs(right.mean() - coarse.mean()) / 3 / right.mean()


def compare(table, name, ours, right, paths):
    """Judges and notes it in the table."""
    verdict = agreement.judge(ours, right, paths)
    table.append((f"surface: {name}", verdict, ALLOWED))
    return verdict


@pytest.mark.parametrize("name", SURFACES)
def test_surfaces_reflect_by_the_microfacets_of_mitsuba(name, renderer, table):
    scene = SURFACES[name]
    right, error = expected(scene)
    ours = renderer.render(scene)
    assert compare(table, name, ours, right, scene.paths[1]).worst < ALLOWED
    # Quadrature errs by less than the noise of the whole picture.
    means = ours[..., :3].mean(axis=(1, 2, 3))
    noise = means.std(ddof=1) / np.sqrt(len(means)) / means.mean()
    print(f"noise {noise:.1e}, quadrature {error:.1e}")
    assert error < 0.5 * noise < 0.005


@pytest.mark.parametrize("name", CHANGES)
def test_other_surfaces_are_told(name, renderer, table):
    scene = SURFACES["metal"]
    ours = renderer.render(scene.but(surface=CHANGES[name]))
    assert compare(table, f"metal, {name}", ours, expected(scene)[0], scene.paths[1]).worst > 1.5 * ALLOWED


@pytest.mark.parametrize("name", ["plastic", "metal", "rough"])
def test_white_surfaces_in_a_white_sky_are_invisible(name, renderer, table):
    """At an albedo of 1 the diffuse lobe scatters all that the reflection leaves, however often."""
    white = SURFACES[name].but(albedo=1.0, lights=(), sky=(1.0, 1.0, 1.0), bounces=None, paths=(0, 64))
    assert compare(table, f"{name}, furnace", renderer.render(white), np.ones((1, 8, 8, 3)), 64).worst < ALLOWED
