"""Who says what a picture should be: plain sums in f64, or the program."""

import dataclasses
import pathlib
import tempfile

import numpy as np
import pytest
import reference
from cumulo.capture import Capture
from cumulo.exr import read_exr


def plain(folder, vdb, camera, settings, supersample=1):
    """The picture by `reference.optical_depth`; the source radiance being constant, L = (1-T) c."""
    picture = np.zeros((camera.height * supersample, camera.width * supersample, 4))
    depth = reference.optical_depth(vdb, "density", finer(camera, supersample), settings.near)
    transmittance = np.exp(-settings.density_scale * depth)
    emission = np.array(settings.emission if settings.model == "emission-absorption" else (0, 0, 0))
    picture[..., 3] = 1.0 - transmittance
    picture[..., :3] = (1 - transmittance)[..., None] * emission + transmittance[..., None] * settings.background
    return box_mean(picture, supersample)


def by_program(cumulo):
    """The same by `cumulo render --cameras`."""

    def render(folder, vdb, camera, settings, supersample=1):
        asked = pathlib.Path(tempfile.mkdtemp(dir=folder))
        given = asked / "given"
        Capture(
            [(finer(camera, supersample), asked / "view.exr")],
            model=settings.model,
            background=settings.background,
            near=settings.near,
            density_scale=settings.density_scale,
            emission=settings.emission,
        ).write(asked / "transforms.json")
        cumulo(
            "render", vdb, "--cameras", asked / "transforms.json", "--model", settings.model,
            "--density-scale", settings.density_scale, "--quadrature", "exact", "-o", given,
        )  # fmt: skip
        (_, picture), = Capture.read(given).frames
        return box_mean(read_exr(picture).astype(np.float64), supersample)

    return render


def finer(camera, times):
    """The camera with each pixel split into times x times."""
    return dataclasses.replace(
        camera,
        width=camera.width * times,
        height=camera.height * times,
        **{key: getattr(camera, key) * times for key in ("fl_x", "fl_y", "cx", "cy")},
    )


def box_mean(picture, times):
    """Mean over times x times pixels of [height, width, channel]."""
    height, width, channels = picture.shape
    return picture.reshape(height // times, times, width // times, times, channels).mean(axis=(1, 3))


@pytest.fixture(params=["plain", "program"])
def expected(request, tmp_path):
    """Function (vdb, camera, settings, supersample=1) that returns the picture to be expected."""
    judge = plain if request.param == "plain" else by_program(request.getfixturevalue("cumulo"))
    return lambda *arguments, **options: judge(tmp_path, *arguments, **options)
