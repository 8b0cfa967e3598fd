"""How Cycles renders a reference."""

import dataclasses

from ..capture import default_emission


@dataclasses.dataclass(frozen=True)
class Settings:
    """How Cycles renders. `density_scale` is extinction per unit of density and world length;
    `emission` the source radiance per channel: 1 unless given, and 0 where the model is "scattering". `unbiased` walks by
    null-collision tracking; the biased walk marches with steps of `step_rate` voxels. `pixel_filter`
    is "box", the mean over the pixel's square, or "point": exactly its centre with one sample, and
    within 0.005 pixels of it for all but about one sample in a thousand with more.

    The model "scattering" is a Principled Volume of `albedo` and `anisotropy`, lit by a constant `sky`
    or an equirectangular EXR, `sky_file`, and by `lights`, and seen before black; light is scattered `max_bounces` times at most.
    `function` holds pairs of a density and its share of the extinction, linear in between, for densities from 0 to 1.
    The grid `emission_grid` emits `emission` per unit, and `blackbody` is the intensity of a grid "temperature", in units of
    `kelvin`."""

    model: str = "absorption"
    density_scale: float = 1.0
    emission: tuple = ()
    background: tuple = (1.0, 1.0, 1.0)
    near: float = 0.0
    pixel_filter: str = "box"
    samples: int = 32
    seed: int = 0
    unbiased: bool = False
    step_rate: float = 0.3
    threads: int = 0
    albedo: tuple = (0.0, 0.0, 0.0)
    anisotropy: float = 0.0
    absorption_color: tuple = (0.0, 0.0, 0.0)
    emission_grid: str = ""
    blackbody: float = 0.0
    kelvin: float = 1000.0
    function: tuple = ()
    sky: tuple = (0.0, 0.0, 0.0)
    sky_file: str = ""
    lights: tuple = ()
    max_bounces: int = 1024

    def __post_init__(self):
        if len(self.emission) == 0:
            object.__setattr__(self, "emission", default_emission(self.model))
