"""Pictures in JAX: their values and derivatives are those of NumPy's functions."""

import jax
import numpy as np
import pytest
from cumulo import Cameras, CumuloError, Lattice, Texture, pictures
from cumulo.jax import render

SHAPE = (5, 6, 7)
LATTICE = Lattice.box(SHAPE, voxel_size=0.2)
CAMERAS = Cameras.around(LATTICE, 2, (8, 6))


def density():
    """Densities from 0.2 to 1."""
    return np.random.default_rng(1).uniform(0.2, 1.0, SHAPE).astype(np.float32)


def test_values_and_derivatives_are_those_of_numpy():
    values = density()
    given = {"lattice": LATTICE, "density_scale": 2.0, "background": (1.0, 0.5, 0.25)}
    seen = pictures.render(values, CAMERAS, **given)
    # Cameras are of single precision in JAX.
    np.testing.assert_allclose(render(values, CAMERAS, **given), seen, atol=1e-5)

    def loss(values, scale, focal):
        cameras = Cameras(CAMERAS.camera_to_world, focal, CAMERAS.centre, CAMERAS.size)
        return (render(values, cameras, **{**given, "density_scale": scale}) ** 2).sum()

    for of in (jax.grad(loss, argnums=(0, 1, 2)), jax.jit(jax.grad(loss, argnums=(0, 1, 2)))):
        by_values, by_scale, by_focal = of(values, 2.0, CAMERAS.focal)
        expected = pictures.gradient(2 * seen, values, CAMERAS, wrt=("values", "cameras"), **given)
        np.testing.assert_allclose(by_values, expected.values, rtol=2e-5, atol=1e-6)
        np.testing.assert_allclose(by_scale, expected.density_scale, rtol=2e-5)
        np.testing.assert_allclose(by_focal, expected.cameras[:, 6:8], rtol=1e-3, atol=1e-5)


def test_functions_have_derivatives():
    texels = np.random.default_rng(2).uniform(0.1, 1.0, (4, 4)).astype(np.float32)

    def loss(texels):
        return render(density(), CAMERAS, lattice=LATTICE, function=Texture(texels)).sum()

    slope = jax.grad(loss)(texels)
    seen = np.ones((2, 6, 8, 4), np.float32)
    expected = pictures.gradient(seen, density(), CAMERAS, lattice=LATTICE, function=Texture(texels), wrt=("function",))
    np.testing.assert_allclose(slope, expected.function, rtol=2e-4, atol=1e-5)


def test_what_is_not_there_is_refused():
    with pytest.raises(CumuloError, match="int32"):
        render(np.ones(SHAPE, np.int32), CAMERAS, lattice=LATTICE)
    with pytest.raises(TypeError, match="forward-mode|jvp"):
        jax.jvp(lambda v: render(v, CAMERAS, lattice=LATTICE), (density(),), (density(),))
