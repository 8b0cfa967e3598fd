"""Regression tests of renders, for pytest: what one program shows against what a reference shows.

    from cumulo.capture import Capture
    from cumulo.testing import volume

    def test_smoke(cumulo_parity):
        camera, _ = Capture.read("shots").frames[0]      # as `cumulo render smoke.vdb --views 1 -o shots` places it
        reference = volume("smoke.vdb", camera, {"model": "scattering", "albedo": (0.8,) * 3, "sky": (1, 1, 1), "unbiased": True})
        command = ["cumulo", "render", "smoke.vdb", "--cameras", "shots", "--density-scale", "1", "--albedo", "0.8",
                   "--sky", "1,1,1", "--background", "0", "--seed", "{seed}", "-o", "{output}"]
        cumulo_parity.statistical(reference, command)

The fixture `cumulo_parity` (`Parity`) comes with the plugin, which pytest finds when the package is
installed. References are rendered once and kept (`Reference`); `--cumulo-regenerate` renders them again,
and such a run fails. A picture that differs fails its test and leaves the expected and actual picture,
their difference, and a page that shows all of it.
"""

from .parity import Parity, rounding
from .reference import Reference, ReferenceProblem, blend_file, volume

__all__ = ["Parity", "Reference", "ReferenceProblem", "blend_file", "rounding", "volume"]
