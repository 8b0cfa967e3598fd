"""Objects that a render of a scene shows."""

import dataclasses

import bpy
import numpy as np

from .refusal import Refused, named

# Types of objects that Cycles renders as surfaces, strands or points.
SURFACES = ("MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD", "GPENCIL", "GREASEPENCIL")


@dataclasses.dataclass(frozen=True)
class Placed:
    """An evaluated object where a render shows it; `matrix` is object to world, [4, 4] f64."""

    object: bpy.types.Object
    matrix: np.ndarray


def view_layer_of(scene):
    """The view layer that a render uses. Raises Refused where there are several, or none."""
    layers = [layer for layer in scene.view_layers if layer.use]
    if len(layers) != 1:
        names = ", ".join(layer.name for layer in layers) or "none"
        raise Refused(
            named("scene", scene),
            f"{len(layers)} view layers are rendered ({names})",
            "leave Use for Rendering on for one",
        )
    layer = layers[0]
    if layer.material_override or getattr(layer, "world_override", None):
        raise Refused(
            named("view layer", layer), "it renders another material or world than the scene's", "clear its override"
        )
    return layer


def evaluated(scene):
    """The dependency graph of the scene at its present frame."""
    layer = view_layer_of(scene)
    layer.update()
    return layer.depsgraph


def placed_objects(scene):
    """Lists the Placed volumes, lights and surfaces that a render shows, instances among them.

    Raises Refused where an object is rendered that the viewport, whose evaluation this is, does not show.
    """
    depsgraph = evaluated(scene)
    rendered = _rendered_names(view_layer_of(scene).layer_collection)
    found, seen = [], set()
    for instance in depsgraph.object_instances:
        thing = instance.object
        if not instance.is_instance:
            seen.add(thing.original.name_full)
        shown = instance.show_self and not thing.original.hide_render
        source = instance.parent.original if instance.is_instance else thing.original
        if shown and source.name_full in rendered and thing.type in (*SURFACES, "VOLUME", "LIGHT"):
            # References to instances end with the step of the iteration.
            kept = thing.original.evaluated_get(depsgraph)
            found.append(Placed(kept, np.array(instance.matrix_world, dtype=np.float64)))
    for thing in scene.objects:
        hidden = thing.name_full in rendered and thing.name_full not in seen
        if hidden and (thing.type in (*SURFACES, "VOLUME", "LIGHT") or thing.instance_type != "NONE"):
            raise Refused(
                named("object", thing),
                "it is rendered, but hidden in the viewport, so that it is not evaluated",
                "show it in the viewport, or disable it in renders",
            )
    return found


def _rendered_names(layer):
    """Names of the objects that a layer collection renders, those of collections inside it included."""
    collection = layer.collection
    if layer.exclude or collection.hide_render:
        return set()
    if collection.objects and (layer.holdout or layer.indirect_only):
        raise Refused(
            named("collection", collection), "it is a holdout, or lights the others alone", "clear Holdout and Indirect Only"
        )
    names = {thing.name_full for thing in collection.objects if not thing.hide_render}
    return names.union(*(_rendered_names(child) for child in layer.children))
