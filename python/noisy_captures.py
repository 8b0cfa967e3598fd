"""Captures with noise and wrong cameras: what `cumulo reconstruct density` finds in them by default.

    noisy_captures.py FOLDER [--volumes NAME ...] [--noises SIGMA ...] [--kinds KIND ...] [--turned DEGREES ...]
                      [--views N] [--size N] [--keep]

Three volumes of 128^3 voxels, a smoke, a textured cloud and opaque boxes, in pictures by absorption on a white
background without alpha. Gaussian noise of the given deviations is added to the colors of every pixel (`plain`), which
is then cut at black and white and rounded to 8 bits (`cut`), or the exact alpha is kept beside it (`alpha`). No bounds
are given, and the lattice is not stated. Cameras are exact, or turned by random angles of that deviation and moved by
as large a share of their distance; these captures are reconstructed as they are, and with `--refine-cameras`. A row has
the decibels of the volume (of a peak of 1), those of the held-out view, which has noise, too, the unknown voxels, the
seconds, and what the cameras are off by: the root mean square of their rotations in degrees and of their shifts in
percent of the distance, after the motion and scale of the scene as a whole, which no picture tells.
Needs numpy and OpenEXR (`peers/requirements-denoisers.txt`). CUMULO is the program, `cumulo` by default.
"""

import argparse
import itertools
import json
import os
import pathlib
import shutil
import subprocess
import sys
import time

import numpy as np
import OpenEXR

ROOT = pathlib.Path(__file__).resolve().parents[1]
EDGE = 128


def cumulo(*words):
    """Runs the program and returns what it prints."""
    program = os.environ.get("CUMULO", "cumulo")
    done = subprocess.run([program, *map(str, words)], capture_output=True, text=True)
    if done.returncode == 2:
        raise RuntimeError(done.stderr.strip())
    return done.stdout


def fractal(seed, power):
    """Noise of mean 0 and deviation 1 whose amplitude falls as the frequency to `power`: float32 `[z, y, x]`."""
    spectrum = np.fft.rfftn(np.random.default_rng(seed).standard_normal((EDGE, EDGE, EDGE)))
    z, y, x = np.fft.fftfreq(EDGE), np.fft.fftfreq(EDGE), np.fft.rfftfreq(EDGE)
    frequency = np.sqrt(z[:, None, None] ** 2 + y[None, :, None] ** 2 + x[None, None, :] ** 2)
    frequency[0, 0, 0] = 1
    field = np.fft.irfftn(spectrum * frequency**-power, s=(EDGE, EDGE, EDGE), axes=(0, 1, 2))
    return ((field - field.mean()) / field.std()).astype(np.float32)


def cloud():
    """A round cloud with texture down to single voxels."""
    z, y, x = (np.mgrid[0:EDGE, 0:EDGE, 0:EDGE] + 0.5) / EDGE * 2 - 1
    radius = np.sqrt(x * x + (1.2 * y) ** 2 + z * z)
    return np.clip((0.75 - radius) * 3 + 0.6 * fractal(3, 1.8), 0, 1) * (radius < 0.97) * (np.abs(y) < 0.9)


def boxes():
    """Twelve boxes of one density each."""
    values, random = np.zeros((EDGE, EDGE, EDGE)), np.random.default_rng(7)
    for _ in range(12):
        low, size = random.integers(EDGE // 6, EDGE - EDGE // 3, 3), random.integers(4, EDGE // 5, 3)
        values[tuple(slice(a, a + s) for a, s in zip(low, size))] = random.uniform(0.2, 1)
    return values


def volume(name, folder):
    """The VDB of a volume."""
    vdb = folder / f"{name}.vdb"
    if name == "smoke":
        maker = ROOT / "fixtures" / "make_fixtures.py"
        subprocess.run(["/usr/bin/python3", maker, "--plume", str(EDGE), vdb], check=True, stdout=subprocess.DEVNULL)
        return vdb
    array = folder / f"{name}.npy"
    np.save(array, {"cloud": cloud, "boxes": boxes}[name]().astype(np.float32))
    cumulo("convert", array, vdb, "--voxel-size", 2 / EDGE)
    return vdb


def with_noise(clean, folder, sigma, kind):
    """A copy of a capture whose pictures have noise."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(clean, folder)
    capture = json.loads((folder / "transforms.json").read_text())
    capture.pop("lattice", None)
    (folder / "transforms.json").write_text(json.dumps(capture))
    random = np.random.default_rng(1)
    for path in sorted(folder.glob("*.exr")):
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.array(channel.pixels, np.float32) for name, channel in file.channels().items()}
        for name in "RGB":
            noisy = channels[name] + sigma * random.standard_normal(channels[name].shape).astype(np.float32)
            channels[name] = np.round(np.clip(noisy, 0, 1) * 255) / 255 if kind == "cut" else noisy
        names = "RGBA" if kind == "alpha" else "RGB"
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {n: OpenEXR.Channel(n, channels[n].astype(np.float32)) for n in names}).write(str(path))


def turn(folder, degrees):
    """Turns the cameras of a capture by random rotation vectors, and moves them."""
    path, random = folder / "transforms.json", np.random.default_rng(2)
    capture = json.loads(path.read_text())
    for frame in capture["frames"]:
        matrix = np.array(frame["transform_matrix"])
        x, y, z = np.radians(degrees) / np.sqrt(3) * random.standard_normal(3)
        left, _, right = np.linalg.svd(np.eye(3) + np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))
        matrix[:3, :3] = left @ right @ matrix[:3, :3]
        shift = np.radians(degrees) / np.sqrt(3) * random.standard_normal(3)
        matrix[:3, 3] += np.linalg.norm(matrix[:3, 3]) * shift
        frame["transform_matrix"] = matrix.tolist()
    path.write_text(json.dumps(capture))


def poses(capture):
    """The rotations and positions of a capture's cameras."""
    matrices = np.array([frame["transform_matrix"] for frame in json.loads(capture.read_text())["frames"]])
    return matrices[:, :3, :3], matrices[:, :3, 3]


def apart(found, true):
    """Degrees and percent that the cameras of a capture are off by, after the similarity that brings them nearest."""
    (rotations, positions), (true_rotations, true_positions) = poses(found), poses(true)
    left, _, right = np.linalg.svd(np.einsum("nij,nkj->ik", true_rotations, rotations))
    turn = left @ right
    cosines = (np.einsum("nij,ik,nkj->n", true_rotations, turn, rotations) - 1) / 2
    moved, centred = (p - p.mean(0) for p in (positions @ turn.T, true_positions))
    shifts = np.linalg.norm(centred - (moved * centred).sum() / (moved**2).sum() * moved, axis=1)
    shares = shifts / np.linalg.norm(centred, axis=1)
    return np.degrees(np.sqrt(np.mean(np.arccos(np.clip(cosines, -1, 1)) ** 2))), 100 * np.sqrt(np.mean(shares**2))


def reconstruct(capture, found, vdb, clean, words):
    """Reconstructs and compares: a row's figures."""
    begun = time.monotonic()
    report = json.loads(cumulo("reconstruct", "density", capture, "-o", found, "--json", *words))
    seconds = time.monotonic() - begun
    cameras = pathlib.Path((report["cameras"] or {}).get("capture") or capture / "transforms.json")
    degrees, percent = apart(cameras, clean / "transforms.json")
    [grid] = json.loads(cumulo("diff", vdb, found, "--grid", "density", "--json"))["grids"]
    figures = f"{grid['psnr_db']:9.1f} {report['held_out_psnr_db']:12.1f} {report['unknowns']:9} {seconds:8.0f}"
    return f"{figures} {degrees:8.4f} {percent:8.4f}"


def main():
    """Makes the volumes and their captures, adds noise, reconstructs, compares."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--volumes", nargs="+", default=["smoke", "cloud", "boxes"])
    parser.add_argument("--noises", nargs="+", type=float, default=[0, 0.001, 0.005, 0.01, 0.05])
    parser.add_argument("--kinds", nargs="+", choices=["plain", "cut", "alpha"], default=["plain"])
    parser.add_argument("--turned", nargs="+", type=float, default=[0], help="degrees by which cameras are turned")
    parser.add_argument("--views", type=int, default=64)
    parser.add_argument("--size", type=int, default=128, help="edge of the pictures in pixels")
    parser.add_argument("--keep", action="store_true", help="keep the captures with noise")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    print("volume  noise   kind    cameras         volume dB  held out dB  unknowns  seconds  degrees  percent")
    for name in asked.volumes:
        vdb, clean = volume(name, asked.folder), asked.folder / f"{name}-clean"
        size = f"{asked.size}x{asked.size}"
        cumulo("render", vdb, "--views", asked.views, "--size", size, "--density-scale", "auto", "-o", clean)
        for kind, sigma, turned in itertools.product(asked.kinds, asked.noises, asked.turned):
            capture, found = asked.folder / f"{name}-{kind}-{sigma}-{turned}", asked.folder / f"{name}-found.vdb"
            with_noise(clean, capture, sigma, kind)
            ways = {"exact": []}
            if turned > 0:
                turn(capture, turned)
                ways = {f"{turned} given": [], f"{turned} refined": ["--refine-cameras"]}
            for cameras, words in ways.items():
                row = f"{name:7} {sigma:<7} {kind:7} {cameras:14}"
                try:
                    print(row, reconstruct(capture, found, vdb, clean, words), flush=True)
                except RuntimeError as error:
                    print(row, error, file=sys.stderr)
            if not asked.keep:
                shutil.rmtree(capture)


if __name__ == "__main__":
    main()
