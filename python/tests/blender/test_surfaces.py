"""Surfaces among volumes: meshes of a scene of Blender are rendered as Cycles renders them."""

import json

import bmesh
import bpy
import numpy as np
import pytest
import reference
import smoke_scene
from cumulo import bpy_scene
from cumulo.capture import look_at
from cumulo.cycles.objects import box_mesh, link_object
from cumulo.exr import read_exr
from mathutils import Euler, Matrix
from test_blur import in_focus, moving
from test_bpy_scene import lamp


def material(name, color=(0.8, 0.8, 0.8), emission=None):
    """A diffuse material, or one that emits."""
    made = bpy.data.materials.new(name)
    tree = made.node_tree
    tree.nodes.clear()
    kind, strength = ("BsdfDiffuse", None) if emission is None else ("Emission", emission)
    shader, output = tree.nodes.new(f"ShaderNode{kind}"), tree.nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = (*color, 1)
    if strength is not None:
        shader.inputs["Strength"].default_value = strength
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return made


def quad(scene, corner, first, second, color=(0.8, 0.8, 0.8)):
    """A parallelogram."""
    a, u, v = (np.array(vector, dtype=float) for vector in (corner, first, second))
    mesh = bpy.data.meshes.new("Quad")
    mesh.from_pydata([a.tolist(), (a + u).tolist(), (a + u + v).tolist(), (a + v).tolist()], [], [(0, 1, 2, 3)])
    mesh.materials.append(material("Quad", color))
    return link_object(scene, "Quad", mesh)


def ball(scene, centre, radius, made=None):
    """A sphere of triangles with flat faces; `made` is its material."""
    mesh, shape = bpy.data.meshes.new("Ball"), bmesh.new()
    bmesh.ops.create_icosphere(shape, subdivisions=3, radius=radius)
    shape.to_mesh(mesh)
    shape.free()
    mesh.materials.append(made or material("Ball", (0.9, 0.3, 0.2)))
    return link_object(scene, "Ball", mesh, np.array(Matrix.Translation(centre)))


def floor(scene):
    """A floor beneath the plume."""
    return quad(scene, (-3, -3, 0.1), (8, 0, 0), (0, 8, 0), (0.7, 0.6, 0.5))


def even_world(scene, strength):
    node = next(node for node in scene.world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")
    node.inputs["Color"].default_value = (*strength, 1)


def room(scene):
    floor(scene)
    quad(scene, (-0.6, -3, 0.1), (0, 8, 0), (0, 0, 4), (0.8, 0.1, 0.1))
    quad(scene, (-3, -0.6, 0.1), (8, 0, 0), (0, 0, 4), (0.1, 0.7, 0.2))
    even_world(scene, (0.3, 0.4, 0.6))


def ball_in_the_smoke(scene):
    floor(scene)
    ball(scene, (1.1, 0.9, 1.1), 0.45)


def ball_that_shines(scene):
    scene.objects["Sun"].hide_render = True
    floor(scene)
    ball(scene, (1.9, 1.2, 0.6), 0.25, material("Lamp", (1, 0.6, 0.3), 6.0))


def ball_held_out(scene):
    floor(scene)
    ball(scene, (1.3, 1.1, 0.9), 0.5).is_holdout = True


def lamps_over_a_floor(scene):
    scene.objects["Sun"].hide_render = True
    floor(scene)
    lamp(scene, "POINT", (0.2, 1.6, 1.3), (1, 1, 1), 0.3, soft=True, energy=30.0, color=(0.2, 0.3, 1))
    lamp(scene, "SPOT", (2.6, 0.5, 2.4), (1.2, 1, 0.1), 0.0, soft=True, cone=(0.7, 0.3), color=(1, 0.2, 0.1))
    area = bpy.data.lights.new("Area", "AREA")
    area.energy, area.shape, area.size, area.size_y = 30.0, "RECTANGLE", 0.6, 1.5
    link_object(scene, "Area", area, look_at((1.2, 1.1, 3.4), (1, 1, 1))).visible_camera = False


def moving_lens(scene):
    floor(scene)
    ball(scene, (1.6, 1.5, 0.5), 0.3)
    moving(scene, "START", 0.8)
    in_focus(scene, 2.0, 0.1)


def colored_smoke(scene):
    node, tree = smoke_scene.medium_node("ShaderNodeVolumeScatter")
    node.inputs["Color"].default_value = (1.0, 0.5, 0.2, 1)
    smoke_scene.driven(4.0, "density", node.inputs["Density"], tree)
    floor(scene)
    ball(scene, (1.1, 0.9, 1.1), 0.3)
    even_world(scene, (0.3, 0.3, 0.3))


def fire_on_a_floor(scene):
    scene.objects["Sun"].hide_render = True
    node, tree = smoke_scene.medium_node()
    node.inputs["Emission Color"].default_value = (1.0, 0.5, 0.1, 1)
    smoke_scene.driven(3.0, "density", node.inputs["Emission Strength"], tree)
    floor(scene)
    ball(scene, (1.7, 1.7, 0.4), 0.3)


def a_curve_and_a_mirror(scene):
    curve = bpy.data.curves.new("Letter", "CURVE")
    curve.dimensions, curve.fill_mode, curve.extrude = "2D", "BOTH", 0.1
    spline = curve.splines.new("POLY")
    outline = [(0, 0), (0.2, 0), (0.4, 0.9), (0.6, 0), (0.8, 0), (0.5, 1.3), (0.3, 1.3)]
    spline.points.add(len(outline) - 1)
    for point, (x, y) in zip(spline.points, outline):
        point.co = (x, y, 0, 1)
    spline.use_cyclic_u, spline.use_smooth = True, False
    curve.materials.append(material("Letter", (0.2, 0.5, 0.9)))
    upright = np.array(Matrix.LocRotScale((2.6, 1.2, 0.1), Euler((1.5708, 0, 1.9)), None))
    link_object(scene, "Letter", curve, upright)
    box = box_mesh(scene, (0, 0, 0), (0.5, 0.3, 0.7))
    box.data.materials.append(material("Top", (0.9, 0.8, 0.2)))
    box.data.materials.append(material("Side", (0.1, 0.1, 0.1)))
    for polygon in box.data.polygons:
        polygon.material_index = polygon.index % 2
    scene.collection.objects.unlink(box)
    smoke_scene.instance_of(scene, box)
    scene.objects["Instance"].matrix_world = Matrix.LocRotScale((2.2, 0.6, 0.1), None, (-1, 1, 1))
    floor(scene)


def smokes_on_a_floor(scene):
    second = scene.objects["Smoke"].copy()
    scene.collection.objects.link(second)
    second.matrix_world = Matrix.LocRotScale((0.6, -0.3, 0.2), None, (0.8, 0.8, 0.8))
    floor(scene)
    ball(scene, (1.1, 0.9, 1.1), 0.3)


@pytest.mark.parametrize("furnish", [room, ball_in_the_smoke, ball_that_shines, ball_held_out, lamps_over_a_floor, moving_lens,
                                     colored_smoke, fire_on_a_floor, a_curve_and_a_mirror, smokes_on_a_floor])  # fmt: skip
def test_surfaces_are_those_of_cycles(fixtures, cumulo, cumulo_parity, tmp_path, furnish):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    furnish(scene)
    exported = bpy_scene.export(tmp_path / "scene")
    assert exported.left_out == ()
    of_cycles = reference.of_cycles(
        f"surfaces_{furnish.__name__}",
        lambda seed: smoke_scene.film(scene, seed),
        [fixtures / "plume.vdb", __file__],
    )

    def rendered(seed, path):
        folder = tmp_path / "rendered" / str(seed)
        cumulo(*exported.arguments(folder, 64), "--seed", seed)
        picture = folder / f"frame.{exported.frames[0]:04}.exr"
        assert read_exr(picture)[..., :3].max() > 0.1
        return picture

    assert cumulo_parity.statistical(of_cycles, rendered)


def test_a_wrong_albedo_is_found(fixtures, cumulo, cumulo_parity, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    ball_in_the_smoke(scene)
    exported = bpy_scene.export(tmp_path / "scene")
    document = json.loads(exported.scene.read_text())
    for mesh in document["meshes"]:
        mesh["albedo"] = [0.95 * v for v in mesh["albedo"]]
    exported.scene.write_text(json.dumps(document))
    of_cycles = reference.of_cycles(
        "surfaces_ball_in_the_smoke",
        lambda seed: smoke_scene.film(scene, seed),
        [fixtures / "plume.vdb", __file__],
    )

    def rendered(seed, path):
        folder = tmp_path / "rendered" / str(seed)
        cumulo(*exported.arguments(folder, 64), "--seed", seed)
        return folder / f"frame.{exported.frames[0]:04}.exr"

    with pytest.raises(pytest.fail.Exception, match="expected values differ"):
        cumulo_parity.statistical(of_cycles, rendered)
