"""Volumes of a scene file, of volume objects."""

import os
import pathlib

import bpy
import numpy as np

from .. import padding
from .media import default_medium, medium_entry
from .refusal import Complaint, Refused, named, refused

BACKED = "import the VDB files that it stands for (Add > Volume > Import OpenVDB), and disable this object in renders"


def inside_complaint(thing):
    """The Complaint about an object with a surface if it is, or holds, a volume without a VDB file; None of others."""
    where = named("object", thing)
    fluid = [m for m in thing.modifiers if m.type == "FLUID" and m.fluid_type == "DOMAIN"]
    if fluid:
        cache = bpy.path.abspath(fluid[0].domain_settings.cache_directory)
        return Complaint(
            where, f"it is a fluid domain (cache: {cache})", f"bake it with the cache format OpenVDB, then {BACKED}"
        )
    if any(m and m.node_tree and (out := m.node_tree.get_output_node("CYCLES")) and out.inputs["Volume"].is_linked
           for m in getattr(thing.data, "materials", ())):  # fmt: skip
        return Complaint(where, f"its inside ({thing.type.lower()}) is a medium without a VDB file", BACKED)
    if _makes_volume(thing):
        return Complaint(where, f"its modifiers make a volume of a {thing.type.lower()}, without a VDB file", BACKED)
    return None


def _makes_volume(thing):
    """True if the modifiers of an evaluated object make a volume, as far as this Blender tells."""
    if not thing.modifiers:
        return False
    # Before Blender 4.5 nothing tells what geometry nodes make.
    geometry = thing.evaluated_geometry() if hasattr(thing, "evaluated_geometry") else None
    made_of_nodes = any(modifier.type in ("NODES", "MESH_TO_VOLUME") for modifier in thing.modifiers)
    return made_of_nodes if geometry is None else geometry.volume is not None


def vdb_of(placed):
    """Path of the VDB file that a volume object shows at the present frame. Raises Refused where there is none."""
    thing = placed.object
    volume, where = thing.data, named("object", thing)
    if shown := [m.name for m in thing.modifiers if m.show_render]:
        raise refused(
            where,
            f"the modifier {shown[0]!r} changes or makes the volume",
            "remove it, or write its result as VDB, import that, and disable this object in renders",
        )
    if volume.packed_file:
        raise refused(where, "its VDB is packed into the .blend", "unpack it (File > External Data)")
    if not volume.filepath:
        raise refused(where, "no VDB file stands behind it", BACKED)
    if shows_nothing(thing):
        raise refused(
            where, "its sequence has no file at this frame", "choose the mode Extend or Repeat, or other frames"
        )
    path = pathlib.Path(bpy.path.abspath(volume.grids.frame_filepath or volume.filepath, library=volume.library))
    if volume.grids.error_message or not path.is_file():
        raise refused(
            where,
            f"{'its sequence from ' if volume.is_sequence else ''}{path} cannot be read: "
            f"{volume.grids.error_message or 'no such file'}",
            "correct the path, or the sequence's frames",
        )
    return path.resolve()


def shows_nothing(thing):
    """True for a volume object that is rendered as nothing, because its sequence has no file at the present frame."""
    volume = thing.data
    return volume.grids.load() and volume.is_sequence and not volume.grids.frame_filepath


def _check_visibility(placed):
    """Refuses what makes a volume visible to some rays alone, or to none."""
    thing = placed.object
    if np.linalg.det(placed.matrix[:3, :3]) == 0:
        raise refused(named("object", thing), "it is flat, by a scale of 0", "give it a size, or disable it in renders")
    found = [
        Complaint(named("object", thing), f"its ray visibility {attribute} is off", "switch it on (Object > Visibility)")
        for attribute in ("visible_camera", "visible_shadow", "visible_volume_scatter")
        if not getattr(thing, attribute)
    ] + [
        Complaint(named("object", thing), f"its {attribute} is on", "switch it off (Object > Visibility)")
        for attribute in ("is_holdout", "is_shadow_catcher")
        if getattr(thing, attribute)
    ]
    if found:
        raise Refused(*found)


def coefficient_scale(placed):
    """Factor of the coefficients of a volume's material: in object space Blender divides them by the object's scale along
    its diagonal."""
    if placed.object.data.render.space == "WORLD":
        return 1.0
    return 1.0 / float(np.linalg.norm(placed.matrix[:3, :3] @ np.full(3, 3**-0.5)))


def volume_entry(placed, folder, fps):
    """Entry of a scene file in `folder` for a Placed volume. Raises Refused about what Cumulo cannot honor."""
    thing = placed.object
    path = vdb_of(placed)
    _check_visibility(placed)
    grids = padding.grid_names(path)
    # Cycles renders a volume by its first slot, and by a material of its own where that is empty.
    material = thing.material_slots[0].material if thing.material_slots else None
    scale = coefficient_scale(placed)
    grid, medium = (
        default_medium(named("object", thing), grids, scale) if material is None else medium_entry(material, grids, scale)
    )
    entry = {"file": relative(path, folder), "grid": grid, "medium": medium}
    if not np.array_equal(placed.matrix, np.eye(4)):
        entry["transform"] = placed.matrix.tolist()
    velocity = thing.data.velocity_grid
    if velocity in grids and thing.data.velocity_scale == 1.0:
        entry["velocity"] = {"grid": velocity, "fps": fps if thing.data.velocity_unit == "SECOND" else 1.0}
    return entry


def check_handedness(placed, lattice):
    """Refuses a grid that a Placed volume shows by the index-to-world matrix `lattice` if its own transform mirrors it: the
    mesh that Cycles makes around its voxels is inside out then, and nothing is seen."""
    if np.linalg.det(lattice[:3, :3]) * np.linalg.det(placed.matrix[:3, :3]) < 0:
        raise refused(
            named("object", placed.object),
            "the transform in its file mirrors the grid, and Cycles shows nothing of it",
            "write the grid unmirrored, and mirror the object",
        )


def lattice_of(placed, path, grid):
    """Index-to-world matrix of a grid where a Placed volume shows it, and its active index box. Raises Refused where the
    grid is empty, or no matrix describes its lattice."""
    try:
        matrix, box = padding.lattice(path, grid)
    except ValueError as error:
        raise refused(
            named("object", placed.object), str(error), "show another file, or disable it in renders"
        ) from error
    return placed.matrix @ matrix, box


def relative(path, folder):
    """`path` as a file in `folder` names it: relative to it, or absolute where it lies on another drive."""
    try:
        return pathlib.Path(os.path.relpath(path, pathlib.Path(folder).resolve())).as_posix()
    except ValueError:
        return pathlib.Path(path).as_posix()
