"""Reconstructed volumes beside the originals."""

import pathlib

import bpy

from ..capture import Capture
from .refusal import named, refused
from .shots import chosen
from .volumes import volume_entry


def load(path, scene=None, like=None, capture=None):
    """Links the VDB at `path` into a scene, the present one unless given, where its own transform puts it, with a Principled
    Volume.

    Density, color and anisotropy of the material are those of the medium of the volume object named `like`; without it the
    medium absorbs, by the density scale of `capture`, a `transforms.json` or its folder, else by 1. Returns the object.
    Raises ValueError where Blender cannot read the file, and Refused about `like`.
    """
    scene, path = scene or bpy.context.scene, pathlib.Path(path).resolve()
    medium = _medium(scene, like, capture)
    volume = bpy.data.volumes.new(path.stem)
    volume.filepath = str(path)
    # Coefficients are per world length.
    volume.render.space = "WORLD"
    if not volume.grids.load() or not len(volume.grids):
        error = volume.grids.error_message or "it has no grids"
        bpy.data.volumes.remove(volume)
        raise ValueError(f"{path}: Blender cannot read it: {error}")
    names = [grid.name for grid in volume.grids]
    volume.materials.append(_material(path.stem, "density" if "density" in names else names[0], medium))
    thing = bpy.data.objects.new(path.stem, volume)
    scene.collection.objects.link(thing)
    return thing


def _medium(scene, like, capture):
    """What a scene file would state of the medium."""
    if like is None:
        return {
            "density_scale": Capture.read(capture).density_scale if capture else 1.0,
            "albedo": (0.0, 0.0, 0.0),
            "anisotropy": 0.0,
        }
    placed = chosen(scene, like)
    medium = volume_entry(placed, ".", 1.0)["medium"]
    if "extinction_color" in medium:
        raise refused(named("object", placed.object), "its extinction has a color", "load the result without it")
    return medium


def _material(name, grid, medium):
    """A Principled Volume of an extinction without color."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new("ShaderNodeVolumePrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    shader.location.x = -300
    shader.inputs["Density"].default_value = medium["density_scale"]
    shader.inputs["Density Attribute"].default_value = grid
    shader.inputs["Color"].default_value = (*medium["albedo"], 1.0)
    shader.inputs["Anisotropy"].default_value = medium["anisotropy"]
    tree.links.new(shader.outputs[0], output.inputs["Volume"])
    return material
