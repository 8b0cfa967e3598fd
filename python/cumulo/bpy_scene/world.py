"""Light from all around, of a scene's world."""

import os
import pathlib
import shutil
import tempfile

import bpy
import numpy as np

from .expressions import Tree
from .refusal import Complaint, Refused, named, refused
from .sky import render_sky, write_sky
from .volumes import relative

# Nodes that show a picture.
PICTURES = ("ShaderNodeTexEnvironment", "ShaderNodeTexImage")
LINEAR = ("Linear Rec.709", "Linear", "Non-Color")


class Worlds:
    """Lights of worlds for the scene files of a folder. What no scene file states is rendered to a picture: once, unless it
    changes from frame to frame."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self._rendered = {}
        # Pictures wait here until the export is known to be whole.
        self._drafts = tempfile.TemporaryDirectory(prefix="cumulo-")

    def lights(self, scene, complaints):
        """Entries of scene files for the scene's world, of which a black one has none. A world that cannot be stated is left
        out, and what is wrong about it, with the node, is added to the Complaints. Raises Refused about a medium that fills
        the world, and renders nothing where the Complaints stop the export."""
        world = scene.world
        output = world.node_tree and world.node_tree.get_output_node("CYCLES")
        if output and output.inputs["Volume"].is_linked:
            raise refused(named("world", world), "the world is filled by a medium", "unlink Volume of its output")
        found = list(_faults(world))
        for complaint in found:
            complaints.add(complaint)
        if found:
            return []
        try:
            return _stated(world, self.folder)
        except Refused:
            pass
        if complaints.stops or (complaints.found and not complaints.ignore):
            return []
        return self._picture(world, scene)

    def _picture(self, world, scene):
        """A DomeLight with a picture of the world, and its suns."""
        number = f".{scene.frame_current:04}" if world.animation_data or _moves(world.node_tree) else ""
        if number not in self._rendered:
            sky, name = render_sky(world, scene), f"world{number}.exr"
            write_sky(sky, pathlib.Path(self._drafts.name) / name)
            self._rendered[number] = [*sky.suns, {"type": "DomeLight", "texture": name}]
        return self._rendered[number]

    def write(self):
        """Puts the pictures into the folder, each whole or not at all."""
        with tempfile.TemporaryDirectory(dir=self.folder, prefix=".writing-") as beside:
            for draft in pathlib.Path(self._drafts.name).iterdir():
                os.replace(shutil.copy(draft, beside), self.folder / draft.name)


def _moves(tree):
    """True if a node tree may differ from frame to frame."""
    return bool(tree.animation_data) or any(
        (node.bl_idname == "ShaderNodeGroup" and node.node_tree and _moves(node.node_tree))
        or (node.bl_idname in PICTURES and node.image and node.image.source in ("SEQUENCE", "MOVIE"))
        # A texture may be fixed to an object.
        or getattr(node, "object", None)
        for node in tree.nodes
    )


def _faults(world):
    """The complaints about a world of which neither a scene file nor a picture tells."""
    without = "the world is left out"
    if not world.cycles_visibility.scatter:
        yield Complaint(
            named("world", world),
            "it does not light volumes (Ray Visibility)",
            "switch Volume Scatter on",
            without,
        )
    for node in world.node_tree.nodes if world.node_tree else ():
        if node.bl_idname == "ShaderNodeLightPath" and any(socket.is_linked for socket in node.outputs):
            yield Complaint(
                named("world", world, node), "the camera sees another world than lights the scene", "unlink it", without
            )
        if node.bl_idname in PICTURES and any(socket.is_linked for socket in node.outputs) and _is_missing(node.image):
            yield Complaint(named("world", world, node), "its picture is missing", "choose one that is there", without)


def _is_missing(image):
    if image is None:
        return True
    if image.source != "FILE" or image.packed_file:
        return False
    return not pathlib.Path(bpy.path.abspath(image.filepath, library=image.library)).is_file()


def _stated(world, folder):
    """Entries of a scene file for a world of one color, or of an EXR as it is. Raises Refused about others."""
    # From Blender 5.0 on worlds always use nodes.
    if world.node_tree is None or (bpy.app.version < (5, 0) and not world.use_nodes):
        return _even(np.array(world.color))
    tree = Tree("world", world)
    output = world.node_tree.get_output_node("CYCLES")
    source = output and tree.source(output.inputs["Surface"])
    if not source:
        return []
    node = source.node
    if node.bl_idname != "ShaderNodeBackground":
        raise tree.refused(node, f"a {node.bl_label} lights the world", "use a Background")
    strength = tree.number(node.inputs["Strength"])
    texture = tree.source(node.inputs["Color"])
    if texture is None or texture.node.bl_idname == "ShaderNodeRGB":
        return _even(strength * np.array(tree.color(node.inputs["Color"])))
    if strength == 0:
        return []
    path = _texture(tree, texture.node)
    return [{"type": "DomeLight", "radiance": [strength] * 3, "texture": relative(path, folder)}]


def _even(color):
    """Light that is the same from all around, if there is any."""
    return [{"type": "DomeLight", "radiance": color.tolist()}] if color.any() else []


def _texture(tree, node):
    """Path of the equirectangular EXR that a node shows."""
    if node.bl_idname != "ShaderNodeTexEnvironment":
        raise tree.refused(node, f"a {node.bl_label} lights the world", "use one color, or an Environment Texture")
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
