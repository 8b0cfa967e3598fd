"""B8: path tracing beside Mitsuba 3 (`volpath`, LLVM), in turn: time to equal variance.

    run_paths.py SMOKE.npy SMOKE.vdb [--only white sun cloud] [--samples 64] [--rounds 3] [--threads 2]

SMOKE is the plume of 128³ voxels in the unit cube, as `make bench` makes it (target/bench/smoke128.*). Each side renders
256² pixels with box filter and as many paths by different seeds; the mean over pixels of half of the squared
difference is a picture's variance. Time is that of rendering: the reading of the volume and the compilation
of kernels are left out. CUMULO is the program, `cumulo` by default.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import tempfile
import time

import drjit as dr
import mitsuba as mi
import numpy as np

SIZE, ANGLE = 256, 30.0
EYE, TARGET = [0.5, -2.2, 0.9], [0.5, 0.5, 0.5]
SUN = [0.4, -0.5, 0.8]
# Extinction at density 1, albedo, anisotropy, sky, sun.
SCENES = {
    "white": {"scale": 20.0, "albedo": 0.9, "g": 0.0, "sky": 1.0, "sun": 0.0},
    "sun": {"scale": 4.0, "albedo": 0.9, "g": 0.0, "sky": 0.0, "sun": 3.0},
    "cloud": {"scale": 100.0, "albedo": 0.99, "g": 0.85, "sky": 0.2, "sun": 3.0},
}


def peer(scene, volume, samples):
    """A function from seed to picture and seconds, of Mitsuba."""
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
            "sampler": {"type": "independent", "sample_count": samples},
        },
        "cube": {"type": "cube", "to_world": place, "bsdf": {"type": "null"}, "interior": medium},
    }  # fmt: skip
    if scene["sky"]:
        parts["sky"] = {"type": "constant", "radiance": scene["sky"]}
    if scene["sun"]:
        parts["sun"] = {"type": "directional", "direction": [-v for v in SUN], "irradiance": scene["sun"]}
    loaded = mi.load_dict(parts)

    def render(seed):
        begin = time.perf_counter()
        picture = np.array(mi.render(loaded, seed=seed, spp=samples))
        return picture[..., :3], time.perf_counter() - begin

    return render


def ours(scene, volume, samples, threads, folder):
    """The same of Cumulo."""
    eye, target = np.array(EYE), np.array(TARGET)
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    place = np.eye(4)
    place[:3, 0], place[:3, 1], place[:3, 2], place[:3, 3] = right, np.cross(back, right), back, eye
    frame = {"file_path": "view.exr", "transform_matrix": place.tolist()}
    camera = {"w": SIZE, "h": SIZE, "fl_x": SIZE / 2 / np.tan(np.radians(ANGLE / 2)), "frames": [frame]}
    (folder / "camera.json").write_text(json.dumps(camera))
    words = ["--albedo", scene["albedo"], f"--anisotropy={scene['g']}", "--sky", scene["sky"]]
    if scene["sun"]:
        words += [f"--sun={','.join(map(str, SUN))}", "--sun-color", scene["sun"], "--sun-angle", 0]

    def render(seed):
        command = [os.environ.get("CUMULO", "cumulo"), "render", volume, "--cameras", folder / "camera.json", *words]
        command += ["--density-scale", scene["scale"], "--samples", samples, "--seed", seed, "--threads", threads]
        command += ["--overwrite", "--quiet", "--json", "-o", folder / f"view{seed}"]
        done = subprocess.run([str(word) for word in command], check=True, stdout=subprocess.PIPE, text=True)
        picture = np.array(mi.Bitmap(str(folder / f"view{seed}" / "view_000.exr")))
        return picture[..., :3].astype(np.float64), json.loads(done.stdout)["seconds"]

    return render


def main():
    """Runs both in turn and prints a line a scene."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("npy", type=pathlib.Path)
    p.add_argument("vdb", type=pathlib.Path)
    p.add_argument("--only", nargs="+", choices=SCENES, default=list(SCENES))
    p.add_argument("--samples", type=int, default=64)
    p.add_argument("--rounds", type=int, default=3)
    p.add_argument("--threads", type=int, default=2)
    a = p.parse_args()
    mi.set_variant("llvm_ad_rgb")
    dr.set_thread_count(a.threads)
    volume = np.load(a.npy)
    with tempfile.TemporaryDirectory() as folder:
        for name in a.only:
            sides = {"cumulo": ours(SCENES[name], a.vdb, a.samples, a.threads, pathlib.Path(folder)),
                     "mitsuba": peer(SCENES[name], volume, a.samples)}  # fmt: skip
            sides["mitsuba"](0)
            runs = {side: [] for side in sides}
            for seed in range(1, a.rounds + 1):
                for side, render in sides.items():
                    runs[side].append(render(seed))
            line = {"bench": "B8", "scene": name, "samples": a.samples}
            for side, of in runs.items():
                pictures = [picture for picture, _ in of]
                variance = statistics.mean(np.mean((b - a) ** 2) / 2 for a, b in zip(pictures, pictures[1:]))
                line[side] = {"seconds": round(statistics.median(s for _, s in of), 3),
                              "deviation": round(float(np.sqrt(variance)), 5),
                              "mean": round(float(np.mean(pictures)), 5)}  # fmt: skip
            cost = {side: line[side]["seconds"] * line[side]["deviation"] ** 2 for side in sides}
            line["time_to_equal_variance"] = round(cost["mitsuba"] / cost["cumulo"], 2)
            print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
