"""B8: path tracing beside Mitsuba 3 (`volpath`, LLVM) or Blender's Cycles, in turn: time to equal variance.

    run_paths.py SMOKE.npy SMOKE.vdb [--peer mitsuba] [--only white sun cloud panel] [--samples 64 ...] [--rounds 3] [--threads 2]

SMOKE is the plume of 128³ voxels in the unit cube, as `make bench` makes it (target/bench/smoke128.*). Each side renders
256² pixels with box filter and as many paths by different seeds, in a shuffled order; the deviation is the root of the
mean over pixels of the variance over the seeds. Seconds are processor time of all threads, medians, of what a picture
takes longer than one of a single path: start, reading of the volume, compilation of kernels and writing are left
out. CUMULO is the program, `cumulo` by default. For Cycles run it in Blender's environment with python/ on the path.
"""

import argparse
import json
import os
import pathlib
import random
import resource
import statistics
import subprocess
import tempfile
import time

import numpy as np

SIZE, ANGLE = 256, 30.0
EYE, TARGET = [0.5, -2.2, 0.9], [0.5, 0.5, 0.5]
SUN = [0.4, -0.5, 0.8]
# A square of this edge above the smoke, that shines down.
PANEL, HEIGHT = 0.8, 1.6
# Shares of the extinction by density, linear in between.
FUNCTION = [[0.0, 0.0], [0.15, 0.0], [0.3, 1.0], [0.45, 0.1], [1.0, 0.6]]
# Extinction at density 1, albedo, anisotropy, sky, sun, radiance of the panel, transfer function.
SCENES = {
    "white": {"scale": 20.0, "albedo": 0.9, "g": 0.0, "sky": 1.0, "sun": 0.0, "panel": 0.0, "function": False},
    "sun": {"scale": 4.0, "albedo": 0.9, "g": 0.0, "sky": 0.0, "sun": 3.0, "panel": 0.0, "function": False},
    "cloud": {"scale": 100.0, "albedo": 0.99, "g": 0.85, "sky": 0.2, "sun": 3.0, "panel": 0.0, "function": False},
    "panel": {"scale": 30.0, "albedo": 0.9, "g": 0.0, "sky": 0.0, "sun": 0.0, "panel": 5.0, "function": True},
}


def camera_matrix():
    """Camera to world, looking along -Z."""
    eye, target = np.array(EYE), np.array(TARGET)
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    place = np.eye(4)
    place[:3, 0], place[:3, 1], place[:3, 2], place[:3, 3] = right, np.cross(back, right), back, eye
    return place


def doubled(volume):
    """The volume at half of the voxel size, interpolated: a function of voxels comes near to that of the densities between."""
    for axis in range(3):
        n = volume.shape[axis]
        at = (np.arange(2 * n) + 0.5) / 2 - 0.5
        low = np.clip(np.floor(at).astype(int), 0, n - 1)
        share = np.clip(at - low, 0, 1).reshape([-1 if a == axis else 1 for a in range(3)])
        volume = np.take(volume, low, axis) * (1 - share) + np.take(volume, np.minimum(low + 1, n - 1), axis) * share
    return volume.astype(np.float32)


class Mitsuba:
    """Mitsuba 3."""

    def __init__(self, a):
        import drjit
        import mitsuba

        mitsuba.set_variant("llvm_ad_rgb")
        drjit.set_thread_count(a.threads)
        self.mi, self.volume = mitsuba, np.load(a.npy)

    def picture_of(self, path):
        """An EXR's colors."""
        return np.array(self.mi.Bitmap(str(path)))

    def renderer(self, scene):
        """A function from seed and number of paths to picture and seconds."""
        mi, volume = self.mi, self.volume
        if scene["function"]:
            volume = np.interp(doubled(volume), *np.transpose(FUNCTION)).astype(np.float32)
        place = mi.ScalarTransform4f().translate([0.5] * 3).scale(0.5)
        grid = {"type": "gridvolume", "grid": mi.VolumeGrid(volume[..., None]), "filter_type": "trilinear"}
        medium = {"type": "heterogeneous", "scale": scene["scale"], "albedo": scene["albedo"], "sigma_t": grid,
                  "phase": {"type": "hg", "g": scene["g"]} if scene["g"] else {"type": "isotropic"}}  # fmt: skip
        parts = {
            "type": "scene",
            "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": 5},
            "sensor": {
                "type": "perspective", "fov": ANGLE,
                "to_world": mi.ScalarTransform4f().look_at(EYE, TARGET, [0, 0, 1]),
                "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
                "sampler": {"type": "independent"},
            },
            "cube": {"type": "cube", "to_world": place, "bsdf": {"type": "null"}, "interior": medium},
        }  # fmt: skip
        if scene["sky"]:
            parts["sky"] = {"type": "constant", "radiance": scene["sky"]}
        if scene["sun"]:
            parts["sun"] = {"type": "directional", "direction": [-v for v in SUN], "irradiance": scene["sun"]}
        if scene["panel"]:
            lies = mi.ScalarTransform4f().translate([0.5, 0.5, HEIGHT]).rotate([1, 0, 0], 180).scale(PANEL / 2)
            emitter = {"type": "area", "radiance": scene["panel"]}
            parts["panel"] = {"type": "rectangle", "to_world": lies, "emitter": emitter}
        loaded = mi.load_dict(parts)

        def render(seed, samples):
            begin = time.process_time()
            picture = np.array(mi.render(loaded, seed=seed, spp=samples))
            return picture[..., :3].astype(np.float64), time.process_time() - begin

        return render


class Cycles:
    """Blender's Cycles, by null-collision tracking."""

    def __init__(self, a):
        from cumulo import blender, exr

        self.blender, self.exr, self.vdb, self.threads = blender, exr, a.vdb, a.threads

    def picture_of(self, path):
        """An EXR's colors."""
        return self.exr.read_exr(path)

    def renderer(self, scene):
        """A function from seed and number of paths to picture and seconds."""
        from cumulo.capture import Camera

        lights = [self.blender.Sun(tuple(SUN), (scene["sun"],) * 3)] if scene["sun"] else []
        if scene["panel"]:
            lights.append(self.blender.Rectangle((0.5, 0.5, HEIGHT), (0, 0, -1), (PANEL, PANEL), (scene["panel"],) * 3))
        settings = self.blender.Settings(
            model="scattering", density_scale=scene["scale"], emission=(0, 0, 0), background=(0, 0, 0), unbiased=True,
            albedo=(scene["albedo"],) * 3, anisotropy=scene["g"], sky=(scene["sky"],) * 3, lights=tuple(lights),
            samples=1, threads=self.threads, function=tuple(map(tuple, FUNCTION)) if scene["function"] else (),
        )  # fmt: skip
        stage = self.blender.Stage(settings, self.vdb)
        focal = SIZE / 2 / np.tan(np.radians(ANGLE / 2))
        camera = Camera(camera_matrix(), focal, focal, SIZE / 2, SIZE / 2, SIZE, SIZE)

        def render(seed, samples):
            stage.scene.cycles.samples = samples
            begin = time.process_time()
            film = stage.film(camera, seed).astype(np.float64)
            seconds = time.process_time() - begin
            # The film is before black; the sky is seen behind.
            return film[..., :3] + (1 - film[..., 3:]) * scene["sky"], seconds

        return render


def write_cameras(path, matrices):
    """Writes a capture of cameras without pictures."""
    frames = [{"file_path": f"view_{i:03}.exr", "transform_matrix": matrix.tolist()} for i, matrix in enumerate(matrices)]
    camera = {"w": SIZE, "h": SIZE, "fl_x": SIZE / 2 / np.tan(np.radians(ANGLE / 2)), "frames": frames}
    path.write_text(json.dumps(camera))


def write_scene(scene, vdb, folder):
    """Writes a scene as Cumulo reads it, and returns the path."""
    medium = {"density_scale": scene["scale"], "albedo": [scene["albedo"]] * 3, "anisotropy": scene["g"]}
    if scene["function"]:
        transfer = {"kind": "piecewise", "points": [[x, 0, 0, 0, share] for x, share in FUNCTION]}
        document = {"format": "cumulo-transfer-function", "version": 1, "transfer": transfer}
        (folder / "function.json").write_text(json.dumps(document))
        medium["transfer"] = "function.json"
    lights = [{"type": "DomeLight", "radiance": [scene["sky"]] * 3}]
    if scene["sun"]:
        lights.append({"type": "DistantLight", "direction": SUN, "irradiance": [scene["sun"]] * 3, "angle": 0})
    if scene["panel"]:
        low = 0.5 - PANEL / 2
        lights.append({"type": "RectLight", "corner": [low, low, HEIGHT], "edges": [[0, PANEL, 0], [PANEL, 0, 0]],
                       "radiance": [scene["panel"]] * 3})  # fmt: skip
    path = folder / "scene.json"
    path.write_text(json.dumps({"volumes": [{"file": str(vdb.resolve()), "medium": medium}], "lights": lights}))
    return path


def run(*words):
    """Runs Cumulo; returns its report, and its seconds of processor time."""
    command = [os.environ.get("CUMULO", "cumulo"), *words, "--overwrite", "--quiet", "--json"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([str(word) for word in command], check=True, stdout=subprocess.PIPE, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return json.loads(done.stdout), after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def ours(scene, a, picture_of, folder):
    """A function from seed and number of paths to picture and seconds, of Cumulo."""
    path = write_scene(scene, a.vdb, folder)
    write_cameras(folder / "camera.json", [camera_matrix()])

    def render(seed, samples):
        words = ["--cameras", folder / "camera.json", "--samples", samples, "--seed", seed, "--threads", a.threads]
        seconds = run("render", path, *words, "-o", folder / "views")[1]
        return picture_of(folder / "views" / "view_000.exr")[..., :3].astype(np.float64), seconds

    return render


PEERS = {"mitsuba": Mitsuba, "cycles": Cycles}


def measured(sides, samples, rounds):
    """Seconds, deviation, mean and root mean square of the pictures of each side, by number of paths."""
    counts, order = [1, *samples], random.Random(1)
    runs = {(side, count): [] for side in sides for count in counts}
    for side, count in runs:
        sides[side](0, count)
    for seed in range(1, rounds + 1):
        for side, count in order.sample(list(runs), len(runs)):
            runs[side, count].append(sides[side](seed, count))
    for count in samples:
        line = {}
        for side in sides:
            start = statistics.median(seconds for _, seconds in runs[side, 1])
            beyond = [round((seconds - start) * count / (count - 1), 4) for _, seconds in runs[side, count]]
            pictures = np.stack([picture for picture, _ in runs[side, count]])
            line[side] = {"seconds": statistics.median(beyond),
                          "runs": beyond,
                          "deviation": round(float(np.sqrt(pictures.var(axis=0, ddof=1).mean())), 6),
                          "mean": round(float(pictures.mean()), 5),
                          "rms": round(float(np.sqrt((pictures.mean(axis=0) ** 2).mean())), 5)}  # fmt: skip
        yield count, line


def main():
    """Runs both in turn and prints a line for each scene and number of paths."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("npy", type=pathlib.Path)
    p.add_argument("vdb", type=pathlib.Path)
    p.add_argument("--peer", choices=PEERS, default="mitsuba")
    p.add_argument("--only", nargs="+", choices=SCENES, default=list(SCENES))
    p.add_argument("--samples", type=int, nargs="+", default=[64])
    p.add_argument("--rounds", type=int, default=3)
    p.add_argument("--threads", type=int, default=2)
    a = p.parse_args()
    if min(a.samples) < 2:
        p.error("a single path is what times are beyond: --samples are 2 or more")
    peer = PEERS[a.peer](a)
    with tempfile.TemporaryDirectory() as folder:
        for name in a.only:
            sides = {"cumulo": ours(SCENES[name], a, peer.picture_of, pathlib.Path(folder)), a.peer: peer.renderer(SCENES[name])}
            for count, line in measured(sides, a.samples, a.rounds):
                cost = {side: line[side]["seconds"] * line[side]["deviation"] ** 2 for side in sides}
                line["time_to_equal_variance"] = round(cost[a.peer] / cost["cumulo"], 2)
                print(json.dumps({"bench": "B8", "scene": name, "samples": count, **line}), flush=True)


if __name__ == "__main__":
    main()
