"""Which ways into Blender turn a volume of a Y-up program upright, and which do not, as the guide's page on volumes has it.
A Blender that does otherwise fails these tests; then the page has to change."""

import math

import bpy
import numpy as np
import pytest
from cumulo import blender, bpy_scene, padding
from cumulo.cycles.stage import quiet
from mathutils import Vector

import openvdb  # noqa: E402  `cumulo.blender` brings it

# Voxels along x, y, z: the volume is tall along y.
SHAPE = (8, 32, 16)
HOUDINI, SOP = "Houdini 20.5.654/GEO_VDBTranslator", "Houdini/SOP_OpenVDB_Write"
MAYA, BLENDER = "Maya/OpenVDB_Write_Node", "Blender/OpenVDBWriter"


@pytest.fixture
def written(cumulo, tmp_path):
    """Function (creator, turned=False) that writes a tall file of a program, or that file after `convert --up z`."""

    def write(creator, turned=False):
        grid = openvdb.FloatGrid()
        grid.name, grid.gridClass, grid.transform = "density", openvdb.GridClass.FOG_VOLUME, openvdb.createLinearTransform(0.1)
        grid.fill((0, 0, 0), tuple(n - 1 for n in SHAPE), 1.0)
        path = tmp_path / "tall.vdb"
        openvdb.write(str(path), grids=[grid], metadata={"creator": creator} if creator else {})
        if turned:
            cumulo("convert", path, tmp_path / "turned.vdb", "--up", "z", "--up-from", "y", "--names", "blender")
            return tmp_path / "turned.vdb"
        return path

    return write


def tallest(box):
    """Name of the axis along which a box (low, high) is longest, signed by where it extends from the origin."""
    low, high = np.array(box)
    axis = int(np.argmax(high - low))
    return ("+" if high[axis] > -low[axis] else "-") + "xyz"[axis]


def stands(thing):
    """That of an object's world box."""
    bpy.context.view_layer.update()
    corners = np.array([thing.matrix_world @ Vector(corner) for corner in thing.bound_box])
    return tallest((corners.min(0), corners.max(0)))


def empty():
    with quiet():
        bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene


@pytest.mark.parametrize(
    ("creator", "turned", "rotation", "tall"),
    [
        (HOUDINI, False, 90, "+z"),
        (SOP, False, 90, "+z"),
        # The creator of the turned file is no longer Houdini, so that it is not turned once more.
        (HOUDINI, True, 0, "+z"),
        (MAYA, False, 0, "+y"),
        (MAYA, True, 0, "+z"),
        (BLENDER, False, 0, "+y"),
        ("", False, 0, "+y"),
        ("", True, 0, "+z"),
    ],
)
def test_import_openvdb_turns_files_of_houdini_alone(written, creator, turned, rotation, tall):
    empty()
    path = written(creator, turned)
    with quiet():
        assert bpy.ops.object.volume_import(filepath=str(path)) == {"FINISHED"}
    thing = bpy.context.object
    assert tuple(thing.rotation_euler) == pytest.approx((math.radians(rotation), 0, 0), abs=1e-6) and stands(thing) == tall
    thing.rotation_euler.x = 0.0
    assert stands(thing) == ("+z" if turned else "+y")


@pytest.mark.parametrize("creator", [HOUDINI, MAYA, ""])
@pytest.mark.parametrize("turned", [False, True], ids=["as it is", "turned"])
def test_other_ways_turn_nothing(written, creator, turned):
    path, tall = written(creator, turned), "+z" if turned else "+y"
    scene = empty()
    data = bpy.data.volumes.new("tall")
    data.filepath = str(path)
    thing = bpy.data.objects.new("tall", data)
    scene.collection.objects.link(thing)
    assert stands(thing) == tall
    # The operator Load Result and `cumulo.bpy_scene load` are this function.
    loaded = bpy_scene.load(path, scene)
    assert tuple(loaded.rotation_euler) == (0, 0, 0) and stands(loaded) == tall
    assert tallest(blender.where(path)["box"]) == tall
    # The cameras of `cumulo.blender render --views` look at this box.
    assert tallest(padding.world_box(*padding.lattice(path, "density"))) == tall


@pytest.mark.parametrize(
    ("creator", "turned", "axis"), [(HOUDINI, False, "Y"), (HOUDINI, True, "Z"), (MAYA, False, "Y"), (MAYA, True, "Z")]
)
def test_stages_state_their_axis_and_stand_upright(cumulo, written, tmp_path, creator, turned, axis):
    report = cumulo("usd", "author", written(creator, turned), "-o", tmp_path / "tall.usda")
    assert report["up"]["axis"] == axis
    empty()
    with quiet():
        assert bpy.ops.wm.usd_import(filepath=str(tmp_path / "tall.usda")) == {"FINISHED"}
    (thing,) = (each for each in bpy.data.objects if each.type == "VOLUME")
    assert stands(thing) == "+z" and not thing.data.materials


def test_an_export_keeps_the_turn_of_an_import(cumulo, written, tmp_path):
    scene = empty()
    with quiet():
        bpy.ops.object.volume_import(filepath=str(written(HOUDINI)))
    thing = bpy.context.object
    material = bpy.data.materials.new("smoke")
    tree = material.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new("ShaderNodeVolumePrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], output.inputs["Volume"])
    thing.data.materials.append(material)
    capture = bpy_scene.capture(tmp_path / "shots", scene, views=1, size=(4, 4), samples=1)
    corners = np.array([[(0, n - 1)[i >> axis & 1] for axis, n in enumerate(SHAPE)] + [1] for i in range(8)])
    world = (corners @ capture.lattice.T)[:, :3]
    assert tallest((world.min(0), world.max(0))) == "+z"
