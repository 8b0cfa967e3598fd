"""From scenes of Blender to scene files and captures: what is stated is what Cycles renders, and the rest is refused by name."""

import dataclasses
import json
import math
import pathlib
import shlex

import bpy
import numpy as np
import pytest
import reference
import smoke_scene
from bpy_extras.object_utils import world_to_camera_view
from cumulo import bpy_scene, padding
from cumulo.bpy_scene import sky
from cumulo.capture import Capture, look_at
from cumulo.cycles.objects import box_mesh, link_object
from cumulo.exr import read_exr, write_exr
from mathutils import Euler, Matrix, Vector

import openvdb  # isort: skip  `cumulo.cycles` brings it

# Turned, stretched, and away from the origin.
PLACE = np.array(Matrix.LocRotScale((0.3, -0.2, 0.1), Euler((0.2, 0.4, 0.6)), (1.5, 1.0, 0.8)))


def rendered(cumulo, exported, folder):
    """Function of a seed and a path that renders the first frame by the program, and returns where it is."""

    def render(seed, path):
        cumulo(*exported.arguments(folder / str(seed), 64), "--seed", seed)
        picture = folder / str(seed) / f"frame.{exported.frames[0]:04}.exr"
        assert read_exr(picture)[..., :3].max() > 0.1
        return picture

    return render


def of_cycles(name, scene, vdb):
    """Cycles' pictures of the scene as a reference."""
    return reference.of_cycles(f"bpy_scene_{name}", lambda seed: smoke_scene.film(scene, seed), [vdb, __file__])


def test_a_moved_smoke_in_sun_light_is_the_picture_of_cycles(fixtures, cumulo, cumulo_parity, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb", matrix=PLACE)
    exported = bpy_scene.export(tmp_path / "scene")
    moved = of_cycles("moved", scene, fixtures / "plume.vdb")
    assert cumulo_parity.statistical(moved, rendered(cumulo, exported, tmp_path))
    # A wrong density, by a tenth, would be found.
    document = json.loads(exported.scene.read_text())
    document["volumes"][0]["medium"]["density_scale"] *= 1.1
    exported.scene.write_text(json.dumps(document))
    with pytest.raises(pytest.fail.Exception, match="expected values differ"):
        cumulo_parity.statistical(moved, rendered(cumulo, exported, tmp_path / "wrong"))


def test_lamps_and_the_sky_are_those_of_cycles(fixtures, cumulo, cumulo_parity, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb", sun=0.0, anisotropy=0.0)
    point = bpy.data.lights.new("Point", "POINT")
    point.energy, point.color, point.shadow_soft_size, point.use_soft_falloff = 90.0, (1, 0.6, 0.3), 0.3, False
    link_object(scene, "Point", point, look_at((-0.9, 0.5, 2.2), (0, 0, 0)))
    area = bpy.data.lights.new("Area", "AREA")
    area.energy, area.shape, area.size, area.size_y, area.exposure = 40.0, "RECTANGLE", 0.6, 1.5, 1.0
    # Mirrored, it still emits along its -Z.
    link_object(scene, "Area", area, look_at((1.2, 1.1, 3.4), (1, 1, 1)) @ np.diag([-1, 1, 1, 1]))
    rows, columns = np.mgrid[0:16, 0:32]
    pixels = np.stack(
        [0.1 + 0.02 * columns, 0.5 - 0.02 * rows, 0.2 + 0.2 * (columns > 20), np.ones_like(rows, float)], axis=-1
    )
    write_exr(tmp_path / "sky.exr", pixels.astype(np.float32), "test", {})
    scene.world = bpy.data.worlds.new("World")
    tree = scene.world.node_tree
    tree.nodes.clear()
    texture, back, out = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexEnvironment", "Background", "OutputWorld")
    )
    texture.image = bpy.data.images.load(str(tmp_path / "sky.exr"))
    texture.image.colorspace_settings.name = "Linear Rec.709"
    back.inputs["Strength"].default_value = 0.5
    tree.links.new(texture.outputs["Color"], back.inputs["Color"])
    tree.links.new(back.outputs[0], out.inputs["Surface"])
    exported = bpy_scene.export(tmp_path / "scene")
    lights = json.loads(exported.scene.read_text())["lights"]
    assert [light["type"] for light in lights] == ["SphereLight", "RectLight", "DomeLight"]
    assert cumulo_parity.statistical(of_cycles("lamps", scene, fixtures / "plume.vdb"), rendered(cumulo, exported, tmp_path))


def lamp(scene, kind, place, target, radius, *, soft, cone=None, energy=400.0, color=(1, 0.6, 0.3)):
    """Links a lamp that shines from a place to a target; `cone` is the angle and the blend of a spot."""
    data = bpy.data.lights.new("Lamp", kind)
    data.energy, data.color, data.shadow_soft_size, data.use_soft_falloff = energy, color, radius, soft
    if cone:
        data.spot_size, data.spot_blend = cone
    link_object(scene, "Lamp", data, look_at(place, target)).visible_camera = False


def lamps_beside(scene):
    lamp(scene, "POINT", (-0.7, 0.4, 2.1), (1, 1, 1), 0.6, soft=True, energy=100.0, color=(0.2, 0.2, 1))
    # A point, a sphere with a sharp rim, and a disc whose whole cone falls off.
    lamp(scene, "SPOT", (2.6, 0.5, 2.4), (1, 1, 1), 0.0, soft=True, cone=(0.5, 0.15), color=(1, 0, 0))
    lamp(scene, "SPOT", (-0.9, 0.5, 2.4), (1, 1, 1), 0.3, soft=False, cone=(0.4, 0.0), color=(0, 1, 0))
    lamp(scene, "SPOT", (1.0, -1.2, 1.0), (1, 1, 1.4), 0.4, soft=True, cone=(1.2, 1.0), color=(0, 0.2, 0.6))


def lamps_inside(scene):
    lamp(scene, "POINT", (1.0, 0.9, 0.8), (1, 1, 1), 0.3, soft=True, color=(1, 0.2, 0))
    lamp(scene, "SPOT", (1.0, 0.9, 1.6), (1.2, 0.8, 0.5), 0.1, soft=True, cone=(2.0, 0.5), color=(0, 0.2, 1))


@pytest.mark.parametrize("lamps", [lamps_beside, lamps_inside])
def test_soft_falloff_and_spots_are_those_of_cycles(fixtures, cumulo, cumulo_parity, tmp_path, lamps):
    scene = smoke_scene.smoke(fixtures / "plume.vdb", sun=0.0, anisotropy=0.0)
    lamps(scene)
    exported = bpy_scene.export(tmp_path / "scene")
    lit = of_cycles(lamps.__name__, scene, fixtures / "plume.vdb")
    assert cumulo_parity.statistical(lit, rendered(cumulo, exported, tmp_path))
    # Without soft falloff, and with another blend, there would be other pictures.
    document = json.loads(exported.scene.read_text())
    for light in document["lights"]:
        light.pop("soft_falloff", None)
        light |= {"blend": 0.0} if light["type"] == "SpotLight" else {}
    exported.scene.write_text(json.dumps(document))
    with pytest.raises(pytest.fail.Exception, match="expected values differ"):
        cumulo_parity.statistical(lit, rendered(cumulo, exported, tmp_path / "wrong"))


def test_a_sky_is_a_picture_and_a_sun(fixtures, cumulo, cumulo_parity, tmp_path, monkeypatch):
    monkeypatch.setattr(sky, "SIZE", (256, 128))
    scene = smoke_scene.smoke(fixtures / "plume.vdb", sun=0.0, size=(16, 12))
    smoke_scene.world("ShaderNodeTexSky")(scene)
    node = scene.world.node_tree.nodes["Sky Texture"]
    node.sun_elevation, node.sun_rotation = 0.6, 2.0
    worlds = len(bpy.data.worlds)
    scene.frame_end = 2
    exported = bpy_scene.export(tmp_path / "scene", frames=(1, 2))
    # One picture for both frames, and nothing of it stays.
    assert exported.scene.name == "scene.json" and len(bpy.data.worlds) == worlds and node.sun_disc
    sun, dome = json.loads(exported.scene.read_text())["lights"]
    assert dome == {"type": "DomeLight", "texture": "world.exr"}
    towards = np.array((math.cos(0.6) * math.sin(2.0), math.cos(0.6) * math.cos(2.0), math.sin(0.6)))
    assert np.array(sun["direction"]) == pytest.approx(towards, abs=1e-3) and sun["angle"] == pytest.approx(0.545)
    under_sky = of_cycles("sky", scene, fixtures / "plume.vdb")
    # The disc is darker towards its rim, and the picture has pixels of 1.4 degrees.
    assert cumulo_parity.statistical(under_sky, rendered(cumulo, exported, tmp_path), tolerance=0.01)


def test_pictures_of_worlds_stand_as_cycles_has_them(fixtures, tmp_path, monkeypatch):
    monkeypatch.setattr(sky, "SIZE", (64, 32))
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    rows, columns = np.mgrid[0:32, 0:64]
    pixels = np.stack([rows / 32, columns / 64, (rows * columns % 7) / 7, np.ones((32, 64))], axis=-1).astype(np.float32)
    write_exr(tmp_path / "sky.exr", pixels, "test", {})
    smoke_scene.world("ShaderNodeTexEnvironment")(scene)
    node = scene.world.node_tree.nodes["Environment Texture"]
    node.image, node.interpolation = bpy.data.images.load(str(tmp_path / "sky.exr")), "Closest"
    node.image.colorspace_settings.name = "Linear Rec.709"
    node.image.pack()
    exported = bpy_scene.export(tmp_path / "still")
    _, dome = json.loads(exported.scene.read_text())["lights"]
    assert dome == {"type": "DomeLight", "texture": "world.exr"}
    # Samples may fall on a pixel's border; half of single precision is lost in angles.
    assert np.abs(read_exr(tmp_path / "still" / "world.exr") - pixels).mean() < 1e-3
    # A picture of each frame where the world moves.
    back = scene.world.node_tree.nodes["Background"].inputs["Strength"]
    for frame in (1, 2):
        back.default_value = frame
        back.keyframe_insert("default_value", frame=frame)
    bpy_scene.export(tmp_path / "moving", scene, (1, 2))
    first, second = (read_exr(tmp_path / "moving" / f"world.000{frame}.exr") for frame in (1, 2))
    assert second[..., :3] == pytest.approx(2 * first[..., :3], rel=1e-5)


def test_what_is_made_while_views_are_rendered_stays(fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    shots = bpy_scene.shots(tmp_path, views=2, size=(8, 8), samples=1)
    assert next(shots) == (1, 2)
    material, box = bpy.data.materials.new("Mine"), box_mesh(scene, (3, 3, 3), (4, 4, 4))
    box.name = "My box"
    for _ in shots:
        pass
    assert scene.objects["My box"] == box and bpy.data.materials["Mine"] == material
    assert [each.name for each in bpy.data.scenes] == ["Scene"] and len(bpy.data.volumes) == len(bpy.data.cameras) == 1


def test_an_undo_ends_the_views_and_leaves_no_scene(fixtures, tmp_path):
    smoke_scene.smoke(fixtures / "plume.vdb")
    bpy.ops.ed.undo_push(message="before")
    shots = bpy_scene.shots(tmp_path, views=2, size=(8, 8), samples=1)
    next(shots)
    bpy.data.objects.new("Mine", None)
    bpy.ops.ed.undo_push(message="an object")
    bpy.ops.ed.undo()
    with pytest.raises(ReferenceError):
        next(shots)
    assert [scene.name for scene in bpy.data.scenes] == ["Scene"] and not list(tmp_path.iterdir())


def test_a_cancelled_capture_leaves_the_one_before(fixtures, tmp_path):
    smoke_scene.smoke(fixtures / "plume.vdb")
    bpy_scene.capture(tmp_path, views=2, size=(8, 8), samples=1)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    shots = bpy_scene.shots(tmp_path, views=2, size=(16, 16), samples=1)
    next(shots)
    shots.close()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_grid_is_read_once_for_all_frames(fixtures, tmp_path, monkeypatch):
    vdb, read = tmp_path / "smoke.vdb", []
    vdb.write_bytes((fixtures / "plume.vdb").read_bytes())
    monkeypatch.setattr(padding, "read_grid", lambda *words, grid=padding.read_grid: read.append(words) or grid(*words))
    smoke_scene.smoke(vdb)
    bpy_scene.export(tmp_path / "out", frames=(1, 2, 3))
    assert len(read) == 1
    # Another file of that name is read.
    padding.moved_copy(fixtures / "plume.vdb", "density", np.diag([2.0, 2.0, 2.0, 1.0]), vdb)
    before, (matrix, _) = len(read), padding.lattice(vdb, "density")
    assert len(read) == before + 1 and matrix[0, 0] == pytest.approx(2 / 24)


def test_three_lines_make_a_capture(fixtures, tmp_path):
    smoke_scene.smoke(fixtures / "plume.vdb", matrix=PLACE)
    before = [set(getattr(bpy.data, kind).keys()) for kind in ("scenes", "objects", "materials", "cameras", "worlds")]
    captures = [bpy_scene.capture(tmp_path / str(seed), views=2, size=(32, 32), seed=10 * seed) for seed in (1, 2)]
    assert before == [
        set(getattr(bpy.data, kind).keys()) for kind in ("scenes", "objects", "materials", "cameras", "worlds")
    ]
    capture = Capture.read(tmp_path / "1")
    # In object space Blender divides the density by the scale along the diagonal.
    scale = 4.0 / np.linalg.norm(PLACE[:3, :3] @ np.full(3, 3**-0.5))
    assert (capture.model, capture.pixel_filter) == ("absorption", "box")
    assert capture.density_scale == pytest.approx(scale, rel=1e-6)
    assert np.allclose(capture.lattice, PLACE @ padding.lattice(fixtures / "plume.vdb", "density")[0], atol=1e-6)
    # The moved volume's exact integral, over 4 x 4 points a pixel.
    padding.moved_copy(fixtures / "plume.vdb", "density", PLACE, tmp_path / "moved.vdb")
    for view in range(2):
        camera = capture.frames[view][0]
        fine = [
            reference.optical_depth(tmp_path / "moved.vdb", "density", shifted(camera, x, y))
            for x in OFFSETS
            for y in OFFSETS
        ]
        expected = np.exp(-scale * np.array(fine)).mean(axis=0)
        pictures = [1 - read_exr(one.frames[view][1])[..., 3] for one in captures]
        assert 0.02 < expected.min() < 0.8
        assert reference.excess(*pictures, expected, samples=32) <= 1.0


OFFSETS = (-0.375, -0.125, 0.125, 0.375)


def shifted(camera, x, y):
    """The camera with its pixels' centres elsewhere, by fractions of a pixel."""
    return dataclasses.replace(camera, cx=camera.cx - x, cy=camera.cy - y)


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_cameras_see_points_where_blender_does(fixtures, fit, kind):
    scene = smoke_scene.smoke(fixtures / "plume.vdb", size=(40, 56))
    scene.render.pixel_aspect_x, scene.render.resolution_percentage = 1.5, 50
    data = scene.camera.data
    data.type, data.sensor_fit, data.lens, data.sensor_width, data.sensor_height = kind, fit, 40.0, 30.0, 20.0
    data.shift_x, data.shift_y, data.ortho_scale = 0.1, -0.2, 3.0
    scene.camera.scale = (2.0, 2.0, 2.0)
    _, camera, _ = bpy_scene.describe(".", scene)
    assert (camera.width, camera.height) == (20, 28)
    for point in ((0.4, 1.1, 0.3), (1.5, 0.2, 1.9), (1.0, 1.0, 1.0)):
        at = np.linalg.inv(camera.camera_to_world) @ (*point, 1.0)
        depth = 1.0 if kind == "ORTHO" else -at[2]
        pixel = (camera.cx + camera.fl_x * at[0] / depth, camera.cy - camera.fl_y * at[1] / depth)
        u, v, _ = world_to_camera_view(scene, scene.camera, Vector(point))
        assert pixel == pytest.approx((20 * u, 28 * (1 - v)), abs=2e-3)


def test_media_of_node_trees(fixtures):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")

    def medium():
        return bpy_scene.describe(".", scene)[0]["volumes"][0]["medium"]

    node, tree = smoke_scene.medium_node()
    node.inputs["Absorption Color"].default_value = (0.25, 0.25, 0.0, 1)
    found, color = medium(), np.array((0.9, 0.8, 0.6))
    extinction = color + (1 - color) * (0.5, 0.5, 1.0)
    assert found["density_scale"] == pytest.approx(4 * extinction.max())
    assert found["extinction_color"] == pytest.approx(extinction / extinction.max())
    assert found["albedo"] == pytest.approx(color / extinction)
    # The grid by a link, through a reroute, and fire beside it.
    node.inputs["Absorption Color"].default_value = (0, 0, 0, 1)
    node.inputs["Density Attribute"].default_value = ""
    smoke_scene.driven(2.5, "density", node.inputs["Density"], tree)
    smoke_scene.driven(0.5, "density", node.inputs["Emission Strength"], tree)
    node.inputs["Emission Color"].default_value = (1.0, 0.5, 0.25, 1)
    node.inputs["Blackbody Intensity"].default_value, node.inputs["Temperature Attribute"].default_value = (
        0.5,
        "density",
    )
    found = medium()
    assert found["density_scale"] == pytest.approx(2.5) and "extinction_color" not in found
    assert found["emission_grid"] == {"grid": "density", "radiance": pytest.approx([0.5, 0.25, 0.125])}
    assert found["blackbody"] == {
        "grid": "density",
        "kelvin": 1000.0,
        "intensity": pytest.approx(0.5),
        "tint": [1.0, 1.0, 1.0],
    }
    # A scatterer and half an absorber, added; the scatterer takes no light that it does not scatter.
    scatter, tree = smoke_scene.medium_node("ShaderNodeVolumeScatter")
    scatter.inputs["Color"].default_value, scatter.inputs["Anisotropy"].default_value = (0.5, 0.5, 0.5, 1), -0.2
    smoke_scene.driven(3.0, "density", scatter.inputs["Density"], tree)
    absorb, mix, add = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("VolumeAbsorption", "MixShader", "AddShader"))
    absorb.inputs["Color"].default_value = (0.2, 0.2, 0.2, 1)
    smoke_scene.driven(5.0, "density", absorb.inputs["Density"], tree)
    mix.inputs[0].default_value = 0.5
    output = scatter.outputs[0].links[0].to_socket
    tree.links.new(absorb.outputs[0], mix.inputs[2])
    tree.links.new(scatter.outputs[0], add.inputs[0])
    tree.links.new(mix.outputs[0], add.inputs[1])
    tree.links.new(add.outputs[0], output)
    found = medium()
    assert found["density_scale"] == pytest.approx(1.5 + 2.0)
    assert (found["albedo"], found["anisotropy"]) == (pytest.approx([1.5 / 3.5] * 3), -0.2)


def test_animations_state_each_frame(fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    smoke_scene.orbit(scene, (3, 4, 5))
    exported = bpy_scene.export(tmp_path / "still", frames=bpy_scene.frames_of(scene))
    assert exported.scene.name == "scene.json" and exported.frames == (3, 4, 5)
    capture = Capture.read(exported.cameras)
    assert [picture.name for _, picture in capture.frames] == ["frame.0003.exr", "frame.0004.exr", "frame.0005.exr"]
    turned = [camera.camera_to_world for camera, _ in capture.frames]
    assert np.abs(turned[0] - turned[2]).max() > 0.05
    # A driven density, a keyed place, a sequence of files: another scene in each frame.
    node, _ = smoke_scene.medium_node()
    node.inputs["Density"].driver_add("default_value").driver.expression = "frame * 2"
    thing = scene.objects["Smoke"]
    for frame in (3, 5):
        thing.location.x = 0.25 * frame
        thing.keyframe_insert("location", frame=frame)
    for curve in thing.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    scene.frame_set(1)
    exported = bpy_scene.export(tmp_path / "moving", frames=(3, 4, 5))
    assert exported.scene.name == "scene.####.json" and scene.frame_current == 1
    for frame in (3, 4, 5):
        (volume,) = json.loads((tmp_path / "moving" / f"scene.{frame:04}.json").read_text())["volumes"]
        assert volume["medium"]["density_scale"] == pytest.approx(2 * frame)
        assert volume["transform"][0][3] == pytest.approx(0.25 * frame)


def test_sequences_name_the_file_of_each_frame(fixtures, tmp_path):
    for number in (7, 8):
        (tmp_path / f"smoke_{number:03}.vdb").write_bytes((fixtures / "plume.vdb").read_bytes())
    scene = smoke_scene.smoke(tmp_path / "smoke_007.vdb")
    volume = bpy.data.volumes["Smoke"]
    volume.is_sequence, volume.frame_start, volume.frame_duration, volume.frame_offset = True, 1, 2, 6
    bpy_scene.export(tmp_path / "out", frames=(1, 2))
    for frame in (1, 2):
        (entry,) = json.loads((tmp_path / "out" / f"scene.{frame:04}.json").read_text())["volumes"]
        assert entry["file"] == f"../smoke_{frame + 6:03}.vdb"
    (tmp_path / "smoke_008.vdb").unlink()
    scene.frame_set(1)
    with pytest.raises(bpy_scene.Refused, match="object 'Smoke': its sequence from .*smoke_007.vdb.*: smoke_008.vdb not found"):
        bpy_scene.export(tmp_path / "out", frames=(1, 2))


def places(scene):
    """Places along x of the volumes that an export states, in order."""
    entries = bpy_scene.describe(".", scene)[0]["volumes"]
    return sorted(round(entry.get("transform", np.eye(4).tolist())[0][3], 3) for entry in entries)


def test_volumes_are_those_that_cycles_renders(fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    # In a collection that a view layer includes, inside one that it excludes.
    outer, inner = (bpy.data.collections.new(name) for name in ("Outer", "Inner"))
    scene.collection.children.link(outer)
    outer.children.link(inner)
    for collection, x in ((outer, 1.0), (inner, 2.0)):
        copy = scene.objects["Smoke"].copy()
        copy.location.x = x
        collection.objects.link(copy)
    layers = scene.view_layers[0].layer_collection.children["Outer"]
    layers.exclude, layers.children["Inner"].exclude = True, False
    assert places(scene) == [0.0, 2.0]
    # In an instance of a collection, unless a collection in it is disabled in renders.
    copy = scene.objects["Smoke"].copy()
    copy.location.x = 3.0
    collection = smoke_scene.instance_of(scene, copy)
    assert places(scene) == [0.0, 2.0, 3.0]
    collection.hide_render = True
    assert places(scene) == [0.0, 2.0]
    collection.hide_render = False
    # One whose sequence has no file at the present frame is rendered as nothing.
    copy.data = copy.data.copy()
    copy.data.is_sequence, copy.data.frame_start, copy.data.frame_duration, copy.data.sequence_mode = True, 1, 1, "CLIP"
    (tmp_path / "one_001.vdb").write_bytes((fixtures / "plume.vdb").read_bytes())
    copy.data.filepath = str(tmp_path / "one_001.vdb")
    scene.frame_set(1)
    assert places(scene) == [0.0, 2.0, 3.0]
    scene.frame_set(2)
    assert places(scene) == [0.0, 2.0]


def test_the_present_frame_is_exported_with_its_subframe(fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    thing = scene.objects["Smoke"]
    for frame, x in ((1, 0.0), (2, 1.0)):
        thing.location.x = x
        thing.keyframe_insert("location", frame=frame)
    scene.frame_set(1, subframe=0.5)
    for frames, x in ((None, 0.5), ((1,), 0.5), ((1, 2), 0.0)):
        exported = bpy_scene.export(tmp_path / "out", frames=frames)
        (volume,) = json.loads(pathlib.Path(str(exported.scene).replace("####", "0001")).read_text())["volumes"]
        assert volume.get("transform", np.eye(4).tolist())[0][3] == pytest.approx(x, abs=1e-6)
    assert (scene.frame_current, scene.frame_subframe) == (1, 0.5)


def test_commands_are_quoted(fixtures, tmp_path):
    smoke_scene.smoke(fixtures / "plume.vdb")
    exported = bpy_scene.export(tmp_path / "a smoke; $(it)")
    assert shlex.split(exported.command(tmp_path / "it's")) == ["cumulo", *exported.arguments(tmp_path / "it's")]


@pytest.mark.parametrize("empty", ["slots", "the first slot"])
def test_a_volume_without_a_material_is_the_one_of_cycles(fixtures, cumulo, cumulo_parity, tmp_path, empty):
    scene = smoke_scene.smoke(fixtures / "plume.vdb", sun=12.0, size=(16, 12))
    materials = bpy.data.volumes["Smoke"].materials
    if empty == "slots":
        materials.clear()
    else:
        materials.append(materials[0])
        materials[0] = None
    exported = bpy_scene.export(tmp_path / "scene")
    unshaded = of_cycles(f"unshaded_{empty.replace(' ', '_')}", scene, fixtures / "plume.vdb")
    assert cumulo_parity.statistical(unshaded, rendered(cumulo, exported, tmp_path))
    padding.moved_copy(fixtures / "plume.vdb", "density", np.eye(4), tmp_path / "other.vdb")
    grid = openvdb.read(str(tmp_path / "other.vdb"), "density")
    grid.name = "soot"
    openvdb.write(str(tmp_path / "other.vdb"), grids=[grid])
    bpy.data.volumes["Smoke"].filepath = str(tmp_path / "other.vdb")
    with pytest.raises(bpy_scene.Refused, match="no material, and its file has soot, no grid 'density'"):
        bpy_scene.export(tmp_path / "scene")


def test_captures_are_refused_where_they_would_show_another_medium(fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    node, _ = smoke_scene.medium_node()
    node.inputs["Absorption Color"].default_value = (0.5, 0.1, 0.0, 1)
    with pytest.raises(bpy_scene.Refused, match="object 'Smoke'.*extinction has the color"):
        bpy_scene.capture(tmp_path / "out", views=1)
    node.inputs["Absorption Color"].default_value = (0, 0, 0, 1)
    other = scene.objects["Smoke"].copy()
    other.name = "Other"
    scene.collection.objects.link(other)
    with pytest.raises(bpy_scene.Refused, match="2 volumes are rendered .all: Smoke, Other"):
        bpy_scene.capture(tmp_path / "out", views=1)
    with pytest.raises(bpy_scene.Refused, match="0 volumes named 'None'"):
        bpy_scene.capture(tmp_path / "out", volume="None", views=1)
    assert not (tmp_path / "out").exists()


def test_angles_of_suns_are_degrees(fixtures):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    (sun,) = bpy_scene.describe(".", scene)[0]["lights"]
    assert sun["angle"] == pytest.approx(math.degrees(0.1))
    assert np.array(sun["direction"]) == pytest.approx(
        np.array((0.8, -1.0, 1.6)) / np.linalg.norm((0.8, -1.0, 1.6)), abs=1e-6
    )
