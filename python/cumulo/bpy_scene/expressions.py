"""Values that node trees state: numbers, colors, and numbers times a grid."""

import dataclasses
import math

from .refusal import named, refused

# Outputs of the node Volume Info, and the grids that they read.
VOLUME_INFO = {"Density": "density", "Flame": "flame", "Temperature": "temperature"}


@dataclasses.dataclass(frozen=True)
class Product:
    """`factor` times the grid named `grid`, or `factor` alone."""

    factor: float
    grid: str | None = None


class Tree:
    """The nodes of a material or world, `owner` being how messages name it."""

    def __init__(self, kind, block):
        self.kind, self.block, self.nodes = kind, block, block.node_tree

    def refused(self, node, found, remedy):
        """The error about a node."""
        return refused(named(self.kind, self.block, node), found, remedy)

    def source(self, socket):
        """The socket that feeds `socket`, through reroutes; None where nothing is linked."""
        while socket.is_linked:
            link = socket.links[0]
            if link.is_muted:
                return None
            node, socket = link.from_node, link.from_socket
            if node.mute:
                raise self.refused(node, "the node is muted", "delete it, or switch it on")
            if node.bl_idname != "NodeReroute":
                return socket
            socket = node.inputs[0]
        return None

    def number(self, socket):
        """The number of a socket, which no grid may drive."""
        product = self.product(socket)
        if product.grid is not None:
            raise self.refused(
                socket.node, f"{socket.name!r} is driven by the grid {product.grid!r}", f"give {socket.name!r} a number"
            )
        return product.factor

    def color(self, socket):
        """The color of a socket, three numbers from 0 on."""
        source = self.source(socket)
        if source is None:
            color = tuple(socket.default_value)[:3]
        elif source.node.bl_idname == "ShaderNodeRGB":
            color = tuple(source.default_value)[:3]
        else:
            raise self.refused(
                source.node,
                f"drives the color {socket.name!r} of {socket.node.name!r}",
                "unlink it and choose one color",
            )
        if not all(math.isfinite(c) and c >= 0 for c in color):
            raise self.refused(socket.node, f"{socket.name!r} is {color}", "choose finite numbers from 0 on")
        return color

    def product(self, socket):
        """The Product that feeds a socket of numbers."""
        source = self.source(socket)
        if source is None:
            return self._finite(socket.node, Product(float(socket.default_value)))
        node = source.node
        if node.bl_idname == "ShaderNodeValue":
            return self._finite(node, Product(float(source.default_value)))
        if node.bl_idname == "ShaderNodeAttribute":
            return self._attribute(node, source)
        if node.bl_idname == "ShaderNodeVolumeInfo" and source.name in VOLUME_INFO:
            return Product(1.0, VOLUME_INFO[source.name])
        if node.bl_idname == "ShaderNodeMath":
            return self._finite(node, self._arithmetic(node))
        raise self.refused(
            node,
            f"output {source.name!r} of a {node.bl_label} drives {socket.name!r} of {socket.node.name!r}",
            "Cumulo knows numbers and grids (Attribute, Volume Info) times numbers (Value, Math): bake the rest into the grid",
        )

    def _attribute(self, node, source):
        if node.attribute_type != "GEOMETRY" or source.identifier != "Fac":
            raise self.refused(
                node,
                f"output {source.name!r} of a {node.attribute_type.lower()} attribute is used",
                "use the output Fac of type Geometry",
            )
        if not node.attribute_name:
            raise self.refused(node, "names no attribute", "name the grid")
        return Product(1.0, node.attribute_name)

    def _arithmetic(self, node):
        """The Product of a Math node."""
        if node.use_clamp:
            raise self.refused(node, "clamps its result", "switch Clamp off")
        first, second = (self.product(socket) for socket in list(node.inputs)[:2])
        operation = node.operation
        if operation == "MULTIPLY" and not (first.grid and second.grid):
            return Product(first.factor * second.factor, first.grid or second.grid)
        if operation == "DIVIDE" and second.grid is None and second.factor != 0:
            return Product(first.factor / second.factor, first.grid)
        # Sums of numbers, or of multiples of one grid.
        if operation in ("ADD", "SUBTRACT") and first.grid == second.grid:
            return Product(first.factor + (second.factor if operation == "ADD" else -second.factor), first.grid)
        raise self.refused(
            node, f"the operation {operation} is not a number times one grid", "bake it into the grid, or simplify it"
        )

    def _finite(self, node, product):
        if not (math.isfinite(product.factor) and product.factor >= 0):
            raise self.refused(node, f"gives {product.factor}", "give a finite number from 0 on")
        return product
