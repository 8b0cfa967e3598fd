"""What an export of a scene of Blender refuses by name, and what it leaves out on request."""

import json
import pathlib

import bpy
import numpy as np
import pytest
import smoke_scene
from cumulo import bpy_scene
from cumulo.capture import Capture, look_at
from cumulo.cycles.objects import box_mesh, link_object
from mathutils import Matrix

import openvdb  # isort: skip  `cumulo.cycles` brings it



def light(kind, **options):
    """A change of the scene: another light in it."""

    def change(scene):
        data = bpy.data.lights.new("Lamp", kind)
        data.energy = 10.0
        for name, value in options.items():
            setattr(data, name, value)
        link_object(scene, "Lamp", data, look_at((-3, 0, 3), (0, 0, 0)))

    return change


def attribute(path, value, root="scene"):
    """A change of one property, `path` from the scene or the smoke."""

    def change(scene):
        thing = scene if root == "scene" else scene.objects["Smoke"]
        *steps, name = path.split(".")
        for step in steps:
            thing = getattr(thing, step)
        setattr(thing, name, value)

    return change


def material(change):
    """A change of the material's tree, given the Principled Volume and the tree."""
    return lambda scene: change(*smoke_scene.medium_node())


def linked(socket, kind, output=0):
    """A change: a node of this kind drives a socket of the Principled Volume."""

    def change(node, tree):
        tree.links.new(tree.nodes.new(kind).outputs[output], node.inputs[socket])

    return material(change)


def value(socket, number):
    """A change: a socket of the Principled Volume has this value."""

    def change(node, tree):
        node.inputs[socket].default_value = number

    return material(change)


def sun_in_sight(scene):
    smoke_scene.world("ShaderNodeTexSky")(scene)
    scene.render.film_transparent = False
    # The sun is in the north, 15 degrees above the horizon.
    scene.camera.matrix_world = Matrix(look_at((1, -3, 1), (1, 1, 2)).tolist())


def focus_on_a_bone(scene):
    armature = link_object(scene, "Rig", bpy.data.armatures.new("Rig"), np.eye(4))
    dof = scene.camera.data.dof
    dof.use_dof, dof.focus_object, dof.focus_subtarget = True, armature, "Hand"


def rolling_shutter(scene):
    scene.render.use_motion_blur, scene.cycles.rolling_shutter_type = True, "TOP"


def moving_sun(scene):
    scene.render.use_motion_blur = True
    sun = scene.objects["Sun"]
    for frame in (0, 2):
        sun.location.x = 0.1 * frame
        sun.keyframe_insert("location", frame=frame)


def mirror(scene):
    thing = box_mesh(scene, (3, 3, 3), (4, 4, 4))
    made = bpy.data.materials.new("Mirror")
    nodes = made.node_tree.nodes
    nodes.clear()
    shader, output = nodes.new("ShaderNodeBsdfGlossy"), nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = (0.9, 0.8, 0.1, 1)
    made.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    thing.data.materials.append(made)


def plastic(scene):
    thing = box_mesh(scene, (3, 3, 3), (4, 4, 4))
    thing.data.materials.append(bpy.data.materials.new("Plastic"))


def striped(scene):
    mirror(scene)
    tree = bpy.data.materials["Mirror"].node_tree
    diffuse, texture = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeTexWave")
    tree.links.new(texture.outputs["Color"], diffuse.inputs["Color"])
    tree.links.new(diffuse.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])


def smooth(scene):
    thing = box_mesh(scene, (3, 3, 3), (4, 4, 4))
    thing.data.shade_smooth()


def bounces(scene):
    box_mesh(scene, (3, 3, 3), (4, 4, 4))
    scene.cycles.max_bounces = 4


def half_visible(scene):
    box_mesh(scene, (3, 3, 3), (4, 4, 4)).visible_shadow = False


def foggy_box(scene):
    thing = box_mesh(scene, (3, 3, 3), (4, 4, 4))
    thing.data.materials.append(bpy.data.materials["Smoke Material"])


def domain(scene):
    thing = box_mesh(scene, (3, 3, 3), (4, 4, 4))
    thing.modifiers.new("Fluid", "FLUID").fluid_type = "DOMAIN"


def procedural(scene):
    group = bpy.data.node_groups.new("Cloud", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    cube, output = group.nodes.new("GeometryNodeVolumeCube"), group.nodes.new("NodeGroupOutput")
    group.links.new(cube.outputs[0], output.inputs[0])
    box_mesh(scene, (3, 3, 3), (4, 4, 4)).modifiers.new("Cloud", "NODES").node_group = group


def holdout(scene):
    collection = bpy.data.collections.new("Masks")
    scene.collection.children.link(collection)
    collection.objects.link(scene.objects["Smoke"])
    scene.view_layers[0].layer_collection.children["Masks"].holdout = True


def modifier(scene):
    scene.objects["Smoke"].modifiers.new("Wobble", "VOLUME_DISPLACE")


def two_grids(node, tree):
    smoke_scene.driven(1.0, "density", node.inputs["Density"], tree)


def scatter_phase(scene):
    node, tree = smoke_scene.medium_node("ShaderNodeVolumeScatter")
    node.phase = "DRAINE"
    smoke_scene.driven(1.0, "density", node.inputs["Density"], tree)


def glass(node, tree):
    tree.links.new(tree.nodes.new("ShaderNodeVolumeCoefficients").outputs[0], node.outputs[0].links[0].to_socket)


def seen_lamp(scene):
    data = bpy.data.lights.new("Lamp", "AREA")
    link_object(scene, "Lamp", data, look_at((1, 1, 1), (4.2, 3.0, 2.6))).visible_camera = True


def profile(scene):
    light("POINT", use_nodes=True)(scene)
    tree = bpy.data.lights["Lamp"].node_tree
    emission = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeEmission")
    tree.links.new(tree.nodes.new("ShaderNodeTexIES").outputs[0], emission.inputs["Strength"])


def scaled_spot(scene):
    light("SPOT")(scene)
    scene.objects["Lamp"].scale = (2, 1, 1)


def seen_sun(scene):
    sun = scene.objects["Sun"]
    sun.visible_camera, sun.matrix_world = True, Matrix(look_at((-3.2, -2.0, -1.6), (0, 0, 0)).tolist())


def simplified(scene):
    scene.render.use_simplify, scene.render.simplify_volumes = True, 0.5


def overridden(scene):
    scene.view_layers[0].material_override = bpy.data.materials["Smoke Material"]


def few_bounces(scene):
    scene.objects["Sun"].data.cycles.max_bounces = 0


def left_out(name):
    """A change: the view layer leaves this out."""
    return lambda scene: setattr(scene.view_layers[0], name, False)


def covered(node, tree):
    output = node.outputs[0].links[0].to_node
    tree.links.new(tree.nodes.new("ShaderNodeBsdfPrincipled").outputs[0], output.inputs["Surface"])


def sheared_lamp(scene):
    data = bpy.data.lights.new("Lamp", "AREA")
    shear = np.eye(4)
    # Columns of length 1.
    shear[:2, 1] = 0.6, 0.8
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    thing = link_object(scene, "Lamp", data)
    thing.parent, thing.matrix_parent_inverse = parent, Matrix(shear.tolist())


def hidden_instance(scene):
    smoke_scene.instance_of(scene, scene.objects["Smoke"].copy()).hide_viewport = True


def past_the_end(scene):
    volume = bpy.data.volumes["Smoke"]
    path = pathlib.Path(bpy.app.tempdir) / "one_001.vdb"
    path.write_bytes(pathlib.Path(volume.filepath).read_bytes())
    volume.filepath, volume.is_sequence = str(path), True
    volume.frame_start, volume.frame_duration, volume.sequence_mode = 1, 1, "CLIP"
    scene.frame_set(2)


def mirrored_grid(scene):
    grid = openvdb.read(bpy.data.volumes["Smoke"].filepath, "density")
    grid.transform = openvdb.createLinearTransform(np.diag([-0.1, 0.1, 0.1, 1.0]).tolist())
    path = pathlib.Path(bpy.app.tempdir) / "mirrored.vdb"
    openvdb.write(str(path), grids=[grid])
    bpy.data.volumes["Smoke"].filepath = str(path)


REFUSED = {
    "a surface around the medium": (material(covered), ["material 'Smoke Material'", "surface", "unlink Surface"]),
    "cubic interpolation": (
        lambda scene: setattr(bpy.data.materials["Smoke Material"].cycles, "volume_interpolation", "CUBIC"),
        ["material 'Smoke Material'", "cubics", "Linear"],
    ),
    "a sun of a power by solid angle": (light("SUN", normalize=False), ["light 'Lamp'", "Normalize"]),
    "a point of a power by area": (light("POINT", normalize=False, shadow_soft_size=0.0), ["light 'Lamp'", "Normalize"]),
    "a sheared lamp": (sheared_lamp, ["light 'Lamp'", "shears"]),
    "volumes left out": (left_out("use_volumes"), ["view layer 'ViewLayer'", "leaves volumes out"]),
    "a world left out": (left_out("use_sky"), ["view layer 'ViewLayer'", "leaves the world out"]),
    "light of later bounces made up": (attribute("cycles.use_fast_gi", True), ["scene 'Scene'", "Fast GI"]),
    "a flat volume": (lambda scene: setattr(scene.objects["Smoke"], "scale", (1, 0, 1)), ["object 'Smoke'", "scale of 0"]),
    "a mirrored grid": (mirrored_grid, ["object 'Smoke'", "mirrors the grid"]),
    "an instance hidden in the viewport": (hidden_instance, ["object 'Smoke.001'", "by 'Instance'", "viewport"]),
    "a frame without a file": (past_the_end, ["scene 'Scene'", "no volume at frame 2"]),
    "a mirror": (mirror, ["material 'Mirror'", "Glossy BSDF", "use Diffuse BSDF"]),
    "plastic": (plastic, ["material 'Plastic'", "not diffuse", "Specular IOR Level", "Diffuse BSDF"]),
    "a texture of a surface": (striped, ["material 'Mirror'", "'Wave Texture'", "unlink it"]),
    "a smooth surface": (smooth, ["object 'box'", "smooth", "Shade Flat"]),
    "limits of bounces": (bounces, ["scene 'Scene'", "4 bounces in all", "the same number"]),
    "an object without shadows": (half_visible, ["object 'box'", "shadow", "switch it on"]),
    "a mesh with a medium": (foggy_box, ["object 'box'", "medium without a VDB", "Import OpenVDB"]),
    "a fluid domain": (domain, ["object 'box'", "fluid domain", "cache:", "Import OpenVDB"]),
    "a procedural volume": (procedural, ["object 'box'", "modifiers make a volume", "Import OpenVDB"]),
    "a holdout": (holdout, ["collection 'Masks'", "Holdout"]),
    "a modifier": (modifier, ["object 'Smoke'", "'Wobble'", "write its result as VDB"]),
    "no file": (lambda scene: setattr(bpy.data.volumes["Smoke"], "filepath", ""), ["object 'Smoke'", "no VDB file"]),
    "a missing file": (
        lambda scene: setattr(bpy.data.volumes["Smoke"], "filepath", "/none.vdb"),
        ["object 'Smoke'", "/none.vdb"],
    ),
    "hidden from cameras": (attribute("visible_camera", False, "smoke"), ["object 'Smoke'", "visible_camera"]),
    "hidden in the viewport": (attribute("hide_viewport", True, "smoke"), ["object 'Smoke'", "viewport"]),
    "an IES profile": (profile, ["light 'Lamp'", "IES profile", "Use Nodes"]),
    "a scaled spot": (scaled_spot, ["light 'Lamp'", "scaled", "apply its scale"]),
    "a disk": (light("AREA", shape="DISK"), ["light 'Lamp'", "disk", "rectangle"]),
    "a narrow spread": (light("AREA", spread=1.0), ["light 'Lamp'", "spread", "180°"]),
    "no shadow": (light("SUN", use_shadow=False), ["light 'Lamp'", "Shadow"]),
    "nodes of a light": (light("SUN", use_nodes=True), ["light 'Lamp'", "Use Nodes"]),
    "a lamp in the picture": (seen_lamp, ["light 'Lamp'", "Camera"]),
    "a sun in the picture": (seen_sun, ["light 'Sun'", "Camera"]),
    "a world that the camera sees otherwise": (
        smoke_scene.world("ShaderNodeLightPath"),
        ["world 'Sky', node 'Light Path'", "the camera sees another world"],
    ),
    "a sun of the world in the picture": (sun_in_sight, ["world 'Sky'", "disc of its sun", "Sun Disc"]),
    "an environment without a file": (
        smoke_scene.world("ShaderNodeTexEnvironment"),
        ["world 'Sky', node 'Environment Texture'", "picture is missing"],
    ),
    "a texture of densities": (
        linked("Density", "ShaderNodeTexNoise"),
        ["material 'Smoke Material', node 'Noise Texture'", "'Density'", "bake"],
    ),
    "a color ramp": (
        linked("Density", "ShaderNodeValToRGB"),
        ["material 'Smoke Material', node 'Color Ramp'", "'Density'"],
    ),
    "a driven color": (linked("Color", "ShaderNodeAttribute"), ["node 'Attribute'", "'Color'", "Principled Volume"]),
    "a linked anisotropy": (
        linked("Anisotropy", "ShaderNodeAttribute", 2),
        ["node 'Principled Volume'", "'Anisotropy' is linked"],
    ),
    "a grid that is not there": (
        value("Density Attribute", "soot"),
        ["node 'Principled Volume'", "'soot'", "the file has density"],
    ),
    "no grid": (value("Density Attribute", ""), ["node 'Principled Volume'", "'Density' is 4 everywhere"]),
    "two grids": (material(two_grids), ["node 'Principled Volume'", "multiplies the grids", "clear Density Attribute"]),
    "colors of a grid": (value("Color Attribute", "density"), ["node 'Principled Volume'", "reads colors"]),
    "emission everywhere": (
        value("Emission Strength", 1.0),
        ["node 'Principled Volume'", "'Emission Strength' is 1 everywhere"],
    ),
    "no extinction": (value("Density", 0.0), ["material 'Smoke Material'", "takes no light"]),
    "another phase function": (scatter_phase, ["node 'Volume Scatter'", "DRAINE"]),
    "an unknown shader": (material(glass), ["node 'Volume Coefficients'", "no medium that Cumulo knows"]),
    "a panorama": (attribute("camera.data.type", "PANO"), ["camera 'Camera'", "pano"]),
    "focus on a bone": (focus_on_a_bone, ["camera 'Camera'", "bone 'Hand'"]),
    "a clip end": (attribute("camera.data.clip_end", 3.0), ["camera 'Camera'", "clip end 3"]),
    "a rolling shutter": (rolling_shutter, ["scene 'Scene'", "rolling shutter"]),
    "a light that moves while the shutter is open": (moving_sun, ["object 'Sun'", "it moves while"]),
    "a border": (attribute("render.use_border", True), ["scene 'Scene'", "border"]),
    "film exposure": (attribute("cycles.film_exposure", 2.0), ["scene 'Scene'", "exposure"]),
    "simplification": (simplified, ["scene 'Scene'", "Simplify"]),
    "another material": (overridden, ["view layer 'ViewLayer'", "material"]),
    "no world": (attribute("world", None), ["scene 'Scene'", "no world"]),
    "few bounces of a light": (few_bounces, ["light 'Sun'", "bounces"]),
    "no camera": (attribute("camera", None), ["scene 'Scene'", "no camera"]),
    "no volume": (lambda scene: bpy.data.objects.remove(scene.objects["Smoke"]), ["scene 'Scene'", "no volume"]),
}


def test_grids_without_a_lattice_or_without_voxels_are_refused(fixtures, tmp_path):
    frustum, empty = openvdb.FloatGrid(), openvdb.FloatGrid()
    frustum.transform = openvdb.createFrustumTransform((0, 0, 0), (7, 7, 7), 0.5, 2.0, 1.0)
    frustum.fill((1, 1, 1), (6, 6, 6), 1.0)
    for grid, words in ((frustum, "lies in a frustum"), (empty, "no active voxels")):
        grid.name = "density"
        openvdb.write(str(tmp_path / "odd.vdb"), grids=[grid])
        smoke_scene.smoke(tmp_path / "odd.vdb")
        for act in (bpy_scene.export, bpy_scene.capture):
            with pytest.raises(bpy_scene.Refused, match=f"object 'Smoke'.*{words}"):
                act(tmp_path / "out")


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_honored_is_refused_by_name(fixtures, tmp_path, case):
    change, words = REFUSED[case]
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    change(scene)
    with pytest.raises(bpy_scene.Refused) as refused:
        bpy_scene.export(tmp_path / "out")
    for word in words:
        assert word in str(refused.value), str(refused.value)
    assert not (tmp_path / "out").exists()


MANY = {
    "a mirror": (mirror, "material 'Mirror'"),
    "a disk": (light("AREA", shape="DISK"), "light 'Lamp'"),
    "focus on a bone": (focus_on_a_bone, "camera 'Camera'"),
    "a rolling shutter": (rolling_shutter, "scene 'Scene': it has a rolling"),
    "stereoscopy": (attribute("render.use_multiview", True), "scene 'Scene': it has stereo"),
    "a border": (attribute("render.use_border", True), "scene 'Scene': a border"),
    "film exposure": (attribute("cycles.film_exposure", 2.0), "scene 'Scene': its film exposure"),
    "an environment without a file": (smoke_scene.world("ShaderNodeTexEnvironment"), "world 'Sky', node 'Environment Texture'"),
}


def many(vdb):
    """The smoke with all of `MANY`."""
    scene = smoke_scene.smoke(vdb)
    for change, _ in MANY.values():
        change(scene)
    return scene


def test_all_complaints_about_a_scene_are_in_one_list(fixtures, tmp_path):
    many(fixtures / "plume.vdb")
    with pytest.raises(bpy_scene.Refused) as refused:
        bpy_scene.export(tmp_path / "out")
    assert refused.value.can_be_left_out and len(refused.value.complaints) == len(MANY)
    lines = str(refused.value).splitlines()
    for _, name in MANY.values():
        assert sum(line.startswith(name) for line in lines) == 1, (name, lines)
    # Each has a remedy.
    assert all(line.count("; ") >= 1 for line in lines)
    assert not (tmp_path / "out").exists()


def test_an_export_carries_on_without_what_it_can_leave_out(fixtures, tmp_path):
    scene = many(fixtures / "plume.vdb")
    scene.frame_end = 2
    exported = bpy_scene.export(tmp_path / "out", frames=(1, 2), ignore=True)
    assert len(exported.left_out) == len(MANY)
    (of_mirror,) = (what for what in exported.left_out if what.startswith("material 'Mirror'"))
    assert of_mirror.endswith("its surface is diffuse, of its color")
    document = json.loads(exported.scene.read_text())
    (box,) = document["meshes"]
    assert np.allclose(box["albedo"], (0.9, 0.8, 0.1)) and (exported.scene.parent / box["file"]).is_file()
    assert document["left_out"] == list(exported.left_out)
    assert Capture.read(exported.cameras).extra["left_out"] == document["left_out"]
    assert [light["type"] for light in document["lights"]] == ["DistantLight"] and len(document["volumes"]) == 1


@pytest.mark.parametrize("case", ["a texture of densities", "a mesh with a medium", "a procedural volume", "a modifier",
                                  "a holdout", "hidden in the viewport", "no camera"])  # fmt: skip
def test_an_export_stops_where_it_would_lose_a_volume(fixtures, tmp_path, case):
    scene = many(fixtures / "plume.vdb")
    change, words = REFUSED[case]
    change(scene)
    with pytest.raises(bpy_scene.Refused) as refused:
        bpy_scene.export(tmp_path / "out", ignore=True)
    assert not refused.value.can_be_left_out
    (stopping,) = (complaint for complaint in refused.value.complaints if complaint.without is None)
    # Another box is there, so that a box has another name than alone.
    assert all(word in str(stopping) for word in words[1:]), str(stopping)
    assert not (tmp_path / "out").exists()


def test_a_light_that_is_hidden_in_the_viewport_can_be_left_out(fixtures, tmp_path):
    scene = smoke_scene.smoke(fixtures / "plume.vdb")
    scene.objects["Sun"].hide_viewport = True
    # The camera is found all the same.
    scene.render.use_motion_blur = True
    exported = bpy_scene.export(tmp_path / "out", ignore=True)
    assert len(exported.left_out) == 1 and "object 'Sun'" in exported.left_out[0]
    assert json.loads(exported.scene.read_text())["lights"] == []


def startup(vdb):
    """Blender's startup scene with a VDB imported into it."""
    bpy.ops.wm.read_factory_settings()
    bpy.ops.object.volume_import(filepath=str(vdb))
    return bpy.context.scene


def test_the_startup_scene_with_a_smoke_is_exported(fixtures, tmp_path):
    startup(fixtures / "plume.vdb")
    with pytest.raises(bpy_scene.Refused, match="material 'Material'") as refused:
        bpy_scene.export(tmp_path / "out")
    assert refused.value.can_be_left_out
    exported = bpy_scene.export(tmp_path / "out", ignore=True)
    assert any(what.endswith("its surface is diffuse, of its Base Color") for what in exported.left_out)
    document = json.loads(exported.scene.read_text())
    (cube,), (volume,) = document["meshes"], document["volumes"]
    assert np.allclose(cube["albedo"], 0.8)
    assert volume["grid"] == "density" and volume["medium"]["albedo"] == [0.5, 0.5, 0.5]
