"""The seven scenarios of Iglesias-Guitian et al. 2020 as path-traced sequences: noisy frames with their layers, and
converged references.

    scenarios.py FOLDER [--frames 44] [--judged 27-32] [--samples 2] [--reference 1024] [--size 240x180]
                 [--only VOLUME-SCENARIO ...] [--levels 1 4 8 ...] [--layers motion,...]

Writes FOLDER/VOLUME-SCENARIO/noisy/frame.####.exr and reference/frame.####.exr, the latter for the judged frames only. Two
volumes go through each scenario: a plume of smoke and a round cloud. With `--only brain-camera` the camera moves around a scan, the
MRI of a brain of Debian's package mricron-data. With `--levels` there are noisy frames of so many samples,
too, in FOLDER/VOLUME-SCENARIO-8spp and so on, beside the same references. `--reference 0` renders none. Frames that are there are left as they are. Needs
numpy and OpenVDB's Python module (Debian's python3-openvdb). CUMULO is the program, `cumulo` by default.
"""

import argparse
import json
import math
import os
import pathlib
import subprocess
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parent / "peers"))
from field import smoke  # noqa: E402  lies beside the peers

LAYERS = "motion,halves,albedo,variance,direct,indirect"
SUN = {"type": "DistantLight", "direction": [0.4, -0.5, 0.8], "irradiance": [3, 2.8, 2.5], "angle": 0.53}
SKY = {"type": "DomeLight", "radiance": [0.15, 0.2, 0.3]}
DUSK = {"type": "DomeLight", "radiance": [0.03, 0.04, 0.06]}


def cloud(n):
    """A round cloud: float32 `[z, y, x]`, 0..1."""
    c = (np.arange(n) + 0.5) / n - 0.5
    z, y, x = np.meshgrid(c, c, c, indexing="ij")
    lumps = sum(
        np.sin(2 * np.pi * k * x + 1.3 * k) * np.sin(2 * np.pi * k * y + 2.1 * k * k) * np.sin(2 * np.pi * k * z + 0.7 * k) / k
        for k in (2, 3, 5, 8, 13)
    )
    edge = 0.38 + 0.1 * lumps - np.sqrt(x * x + y * y + 1.5 * z * z)
    return np.clip(12 * edge, 0, 1).astype(np.float32)


# The medium of each volume, dense enough to scatter several times.
VOLUMES = {
    "plume": (smoke, {"density_scale": 20, "albedo": [0.95, 0.92, 0.88], "anisotropy": 0.3}),
    "cloud": (cloud, {"density_scale": 30, "albedo": [0.99, 0.99, 0.99], "anisotropy": 0.6}),
    "brain": (None, {"density_scale": 200, "albedo": [0.9, 0.9, 0.9], "transfer": "../brain.tf.json"}),
}
# Millimetres around the brain's middle come to the unit cube's.
PLACES = {"brain": [[1 / 200, 0, 0, 0.5], [0, 1 / 200, 0, 0.59], [0, 0, 1 / 200, 0.46], [0, 0, 0, 1]]}
SCAN = "/usr/share/mricron/templates/ch2bet.nii.gz"
# Opaque from grey matter on; the scan's numbers go up to 133.
SCANNED = [[0, 0, 0, 0, 0], [40, 0.9, 0.5, 0.4, 0], [60, 0.9, 0.6, 0.5, 0.6], [93, 0.9, 0.8, 0.7, 1.2], [133, 1, 1, 1, 1.5]]


def turned(angle, radius, height):
    """A point on a circle around the volume, whose centre is (0.5, 0.5, 0.5)."""
    return [0.5 + radius * math.sin(angle), 0.5 - radius * math.cos(angle), height]


def function(peak):
    """A transfer function: a shell of a color around the density `peak`, and a body."""
    points = [[0, 0, 0, 0, 0], [peak - 0.1, 0, 0, 0, 0], [peak, 0.05, 0.01, 0, 1], [peak + 0.15, 0, 0, 0, 0.1], [1, 0, 0, 0, 0.4]]
    points[1][0] = max(points[1][0], 0.005)
    return piecewise(points)


def piecewise(points):
    """A transfer function from points: density, color and extinction."""
    return {"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise", "points": points}}


def frame_of(scenario, medium, t):
    """Medium, lights and the camera's angle of a frame; t goes by 1 a frame."""
    lights, angle = [SUN, SKY], 0.5
    if scenario in ("camera", "thin"):
        angle += 0.02 * t
    if scenario == "thin":
        medium = {**medium, "density_scale": 0.1 * medium["density_scale"]}
    if scenario == "point-light":
        lights = [{"type": "PointLight", "position": turned(0.4 + 0.04 * t, 0.9, 1.0), "intensity": [3, 2.6, 2]}, DUSK]
    if scenario == "area-light":
        x = -0.9 + 0.05 * t
        lights = [{"type": "RectLight", "corner": [x, 0, 1.5], "edges": [[0, 1, 0], [0.8, 0, 0]], "radiance": [5, 4.5, 4]}, DUSK]
    if scenario == "light-color":
        wave = [0.5 + 0.5 * math.sin(0.1 * t + phase) for phase in (0.5, 2.6, 4.7)]
        lights = [{**SUN, "irradiance": [0.6 + 3 * v for v in wave]}, SKY]
    if scenario == "transfer":
        medium = {**medium, "transfer": f"edit.{t:04}.tf.json"}
    return medium, lights, angle


SCENARIOS = ["camera", "point-light", "area-light", "transfer", "thin", "static", "light-color"]
SEQUENCES = [f"{volume}-{scenario}" for scenario in SCENARIOS for volume in ("plume", "cloud")]


def camera(angle, size):
    """A frame of transforms.json."""
    eye, target = np.array(turned(angle, 2.2, 0.9)), np.full(3, 0.5)
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    place = np.eye(4)
    place[:3, 0], place[:3, 1], place[:3, 2], place[:3, 3] = right, np.cross(back, right), back, eye
    return {"transform_matrix": place.tolist(), "w": size[0], "h": size[1], "fl_x": 1.9 * size[1], "fl_y": 1.9 * size[1]}


def write(path, value):
    """Writes JSON, but leaves a file of the same content, and its time, as it is."""
    text = json.dumps(value)
    if not path.exists() or path.read_text() != text:
        path.write_text(text)


def write_scenes(folder, volume, scenario, frames, size):
    """Scene files of all frames and their cameras, in `folder`."""
    cameras = []
    for t in range(1, frames + 1):
        medium, lights, angle = frame_of(scenario, VOLUMES[volume][1], t)
        if scenario == "transfer":
            write(folder / medium["transfer"], function(0.12 + 0.012 * t))
        placed = {"transform": PLACES[volume]} if volume in PLACES else {}
        scene = {"volumes": [{"file": f"../{volume}.vdb", "medium": medium, **placed}], "lights": lights}
        write(folder / f"scene.{t:04}.json", scene)
        cameras.append({"file_path": f"frame.{t:04}.exr", **camera(angle, size)})
    write(folder / "cameras.json", {"model": "scattering", "frames": cameras})


def render(folder, out, samples, seed, cameras, *options):
    """Renders frames that are not there."""
    command = [os.environ.get("CUMULO", "cumulo"), "render", folder / "scene.####.json", "--cameras", cameras, "--resume"]
    command += ["--samples", samples, "--seed", seed, "--background", "0,0,0", "--quiet", "-o", out, *options]
    subprocess.run(list(map(str, command)), check=True, stdout=subprocess.DEVNULL)


def write_volume(folder, volume):
    """The volume as VDB in the unit cube, if it is not there."""
    vdb = folder / f"{volume}.vdb"
    if vdb.exists():
        return
    if volume == "brain":
        command = [os.environ.get("CUMULO", "cumulo"), "convert", SCAN, vdb, "--quiet"]
        subprocess.run(list(map(str, command)), check=True, stdout=subprocess.DEVNULL)
        write(folder / "brain.tf.json", piecewise(SCANNED))
        return
    np.save(folder / "volume.npy", VOLUMES[volume][0](128))
    lattice = [[1 / 128, 0, 0, 1 / 256], [0, 1 / 128, 0, 1 / 256], [0, 0, 1 / 128, 1 / 256], [0, 0, 0, 1]]
    script = pathlib.Path(__file__).parent / "peers" / "write_vdb.py"
    words = ["/usr/bin/python3", script, folder / "volume.npy", vdb, json.dumps(lattice)]
    subprocess.run(list(map(str, words)), check=True)
    (folder / "volume.npy").unlink()


def main():
    """Renders what is not there."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("folder", type=pathlib.Path)
    p.add_argument("--frames", type=int, default=44)
    p.add_argument("--judged", default="27-32")
    p.add_argument("--samples", type=int, default=2)
    p.add_argument("--reference", type=int, default=1024)
    p.add_argument("--size", default="240x180")
    p.add_argument("--only", nargs="+")
    p.add_argument("--levels", type=int, nargs="+", default=[])
    p.add_argument("--layers", default=LAYERS, help="layers of the noisy frames")
    a = p.parse_args()
    size = [int(n) for n in a.size.split("x")]
    a.folder.mkdir(parents=True, exist_ok=True)
    for name in a.only or SEQUENCES:
        volume, _, scenario = name.partition("-")
        if volume not in VOLUMES or scenario not in SCENARIOS:
            p.error(f"{name} is no VOLUME-SCENARIO of {', '.join(VOLUMES)} and {', '.join(SCENARIOS)}")
        write_volume(a.folder, volume)
        folder = a.folder / name
        folder.mkdir(exist_ok=True)
        write_scenes(folder, volume, scenario, a.frames, size)
        cameras = folder / "cameras.json"
        render(folder, folder / "noisy", a.samples, 1, cameras, "--aov", a.layers)
        if a.reference:
            render(folder, folder / "reference", a.reference, 10_000, cameras, "--frames", a.judged)
        for level in a.levels:
            other = a.folder / f"{name}-{level}spp"
            other.mkdir(exist_ok=True)
            # One path has neither halves nor a variance.
            render(folder, other / "noisy", level, 1, cameras, "--aov", LAYERS if level > 1 else "motion,albedo")
            if not (other / "reference").exists():
                (other / "reference").symlink_to((folder / "reference").resolve())
        print(name, flush=True)


if __name__ == "__main__":
    main()
