"""From Cycles' pictures to a VDB, and back into Blender, where it was."""

import json
import subprocess
import sys

import numpy as np
import pytest
from cumulo import blender, noise, padding
from cumulo.capture import Capture, sphere_cameras
from cumulo.exr import read_exr

SETTINGS = blender.Settings(density_scale=3.5, samples=16, step_rate=0.5)


@pytest.fixture(scope="module")
def pictures(fixtures, tmp_path_factory):
    """24 views of the plume, 64x64, by Cycles."""
    folder = tmp_path_factory.mktemp("cycles")
    box = padding.world_box(*padding.lattice(fixtures / "plume.vdb", "density"))
    blender.render_capture(fixtures / "plume.vdb", sphere_cameras(24, *box, 64, 64), SETTINGS, folder)
    return folder


def test_the_capture_reads_back_as_it_was_rendered(fixtures, pictures):
    capture = Capture.read(pictures)
    assert (capture.model, capture.pixel_filter, capture.density_scale) == ("absorption", "box", 3.5)
    assert np.array_equal(capture.lattice, padding.lattice(fixtures / "plume.vdb", "density")[0])
    assert len(capture.frames) == 24
    for _, path in capture.frames:
        picture = read_exr(path)
        assert picture.shape == (64, 64, 4)
        # T times a white background, and 1 - T, add up to 1 in f32.
        assert np.abs(picture[..., :3] + picture[..., 3:] - 1).max() <= 2.0**-23
        assert picture[..., 3].max() > 0.5


def test_reconstruction_stands_where_the_volume_was(fixtures, pictures, cumulo, tmp_path):
    source, found = fixtures / "plume.vdb", tmp_path / "found.vdb"
    report = cumulo(
        "reconstruct", "density", pictures / "transforms.json", "-o", found, "--voxel-size", 1 / 24, "--held-out", 2,
    )  # fmt: skip
    assert report["iterations"] > 0
    # Blender puts both on one lattice: index to world agree up to whole voxels, in its f32.
    matrices = [np.array(blender.where(path)["grids"][0]["lattice"]) for path in (source, found)]
    offset = np.linalg.solve(matrices[0], matrices[1])
    assert np.abs(offset[:3, :3] - np.eye(3)).max() < 1e-5
    assert np.abs(offset[:3, 3] - np.round(offset[:3, 3])).max() < 1e-3
    grid, = cumulo("diff", source, found)["grids"]
    assert grid["psnr_db"] > 28
    # Seen from a place that no picture was taken from.
    box = padding.world_box(*padding.lattice(source, "density"))
    camera = sphere_cameras(7, *box, 64, 64)[3]
    first, second = (blender.Stage(SETTINGS, source).picture(camera, seed) for seed in (91, 92))
    again = blender.Stage(SETTINGS, found).picture(camera, 93)
    floor = noise.floor_of(first, second)
    error = np.sqrt(np.mean((again - first)[..., :3].astype(np.float64) ** 2))
    # Two noisy pictures of the same volume differ by the floor between seeds; what the volume's own
    # error adds must not show at more than 38 dB.
    assert noise.decibels(error) > min(floor.between_seeds_db - 1.0, 38.0)


def test_command_line(fixtures, tmp_path):
    def run(*words):
        return subprocess.run(
            [sys.executable, "-m", "cumulo.blender", *map(str, words)],
            cwd=fixtures.parent / "python", capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip

    done = run("render", fixtures / "cube.vdb", "--views", 2, "--size", "20x16", "--samples", 2, "--threads", 1, "-o", tmp_path / "a")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"{tmp_path / 'a' / 'transforms.json'}: 2 views") and done.stdout.count("\n") == 1, done.stdout
    # The same cameras again, on two threads: the same bits.
    done = run("render", fixtures / "cube.vdb", "--capture", tmp_path / "a", "--samples", 2, "--threads", 2, "-o", tmp_path / "b")
    assert done.returncode == 0, done.stderr
    for (one, first), (other, second) in zip(Capture.read(tmp_path / "a").frames, Capture.read(tmp_path / "b").frames):
        assert np.array_equal(one.camera_to_world, other.camera_to_world)
        assert np.array_equal(read_exr(first), read_exr(second))
    place = json.loads(run("load", fixtures / "cube.vdb").stdout)
    assert place["grids"][0]["name"] == "density"
    assert np.allclose(np.array(place["grids"][0]["lattice"]), np.diag([0.125, 0.125, 0.125, 1.0]))
    for wrong in (["load", fixtures / "README.md"], ["render", fixtures / "kinds.vdb", "--views", 1, "-o", tmp_path / "c"]):
        done = run(*wrong)
        assert done.returncode == 2
        assert str(wrong[1]) in done.stderr and "Traceback" not in done.stderr
