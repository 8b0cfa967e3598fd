"""Meshes of a scene file, of objects with surfaces."""

import dataclasses
import hashlib
import math
import os
import pathlib
import re
import tempfile

import bpy
import numpy as np

from .expressions import Tree
from .refusal import Complaint, Refused, named

# Types of objects that Blender turns into meshes; strands, points and strokes it does not.
MESHES = ("MESH", "CURVE", "SURFACE", "META", "FONT")
# Inputs of Principled BSDF that add to its diffuse light, and what they are where they add nothing.
PRINCIPLED = {
    "Metallic": 0.0,
    "Specular IOR Level": 0.0,
    "Diffuse Roughness": 0.0,
    "Subsurface Weight": 0.0,
    "Transmission Weight": 0.0,
    "Coat Weight": 0.0,
    "Sheen Weight": 0.0,
    "Alpha": 1.0,
}
GREY = (0.8, 0.8, 0.8)


@dataclasses.dataclass
class Surface:
    """What a material does with light, as a mesh of a scene file states it: sums of parts."""

    albedo: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))
    emission: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))
    holdout: bool = False


class Surfaces:
    """The meshes of frames, as files in a folder. A mesh that is the same in several frames or objects is one file."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self._pending = {}

    def entries(self, placed, complaints):
        """Entries of a scene file for a Placed object with a surface, one for each of its materials. Adds what Cumulo shows as
        something else to the Complaints."""
        thing, where = placed.object, named("object", placed.object)
        if thing.type not in MESHES:
            complaints.add(
                Complaint(
                    where,
                    f"a {thing.type.lower()} is rendered, and Cumulo renders volumes and meshes",
                    "disable it in renders (camera icon in the outliner)",
                    "the object is left out",
                )
            )
            return []
        mesh = thing.to_mesh()
        try:
            parts = list(_parts(mesh, thing, complaints))
        finally:
            thing.to_mesh_clear()
        if not parts:
            return []
        for complaint in _faults(thing):
            complaints.add(complaint)
        # Cycles lets an object that catches shadows be seen by its shadows alone.
        if thing.is_shadow_catcher:
            return []
        entries = []
        for material, vertices, triangles in parts:
            surface = surface_of(material, complaints)
            entry = {"file": self._file(thing.name, vertices, triangles), "albedo": surface.albedo.tolist()}
            if not np.array_equal(placed.matrix, np.eye(4)):
                entry["transform"] = placed.matrix.tolist()
            if surface.emission.any():
                entry["emission"] = surface.emission.tolist()
            if surface.holdout or thing.is_holdout:
                entry["holdout"] = True
            entries.append(entry)
        return entries

    def _file(self, name, vertices, triangles):
        """The name of the file of a mesh in the folder, in which `write` puts it."""
        faces = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        faces["count"], faces["corners"] = 3, triangles
        head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}",
                *(f"property float {axis}" for axis in "xyz"), f"element face {len(faces)}",
                "property list uchar int vertex_indices", "end_header", ""]  # fmt: skip
        content = "\n".join(head).encode() + vertices.astype("<f4").tobytes() + faces.tobytes()
        plain = re.sub(r"[^A-Za-z0-9_-]+", "_", name)
        path = f"meshes/{plain}.{hashlib.sha256(content).hexdigest()[:12]}.ply"
        if not (self.folder / path).exists():
            self._pending[path] = content
        return path

    def write(self):
        """Puts the meshes into the folder, each whole or not at all."""
        if self._pending:
            (self.folder / "meshes").mkdir(parents=True, exist_ok=True)
        for path, content in self._pending.items():
            with tempfile.TemporaryDirectory(dir=self.folder, prefix=".writing-") as beside:
                draft = pathlib.Path(beside) / "mesh.ply"
                draft.write_bytes(content)
                os.replace(draft, self.folder / path)
        self._pending = {}


def _parts(mesh, thing, complaints):
    """The material, the vertices [n, 3] and the triangles [n, 3] of each material of an evaluated mesh. Adds what Cycles makes
    of the mesh besides to the Complaints."""
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    if not count:
        return
    vertices = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", vertices)
    triangles, polygons = np.empty(3 * count, dtype=np.int32), np.empty(count, dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    mesh.loop_triangles.foreach_get("polygon_index", polygons)
    slots, smooth = np.empty(len(mesh.polygons), dtype=np.int32), np.empty(len(mesh.polygons), dtype=bool)
    mesh.polygons.foreach_get("material_index", slots)
    mesh.polygons.foreach_get("use_smooth", smooth)
    if smooth.any():
        complaints.add(
            Complaint(
                named("object", thing),
                "its faces are shaded smooth",
                "shade it flat (Object > Shade Flat), with more faces if need be",
                "its faces are flat",
            )
        )
    vertices, triangles = vertices.reshape(-1, 3), triangles.reshape(-1, 3)
    of_slot = np.clip(slots[polygons], 0, max(len(thing.material_slots) - 1, 0))
    for slot in np.unique(of_slot):
        used, corners = np.unique(triangles[of_slot == slot], return_inverse=True)
        material = thing.material_slots[slot].material if thing.material_slots else None
        yield material, vertices[used], corners.reshape(-1, 3)


def _faults(thing):
    """The complaints about what makes an object visible to some rays alone."""
    where = named("object", thing)
    for kind in ("camera", "diffuse", "volume_scatter", "shadow"):
        if not getattr(thing, f"visible_{kind}"):
            yield Complaint(
                where,
                f"its ray visibility {kind} is off",
                "switch it on (Object > Visibility)",
                "all rays meet the object",
            )
    if thing.is_shadow_catcher:
        yield Complaint(
            where, "it is a shadow catcher", "switch it off (Object > Visibility)", "the object is left out"
        )
    if thing.original.cycles.use_motion_blur and thing.original.cycles.use_deform_motion and _deforms(thing):
        yield Complaint(
            where,
            "it deforms while the shutter is open",
            "switch its Motion Blur off (Object Properties)",
            "it stands still in each picture",
        )


def _deforms(thing):
    """True if a picture with motion blur may show the shape of an object change."""
    original, scene = thing.original, bpy.context.scene
    keys = getattr(original.data, "shape_keys", None)
    deforming = any(modifier.type in ("ARMATURE", "CLOTH", "SOFT_BODY", "MESH_CACHE", "MESH_SEQUENCE_CACHE", "WAVE")
                    for modifier in original.modifiers)  # fmt: skip
    return scene.render.use_motion_blur and bool(deforming or (keys and keys.animation_data))


def surface_of(material, complaints):
    """The Surface of a material, None for that of objects without one. Adds what Cumulo shows as something else to the
    Complaints."""
    # From Blender 5.0 on materials always use nodes.
    if material is None or material.node_tree is None or (bpy.app.version < (5, 0) and not material.use_nodes):
        color = GREY if material is None else tuple(material.diffuse_color)[:3]
        return Surface(albedo=np.array(color))
    return _Reader(material, complaints).read()


class _Reader:
    """Reads the surface of a material with nodes."""

    def __init__(self, material, complaints):
        self.material, self.complaints = material, complaints
        self.tree, self.surface = Tree("material", material), Surface()

    def read(self):
        """The Surface."""
        output = self.material.node_tree.get_output_node("CYCLES")
        if output and self.tree.source(output.inputs["Displacement"]):
            self._complain(output, "it is displaced", "unlink Displacement of its output", "it is not displaced")
        if source := output and self.tree.source(output.inputs["Surface"]):
            self._shader(source.node, 1.0)
        self.surface.albedo = np.clip(self.surface.albedo, 0.0, 1.0)
        return self.surface

    def _complain(self, node, found, remedy, without):
        self.complaints.add(Complaint(named("material", self.material, node), found, remedy, without))

    def _value(self, socket, read, instead, without):
        """What `read` has of a socket; `instead` where something drives it that Cumulo does not know."""
        try:
            return read(socket)
        except Refused as refused:
            for complaint in refused.complaints:
                self.complaints.add(dataclasses.replace(complaint, without=without))
            return instead

    def _color(self, socket):
        return np.array(self._value(socket, self.tree.color, GREY, "its color is light grey"))

    def _number(self, socket, instead):
        return self._value(socket, self.tree.number, instead, f"{socket.name!r} is {instead:g}")

    def _shader(self, node, weight):
        """Adds what a shader states, times `weight`."""
        shaders = {
            "ShaderNodeBsdfDiffuse": self._diffuse,
            "ShaderNodeBsdfPrincipled": self._principled,
            "ShaderNodeEmission": self._emission,
            "ShaderNodeHoldout": self._holdout,
            "ShaderNodeAddShader": self._sum,
            "ShaderNodeMixShader": self._mix,
        }
        shaders.get(node.bl_idname, self._other)(node, weight)

    def _diffuse(self, node, weight):
        if self._number(node.inputs["Roughness"], 0.0) > 0:
            self._complain(
                node, "its diffuse light is rough (Oren-Nayar)", "set Roughness to 0", "its diffuse light is Lambert's"
            )
        self._normal(node)
        self.surface.albedo += weight * self._color(node.inputs["Color"])

    def _principled(self, node, weight):
        found = []
        for name, nothing in PRINCIPLED.items():
            socket = node.inputs.get(name)
            if socket is None:
                continue
            linked = self.tree.source(socket) is not None
            if linked or not math.isclose(socket.default_value, nothing, abs_tol=1e-6):
                found.append(f"{name} is {'linked' if linked else format(socket.default_value, '.4g')}")
        if found:
            wanted = ", ".join(f"{name} {nothing:g}" for name, nothing in PRINCIPLED.items() if node.inputs.get(name))
            self._complain(
                node,
                f"it is not diffuse: {', '.join(found)}",
                f"use a Diffuse BSDF, or set {wanted}",
                "its surface is diffuse, of its Base Color",
            )
        self._normal(node)
        self.surface.albedo += weight * self._color(node.inputs["Base Color"])
        strength = self._number(node.inputs["Emission Strength"], 0.0)
        if strength > 0:
            self.surface.emission += weight * strength * self._color(node.inputs["Emission Color"])

    def _normal(self, node):
        if self.tree.source(node.inputs["Normal"]):
            self._complain(node, "its normals are changed", "unlink Normal", "its normals are the faces'")

    def _emission(self, node, weight):
        strength = self._number(node.inputs["Strength"], 1.0)
        self.surface.emission += weight * strength * self._color(node.inputs["Color"])

    def _holdout(self, node, weight):
        self.surface.holdout = True

    def _sum(self, node, weight):
        for socket in node.inputs:
            if source := self.tree.source(socket):
                self._shader(source.node, weight)

    def _mix(self, node, weight):
        share = min(max(self._number(node.inputs[0], 0.5), 0.0), 1.0)
        for socket, part in zip(list(node.inputs)[1:], (1.0 - share, share)):
            source = self.tree.source(socket)
            if source and part > 0:
                self._shader(source.node, weight * part)

    def _other(self, node, weight):
        self._complain(
            node,
            f"a {node.bl_label} is no surface that Cumulo knows",
            "use Diffuse BSDF, Emission, Holdout, Add Shader and Mix Shader",
            "its surface is diffuse, of its color",
        )
        color = node.inputs.get("Color")
        self.surface.albedo += weight * (np.array(GREY) if color is None else self._color(color))
