"""RTK (CPU) on the cone-beam set: conjugate gradient or SART from zero, on the exact line integrals.

    run_rtk.py DATA [--alg cg|sart] [--iters N] [--threads 2]
"""

import argparse
import json
import time

import itk
import numpy as np
from field import emit, psnr, sphere_directions
from itk import RTK as rtk

p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
p.add_argument("data")
p.add_argument("--alg", choices=["cg", "sart"], default="cg")
p.add_argument("--iters", type=int, help="30 for cg, 3 for sart unless given")
p.add_argument("--threads", type=int, default=2)
a = p.parse_args()
iters = a.iters or {"cg": 30, "sart": 3}[a.alg]
itk.MultiThreaderBase.SetGlobalDefaultNumberOfThreads(a.threads)

Image = itk.Image[itk.F, 3]
# RTK's detector rows run upwards.
integrals = np.load(f"{a.data}/integrals.npy")[:, ::-1]
truth = np.load(f"{a.data}/truth.npy")
capture = json.load(open(f"{a.data}/transforms.json"))
views, pixels = integrals.shape[:2]
n = truth.shape[0]
sid, sdd = 2.4 * n, 3.6 * n
pitch = sdd / capture["fl_x"]


def image(array, spacing, origin):
    i = itk.image_from_array(np.ascontiguousarray(array, np.float32))
    i.SetSpacing(spacing)
    i.SetOrigin(origin)
    return i


def volume_image(array):
    return image(array, [1.0] * 3, [-(n - 1) / 2] * 3)


def detector_image(array):
    return image(array, [pitch, pitch, 1.0], [-(pixels - 1) / 2 * pitch] * 2 + [0.0])


geometry = rtk.ThreeDCircularProjectionGeometry.New()
for d in sphere_directions(views):
    gantry, tilt = np.degrees(np.arctan2(d[0], d[1])), np.degrees(np.arcsin(d[2]))
    geometry.AddProjection(sid, sdd, float(gantry), 0.0, 0.0, float(tilt), 0.0)
for i, frame in enumerate(capture["frames"]):
    m = np.array(frame["transform_matrix"])
    turn = itk.array_from_matrix(geometry.GetRotationMatrix(i))[:3, :3]
    source = np.array(geometry.GetSourcePosition(i))[:3]
    assert abs(turn - m[:3, :3].T).max() < 1e-9 and abs(source - m[:3, 3]).max() < 1e-6, f"view {i} is elsewhere"

# How far RTK's own projector is from the exact integrals: a flipped axis would show here.
joseph = rtk.JosephForwardProjectionImageFilter[Image, Image].New()
joseph.SetGeometry(geometry)
joseph.SetInput(0, detector_image(np.zeros_like(integrals)))
joseph.SetInput(1, volume_image(truth))
joseph.Update()
own = psnr(itk.array_from_image(joseph.GetOutput()), integrals, integrals.max())

if a.alg == "cg":
    f = rtk.ConjugateGradientConeBeamReconstructionFilter[Image].New()
    f.SetInput(2, detector_image(np.ones_like(integrals)))
else:
    f = rtk.SARTConeBeamReconstructionFilter[Image, Image].New()
    f.SetEnforcePositivity(True)
    f.SetLambda(0.3)
f.SetInput(0, volume_image(np.zeros_like(truth)))
f.SetInput(1, detector_image(integrals))
f.SetNumberOfIterations(iters)
f.SetGeometry(geometry)
start = time.perf_counter()
f.Update()
seconds = time.perf_counter() - start
result = itk.array_from_image(f.GetOutput())
emit(
    bench="B4", peer="rtk", version=itk.Version.GetITKVersion(), alg=a.alg, iters=iters, views=views, threads=a.threads,
    seconds=round(seconds, 2), psnr_db=round(psnr(result, truth), 2),
    psnr_clipped_db=round(psnr(np.clip(result, 0, 1), truth), 2), projector_psnr_db=round(own, 2),
)  # fmt: skip
