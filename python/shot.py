"""A shot of Blender with smoke in it, rendered by Cumulo and by Cycles, denoised, and composited by Blender's compositor.

    shot.py OUT [--frames 24] [--size 320x200] [--samples 64] [--sheet sheet.png]

A floor and a ball stand in sun and spot light, a smoke goes up between them, and a camera moves past, with depth of field
and motion blur, of the smoke by its velocities, too. OUT gets the VDBs, the export, both renders, the denoised frames and the composites, and `sheet.png` shows
three frames: Cycles' own, and Cumulo's. Needs `bpy` (`.venvs/bpy`); CUMULO is the program, `cumulo` by default.
"""

import argparse
import math
import os
import pathlib
import subprocess
import time

import bpy
import numpy as np
from cumulo import bpy_scene
from cumulo.capture import look_at
from cumulo.cycles.objects import link_object
from cumulo.cycles.stage import empty_scene, quiet
from cumulo.exr import read_exr
from mathutils import Matrix

import openvdb  # isort: skip  `cumulo.cycles` brings it

FPS = 24
VOXEL = 0.025
# Voxels of the grid, whose base stands in the middle of the floor.
SHAPE = (80, 80, 96)
# Seconds that a puff lives, and how many are born in one.
LIFE, RATE = 2.2, 90


def puffs(time_now):
    """Centres, velocities [n, 3], radii and strengths of the puffs that a smoke is made of, in meters and seconds."""
    random = np.random.default_rng(4)
    count = int(RATE * (LIFE + 2.0))
    born = np.arange(count) / RATE - LIFE
    phase, out, speed = random.uniform(0, 2 * np.pi, count), random.uniform(0.0, 0.2, count), random.uniform(0.8, 1.2, count)

    def place(age):
        rise = speed * (1 - np.exp(-0.5 * age)) / 0.5
        turn = phase + 2.6 * age
        wide = 0.05 + out * (0.2 + 1.3 * age)
        lean = 0.09 * np.sin(2.3 * (born + age)) * age
        return np.stack([wide * np.cos(turn) + lean, wide * np.sin(turn), 0.08 + rise], axis=-1)

    age = time_now - born
    alive = (age > 0) & (age < LIFE)
    centres, moved = place(age), place(age + 1e-3)
    radius = 0.035 + 0.06 * np.sqrt(np.maximum(age, 0))
    strength = np.clip(age / 0.1, 0, 1) * np.clip((LIFE - age) / 0.8, 0, 1) * (0.06 / radius) ** 2
    return centres[alive], (moved - centres)[alive] / 1e-3, radius[alive], strength[alive]


def write_smoke(path, time_now):
    """Writes the densities and velocities of the smoke at a time, as Blender's fluid caches have them."""
    axes = [VOXEL * (np.arange(n) + 0.5 - (n / 2 if axis < 2 else 0)) for axis, n in enumerate(SHAPE)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    # Curls that go up with the smoke.
    at, up = np.stack([x, y, z], axis=-1), z - 0.7 * time_now
    for size, turn in ((0.035, 9.0), (0.02, 19.0), (0.01, 41.0)):
        bent = [np.sin(turn * (at[..., 1] + up)), np.sin(turn * (up - at[..., 0])), np.sin(turn * (at[..., 0] + at[..., 1]))]
        at = at + size * np.minimum(1, 3 * z)[..., None] * np.stack(bent, axis=-1)
    density, momentum = np.zeros(SHAPE, dtype=np.float32), np.zeros((*SHAPE, 3), dtype=np.float32)
    for centre, velocity, radius, strength in zip(*puffs(time_now)):
        low = [max(int((c - 4 * radius - axis[0]) / VOXEL), 0) for c, axis in zip(centre, axes)]
        high = [max(int((c + 4 * radius - axis[0]) / VOXEL), 0) for c, axis in zip(centre, axes)]
        box = tuple(slice(a, b) for a, b in zip(low, high))
        away = ((at[box] - centre) ** 2).sum(axis=-1) / (0.7 * radius) ** 2
        part = (strength * np.exp(-0.5 * away)).astype(np.float32)
        density[box] += part
        momentum[box] += part[..., None] * velocity.astype(np.float32)
    velocities = momentum / np.maximum(density, 1e-6)[..., None]
    density = np.maximum(density - 0.02, 0)
    grids = []
    for name, values, kind in (("density", density, openvdb.FloatGrid), ("velocity", velocities, openvdb.Vec3SGrid)):
        grid = kind()
        grid.name = name
        grid.transform = openvdb.createLinearTransform(VOXEL)
        grid.transform.postTranslate((axes[0][0], axes[1][0], axes[2][0]))
        grid.copyFromArray(np.where((density > 0)[..., None] if values.ndim == 4 else density > 0, values, 0))
        grids.append(grid)
    openvdb.write(str(path), grids=grids)


def material(name, color):
    """A diffuse material."""
    made = bpy.data.materials.new(name)
    tree = made.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = (*color, 1)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return made


def smoke_object(scene, vdb, frames):
    """The smoke's sequence with a Principled Volume."""
    volume = bpy.data.volumes.new("Smoke")
    volume.filepath, volume.is_sequence = str(vdb), True
    volume.frame_start, volume.frame_duration = 1, frames
    volume.render.precision = "FULL"
    volume.velocity_grid, volume.velocity_unit = "velocity", "SECOND"
    made = bpy.data.materials.new("Smoke")
    tree = made.node_tree
    tree.nodes.clear()
    medium, output = tree.nodes.new("ShaderNodeVolumePrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(medium.outputs[0], output.inputs["Volume"])
    medium.inputs["Density"].default_value, medium.inputs["Anisotropy"].default_value = 9.0, 0.3
    medium.inputs["Color"].default_value = (0.92, 0.9, 0.88, 1)
    volume.materials.append(made)
    return link_object(scene, "Smoke", volume)


def build(vdb, frames, size, samples):
    """The scene of the shot, whose smoke is the sequence of `vdb`."""
    scene = empty_scene()
    smoke_object(scene, vdb, frames)
    floor = bpy.data.meshes.new("Floor")
    floor.from_pydata([(-6, -6, 0), (6, -6, 0), (6, 6, 0), (-6, 6, 0)], [], [(0, 1, 2, 3)])
    floor.materials.append(material("Floor", (0.45, 0.42, 0.38)))
    link_object(scene, "Floor", floor)
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=6, radius=0.4, location=(0.75, -0.3, 0.4))
    bpy.context.object.data.materials.append(material("Ball", (0.75, 0.16, 0.1)))
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle, sun.color = 3.0, 0.02, (1, 0.92, 0.82)
    link_object(scene, "Sun", sun, look_at((-1.2, -1.4, 1.8), (0, 0, 0)))
    spot = bpy.data.lights.new("Spot", "SPOT")
    spot.energy, spot.color, spot.spot_size, spot.spot_blend = 450.0, (0.35, 0.55, 1), 0.7, 0.3
    spot.shadow_soft_size = 0.05
    link_object(scene, "Spot", spot, look_at((2.4, 2.2, 3.0), (0, 0, 0.9))).visible_camera = False
    camera = bpy.data.cameras.new("Camera")
    camera.lens, camera.dof.use_dof, camera.dof.aperture_fstop = 45, True, 0.35
    scene.camera = link_object(scene, "Camera", camera)
    for frame in range(1, frames + 1):
        turn = -1.35 + 0.5 * (frame - 1) / max(frames - 1, 1)
        eye = np.array((4.6 * math.cos(turn), 4.6 * math.sin(turn), 1.7))
        target = np.array((0.2, 0.0, 0.85))
        scene.camera.matrix_world = Matrix(look_at(eye, target).tolist())
        camera.dof.focus_distance = float(np.linalg.norm(eye - target)) - 0.3
        for thing, path in ((scene.camera, "location"), (scene.camera, "rotation_euler"), (camera.dof, "focus_distance")):
            thing.keyframe_insert(path, frame=frame)
    scene.world = bpy.data.worlds.new("World")
    back = next(node for node in scene.world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")
    back.inputs["Color"].default_value = (0.09, 0.12, 0.18, 1)
    scene.frame_start, scene.frame_end, scene.render.fps = 1, frames, FPS
    render, cycles = scene.render, scene.cycles
    render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
    render.engine, render.film_transparent = "CYCLES", True
    render.use_motion_blur, render.motion_blur_shutter = True, 0.5
    cycles.samples, cycles.volume_bounces, cycles.diffuse_bounces, cycles.max_bounces = samples, 6, 6, 6
    cycles.use_adaptive_sampling = cycles.use_denoising = cycles.volume_biased = False
    cycles.sample_clamp_indirect, cycles.pixel_filter_type = 0.0, "BOX"
    return scene


def render_cycles(scene, frame, path):
    """Renders a frame by Cycles."""
    scene.frame_set(frame)
    image = scene.render.image_settings
    image.media_type, image.file_format, image.color_depth, image.color_mode = "IMAGE", "OPEN_EXR", "32", "RGBA"
    scene.render.filepath = str(path)
    with quiet():
        bpy.ops.render.render(write_still=True)


def composite(picture, path, size):
    """Lets Blender's compositor put a picture over a backdrop that is lighter below, and write it as PNG."""
    scene = bpy.data.scenes.new("Composite")
    tree = bpy.data.node_groups.new("Composite", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    scene.compositing_node_group = tree
    width, height = size
    shade = np.linspace(0.42, 0.1, height)[:, None, None] * np.array([0.75, 0.9, 1.2]) * np.ones((1, width, 1))
    backdrop = bpy.data.images.new("Backdrop", width, height, float_buffer=True)
    backdrop.pixels.foreach_set(np.concatenate([shade, np.ones((height, width, 1))], axis=-1).astype(np.float32).ravel())
    loaded = bpy.data.images.load(str(picture))
    sources = []
    for image in (backdrop, loaded):
        node = tree.nodes.new("CompositorNodeImage")
        node.image = image
        sources.append(node)
    over, output = tree.nodes.new("CompositorNodeAlphaOver"), tree.nodes.new("NodeGroupOutput")
    tree.links.new(sources[0].outputs["Image"], over.inputs["Background"])
    tree.links.new(next(s for s in sources[1].outputs if s.name in ("Image", "Combined")), over.inputs["Foreground"])
    tree.links.new(over.outputs[0], output.inputs[0])
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = width, height, 100
    scene.render.image_settings.file_format = "PNG"
    scene.view_settings.view_transform = "AgX"
    scene.render.filepath = str(path)
    with quiet():
        bpy.ops.render.render(write_still=True, scene=scene.name)
    bpy.data.images.remove(loaded)
    bpy.data.images.remove(backdrop)
    bpy.data.node_groups.remove(tree)
    bpy.data.scenes.remove(scene)


def pixels(path):
    """A picture's pixels from the top, [height, width, 4] f32."""
    image = bpy.data.images.load(str(path))
    values = np.empty(image.size[0] * image.size[1] * 4, dtype=np.float32)
    image.pixels.foreach_get(values)
    values = values.reshape(image.size[1], image.size[0], 4)[::-1]
    bpy.data.images.remove(image)
    return values


def write_sheet(rows, path):
    """Writes rows of pictures as one PNG."""
    sheet = np.concatenate([np.concatenate([pixels(picture) for picture in row], axis=1) for row in rows], axis=0)
    image = bpy.data.images.new("Sheet", sheet.shape[1], sheet.shape[0])
    image.pixels.foreach_set(sheet[::-1].ravel())
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()


def shoot(out, frames=24, size=(320, 200), samples=64, sheet=None):
    """Makes the shot in the folder `out`; returns the folders of the frames by Cycles and by Cumulo, denoised."""
    program = os.environ.get("CUMULO", "cumulo")

    def cumulo(*words):
        subprocess.run([program, *map(str, words)], check=True)

    out.mkdir(parents=True, exist_ok=True)
    for frame in range(1, frames + 1):
        write_smoke(out / f"smoke.{frame:04}.vdb", frame / FPS)
    scene = build(out / "smoke.0001.vdb", frames, size, samples)
    numbers = range(1, frames + 1)
    start = time.perf_counter()
    (out / "cycles").mkdir(exist_ok=True)
    for frame in numbers:
        render_cycles(scene, frame, out / "cycles" / f"frame.{frame:04}.exr")
    middle = time.perf_counter()
    exported = bpy_scene.export(out / "scene", scene, frames=numbers)
    cumulo(*exported.arguments(out / "render", samples), "--aov", "halves,albedo,normal,depth,motion", "--quiet")
    cumulo("denoise", out / "render" / "frame.####.exr", "-o", out / "quiet" / "frame.####.exr", "--quiet")
    print(f"Cycles {middle - start:.1f} s, Cumulo with denoising {time.perf_counter() - middle:.1f} s")
    (out / "composite").mkdir(exist_ok=True)
    for frame in numbers:
        for by, folder in (("cycles", "cycles"), ("cumulo", "quiet")):
            composite(out / folder / f"frame.{frame:04}.exr", out / "composite" / f"{by}.{frame:04}.png", size)
    if sheet:
        shown = [1, (frames + 1) // 2, frames]
        write_sheet([[out / "composite" / f"{by}.{frame:04}.png" for frame in shown] for by in ("cycles", "cumulo")], sheet)
    return out / "cycles", out / "quiet"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--size", type=lambda text: tuple(map(int, text.split("x"))), default=(320, 200))
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--sheet", type=pathlib.Path)
    options = parser.parse_args()
    theirs, ours = shoot(options.out, options.frames, options.size, options.samples, options.sheet)
    for frame in range(1, options.frames + 1):
        pair = [read_exr(folder / f"frame.{frame:04}.exr")[..., :3] for folder in (theirs, ours)]
        print(f"frame {frame}: means {pair[0].mean():.4f} {pair[1].mean():.4f}")


if __name__ == "__main__":
    main()
