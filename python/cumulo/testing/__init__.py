"""Regression tests of renders, for pytest: what one renderer shows against what a reference shows.

    import cumulo
    from cumulo.capture import Capture
    from cumulo.testing import volume

    def picture(seed, path):
        lit = {"density_scale": 1, "albedo": 0.8, "sky": (1, 1, 1), "background": 0}
        cumulo.render("smoke.vdb", path, cameras="shots", seed=seed, **lit)

    def test_smoke(cumulo_parity):
        camera, _ = Capture.read("shots").frames[0]      # as `cumulo.render("smoke.vdb", "shots", views=1)` places it
        reference = volume("smoke.vdb", camera, {"model": "scattering", "albedo": (0.8,) * 3, "sky": (1, 1, 1), "unbiased": True})
        cumulo_parity.statistical(reference, picture)

Candidates are functions of the seed and the path, or commands of any program with the words {seed} and {output}.
Cumulo's own work is done in the process of the tests. The fixture `cumulo_parity` (`Parity`) comes with the plugin,
which pytest finds when the package is installed. References are rendered once and kept (`Reference`);
`--cumulo-regenerate` renders them again, and such a run fails. A picture that differs fails its test and leaves the
expected and actual picture, their difference, and a page that shows all of it.
"""

from .parity import Parity, rounding
from .reference import Reference, ReferenceProblem, blend_file, volume

__all__ = ["Parity", "Reference", "ReferenceProblem", "blend_file", "rounding", "volume"]
