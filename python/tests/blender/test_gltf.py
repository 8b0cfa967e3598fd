"""glTF scenes that Blender exports have the surfaces that Blender has."""

import math

import bpy
import mathutils
import pytest


@pytest.fixture
def scene():
    """A cone beneath a turned and stretched parent, a mirrored sphere of the same parent, and a cube that is used twice."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.object.empty_add(location=(1, 2, 3), rotation=(0.3, 0.5, 0.7))
    parent = bpy.context.object
    parent.scale = (1, 2, 1.5)
    bpy.ops.mesh.primitive_cone_add(vertices=9, location=(4, 0, 0), rotation=(0.4, 0, 0))
    bpy.context.object.parent = parent
    bpy.ops.mesh.primitive_uv_sphere_add(segments=12, ring_count=6, location=(-4, 1, 0))
    bpy.context.object.scale = (-1, 1, 2)
    bpy.context.object.parent = parent
    bpy.ops.mesh.primitive_cube_add(location=(0, 0, 12))
    again = bpy.context.object.copy()
    again.location = (0, 9, 12)
    again.rotation_euler = (0, 0, math.pi / 7)
    bpy.context.scene.collection.objects.link(again)
    bpy.context.view_layer.update()


def surface():
    """Bounds, area and volume of all meshes, with +Y up as glTF has it."""
    turned = mathutils.Matrix.Rotation(-math.pi / 2, 4, "X")
    corners, area, volume = [], 0, 0
    for thing in bpy.context.scene.objects:
        if thing.type != "MESH":
            continue
        mesh, map_ = thing.data, turned @ thing.matrix_world
        sign = math.copysign(1, map_.determinant())
        mesh.calc_loop_triangles()
        for triangle in mesh.loop_triangles:
            a, b, c = (map_ @ mesh.vertices[i].co for i in triangle.vertices)
            corners += [a, b, c]
            area += (b - a).cross(c - a).length / 2
            volume += sign * a.dot(b.cross(c)) / 6
    bounds = [[pick(corner[axis] for corner in corners) for axis in range(3)] for pick in (min, max)]
    return bounds, area, volume


@pytest.mark.parametrize("form", ("GLB", "GLTF_SEPARATE"))
def test_surfaces_are_those_of_blender(cumulo, scene, tmp_path, form):
    path = tmp_path / ("scene.glb" if form == "GLB" else "scene.gltf")
    bpy.ops.export_scene.gltf(filepath=str(path), export_format=form)
    mesh = cumulo("convert", path, tmp_path / "scene.vdb", "--voxel-size", "0.5")["mesh"]
    bounds, area, volume = surface()
    assert mesh["bounds"] == [pytest.approx(corner, abs=1e-4) for corner in bounds]
    assert mesh["area"] == pytest.approx(area, rel=1e-5)
    # All face outwards, the mirrored one as well.
    assert mesh["volume"] == pytest.approx(volume, rel=1e-4) and mesh["open_edges"] == mesh["inward_shells"] == 0
