"""Operator: Load Result."""

import pathlib

import bpy

from .cumulo import bpy_scene
from .cumulo.capture import Capture
from .settings import folder_of


def medium_of(scene, like, capture):
    """Density scale, albedo and anisotropy of the object named `like`, of a capture, or 1, black and 0."""
    if like:
        medium = bpy_scene.medium_of(scene, like)
        if "extinction_color" in medium:
            raise ValueError(f"object {like!r}: its extinction has a color, which a result has not; load without it")
        return medium["density_scale"], medium["albedo"], medium["anisotropy"]
    return (Capture.read(capture).density_scale if capture else 1.0), (0.0, 0.0, 0.0), 0.0


def load_result(scene, path, like="", capture=None):
    """Links the VDB at `path` into a scene, where its own transform puts it, with a Principled Volume of the medium of
    `like`, else of the capture. Returns the object. Raises ValueError where Blender cannot read it."""
    scale, albedo, anisotropy = medium_of(scene, like, capture)
    path = pathlib.Path(path)
    volume = bpy.data.volumes.new(path.stem)
    volume.filepath = str(path)
    # Coefficients are per world length.
    volume.render.space = "WORLD"
    if not volume.grids.load() or not len(volume.grids):
        error = volume.grids.error_message or "it has no grids"
        bpy.data.volumes.remove(volume)
        raise ValueError(f"{path}: Blender cannot read it: {error}")
    names = [grid.name for grid in volume.grids]
    material = bpy.data.materials.new(path.stem)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    medium, output = tree.nodes.new("ShaderNodeVolumePrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    medium.location.x = -300
    medium.inputs["Density"].default_value = scale
    medium.inputs["Density Attribute"].default_value = "density" if "density" in names else names[0]
    medium.inputs["Color"].default_value = (*albedo, 1.0)
    medium.inputs["Anisotropy"].default_value = anisotropy
    tree.links.new(medium.outputs[0], output.inputs["Volume"])
    volume.materials.append(material)
    thing = bpy.data.objects.new(path.stem, volume)
    scene.collection.objects.link(thing)
    return thing


class LoadResult(bpy.types.Operator):
    """Load a VDB where it belongs, with a Principled Volume"""

    bl_idname = "cumulo.load_result"
    bl_label = "Load Result"
    bl_options = {"REGISTER", "UNDO"}

    filepath: bpy.props.StringProperty(name="File", description="VDB to load", subtype="FILE_PATH")
    filter_glob: bpy.props.StringProperty(default="*.vdb", options={"HIDDEN"})
    like: bpy.props.StringProperty(name="Like", description="Object whose medium it gets; empty for the capture's")
    capture: bpy.props.StringProperty(name="Capture", description="Capture that it was reconstructed from; its density scale is set", subtype="FILE_PATH")

    def execute(self, context):
        """Loads the VDB."""
        try:
            capture = folder_of(self.capture) if self.capture else None
            thing = load_result(context.scene, folder_of(self.filepath), self.like, capture)
        except (ValueError, OSError, RuntimeError) as fault:
            self.report({"ERROR"}, str(fault))
            return {"CANCELLED"}
        self.report({"INFO"}, f"{self.filepath} is the object {thing.name}")
        return {"FINISHED"}

    def invoke(self, context, event):
        """Asks for the file."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}
