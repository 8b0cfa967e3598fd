"""Lights of a scene file, of light objects."""

import math

import numpy as np

from .refusal import Refused, named


def light_entry(placed):
    """Entry of a scene file for a Placed light, None for one without power. Raises Refused about what Cumulo cannot
    honor."""
    thing = placed.object
    light, where = thing.data, named("light", thing)
    _check(light, where, thing)
    power = np.array(_power(light, where))
    if not power.any():
        return None
    axes = placed.matrix[:3, :3]
    lengths = np.linalg.norm(axes, axis=0)
    if light.type != "SUN" and _has_extent(light):
        if np.abs(lengths - 1).max() > 1e-4:
            raise Refused(where, f"it is scaled by {lengths.round(4).tolist()}", "apply its scale (Object > Apply > Scale)")
        if np.abs(axes.T @ axes - np.eye(3)).max() > 1e-3:
            raise Refused(where, "its matrix shears it", "clear the scale of its parents")
    position = placed.matrix[:3, 3]
    if light.type == "SUN":
        direction = axes[:, 2] / lengths[2]
        return {
            "type": "DistantLight",
            "direction": direction.tolist(),
            "irradiance": power.tolist(),
            "angle": math.degrees(light.angle),
        }
    if light.type == "POINT":
        return _point(light, where, position, power)
    if light.type == "AREA":
        return _area(light, where, position, axes, power)
    raise Refused(
        where,
        f"Cumulo has no {light.type.lower()} lights",
        "use a sun, a point light or a rectangle, or disable it in renders",
    )


def _has_extent(light):
    return light.type == "AREA" or (light.type == "POINT" and light.shadow_soft_size > 0)


def _check(light, where, thing):
    """Refuses what changes a light in ways that Cumulo does not know."""
    if light.use_nodes and light.node_tree:
        raise Refused(where, "its nodes state its light", "switch Use Nodes off, and set power and color")
    # Before Blender 4.3 Cycles had a switch of its own.
    if not (light.use_shadow and getattr(light.cycles, "cast_shadow", True)):
        raise Refused(where, "it casts no shadows", "switch Shadow on")
    if not thing.visible_volume_scatter:
        raise Refused(
            where, "it does not light volumes (Ray Visibility)", "switch Volume Scatter on, or disable it in renders"
        )
    linking = getattr(thing, "light_linking", None)
    if linking and (linking.receiver_collection or linking.blocker_collection):
        raise Refused(where, "it lights some objects alone (Light Linking)", "clear its light linking")
    if light.cycles.max_bounces < 1024:
        raise Refused(
            where,
            f"it lights {light.cycles.max_bounces} bounces at most",
            "set its Max Bounces to 1024 or more; the scene's bounces are kept",
        )
    if light.cycles.is_portal:
        raise Refused(where, "it is a portal", "disable it in renders")
    if not getattr(light, "normalize", True):
        raise Refused(where, "its power is per area (Normalize is off)", "switch Normalize on, and set its power")


def _power(light, where):
    """Energy of a light in red, green and blue."""
    energy = light.energy * 2.0 ** getattr(light, "exposure", 0.0)
    color = np.array(light.color)
    if getattr(light, "use_temperature", False):
        color = color * np.array(light.temperature_color)
    power = energy * color
    if not (np.isfinite(power).all() and (power >= 0).all()):
        raise Refused(where, f"its power is {power.tolist()}", "choose a finite power from 0 on")
    return power.tolist()


def _point(light, where, position, power):
    radius = light.shadow_soft_size
    if radius == 0:
        return {"type": "PointLight", "position": position.tolist(), "intensity": (power / (4 * np.pi)).tolist()}
    if light.use_soft_falloff:
        raise Refused(
            where,
            "its Soft Falloff makes it darker nearby than a sphere is",
            "switch Soft Falloff off, or make its radius 0",
        )
    radiance = power / (4 * np.pi**2 * radius**2)
    return {"type": "SphereLight", "centre": position.tolist(), "radius": radius, "radiance": radiance.tolist()}


def _area(light, where, position, axes, power):
    if light.shape not in ("SQUARE", "RECTANGLE"):
        raise Refused(where, f"its shape is a {light.shape.lower()}", "make it a square or a rectangle")
    if light.spread < math.pi - 1e-5:
        raise Refused(where, f"its spread is {math.degrees(light.spread):.4g}°", "make it 180°")
    width, height = light.size, light.size if light.shape == "SQUARE" else light.size_y
    # Light leaves along -Z, which is Y x X, and X x Y of a matrix that mirrors.
    edges = [axes[:, 1] * height, axes[:, 0] * width]
    if np.linalg.det(axes) < 0:
        edges.reverse()
    return {
        "type": "RectLight",
        "corner": (position - 0.5 * (edges[0] + edges[1])).tolist(),
        "edges": [edge.tolist() for edge in edges],
        "radiance": (power / (np.pi * width * height)).tolist(),
    }
