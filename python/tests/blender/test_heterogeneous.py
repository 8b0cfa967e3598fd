"""The plume, in both light models, as Cycles sees it: pixels as means over their squares."""

import math

import numpy as np
import pytest
import reference
from cumulo import blender, noise
from cumulo.capture import Camera, look_at
from cumulo.testing import volume

# 64x64 pixels; the plume is a box from 0 to 2.
VIEW = Camera(look_at((3.4, 2.4, 3.1), (1, 1, 1), (0, 0, 1)), 80.0, 80.0, 32.0, 32.0, 64, 64)
MODELS = {
    "absorption": {"background": (1.0, 1.0, 1.0)},
    "emission-absorption": {"emission": (0.3, 1.0, 0.6), "background": (0.8, 0.1, 0.0)},
}
# Means over squares by 4x4 points. The midpoint rule leaves a 16th of a pixel's curvature/24: below
# 1e-4 in single pixels of these pictures, and a hundredth of that where curvatures of both signs meet.
SUPERSAMPLE = 4


# The same in terms of the test: a difference of expected values that counts as none.
UNRESOLVED = 1e-4


@pytest.mark.parametrize("model", MODELS)
def test_plume(fixtures, expected, cumulo_parity, model):
    settings = blender.Settings(model=model, density_scale=3.0, unbiased=True, samples=64, **MODELS[model])

    def candidate(_seed, _path):
        picture = expected(fixtures / "plume.vdb", VIEW, settings, supersample=SUPERSAMPLE)
        transmittance = 1 - picture[..., 3:]
        assert 0.02 < transmittance.min() < 0.5
        # References are films: what is behind the volume is no part of them.
        return np.concatenate([picture[..., :3] - transmittance * settings.background, picture[..., 3:]], axis=-1)

    reference_film = volume(fixtures / "plume.vdb", VIEW, settings, name=f"plume_{model.replace('-', '_')}")
    cumulo_parity.statistical(reference_film, candidate, candidate_seeds=(1,), noiseless="candidate", tolerance=UNRESOLVED)


@pytest.mark.parametrize("model", MODELS)
def test_marched_plume(fixtures, expected, model):
    """The marched walk estimates the optical depth, which biases its pictures by as much as `reference.excess` allows."""
    settings = blender.Settings(model=model, density_scale=3.0, step_rate=0.1, samples=32, **MODELS[model])
    stage = blender.Stage(settings, fixtures / "plume.vdb")
    first, second = (stage.picture(VIEW, seed) for seed in (1, 2))
    wanted = expected(fixtures / "plume.vdb", VIEW, settings, supersample=SUPERSAMPLE)
    transmittance = [1 - picture[..., 3] for picture in (first, second, wanted)]
    assert reference.excess(*transmittance, settings.samples) <= 1.0
    for channel in range(3):
        pictures = (p[..., channel] for p in (first, second, wanted))
        assert reference.excess(*pictures, settings.samples) <= 1.0, "RGB"[channel]


def test_noise_falls_with_the_square_root_of_the_samples(fixtures):
    few, many = (
        noise.noise_floor(fixtures / "plume.vdb", VIEW, blender.Settings(density_scale=6.0, samples=samples, step_rate=1.0))
        for samples in (8, 128)
    )
    assert few.between_seeds_db == pytest.approx(few.psnr_db - 10 * math.log10(2), abs=1e-9)
    # Sixteen times the samples: 12 dB, or more, since samples of a pixel are stratified.
    assert 11.0 < many.psnr_db - few.psnr_db < 24.0
