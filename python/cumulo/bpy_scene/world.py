"""Light from all around, of a scene's world."""

import pathlib

import bpy
import numpy as np

from .expressions import Tree
from .refusal import Refused, named
from .volumes import relative

LINEAR = ("Linear Rec.709", "Linear", "Non-Color")


def dome_entry(world, folder):
    """DomeLight of a scene file in `folder`, None for a black world. Raises Refused, naming the node, about what Cumulo
    cannot honor."""
    # From Blender 5.0 on worlds always use nodes.
    if world.node_tree is None or (bpy.app.version < (5, 0) and not world.use_nodes):
        color = np.array(world.color)
        return {"type": "DomeLight", "radiance": color.tolist()} if color.any() else None
    tree, where = Tree("world", world), named("world", world)
    output = world.node_tree.get_output_node("CYCLES")
    if output is None:
        return None
    if tree.source(output.inputs["Volume"]):
        raise Refused(where, "the world is filled by a medium", "unlink Volume of its output")
    source = tree.source(output.inputs["Surface"])
    if source is None:
        return None
    node = source.node
    if node.bl_idname != "ShaderNodeBackground":
        raise tree.refused(node, f"a {node.bl_label} lights the world", "use a Background")
    strength = tree.number(node.inputs["Strength"])
    texture = tree.source(node.inputs["Color"])
    if texture is None or texture.node.bl_idname == "ShaderNodeRGB":
        color = strength * np.array(tree.color(node.inputs["Color"]))
        return _checked(world, where, {"type": "DomeLight", "radiance": color.tolist()}) if color.any() else None
    if strength == 0:
        return None
    path = _texture(tree, texture.node)
    return _checked(world, where, {"type": "DomeLight", "radiance": [strength] * 3, "texture": relative(path, folder)})


def _checked(world, where, entry):
    """The entry, after a check that the world is seen by all rays that Cumulo knows."""
    if not world.cycles_visibility.scatter:
        raise Refused(where, "it does not light volumes (Ray Visibility)", "switch Volume Scatter on")
    return entry


def _texture(tree, node):
    """Path of the equirectangular EXR that a node shows."""
    if node.bl_idname != "ShaderNodeTexEnvironment":
        raise tree.refused(
            node,
            f"a {node.bl_label} lights the world",
            "use one color, or an Environment Texture of an EXR (bake the sky into one)",
        )
    if tree.source(node.inputs["Vector"]):
        raise tree.refused(node, "its Vector is linked", "unlink it: the picture cannot be turned")
    image = node.image
    if node.projection != "EQUIRECTANGULAR":
        raise tree.refused(node, f"its projection is {node.projection}", "use an equirectangular picture")
    if image is None or image.source != "FILE" or image.packed_file:
        raise tree.refused(node, "its picture is no file on disk", "save it as EXR")
    path = pathlib.Path(bpy.path.abspath(image.filepath, library=image.library))
    if path.suffix.lower() != ".exr" or not path.is_file():
        raise tree.refused(node, f"{path} is no EXR", "save the picture as EXR")
    if image.colorspace_settings.name not in LINEAR:
        raise tree.refused(
            node, f"the color space of {path} is {image.colorspace_settings.name}", "choose Linear Rec.709"
        )
    return path.resolve()
