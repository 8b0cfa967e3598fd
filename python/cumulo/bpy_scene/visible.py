"""Objects that a render of a scene shows."""

import dataclasses

import bpy
import numpy as np

from .refusal import Complaint, Complaints, named, refused

# Types of objects that Cycles renders as surfaces, strands or points.
SURFACES = ("MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD", "GPENCIL", "GREASEPENCIL")


@dataclasses.dataclass(frozen=True)
class Placed:
    """An evaluated object where a render shows it; `matrix` is object to world, [4, 4] f64."""

    object: bpy.types.Object
    matrix: np.ndarray


def view_layer_of(scene, complaints):
    """The view layer that a render uses. Adds what it overrides or leaves out to the Complaints, and raises Refused where
    there are several layers, or none."""
    layers = [layer for layer in scene.view_layers if layer.use]
    if len(layers) != 1:
        names = ", ".join(layer.name for layer in layers) or "none"
        raise refused(
            named("scene", scene),
            f"{len(layers)} view layers are rendered ({names})",
            "leave Use for Rendering on for one",
        )
    layer = layers[0]
    if layer.material_override or getattr(layer, "world_override", None):
        complaints.add(
            Complaint(
                named("view layer", layer), "it renders another material or world than the scene's", "clear its override"
            )
        )
    for filtered, what in (("use_volumes", "volumes"), ("use_sky", "the world")):
        if not getattr(layer, filtered):
            complaints.add(
                Complaint(
                    named("view layer", layer),
                    f"it leaves {what} out",
                    "switch its filters on (View Layer Properties > Filter)",
                )
            )
    return layer


def evaluated(scene, complaints):
    """The dependency graph of the scene at its present frame. Complains as `view_layer_of` does."""
    layer = view_layer_of(scene, complaints)
    layer.update()
    return layer.depsgraph


def placed_objects(scene, complaints=None):
    """Lists the Placed volumes, lights and surfaces that a render shows, instances among them.

    Adds objects that are rendered, and that the viewport, whose evaluation this is, does not show, to the Complaints;
    without these it raises Refused about them.
    """
    if complaints is None:
        complaints = Complaints()
        found = placed_objects(scene, complaints)
        complaints.settle()
        return found
    depsgraph = evaluated(scene, complaints)
    rendered = _rendered_names(view_layer_of(scene, complaints).layer_collection, complaints)
    inside = {thing.name_full: _names_inside(thing, complaints) for thing in scene.objects if thing.name_full in rendered}
    found, seen = [], set()
    for instance in depsgraph.object_instances:
        thing = instance.object
        if not instance.is_instance:
            seen.add(thing.original.name_full)
        shown = instance.show_self and not thing.original.hide_render
        source = instance.parent.original if instance.is_instance else thing.original
        if instance.is_instance and source.instance_type == "COLLECTION":
            shown = shown and thing.original.name_full in inside.get(source.name_full, ())
        if shown and source.name_full in rendered and thing.type in (*SURFACES, "VOLUME", "LIGHT"):
            # References to instances end with the step of the iteration.
            kept = thing.original.evaluated_get(depsgraph)
            found.append(Placed(kept, np.array(instance.matrix_world, dtype=np.float64)))
    for thing in scene.objects:
        hidden = thing.name_full in rendered and thing.name_full not in seen
        if hidden and (thing.type in (*SURFACES, "VOLUME", "LIGHT") or thing.instance_type != "NONE"):
            complaints.add(
                Complaint(
                    named("object", thing),
                    "it is rendered, but hidden in the viewport, so that it is not evaluated",
                    "show it in the viewport, or disable it in renders",
                    _without(thing),
                )
            )
    return found


def _without(thing):
    """What an export does without an object that is not evaluated; None of one that may be, or hold, a volume."""
    plain = thing.instance_type == "NONE" and not thing.modifiers
    filled = any(slot.material and _has_medium(slot.material) for slot in thing.material_slots)
    return "the object is left out" if plain and not filled and thing.type != "VOLUME" else None


def _has_medium(material):
    """True if a material fills what it is put on."""
    output = material.node_tree and material.node_tree.get_output_node("CYCLES")
    return bool(output and output.inputs["Volume"].is_linked)


def _names_inside(instancer, complaints):
    """Names of the objects that a render shows by an instance of a collection, those of instances in it included; none of
    other objects. Adds those that the viewport does not show to the Complaints."""
    if instancer.instance_type != "COLLECTION" or instancer.instance_collection is None:
        return set()
    rendered, shown = {}, {}
    for found, flag in ((rendered, "hide_render"), (shown, "hide_viewport")):
        _collect(instancer.instance_collection, flag, found, set())
    for name, thing in rendered.items():
        if name not in shown and (thing.type in (*SURFACES, "VOLUME", "LIGHT") or thing.instance_type != "NONE"):
            complaints.add(
                Complaint(
                    named("object", thing),
                    f"an instance by {instancer.name!r} is rendered, but hidden in the viewport, so that it is not evaluated",
                    "show it and its collections in the viewport, or disable it in renders",
                    _without(thing),
                )
            )
    return set(rendered)


def _collect(collection, flag, found, entered):
    """Adds to `found`, by name, the objects that an instance of a collection shows where `flag` hides none of them."""
    if getattr(collection, flag) or collection.name_full in entered:
        return
    entered.add(collection.name_full)
    for thing in collection.objects:
        if not getattr(thing, flag):
            found[thing.name_full] = thing
            if thing.instance_type == "COLLECTION" and thing.instance_collection:
                _collect(thing.instance_collection, flag, found, entered)
    for child in collection.children:
        _collect(child, flag, found, entered)


def _rendered_names(layer, complaints):
    """Names of the objects that a layer collection renders, those of collections inside it included."""
    collection = layer.collection
    if collection.hide_render:
        return set()
    if layer.exclude:
        # What is in it is left out, and its collections are where they say so themselves.
        return set().union(*(_rendered_names(child, complaints) for child in layer.children))
    if collection.objects and (layer.holdout or layer.indirect_only):
        complaints.add(
            Complaint(
                named("collection", collection),
                "it is a holdout, or lights the others alone",
                "clear Holdout and Indirect Only",
            )
        )
    names = {thing.name_full for thing in collection.objects if not thing.hide_render}
    return names.union(*(_rendered_names(child, complaints) for child in layer.children))
