"""Mitsuba 3 (`prbvolpath`, LLVM) on the set around the unit cube: Adam on the grid, exact pictures as references.

    run_mitsuba.py DATA [--steps 100] [--threads 2] [--pictures point|box]

The start is a perturbed grid: a constant one makes the majorant tight, so no null collision happens and the
gradient of the absorption comes out wrong. Mitsuba samples all over a pixel, so `box` (the default) gives
it the pixel means it converges to; `point` gives it the capture's own pictures.
"""

import argparse
import json
import math
import time

import drjit as dr
import mitsuba as mi
import numpy as np
from field import emit, psnr

p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
p.add_argument("data")
p.add_argument("--pictures", choices=["point", "box"], default="box")
p.add_argument("--steps", type=int, default=100)
p.add_argument("--batch", type=int, default=4)
p.add_argument("--spp", type=int, default=16)
p.add_argument("--lr", type=float, default=0.02)
p.add_argument("--init", type=float, default=0.05)
p.add_argument("--budget", type=float, default=600, help="seconds after which no further step is begun")
p.add_argument("--threads", type=int, default=2)
a = p.parse_args()
mi.set_variant("llvm_ad_rgb")
dr.set_thread_count(a.threads)

truth = np.load(f"{a.data}/truth.npy")
capture = json.load(open(f"{a.data}/transforms.json"))
scale, width, views = capture["density_scale"], capture["w"], len(capture["frames"])
if a.pictures == "box":
    pictures = np.load(f"{a.data}/pixel_means.npy")
else:
    pictures = np.exp(-scale * np.load(f"{a.data}/integrals.npy"))
pictures = pictures.astype(np.float32)


def sensor(frame):
    # Mitsuba's cameras look down +Z with +X to the left.
    turned = np.array(frame["transform_matrix"]) @ np.diag([-1.0, 1.0, -1.0, 1.0])
    return mi.load_dict({
        "type": "perspective",
        "fov": math.degrees(2 * math.atan(width / 2 / capture["fl_x"])),
        "to_world": mi.ScalarTransform4f(turned),
        "film": {
            "type": "hdrfilm", "width": width, "height": capture["h"], "pixel_format": "luminance",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent"},
    })  # fmt: skip


def scene_of(volume):
    place = mi.ScalarTransform4f().translate([0.5, 0.5, 0.5]).scale(0.5)
    grid = {"type": "gridvolume", "grid": mi.VolumeGrid(volume[..., None]), "filter_type": "trilinear"}
    medium = {"type": "heterogeneous", "scale": scale, "albedo": 0.0, "sigma_t": grid}
    return mi.load_dict({
        "type": "scene",
        "light": {"type": "constant", "radiance": 1.0},
        "cube": {"type": "cube", "to_world": place, "bsdf": {"type": "null"}, "interior": medium},
    })  # fmt: skip


integrator = mi.load_dict({"type": "prbvolpath", "max_depth": 64, "rr_depth": 1000})
sensors = [sensor(f) for f in capture["frames"]]
# Mitsuba's own picture of the truth: the distance must be that of its noise, or a camera is wrong.
seen = np.array(mi.render(scene_of(truth), sensor=sensors[1], integrator=integrator, spp=256, seed=5))[..., 0]
own = psnr(seen, pictures[1])

references = [mi.TensorXf(r[..., None]) for r in pictures]
start_volume = (a.init * np.random.default_rng(0).uniform(0.5, 1.5, truth.shape)).astype(np.float32)
scene = scene_of(start_volume)
params = mi.traverse(scene)
key = next(k for k in params.keys() if k.endswith("sigma_t.data"))
adam = mi.ad.Adam(lr=a.lr)
adam[key] = params[key]
params.update(adam)


def step(number, order):
    for b in range(a.batch):
        i = int(order[(number * a.batch + b) % views])
        seed = 31 * number + b
        picture = mi.render(
            scene, params, sensor=sensors[i], integrator=integrator, spp=a.spp, spp_grad=a.spp,
            seed=seed, seed_grad=seed + 1000003,
        )  # fmt: skip
        dr.backward(dr.mean(dr.square(picture - references[i]), axis=None))
    adam.step()
    adam[key] = dr.clip(adam[key], 0.0, 1.0)
    params.update(adam)
    dr.eval(adam[key])
    dr.sync_thread()


rng, order = np.random.default_rng(0), np.arange(views)
seconds, history, begun = 0.0, [], time.perf_counter()
for number in range(a.steps):
    if (number * a.batch) % views < a.batch:
        rng.shuffle(order)
    start = time.perf_counter()
    step(number, order)
    seconds += time.perf_counter() - start
    if number % 10 == 9 or number == a.steps - 1:
        quality = round(psnr(np.array(params[key])[..., 0], truth), 2)
        history.append([number + 1, round(seconds, 1), quality])
    if time.perf_counter() - begun > a.budget:
        break
emit(
    bench="B6", peer="mitsuba", version=mi.__version__, pictures=a.pictures, views=views, batch=a.batch, spp=a.spp,
    lr=a.lr, threads=a.threads, steps=number + 1, seconds=round(seconds, 1),
    psnr_db=round(psnr(np.array(params[key])[..., 0], truth), 2), start_psnr_db=round(psnr(start_volume, truth), 2),
    picture_psnr_db=round(own, 2), history=history,
)  # fmt: skip
