"""Blender and OpenImageIO find the planes of a picture by their names."""

import bpy
import cumulo.blender  # noqa: F401  exposes OpenImageIO
import OpenImageIO as oiio  # isort: skip

AOVS = "direct,indirect,albedo,normal,position,depth,motion,samples,variance,halves,optical-depth"
SOCKETS = {
    "Combined": "RGBA",
    "Denoising Albedo": "RGBA",
    "Denoising Normal": "VECTOR",
    "Depth": "VALUE",
    "Position": "VECTOR",
    "Vector": "VECTOR",
    "Debug Sample Count": "VALUE",
    "Volume Direct": "RGBA",
    "Volume Indirect": "RGBA",
    "variance": "RGBA",
    "half_a": "RGBA",
    "half_b": "RGBA",
    "optical_depth": "VALUE",
}


def test_layers_are_found_by_name(tmp_path, fixtures, cumulo):
    """Frames of a sequence have a socket of Blender's *Image* node for each plane, of the type that Blender's own passes have."""
    options = "--views 1 --size 16x12 --frames 1-2 --density-scale 4 --albedo 0.9 --sun 1,1,2 --samples 8".split()
    cumulo("render", str(fixtures / "plume.vdb"), *options, "--aov", AOVS, "-o", str(tmp_path / "out"))
    for number in (1, 2):
        path = tmp_path / "out" / f"frame.{number:04d}.exr"
        names = oiio.ImageInput.open(str(path)).spec().channelnames
        assert {"R", "A", "Denoising Albedo.G", "Denoising Normal.Z", "Depth.Z", "Position.X"} <= set(names), names
        image = bpy.data.images.load(str(path))
        node = bpy.data.node_groups.new("layers", "CompositorNodeTree").nodes.new("CompositorNodeImage")
        node.image = image
        sockets = {socket.name: socket.type for socket in node.outputs}
        assert SOCKETS.items() <= sockets.items(), sockets
