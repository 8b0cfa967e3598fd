"""Densities in the unit cube, the same function for both programs, and plain quadrature through them.

A field is an array [z, y, x] of samples at the centres of the cells of the unit cube, trilinear in between. Its
outermost samples are 0: Mitsuba goes on with them up to the faces of the cube, where its medium ends, and OpenVDB has a
background of 0, so that both see the same function everywhere.
"""

import functools

import numpy as np
from scipy import ndimage

CELLS = 16
# Steps of the quadrature along the camera's ray, and along each ray to the sun: about twelve and six a cell.
STEPS, SUN_STEPS = 192, 96
# Points along the edge of a pixel over which closed forms are averaged.
POINTS = 6


def points(cells=CELLS):
    """Coordinates x, y and z of the samples, [z, y, x] each."""
    axis = (np.arange(cells) + 0.5) / cells
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    return x, y, z


def distance(x, y, z, centre):
    """Distances from a centre."""
    return np.sqrt(sum((p - c) ** 2 for p, c in zip((x, y, z), centre)))


def lump():
    """A lump with a dent, a knob beside it and ripples: no two directions are alike."""
    x, y, z = points()
    body = np.clip(1.3 - 7.0 * distance(x, y, z, (0.55, 0.45, 0.5)) ** 2, 0.0, 1.0)
    dent = np.clip(1.0 - 5.0 * distance(x, y, z, (0.35, 0.3, 0.75)), 0.0, 1.0)
    knob = np.clip(1.0 - 6.0 * distance(x, y, z, (0.25, 0.75, 0.3)), 0.0, 1.0)
    ripples = 1.0 + 0.3 * np.sin(17.0 * x) * np.sin(13.0 * y + 1.0) * np.sin(15.0 * z + 2.0)
    return (0.7 * body * (1.0 - 0.8 * dent) + 0.5 * knob) * ripples


def core():
    """A dense ball in a thin one, a hundred times as dense."""
    away = distance(*points(), (0.5, 0.5, 0.5))
    return np.where(away < 0.3, 1.0, np.where(away < 0.42, 0.01, 0.0))


def shell():
    """A spherical shell as thin as a cell."""
    return np.where(np.abs(distance(*points(24), (0.5, 0.5, 0.5)) - 0.36) < 0.5 / 24, 1.0, 0.0)


def ball():
    """A ball of constant density, of voxels."""
    return np.where(distance(*points(), (0.5, 0.5, 0.5)) < 0.38, 1.0, 0.0)


def slab():
    """A box of constant density, wide and flat."""
    field = np.zeros((CELLS,) * 3)
    field[5:11, 1:-1, 1:-1] = 1.0
    return field


def terrace():
    """A box of density 1 inside one of density 0.6: no cell has both a sample of 0 and one of 1."""
    field = np.zeros((CELLS,) * 3)
    field[2:14, 2:14, 2:14] = 0.6
    field[4:12, 3:11, 4:12] = 1.0
    return field


def clamped_terrace():
    """`terrace` clamped at 0.6, between its samples as well: each cell is above 0.6 as a whole or not at all."""
    return np.minimum(terrace(), 0.6)


FIELDS = {f.__name__: f for f in (lump, core, shell, ball, slab, terrace, clamped_terrace)}


@functools.cache
def density(name):
    """A field by its name, f32."""
    field = FIELDS[name]().astype(np.float32)
    for axis in range(3):
        ends = np.moveaxis(field, axis, 0)
        ends[0] = ends[-1] = 0.0
    return field


def at(name, place):
    """Densities at places [..., 3], f64; 0 outside the cube."""
    field = density(name)
    index = np.stack([place[..., axis] * field.shape[0] - 0.5 for axis in (2, 1, 0)])
    return ndimage.map_coordinates(field.astype(np.float64), index, order=1, mode="nearest")


def chord(origin, direction):
    """Where rays enter and leave the unit cube."""
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (0.0 - origin) / direction, (1.0 - origin) / direction
    enter = np.maximum(np.nanmax(np.minimum(first, second), axis=-1), 0.0)
    leave = np.nanmin(np.maximum(first, second), axis=-1)
    return enter, np.maximum(leave, enter)


def along(name, origin, direction, steps):
    """Places, densities and step lengths at the middle of equal steps along rays through the cube."""
    enter, leave = chord(origin, direction)
    step = (leave - enter) / steps
    distances = enter[..., None] + step[..., None] * (np.arange(steps) + 0.5)
    places = origin[..., None, :] + distances[..., None] * direction[..., None, :]
    return places, at(name, places), step


def optical_depth(name, origin, direction, steps=STEPS):
    """Optical depth of rays at an extinction of 1 per unit of density."""
    _, densities, step = along(name, origin, direction, steps)
    return densities.sum(axis=-1) * step


def single_scattering(name, scale, origin, direction, sun, phase, steps=STEPS, sun_steps=SUN_STEPS):
    """Radiance that is scattered once out of a sun of irradiance 1, at an albedo of 1, along rays."""
    places, densities, step = along(name, origin, direction, steps)
    extinction = scale * densities
    depth = (np.cumsum(extinction, axis=-1) - 0.5 * extinction) * step[..., None]
    depth_to_sun = scale * optical_depth(name, places, np.broadcast_to(sun, places.shape), sun_steps)
    value = phase(direction @ sun)
    return value * (extinction * np.exp(-depth - depth_to_sun)).sum(axis=-1) * step


def henyey_greenstein(g):
    """The phase function of the cosine between the directions of flight before and after."""
    return lambda cosine: (1.0 - g * g) / (4.0 * np.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)
