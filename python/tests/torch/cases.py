"""Small volumes, cameras and transfer functions on which derivatives are checked: few pixels, no two values alike."""

import dataclasses
import functools

import cumulo.torch as ct
import numpy as np
import torch
from cumulo import arrays
from cumulo.fields import Cameras, Gaussians, Lattice, Piecewise, Texture

# Width and height of the pictures in pixels.
SIZE = (5, 4)
SHAPE = (4, 5, 3)
# Pixels of two views.
PICTURES = (2, 4, 5, 4)

# Transfer functions by kind, of densities from 0 to 1; rows end with radiance in red, green and blue, and extinction.
FUNCTIONS = {
    Texture: [[0.9, 0.2, 0.1, 0.4], [0.3, 0.8, 0.2, 2.5], [0.1, 0.3, 0.7, 0.6], [0.6, 0.5, 0.9, 1.9]],
    Piecewise: [[0.1, 0.8, 0.2, 0.1, 0.3], [0.42, 0.3, 0.9, 0.4, 2.2], [0.77, 0.2, 0.3, 0.8, 0.9], [0.95, 0.7, 0.6, 0.2, 1.4]],
    Gaussians: [[0.35, -1.6, 0.9, 0.4, 0.1, 1.3], [0.7, -1.2, 0.2, 0.5, 0.8, 2.1]],
}


def random(*shape, seed=0, low=0.0, high=1.0, dtype=torch.float64):
    """Random numbers between two bounds."""
    generator = torch.Generator().manual_seed(seed)
    return (low + (high - low) * torch.rand(shape, generator=generator, dtype=torch.float64)).to(dtype)


def density(shape=SHAPE, dtype=torch.float64, seed=0):
    """Densities between 0.1 and 0.9."""
    return random(*shape, seed=seed, low=0.1, high=0.9, dtype=dtype)


def pre_shaded(dtype=torch.float64):
    """A pre-shaded volume."""
    return random(*SHAPE, 4, seed=1, low=0.1, high=1.5, dtype=dtype)


@functools.cache
def lattice(shape=SHAPE):
    """Places of voxels of 0.5, turned by no axis of the world."""
    turned = rigid(torch.tensor([0.2, -0.3, 0.4]), torch.tensor([0.1, -0.2, 0.3])).numpy()
    turned[:3, 3] -= turned[:3, :3] @ (0.25 * (np.array(shape) - 1))
    turned[:3, :3] *= 0.5
    return Lattice.box(shape, transform=turned)


def sparse(folder):
    """Places and values of the active voxels of a VDB in a folder."""
    values = density(dtype=torch.float32).numpy()
    values[(values < 0.3) | (np.indices(SHAPE).sum(0) % 4 == 0)] = 0
    arrays.write_volume(folder / "sparse.vdb", values, voxel_size=0.5, origin=(-0.7, -1.1, -0.4))
    return Lattice.read(folder / "sparse.vdb")


def rigid(turn, shift):
    """A rigid motion: the rotation of a rotation vector, then a translation. It has derivatives."""
    turn, shift = turn.double(), shift.double()
    zero = torch.zeros((), dtype=torch.float64)
    x, y, z = turn
    skew = torch.stack([torch.stack(row) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))])
    top = torch.cat([torch.linalg.matrix_exp(skew), shift[:, None]], 1)
    return torch.cat([top, torch.tensor([[0.0, 0.0, 0.0, 1.0]], dtype=torch.float64)])


def cameras(views=2, orthographic=False, size=SIZE):
    """Cameras at 2.5 world units from the volume's middle whose pictures show it, slightly off their middles."""
    eyes = torch.tensor([[2.1, 1.0, 0.9], [-0.8, 1.9, -1.4], [0.4, -2.3, 0.8]], dtype=torch.float64)[:views]
    focal = torch.tensor([[2.1, 2.3]] if orthographic else [[5.2, 4.7]], dtype=torch.float64).repeat(views, 1)
    centre = torch.tensor([[2.4, 2.1]], dtype=torch.float64).repeat(views, 1)
    scale = size[0] / SIZE[0]
    return Cameras(ct.look_at(eyes, (0.05, -0.1, 0.02)), scale * focal, scale * centre, size, orthographic)


def moved(seen, turns, shifts):
    """Cameras after rigid motions of each."""
    matrices = torch.stack([rigid(t, s) for t, s in zip(turns, shifts, strict=True)]) @ seen.camera_to_world
    return dataclasses.replace(seen, camera_to_world=matrices)


def function(kind, parameters=None):
    """A transfer function of a kind, of tensors."""
    values = torch.tensor(FUNCTIONS[kind], dtype=torch.float64) if parameters is None else parameters
    return kind(values)


def apart(found, expected):
    """Norm of the difference, relative to the expected one's."""
    return float((found.double() - expected.double()).norm() / expected.double().norm())
