"""Lights in the terms of radiometry, and Blender's counterparts."""

import dataclasses

import bpy
import numpy as np

from .objects import link_object


@dataclasses.dataclass(frozen=True)
class Sun:
    """A sun seen in `direction` (from the scene), `angle` radians across, with this irradiance."""

    direction: tuple
    irradiance: tuple = (1.0, 1.0, 1.0)
    angle: float = 0.0

    def link(self, scene):
        data = bpy.data.lights.new("sun", "SUN")
        data.angle = self.angle
        _set_power(data, self.irradiance)
        link_object(scene, "sun", data, _facing(-np.asarray(self.direction, float), (0, 0, 0)))


@dataclasses.dataclass(frozen=True)
class Sphere:
    """A sphere that emits outwards; Blender's point light with a radius. Seen from far away, one of
    radius 0 and one of any radius with the same intensity are alike."""

    centre: tuple
    radius: float
    radiance: tuple = (1.0, 1.0, 1.0)

    def link(self, scene):
        data = bpy.data.lights.new("sphere", "POINT")
        data.shadow_soft_size = self.radius
        # Else what lies near the light gets less.
        data.use_soft_falloff = False
        # Power over the area and over pi is radiance.
        _set_power(data, [4 * np.pi**2 * self.radius**2 * c for c in self.radiance])
        place = np.eye(4)
        place[:3, 3] = self.centre
        link_object(scene, "sphere", data, place)


@dataclasses.dataclass(frozen=True)
class Rectangle:
    """A rectangle at `centre` that emits along `direction`; `size` is along its own x and y."""

    centre: tuple
    direction: tuple
    size: tuple
    radiance: tuple = (1.0, 1.0, 1.0)

    def link(self, scene):
        data = bpy.data.lights.new("rectangle", "AREA")
        data.shape, (data.size, data.size_y) = "RECTANGLE", self.size
        _set_power(data, [np.pi * self.size[0] * self.size[1] * c for c in self.radiance])
        link_object(scene, "rectangle", data, self.matrix())

    def matrix(self):
        """Object to world; light leaves along -Z."""
        return _facing(np.asarray(self.direction, float), self.centre)


def _facing(direction, centre):
    """A matrix whose -Z is `direction`."""
    back = -direction / np.linalg.norm(direction)
    side = np.cross((0.0, 1.0, 0.0) if abs(back[1]) < 0.9 else (1.0, 0.0, 0.0), back)
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = side, np.cross(back, side), back, centre
    return matrix


def _set_power(data, color):
    """Sets a light's power by channel, and hides it from the camera and from shadows."""
    # A black light keeps its color, of which there is no scale.
    most = max(color) or 1.0
    data.energy = max(color)
    data.color = [c / most for c in color]
    data.use_shadow = True
    data.cycles.max_bounces = 1024
