"""Media that node trees of materials state."""

import dataclasses

import bpy
import numpy as np

from .expressions import Tree
from .refusal import named, refused

KNOWN = "use Principled Volume, Volume Scatter, Volume Absorption, Emission, Add Shader and Mix Shader"


@dataclasses.dataclass
class Medium:
    """Coefficients as sums of parts. `absorbing` and `scattering` hold per grid the coefficients in red, green and blue
    for a density of 1, `emitting` the radiance per length and unit of the grid; `anisotropies` are those of the parts that
    scatter; `blackbodies` are entries of a scene file."""

    absorbing: dict = dataclasses.field(default_factory=dict)
    scattering: dict = dataclasses.field(default_factory=dict)
    emitting: dict = dataclasses.field(default_factory=dict)
    anisotropies: set = dataclasses.field(default_factory=set)
    blackbodies: list = dataclasses.field(default_factory=list)

    def add(self, kind, grid, color):
        """Adds a part to `absorbing`, `scattering` or `emitting`."""
        part = getattr(self, kind)
        part[grid] = part.get(grid, 0.0) + np.asarray(color, dtype=np.float64)


class Reader:
    """Reads the medium of a material."""

    def __init__(self, material, grids):
        """`grids` are the names of the grids that the file has."""
        # From Blender 5.0 on materials always use nodes.
        if material.node_tree is None or (bpy.app.version < (5, 0) and not material.use_nodes):
            raise refused(named("material", material), "it has no nodes", KNOWN)
        self.material, self.grids = material, grids
        self.tree, self.medium = Tree("material", material), Medium()

    def read(self):
        """The Medium. Raises Refused, which names the node that Cumulo cannot honor."""
        output = self.material.node_tree.get_output_node("CYCLES")
        source = output and self.tree.source(output.inputs["Volume"])
        if not source:
            raise refused(named("material", self.material), "nothing is linked to Volume of its output", KNOWN)
        self._check(output)
        self._shader(source.node, 1.0)
        return self.medium

    def _check(self, output):
        """Refuses what Cycles would show besides the medium, or otherwise than it is."""
        where, cycles = named("material", self.material), self.material.cycles
        if self.tree.source(output.inputs["Surface"]):
            raise refused(where, "its surface covers the voxels' outline", "unlink Surface of its output")
        # Before Blender 4.3 a material could say that its medium is the same everywhere.
        if getattr(cycles, "homogeneous_volume", False):
            raise refused(where, "Homogeneous takes no notice of grids", "switch it off (Material Properties > Volume)")
        if cycles.volume_interpolation != "LINEAR":
            raise refused(
                where, "it interpolates voxels by cubics", "choose the interpolation Linear (Material Properties > Volume)"
            )

    def _shader(self, node, weight):
        """Adds what a shader states, times `weight`."""
        shaders = {
            "ShaderNodeVolumePrincipled": self._principled,
            "ShaderNodeVolumeScatter": self._scatter,
            "ShaderNodeVolumeAbsorption": self._absorption,
            "ShaderNodeEmission": self._emission,
            "ShaderNodeAddShader": self._sum,
            "ShaderNodeMixShader": self._mix,
        }
        read = shaders.get(node.bl_idname)
        if read is None:
            raise self.tree.refused(node, f"a {node.bl_label} is no medium that Cumulo knows", KNOWN)
        read(node, weight)

    def _sum(self, node, weight):
        for socket in node.inputs:
            if source := self.tree.source(socket):
                self._shader(source.node, weight)

    def _mix(self, node, weight):
        share = self.tree.number(node.inputs[0])
        if share > 1:
            raise self.tree.refused(node, f"mixes by {share}", "mix by 0 to 1")
        for socket, part in zip(list(node.inputs)[1:], (1.0 - share, share)):
            source = self.tree.source(socket)
            if source and part > 0:
                self._shader(source.node, weight * part)

    def _grid(self, node, name):
        """A grid's name, if the file has it; without it, Blender takes the medium for homogeneous."""
        if name not in self.grids:
            raise self.tree.refused(
                node,
                f"reads the grid {name!r}, and the file has {', '.join(self.grids) or 'none'}",
                "name one of these",
            )
        return name

    def _driven(self, node, socket, attribute=""):
        """The Product of a socket and of the grid that `attribute` names. Nothing is none; a number without a grid fills
        the bounds of the volume, which Cumulo does not know."""
        product = self.tree.product(socket)
        if product.factor == 0:
            return None
        if attribute and product.grid:
            raise self.tree.refused(
                node,
                f"multiplies the grids {product.grid!r} ({socket.name}) and {attribute!r} ({socket.name} Attribute)",
                f"clear {socket.name} Attribute, or unlink {socket.name}",
            )
        grid = product.grid or attribute
        if not grid:
            raise self.tree.refused(
                node,
                f"{socket.name!r} is {product.factor:g} everywhere, driven by no grid",
                f"drive {socket.name!r} by a grid",
            )
        return dataclasses.replace(product, grid=self._grid(node, grid))

    def _anisotropy(self, node):
        socket = node.inputs["Anisotropy"]
        if self.tree.source(socket) is not None:
            raise self.tree.refused(node, "'Anisotropy' is linked", "unlink it and choose one number")
        # Blender's numbers are of single precision.
        anisotropy = round(float(socket.default_value), 6)
        if abs(anisotropy) > 0.999:
            raise self.tree.refused(node, f"its anisotropy is {anisotropy}", "choose -0.999 to 0.999")
        self.medium.anisotropies.add(anisotropy)

    def _principled(self, node, weight):
        inputs = node.inputs
        if inputs["Color Attribute"].default_value in self.grids:
            raise self.tree.refused(
                node, f"reads colors from {inputs['Color Attribute'].default_value!r}", "clear Color Attribute"
            )
        for name in ("Density Attribute", "Color Attribute", "Temperature Attribute"):
            if self.tree.source(inputs[name]):
                raise self.tree.refused(node, f"{name!r} is linked", "unlink it and give the name itself")
        density = self._driven(node, inputs["Density"], inputs["Density Attribute"].default_value)
        if density:
            color, absorption = (np.array(self.tree.color(inputs[name])) for name in ("Color", "Absorption Color"))
            self._within_one(node, color)
            # Of what is not scattered the absorption color takes the share 1 - sqrt(a).
            absorbed = np.maximum(1 - color, 0) * np.maximum(1 - np.sqrt(absorption), 0)
            self.medium.add("scattering", density.grid, weight * density.factor * color)
            self.medium.add("absorbing", density.grid, weight * density.factor * absorbed)
            if color.any():
                self._anisotropy(node)
        if any(glow := self.tree.color(inputs["Emission Color"])):
            if strength := self._driven(node, inputs["Emission Strength"]):
                self.medium.add("emitting", strength.grid, weight * strength.factor * np.array(glow))
        intensity = self.tree.number(inputs["Blackbody Intensity"])
        if intensity > 0:
            temperature = self._driven(node, inputs["Temperature"], inputs["Temperature Attribute"].default_value)
            if temperature:
                tint = self.tree.color(inputs["Blackbody Tint"])
                self.medium.blackbodies.append(
                    {
                        "grid": temperature.grid,
                        "kelvin": temperature.factor,
                        "intensity": weight * intensity,
                        "tint": list(tint),
                    }
                )

    def _within_one(self, node, color):
        if max(color) > 1:
            raise self.tree.refused(
                node, f"its color {tuple(color)} scatters more light than it takes", "choose 0 to 1"
            )

    def _scatter(self, node, weight):
        if getattr(node, "phase", "HENYEY_GREENSTEIN") != "HENYEY_GREENSTEIN":
            raise self.tree.refused(node, f"its phase function is {node.phase}", "choose Henyey-Greenstein")
        if density := self._driven(node, node.inputs["Density"]):
            self.medium.add(
                "scattering", density.grid, weight * density.factor * np.array(self.tree.color(node.inputs["Color"]))
            )
            self._anisotropy(node)

    def _absorption(self, node, weight):
        if density := self._driven(node, node.inputs["Density"]):
            color = np.array(self.tree.color(node.inputs["Color"]))
            self.medium.add("absorbing", density.grid, weight * density.factor * np.maximum(1 - color, 0))

    def _emission(self, node, weight):
        if strength := self._driven(node, node.inputs["Strength"]):
            color = np.array(self.tree.color(node.inputs["Color"]))
            self.medium.add("emitting", strength.grid, weight * strength.factor * color)


def default_medium(where, grids, scale):
    """What `medium_entry` returns of a volume without a material, to which Blender gives a Principled Volume as it is when
    it is added. Raises Refused about the object, `where`, if its file has no grid of densities."""
    if "density" not in grids:
        raise refused(where, f"it has no material, and its file has {', '.join(grids) or 'none'}, no grid 'density'", KNOWN)
    return "density", {"density_scale": scale, "albedo": [0.5, 0.5, 0.5], "anisotropy": 0.0}


def medium_entry(material, grids, scale):
    """The grid of densities and the medium of a scene file, of a material for a file with `grids`; `scale` multiplies all
    coefficients. Raises Refused, which names the node that Cumulo cannot honor."""
    medium = Reader(material, grids).read()
    where = named("material", material)
    driving = sorted(medium.absorbing.keys() | medium.scattering.keys())
    if len(driving) > 1:
        raise refused(
            where, f"the grids {' and '.join(driving)} both drive its extinction", "use one grid of densities"
        )
    if not driving:
        raise refused(where, "it takes no light", "give it a density: Cumulo's media have an extinction")
    if len(medium.anisotropies) > 1:
        raise refused(where, f"its parts have the anisotropies {sorted(medium.anisotropies)}", "give them one")
    if len(medium.emitting) > 1 or len(medium.blackbodies) > 1:
        raise refused(where, "several grids emit", "use one grid that emits, and one of temperatures")
    zero = np.zeros(3)
    scattering = medium.scattering.get(driving[0], zero)
    extinction = scattering + medium.absorbing.get(driving[0], zero)
    most = float(extinction.max())
    if most <= 0:
        raise refused(where, "it takes no light", "give it a density: Cumulo's media have an extinction")
    entry = {
        "density_scale": scale * most,
        "albedo": np.divide(scattering, extinction, out=np.zeros(3), where=extinction > 0).tolist(),
        "anisotropy": next(iter(medium.anisotropies), 0.0),
    }
    if extinction.min() < most:
        entry["extinction_color"] = (extinction / most).tolist()
    for grid, radiance in medium.emitting.items():
        entry["emission_grid"] = {"grid": grid, "radiance": (scale * radiance).tolist()}
    for blackbody in medium.blackbodies:
        entry["blackbody"] = blackbody | {"intensity": scale * blackbody["intensity"]}
    return driving[0], entry
