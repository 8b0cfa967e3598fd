"""The scenes that both programs render, and pixel means of closed forms over the same cameras."""

import dataclasses

import fields
import numpy as np
from cumulo.capture import Camera, look_at


@dataclasses.dataclass(frozen=True)
class View:
    """A camera of square pictures; `angle` is that of view in degrees, or None for a picture of parallel rays that is one
    world unit wide."""

    eye: tuple = (-1.35, -1.05, 1.5)
    target: tuple = (0.5, 0.5, 0.48)
    angle: float | None = 16.0
    size: int = 24
    inside: bool = False

    @property
    def camera(self):
        """The camera as captures have it."""
        length = self.size if self.angle is None else 0.5 * self.size / np.tan(np.radians(0.5 * self.angle))
        matrix, middle = look_at(self.eye, self.target), 0.5 * self.size
        return Camera(matrix, length, length, middle, middle, self.size, self.size, orthographic=self.angle is None)

    def pixel_means(self, function):
        """Means over each pixel of a function of origins and unit directions of rays."""
        inner = (np.arange(fields.POINTS) + 0.5) / fields.POINTS
        offsets = [(x, y) for y in inner for x in inner]
        return np.mean([function(*(v[0] for v in self.camera.rays([offset]))) for offset in offsets], axis=0)


@dataclasses.dataclass(frozen=True)
class Sun:
    """A sun without extent; `direction` is towards it."""

    direction: tuple = (0.3, -0.8, 0.6)
    irradiance: tuple = (3.0, 2.0, 1.0)


@dataclasses.dataclass(frozen=True)
class Point:
    """A point light."""

    position: tuple = (0.3, -0.3, 1.5)
    intensity: tuple = (2.0, 3.0, 4.0)


@dataclasses.dataclass(frozen=True)
class Ball:
    """A sphere that emits."""

    centre: tuple = (1.4, -0.2, 1.2)
    radius: float = 0.3
    radiance: tuple = (8.0, 6.0, 4.0)


@dataclasses.dataclass(frozen=True)
class Rectangle:
    """A rectangle that emits to the side of the first edge x the second."""

    corner: tuple = (0.1, -0.1, 1.4)
    edges: tuple = ((0.0, 1.2, 0.0), (0.8, 0.0, 0.0))
    radiance: tuple = (4.0, 5.0, 6.0)


@dataclasses.dataclass(frozen=True)
class Mesh:
    """A mesh of polygons, counterclockwise as seen from outside; `inside` if it stands within the cube of the volume."""

    vertices: tuple
    faces: tuple
    albedo: tuple = (0.8, 0.8, 0.8)
    emission: tuple = (0.0, 0.0, 0.0)
    inside: bool = False

    def write(self, path):
        """Writes the mesh as PLY, of triangles."""
        coordinates = [" ".join(map(repr, vertex)) for vertex in self.vertices]
        # Mitsuba reads triangles alone.
        triangles = [(face[0], *pair) for face in self.faces for pair in zip(face[1:], face[2:])]
        polygons = [" ".join(map(str, (3, *face))) for face in triangles]
        head = ["ply", "format ascii 1.0", f"element vertex {len(self.vertices)}",
                *(f"property float {axis}" for axis in "xyz"), f"element face {len(triangles)}",
                "property list uchar int vertex_indices", "end_header"]  # fmt: skip
        path.write_text("\n".join([*head, *coordinates, *polygons, ""]))
        return path


@dataclasses.dataclass(frozen=True)
class Surface:
    """Surfaces, which scatter half of the light at a change of density of `half` per world length; they reflect."""

    half: float
    specular: float
    roughness: float


def quad(corner, first, second, **material):
    """A parallelogram; its front is on the side of the first edge x the second."""
    a, u, v = (np.array(vector, dtype=float) for vector in (corner, first, second))
    return Mesh(tuple(map(tuple, np.stack([a, a + u, a + u + v, a + v]).tolist())), ((0, 1, 2, 3),), **material)


def ball(centre, radius, rows=8, **material):
    """A sphere of triangles and quads."""
    polar, turn = np.pi * np.arange(1, rows) / rows, np.pi * np.arange(2 * rows) / rows
    ring = np.stack([np.outer(np.sin(polar), np.cos(turn)), np.outer(np.sin(polar), np.sin(turn)),
                     np.outer(np.cos(polar), np.ones_like(turn))], axis=-1)  # fmt: skip
    vertices = np.array(centre) + radius * np.concatenate([ring.reshape(-1, 3), [[0, 0, 1]], [[0, 0, -1]]])
    n, top = 2 * rows, len(vertices) - 2
    after = [(j + 1) % n for j in range(n)]
    sides = [(i * n + j, (i + 1) * n + j, (i + 1) * n + after[j], i * n + after[j]) for i in range(rows - 2) for j in range(n)]
    last = (rows - 2) * n
    caps = [(top, j, after[j]) for j in range(n)] + [(top + 1, last + after[j], last + j) for j in range(n)]
    return Mesh(tuple(map(tuple, vertices.tolist())), tuple(sides + caps), **material)


@dataclasses.dataclass(frozen=True)
class Scene:
    """A volume in a cube, meshes, lights, and a view.

    `fields` names densities that lie over each other. `place` takes the unit cube to the world, a tuple of rows. `sky` is
    a radiance from all around, or "picture" for the picture of a sky.
    """

    fields: tuple = ("lump",)
    density_scale: float = 6.0
    albedo: tuple | float = 0.9
    g: float = 0.0
    emission: tuple | None = None
    # Not in the text that random numbers are chosen by.
    surface: Surface | None = dataclasses.field(default=None, repr=False)
    bounces: int | None = None
    lights: tuple = ()
    meshes: tuple = ()
    sky: tuple | str = (0.0, 0.0, 0.0)
    place: tuple = tuple(map(tuple, np.eye(4).tolist()))
    view: View = View()
    # Paths per pixel and batch, of Mitsuba and of Cumulo.
    paths: tuple = (64, 32)

    @property
    def colour(self):
        """The albedo of each channel."""
        return self.albedo if isinstance(self.albedo, tuple) else (self.albedo,) * 3

    def but(self, **changes):
        """The scene with changes."""
        return dataclasses.replace(self, **changes)

    def scaled(self, factor):
        """The same picture of a world that is `factor` times as large."""

        def larger(vector):
            return tuple(factor * v for v in vector)

        def light(given):
            match given:
                case Point():
                    return dataclasses.replace(given, position=larger(given.position), intensity=larger(larger(given.intensity)))
                case Ball():
                    return dataclasses.replace(given, centre=larger(given.centre), radius=factor * given.radius)
                case Rectangle():
                    return dataclasses.replace(given, corner=larger(given.corner), edges=tuple(map(larger, given.edges)))
            return given

        return self.but(
            density_scale=self.density_scale / factor,
            lights=tuple(map(light, self.lights)),
            place=tuple(map(larger, self.place[:3])) + self.place[3:],
            view=dataclasses.replace(self.view, eye=larger(self.view.eye), target=larger(self.view.target)),
        )


SKY = (0.4, 0.7, 1.0)
DAY = {"lights": (Sun(),), "sky": SKY}
# Turned by 3-4-5, sheared, and stretched by other factors along each axis.
AFFINE = ((0.9, -0.6, 0.1, 0.2), (0.7, 0.8, 0.2, -0.4), (0.0, 0.15, 1.3, -0.2), (0.0, 0.0, 0.0, 1.0))
INSIDE = View(eye=(0.52, 0.5, 0.45), target=(0.2, 0.9, 0.3), angle=60.0, inside=True)
# Straight through the middle of the core its optical depth is 100.
DENSE = 100.0 / float(fields.optical_depth("core", np.array([-1.0, 0.5, 0.5]), np.array([1.0, 0.0, 0.0]), 512))
CORE = View(angle=12.0, size=16)

# A floor, a red wall behind the volume and a green one beside it, within which light goes back and forth.
FLOOR = quad((-1.0, -1.0, -0.02), (4.0, 0.0, 0.0), (0.0, 4.0, 0.0), albedo=(0.7, 0.6, 0.5))
RED = quad((-1.0, 1.1, -0.02), (4.0, 0.0, 0.0), (0.0, 0.0, 3.0), albedo=(0.8, 0.1, 0.1))
GREEN = quad((1.2, -1.0, -0.02), (0.0, 4.0, 0.0), (0.0, 0.0, 3.0), albedo=(0.1, 0.7, 0.2))
BALL = ball((0.5, 0.55, 0.5), 0.2, albedo=(0.3, 0.6, 0.9), inside=True)
LAMP = ball((-0.3, 0.6, 0.8), 0.15, albedo=(0.2, 0.2, 0.2), emission=(9.0, 6.0, 3.0))
ROOM = View(angle=40.0)

SCENES = {
    "absorption": Scene(albedo=0.0, sky=(1.0, 0.8, 0.6), paths=(128, 64)),
    "emission and absorption": Scene(albedo=0.0, emission=(0.2, 0.9, 2.0), sky=(1.0, 0.3, 0.1), paths=(128, 64)),
    "single scattering, sun": Scene(lights=(Sun(),), bounces=1, paths=(256, 32)),
    "single scattering, point": Scene(lights=(Point(),), bounces=1, paths=(256, 32)),
    "single scattering, rectangle": Scene(lights=(Rectangle(),), bounces=1, paths=(256, 32)),
    "single scattering, sphere": Scene(lights=(Ball(),), bounces=1, paths=(256, 32)),
    "single scattering, sky": Scene(sky=SKY, bounces=1),
    "single scattering, picture of a sky": Scene(sky="picture", g=0.3, bounces=1),
    "two scatterings, rectangle": Scene(lights=(Rectangle(),), bounces=2, paths=(128, 64)),
    "albedo 0.5": Scene(albedo=0.5, **DAY),
    "albedo 0.9": Scene(albedo=0.9, paths=(128, 64), **DAY),
    "albedo 0.99": Scene(albedo=0.99, **DAY),
    "albedo 1": Scene(albedo=1.0, **DAY),
    "albedo by channel": Scene(albedo=(0.95, 0.6, 0.2), **DAY),
    "g -0.9": Scene(g=-0.9, sky="picture"),
    "g -0.5": Scene(g=-0.5, **DAY),
    "g 0.5": Scene(g=0.5, **DAY),
    "g 0.9": Scene(g=0.9, sky="picture"),
    "rectangle": Scene(lights=(Rectangle(),), g=0.4, paths=(128, 64)),
    "sphere": Scene(lights=(Ball(),), g=-0.3, paths=(128, 64)),
    "point and sky": Scene(lights=(Point(), Sun()), sky=SKY),
    "dense core": Scene(("core",), DENSE, view=CORE, paths=(16, 16), **DAY),
    "thin shell": Scene(("shell",), 20.0, **DAY),
    "overlapping": Scene(("lump", "ball"), 4.0, **DAY),
    "affine": Scene(place=AFFINE, view=View(angle=20.0), **DAY),
    "terrace": Scene(("terrace",), 8.0, **DAY),
    "inside": Scene(view=INSIDE, **DAY),
    "floor and walls": Scene(meshes=(FLOOR, RED, GREEN), view=ROOM, **DAY),
    "floor and walls, two scatterings": Scene(meshes=(FLOOR, RED, GREEN), bounces=2, view=ROOM, **DAY),
    "floor without a volume": Scene(density_scale=1e-9, meshes=(FLOOR, RED), view=ROOM, **DAY),
    "ball in the volume": Scene(meshes=(BALL,), g=0.4, **DAY),
    "black ball in the volume": Scene(meshes=(dataclasses.replace(BALL, albedo=(0.0, 0.0, 0.0)),), **DAY),
    "ball in a dense core": Scene(("core",), 0.1 * DENSE, meshes=(BALL,), **DAY),
    "lamp on a floor": Scene(meshes=(FLOOR, LAMP), view=ROOM, paths=(256, 64)),
    "lamp and ball, overlapping": Scene(("lump", "ball"), 3.0, meshes=(BALL, FLOOR, LAMP), view=ROOM, **DAY),
    "point above a floor": Scene(meshes=(FLOOR, GREEN), lights=(Point(),), g=-0.3, view=ROOM),
    "picture of a sky above a floor": Scene(meshes=(FLOOR,), sky="picture", view=ROOM),
    "tiny": Scene(lights=(Ball(),), paths=(128, 64)).scaled(1e-3),
    "huge": Scene(lights=(Rectangle(),), paths=(128, 64)).scaled(1e4),
}


def sky_picture():
    """A sky with a sun that is up to one side and a dark ground, [row, column, channel] as Cumulo reads it: the samples of
    its rows and columns lie at the centres of pixels."""
    turn, rise = np.meshgrid((np.arange(32) + 0.5) / 32, (np.arange(16) + 0.5) / 16)
    sun = 12.0 * np.exp(-((turn - 0.3) ** 2 + (rise - 0.25) ** 2) / 0.008)
    return np.stack([0.2 + sun, 0.3 + 0.3 * turn + 0.8 * sun, np.where(rise < 0.5, 0.8, 0.1) + 0.5 * sun], axis=-1)
