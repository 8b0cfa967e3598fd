"""Scenes of a user of Blender, for tests: the plume with a Principled Volume, a sun and a camera."""

import math
import pathlib
import tempfile

import bpy
import numpy as np
from cumulo.capture import look_at
from cumulo.cycles.objects import link_object
from cumulo.cycles.stage import empty_scene, quiet
from cumulo.exr import read_exr
from mathutils import Matrix


def smoke(vdb, *, matrix=None, density=4.0, color=(0.9, 0.8, 0.6), anisotropy=0.3, sun=3.0, size=(32, 24)):
    """A scene as `File > New` and `Add` make it, in Blender's units; rendered by Cycles without what is no integral."""
    scene = empty_scene()
    volume = bpy.data.volumes.new("Smoke")
    volume.filepath = str(vdb)
    link_object(scene, "Smoke", volume, matrix)
    material = bpy.data.materials.new("Smoke Material")
    tree = material.node_tree
    tree.nodes.clear()
    medium, output = tree.nodes.new("ShaderNodeVolumePrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(medium.outputs[0], output.inputs["Volume"])
    medium.inputs["Density"].default_value = density
    medium.inputs["Color"].default_value = (*color, 1)
    medium.inputs["Anisotropy"].default_value = anisotropy
    volume.materials.append(material)
    light = bpy.data.lights.new("Sun", "SUN")
    light.energy, light.angle = sun, 0.1
    link_object(scene, "Sun", light, look_at((0.8, -1.0, 1.6), (0, 0, 0)))
    centre = np.array([1.0, 1.0, 1.0, 1.0])
    target = (np.eye(4) if matrix is None else np.asarray(matrix)) @ centre
    camera = bpy.data.cameras.new("Camera")
    scene.camera = link_object(scene, "Camera", camera, look_at(target[:3] + (3.2, 2.0, 1.6), target[:3]))
    # Without a world Cycles shows no volume at all.
    scene.world = bpy.data.worlds.new("World")
    next(node for node in scene.world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground").inputs[
        "Color"
    ].default_value = (0, 0, 0, 1)
    scene.frame_start, scene.frame_end = 1, 1
    _cycles(scene, size)
    return scene


def _cycles(scene, size):
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.engine, scene.render.film_transparent = "CYCLES", True
    cycles = scene.cycles
    cycles.samples, cycles.volume_bounces, cycles.max_bounces = 64, 2, 2
    cycles.use_adaptive_sampling = cycles.use_denoising = cycles.volume_biased = False
    cycles.sample_clamp_indirect = cycles.light_sampling_threshold = 0.0
    cycles.pixel_filter_type, cycles.sampling_pattern = "BOX", "TABULATED_SOBOL"


def orbit(scene, frames):
    """Lets the camera go around the plume's middle over these frames, keyed."""
    scene.frame_start, scene.frame_end = frames[0], frames[-1]
    for frame in frames:
        turn = 0.05 * frame
        scene.camera.matrix_world = _matrix(
            look_at((1 + 3.8 * math.cos(turn), 1 + 3.8 * math.sin(turn), 2.6), (1, 1, 1))
        )
        for path in ("location", "rotation_euler"):
            scene.camera.keyframe_insert(path, frame=frame)


def _matrix(rows):
    return Matrix(np.asarray(rows).tolist())


def place(position, scale):
    """The matrix of an object there."""
    return np.array(Matrix.LocRotScale(position, None, (scale,) * 3))


def film(scene, seed=0, frame=None):
    """What Cycles renders of the scene itself, [height, width, 4] f32."""
    if frame is not None:
        scene.frame_set(frame)
    scene.cycles.seed = seed
    image = scene.render.image_settings
    image.media_type, image.file_format, image.color_depth = "IMAGE", "OPEN_EXR", "32"
    image.color_mode = "RGBA"
    scene.view_settings.view_transform = "Raw"
    with tempfile.TemporaryDirectory() as folder, quiet():
        scene.render.filepath = str(pathlib.Path(folder) / "film.exr")
        bpy.ops.render.render(write_still=True)
        return read_exr(scene.render.filepath)


def medium_node(kind="ShaderNodeVolumePrincipled"):
    """The node of the smoke's material, of another kind than it was if asked for, and the tree."""
    tree = bpy.data.materials["Smoke Material"].node_tree
    (node,) = (node for node in tree.nodes if node.bl_idname.startswith("ShaderNodeVolume"))
    if node.bl_idname == kind:
        return node, tree
    other = tree.nodes.new(kind)
    tree.links.new(other.outputs[0], node.outputs[0].links[0].to_socket)
    tree.nodes.remove(node)
    return other, tree


def world(kind):
    """A change: a node of this kind lights the world."""

    def change(scene):
        scene.world = bpy.data.worlds.new("Sky")
        tree = scene.world.node_tree
        back = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeBackground")
        tree.links.new(tree.nodes.new(kind).outputs[0], back.inputs["Color"])

    return change


def driven(factor, grid, socket, tree):
    """Drives a socket by the grid times a factor."""
    attribute, multiply = tree.nodes.new("ShaderNodeAttribute"), tree.nodes.new("ShaderNodeMath")
    attribute.attribute_name, multiply.operation = grid, "MULTIPLY"
    multiply.inputs[1].default_value = factor
    tree.links.new(attribute.outputs["Fac"], multiply.inputs[0])
    tree.links.new(multiply.outputs[0], socket)


def instance_of(scene, thing):
    """Links an object into a collection that is not in the scene, and an instance of that; returns the collection."""
    inner, outer = (bpy.data.collections.new(name) for name in ("Inner", "Outer"))
    outer.children.link(inner)
    inner.objects.link(thing)
    place = link_object(scene, "Instance", None)
    place.instance_type, place.instance_collection = "COLLECTION", outer
    return inner
