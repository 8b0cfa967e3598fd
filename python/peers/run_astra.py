"""ASTRA (CPU) on the parallel-beam set: SIRT or filtered back-projection slice by slice, two processes.

    run_astra.py DATA [--alg SIRT|FBP] [--iters 150] [--procs 2]
"""

import argparse
import multiprocessing
import time

import astra
import numpy as np
from field import emit, psnr

p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
p.add_argument("data")
p.add_argument("--alg", choices=["SIRT", "FBP"], default="SIRT")
p.add_argument("--iters", type=int, default=150)
p.add_argument("--projector", default="linear")
p.add_argument("--procs", type=int, default=2)
a = p.parse_args()

truth = np.load(f"{a.data}/truth.npy")
# [slice, angle, detector], slices upwards.
sinograms = np.ascontiguousarray(np.load(f"{a.data}/integrals.npy")[:, ::-1].swapaxes(0, 1), np.float32)
n, (angles, detector) = len(truth), sinograms.shape[1:]
volume = astra.create_vol_geom(n, n)
beam = astra.create_proj_geom("parallel", 1.0, detector, np.linspace(0, np.pi, angles, endpoint=False))


def projected(image):
    """ASTRA's own sinogram of a slice, to see that the data mean what ASTRA takes them to mean."""
    projector = astra.create_projector(a.projector, beam, volume)
    handle, sinogram = astra.create_sino(np.ascontiguousarray(image), projector)
    astra.data2d.delete(handle)
    astra.projector.delete(projector)
    return sinogram


def reconstruct(sinogram):
    projector = astra.create_projector(a.projector, beam, volume)
    data, image = astra.data2d.create("-sino", beam, sinogram), astra.data2d.create("-vol", volume)
    config = astra.astra_dict(a.alg)
    config |= {"ReconstructionDataId": image, "ProjectionDataId": data, "ProjectorId": projector}
    if a.alg == "SIRT":
        config["option"] = {"MinConstraint": 0.0}
    else:
        config["FilterType"] = "Ram-Lak"
    algorithm = astra.algorithm.create(config)
    astra.algorithm.run(algorithm, a.iters)
    result = astra.data2d.get(image).copy()
    astra.algorithm.delete(algorithm)
    astra.data2d.delete([image, data])
    astra.projector.delete(projector)
    return result


own = psnr(np.array([projected(s) for s in truth]), sinograms, sinograms.max())
with multiprocessing.Pool(a.procs) as pool:
    # A first call in each process loads what later calls find loaded.
    pool.map(reconstruct, sinograms[: a.procs], chunksize=1)
    start = time.perf_counter()
    result = np.array(pool.map(reconstruct, sinograms, chunksize=4))
    seconds = time.perf_counter() - start
emit(
    bench="B5", peer="astra", version=astra.__version__, alg=a.alg, iters=a.iters if a.alg == "SIRT" else 1,
    angles=angles, procs=a.procs, seconds=round(seconds, 2), psnr_db=round(psnr(result, truth), 2),
    psnr_clipped_db=round(psnr(np.clip(result, 0, 1), truth), 2), projector_psnr_db=round(own, 2),
)  # fmt: skip
