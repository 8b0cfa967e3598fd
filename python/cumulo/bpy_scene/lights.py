"""Lights of a scene file, of light objects."""

import math

import numpy as np

from .refusal import Complaint, named


def light_entry(placed, complaints):
    """Entry of a scene file for a Placed light, None for one without power. A light that Cumulo cannot honor is left out,
    and what is wrong about it is added to the Complaints."""
    thing = placed.object
    light, where = thing.data, named("light", thing)
    power = np.array(_power(light))
    if not power.any():
        return None
    found = [Complaint(where, *each, "the light is left out") for each in (*_faults(light, thing), *_shape(placed))]
    for complaint in found:
        complaints.add(complaint)
    if found:
        return None
    position, axes = placed.matrix[:3, 3], placed.matrix[:3, :3]
    if light.type == "SUN":
        direction = axes[:, 2] / np.linalg.norm(axes[:, 2])
        return {
            "type": "DistantLight",
            "direction": direction.tolist(),
            "irradiance": power.tolist(),
            "angle": math.degrees(light.angle),
        }
    if light.type == "POINT":
        return _point(light, position, power)
    if light.type == "SPOT":
        return _spot(light, position, -axes[:, 2], power)
    return _area(light, position, axes, power)


def _has_extent(light):
    return light.type in ("AREA", "SPOT") or (light.type == "POINT" and light.shadow_soft_size > 0)


def _faults(light, thing):
    """What changes a light in ways that Cumulo does not know, and what to do about it."""
    if light.use_nodes and light.node_tree:
        profile = any(node.bl_idname == "ShaderNodeTexIES" for node in light.node_tree.nodes)
        what = "its nodes shape it by an IES profile" if profile else "its nodes state its light"
        yield what, "switch Use Nodes off, and set power and color"
    # Before Blender 4.3 Cycles had a switch of its own.
    if not (light.use_shadow and getattr(light.cycles, "cast_shadow", True)):
        yield "it casts no shadows", "switch Shadow on"
    if not thing.visible_volume_scatter:
        yield "it does not light volumes (Ray Visibility)", "switch Volume Scatter on, or disable it in renders"
    linking = getattr(thing, "light_linking", None)
    if linking and (linking.receiver_collection or linking.blocker_collection):
        yield "it lights some objects alone (Light Linking)", "clear its light linking"
    if light.cycles.max_bounces < 1024:
        yield (
            f"it lights {light.cycles.max_bounces} bounces at most",
            "set its Max Bounces to 1024 or more; the scene's bounces are kept",
        )
    if light.cycles.is_portal:
        yield "it is a portal", "disable it in renders"
    if not getattr(light, "normalize", True):
        yield "its power is per area (Normalize is off)", "switch Normalize on, and set its power"
    power = np.array(_power(light))
    if not (np.isfinite(power).all() and (power >= 0).all()):
        yield f"its power is {power.tolist()}", "choose a finite power from 0 on"


def _shape(placed):
    """What shapes a light in ways that Cumulo does not know, and what to do about it."""
    light, axes = placed.object.data, placed.matrix[:3, :3]
    lengths = np.linalg.norm(axes, axis=0)
    if light.type == "AREA":
        if light.shape not in ("SQUARE", "RECTANGLE"):
            yield f"its shape is a {light.shape.lower()}", "make it a square or a rectangle"
        if light.spread < math.pi - 1e-5:
            yield f"its spread is {math.degrees(light.spread):.4g}°", "make it 180°"
    if light.type != "SUN" and _has_extent(light):
        if np.abs(lengths - 1).max() > 1e-4:
            yield f"it is scaled by {lengths.round(4).tolist()}", "apply its scale (Object > Apply > Scale)"
        elif np.abs(axes.T @ axes - np.eye(3)).max() > 1e-3:
            yield "its matrix shears it", "clear the scale of its parents"


def _power(light):
    """Energy of a light in red, green and blue."""
    energy = light.energy * 2.0 ** getattr(light, "exposure", 0.0)
    color = np.array(light.color)
    if getattr(light, "use_temperature", False):
        color = color * np.array(light.temperature_color)
    return (energy * color).tolist()


def _point(light, position, power):
    radius = light.shadow_soft_size
    if radius == 0:
        return {"type": "PointLight", "position": position.tolist(), "intensity": (power / (4 * np.pi)).tolist()}
    radiance = power / (4 * np.pi**2 * radius**2)
    entry = {"type": "SphereLight", "centre": position.tolist(), "radius": radius, "radiance": radiance.tolist()}
    return entry | _softness(light)


def _softness(light):
    """The key of a light that Cycles renders as a disc which turns to whatever it lights."""
    return {"soft_falloff": True} if light.use_soft_falloff and light.shadow_soft_size > 0 else {}


def _spot(light, position, direction, power):
    # A spot is as bright as a point light of its power, whatever its cone is.
    entry = {
        "type": "SpotLight",
        "position": position.tolist(),
        "direction": direction.tolist(),
        "intensity": (power / (4 * np.pi)).tolist(),
        "angle": math.degrees(light.spot_size),
        "blend": light.spot_blend,
        "radius": light.shadow_soft_size,
    }
    return entry | _softness(light)


def _area(light, position, axes, power):
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
