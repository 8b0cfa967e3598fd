"""What nobody states has one value on every path: a scattering medium emits nothing, and lights of `cumulo.blender render`
are those of `cumulo render`."""

import numpy as np
import pytest
from cumulo import arrays, blender
from cumulo.blender import Settings
from cumulo.capture import Camera, Capture, look_at
from cumulo.exr import read_exr
from cumulo.testing import volume

# The plume is a box from 0 to 2.
VIEW = Camera(look_at((3.4, 2.4, 3.1), (1, 1, 1), (0, 0, 1)), 24.0, 24.0, 12.0, 12.0, 24, 24)
WHITE = {"model": "scattering", "density_scale": 4.0, "albedo": (1.0,) * 3, "sky": (1.0,) * 3, "samples": 16}


def assert_furnace(film):
    """In light that is the same from all around, a medium that loses none is as bright as that light: radiance and what
    shines through add up to 1, in every pixel whatever the paths were."""
    assert film[..., 3].max() > 0.9
    assert film[..., :3] + (1 - film[..., 3:]) == pytest.approx(np.ones((*film.shape[:2], 3)), abs=1e-4)


def test_a_scattering_medium_emits_nothing_unless_that_is_stated(fixtures, tmp_path):
    vdb = fixtures / "plume.vdb"
    # The picture is returned, not written.
    assert_furnace(volume(vdb, VIEW, WHITE).render(1, tmp_path / "none.exr"))
    assert_furnace(volume(vdb, VIEW, Settings(**WHITE)).render(1, tmp_path / "none.exr"))
    made = blender.render_capture(vdb, [VIEW], Settings(**WHITE, background=(0, 0, 0)), tmp_path / "one")
    assert made.emission == (0, 0, 0) and Capture.read(tmp_path / "one").emission == (0, 0, 0)
    assert_furnace(read_exr(made.frames[0][1]))
    given = ["render", str(vdb), "--views", "1", "--size", "16x16", "--albedo", "1", "--samples", "8", "--density-scale", "4"]
    # White is what the sky is without any light, too.
    for folder, sky in (("stated", ["--sky", "1", "1", "1"]), ("default", [])):
        blender.main([*given, *sky, "-o", str(tmp_path / folder)])
        assert_furnace(read_exr(tmp_path / folder / "view_000.exr"))
    glow = volume(vdb, VIEW, {**WHITE, "emission": (1.0, 0.0, 0.0)}).render(1, tmp_path / "none.exr")
    assert glow[..., 0].max() > 1.5 > 1.1 > glow[..., 1].max()


def test_emission_by_model(cumulo, fixtures, tmp_path):
    for model, emission in (("absorption", (1, 1, 1)), ("emission-absorption", (1, 1, 1)), ("scattering", (0, 0, 0))):
        assert Settings(model=model).emission == Capture([], model).emission == emission
        assert Settings(model=model, emission=(1, 2, 3)).emission == Capture([], model, emission=(1, 2, 3)).emission == (1, 2, 3)
    cumulo("render", fixtures / "cube.vdb", "--views", 1, "--size", "4x4", "--albedo", 0.5, "--samples", 1, "-o", tmp_path / "shots")
    assert Capture.read(tmp_path / "shots").emission == (0, 0, 0)


@pytest.mark.parametrize("color", [(), (3.0, 2.0, 1.0)], ids=["default", "stated"])
def test_one_flag_gives_one_sun(cumulo, fixtures, tmp_path, color):
    vdb = fixtures / "plume.vdb"
    Capture([(VIEW, tmp_path / "view.exr")], density_scale=4.0).write(tmp_path / "transforms.json")
    words = ["render", str(vdb), "--capture", str(tmp_path), "--albedo", "0.8", "--samples", "256", "--unbiased", "--sun", "-1", "0.6", "0.7"]
    blender.main([*words, *(["--sun-color", *map(str, color)] if color else []), "-o", str(tmp_path / "cycles")])
    cumulo(
        "render", vdb, "--cameras", tmp_path, "--albedo", 0.8, "--samples", 256, "--density-scale", 4, "--background", 0,
        "--sun=-1,0.6,0.7", *([f"--sun-color={','.join(map(str, color))}"] if color else []), "-o", tmp_path / "ours",
    )  # fmt: skip
    light = [arrays.read_picture(tmp_path / folder / "view_000.exr").values[..., :3].mean(axis=(0, 1)) for folder in ("cycles", "ours")]
    assert light[0].min() > 0.002 and light[0] == pytest.approx(light[1], rel=0.03)


def test_suns_that_are_none_are_refused(fixtures, tmp_path):
    words = ["render", str(fixtures / "cube.vdb"), "--views", "1", "--albedo", "0.5", "-o", str(tmp_path / "out")]
    for given, said in (
        (["--sun-color", "1", "1", "1"], "--sun-color is given without a sun; give --sun X Y Z"),
        (["--sun-angle", "2"], "--sun-angle is given without a sun"),
        (["--sun", "0", "0", "0"], "--sun is 0 0 0, which is no direction; give the vector"),
    ):
        with pytest.raises(ValueError, match=said):
            blender.main([*words, *given])
    assert not (tmp_path / "out").exists()
