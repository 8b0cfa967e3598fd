"""Meshes that `cumulo convert` makes of volumes are those that Blender reads, and the other way about."""

import bmesh
import bpy
import numpy as np
import pytest


def imported(path):
    """The mesh of a file as Blender has it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if path.suffix == ".ply":
        bpy.ops.wm.ply_import(filepath=str(path))
    else:
        # Blender turns OBJ to Y up unless told otherwise.
        bpy.ops.wm.obj_import(filepath=str(path), forward_axis="Y", up_axis="Z")
    (thing,) = bpy.context.scene.objects
    mesh = bmesh.new()
    mesh.from_mesh(thing.data)
    return mesh


@pytest.mark.parametrize("ending", ["ply", "obj"])
def test_blender_finds_the_same_surface(cumulo, fixtures, tmp_path, ending):
    path = tmp_path / f"plume.{ending}"
    report = cumulo("convert", fixtures / "plume.vdb", path, "--iso=0.1")["mesh"]
    mesh = imported(path)
    assert (len(mesh.verts), len(mesh.faces)) == (report["vertices"], report["polygons"])
    # Signed: faces look outwards. Blender sums in single precision.
    assert mesh.calc_volume(signed=True) == pytest.approx(report["volume"], rel=1e-4)
    corners = np.array([vertex.co for vertex in mesh.verts])
    assert np.array([corners.min(0), corners.max(0)]) == pytest.approx(np.array(report["bounds"]), rel=1e-6)
    assert all(edge.is_contiguous for edge in mesh.edges if edge.is_manifold)
    # Of quads that are not flat Blender has another area, unless they are split as Cumulo does.
    bmesh.ops.triangulate(mesh, faces=mesh.faces[:], quad_method="FIXED")
    assert sum(face.calc_area() for face in mesh.faces) == pytest.approx(report["area"], rel=1e-4)


@pytest.mark.parametrize("form", ["ply", "obj"])
def test_a_mesh_of_blender_becomes_a_level_set(cumulo, tmp_path, form):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_torus_add(major_radius=1.0, minor_radius=0.4, location=(0.5, -2.0, 3.0))
    path = tmp_path / f"torus.{form}"
    if form == "ply":
        bpy.ops.wm.ply_export(filepath=str(path), export_normals=True, export_uv=True)
    else:
        bpy.ops.wm.obj_export(filepath=str(path), forward_axis="Y", up_axis="Z")
    report = cumulo("convert", path, tmp_path / "torus.vdb", "--voxel-size=0.05")
    assert report["notes"] == [] and report["mesh"]["open_edges"] == 0
    back = cumulo("convert", tmp_path / "torus.vdb", tmp_path / "back.ply")["mesh"]
    # Blender writes six decimals of an OBJ. Cells of 0.05 cut the curvature of 1 / 0.4 by 0.05^2 / 0.4, of 0.4, twice.
    assert back["volume"] == pytest.approx(report["mesh"]["volume"], rel=2 * 0.05**2 / 0.4**2)
    assert np.array(back["bounds"]) == pytest.approx(np.array(report["mesh"]["bounds"]), abs=0.05)
