"""Settings of the panel, kept with the scene."""

import pathlib

import bpy

# Name and description of the switch that lets an export carry on.
IGNORE = "Leave Out What Is Not Supported"
IGNORING = "Export without meshes, lights and blur that Cumulo does not have, and report each; else nothing is exported"


def _is_volume(_, thing):
    return thing.type == "VOLUME"


class Settings(bpy.types.PropertyGroup):
    """What the buttons of the panel use."""

    folder: bpy.props.StringProperty(
        name="Folder",
        description="Folder that scenes, pictures and volumes are written into",
        subtype="DIR_PATH",
        default="//cumulo",
    )
    volume: bpy.props.PointerProperty(
        name="Volume",
        description="Volume that views are rendered of; empty for the only one",
        type=bpy.types.Object,
        poll=_is_volume,
    )
    views: bpy.props.IntProperty(name="Views", description="Cameras around the volume", default=32, min=1, max=1000)
    size: bpy.props.IntProperty(
        name="Size", description="Width and height of the views in pixels", default=128, min=8, max=8192
    )
    view_samples: bpy.props.IntProperty(
        name="Samples", description="Samples of Cycles per pixel of the views", default=32, min=1
    )
    resolution: bpy.props.IntProperty(
        name="Resolution",
        description="Voxels along the longest edge; 0 for those of the volume that the views show",
        default=0,
        min=0,
        max=4096,
    )
    samples: bpy.props.IntProperty(name="Samples", description="Paths per pixel", default=64, min=1)
    animation: bpy.props.BoolProperty(
        name="Animation", description="All frames of the scene, in place of the present one"
    )
    ignore: bpy.props.BoolProperty(name=IGNORE, description=IGNORING)


def folder_of(path):
    """A folder that a property names. Raises ValueError where it names none, or lies beside a .blend that is not saved
    yet."""
    if not path.strip():
        raise ValueError("no folder or file is named; choose one")
    if path.startswith("//") and not bpy.data.filepath:
        raise ValueError(f"{path} is beside the .blend, which is not saved yet; save it, or choose another folder")
    return pathlib.Path(bpy.path.abspath(path))
