"""Regression tests of renders, for pytest: what one program shows against what a reference shows.

    from cumulo.testing import volume

    def test_smoke(cumulo_parity):
        reference = volume("smoke.vdb", CAMERA, {"model": "scattering", "samples": 64, ...})
        command = ["cumulo", "render", "smoke.scene.json", ..., "--seed", "{seed}", "-o", "{output}"]
        cumulo_parity.statistical(reference, command)

The fixture `cumulo_parity` (`Parity`) comes with the plugin, which pytest finds when the package is
installed. References are rendered once and kept (`Reference`); `--cumulo-regenerate` renders them again,
and such a run fails. A picture that differs fails its test and leaves the expected and actual picture,
their difference, and a page that shows all of it.
"""

from .parity import Parity, rounding
from .reference import Reference, ReferenceProblem, blend_file, volume

__all__ = ["Parity", "Reference", "ReferenceProblem", "blend_file", "rounding", "volume"]
