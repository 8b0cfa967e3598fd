"""VTK's fixed-point ray caster on a volume, through a transfer function, at several settings (B1).

    run_vtk.py volume.npy --function bump|ramp|thin|bone [--threads 2] [--light light_bump.f64] [--steps 4 2 1 0.5 0.25]

`volume.npy` is `[z, y, x]`, whole multiples of 1/255, as `volumes.py` writes it. Scalars have 8 and 16 bits, samples
lie 4, 2, 1, 0.5 and 0.25 voxels apart by default. Seconds are processor time, of all threads, of a picture of 512². With
`--light` the picture is compared with the light that `cargo bench --bench kernels -- --pictures` wrote: `[row shift, column shift,
row, column, rgb]` in f64 for some pixels, at shifts of half a pixel each way. The best of these counts, since VTK's
rays do not go through the middles of pixels.

Of 8-bit scalars VTK rounds interpolated values up, so that entry i serves (i - 1, i]: entries here hold the function at
i - 1/2, which is its best.
"""

import argparse
import math
import statistics
import time

import numpy as np
import vtk
from field import emit, psnr
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

PIXELS, STRIDE, FRAMES = 512, 8, 5
BITS, STEPS = (8, 16), (4.0, 2.0, 1.0, 0.5, 0.25)
BONE = [0, 0.15, 0.25, 0.45, 0.55, 1], [0, 0, 0.03, 0.03, 0.53, 0.53]
OPACITY = {
    "bump": lambda x: 0.25 * math.exp(-(((x - 0.25) / 0.08) ** 2)) + 0.5 * math.exp(-(((x - 0.7) / 0.1) ** 2)),
    "ramp": lambda x: 0.25 * x,
    "thin": lambda x: 0.0005 + 0.005 * x,
    "bone": lambda x: float(np.interp(x, *BONE)),
}
# Points of the function: several in each of the 255 pieces.
POINTS = 1021


def color_at(x):
    """Colors, which are linear between the function's knots."""
    knots = np.asarray(BONE[0] if a.function == "bone" else np.linspace(0, 1, 256))
    return [float(np.interp(x, knots, values)) for values in (knots, 0.5 + 0.5 * np.sin(6 * knots), 1 - knots)]


p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
p.add_argument("volume")
p.add_argument("--function", choices=sorted(OPACITY), default="bump")
p.add_argument("--threads", type=int, default=2)
p.add_argument("--light")
p.add_argument("--steps", type=float, nargs="+", default=STEPS)
a = p.parse_args()

values = np.load(a.volume)
shape = values.shape[::-1]
light = None
if a.light:
    side = PIXELS // STRIDE
    light = np.fromfile(a.light).reshape(9, side, side, 3)


def window(bits, step):
    """A window that shows the volume, and its renderer."""
    top = 2**bits - 1
    image = vtk.vtkImageData()
    image.SetDimensions(*shape)
    scalars = np.round(top * values.astype(np.float64)).astype(np.uint8 if bits == 8 else np.uint16)
    image.GetPointData().SetScalars(numpy_to_vtk(scalars.ravel(), deep=True))
    mapper = vtk.vtkFixedPointVolumeRayCastMapper()
    mapper.SetInputData(image)
    mapper.SetAutoAdjustSampleDistances(False)
    mapper.SetSampleDistance(step)
    mapper.SetInteractiveSampleDistance(step)
    mapper.SetImageSampleDistance(1.0)
    mapper.SetNumberOfThreads(a.threads)
    color, opacity = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
    shift = 0.5 if bits == 8 else 0.0
    for x in np.linspace(0, 1, POINTS).tolist():
        color.AddRGBPoint(top * x + shift, *color_at(x))
        opacity.AddPoint(top * x + shift, OPACITY[a.function](x))
    looks = vtk.vtkVolumeProperty()
    looks.SetColor(color)
    looks.SetScalarOpacity(opacity)
    looks.SetScalarOpacityUnitDistance(1.0)
    looks.SetInterpolationTypeToLinear()
    looks.ShadeOff()
    volume, scene, shown = vtk.vtkVolume(), vtk.vtkRenderer(), vtk.vtkRenderWindow()
    volume.SetMapper(mapper)
    volume.SetProperty(looks)
    scene.AddVolume(volume)
    shown.SetOffScreenRendering(True)
    shown.SetMultiSamples(0)
    shown.SetSize(PIXELS, PIXELS)
    shown.AddRenderer(scene)
    return shown, scene


def frame(shown, scene, turn):
    """Seconds of processor time that the picture from this side takes."""
    camera, middle, edge = scene.GetActiveCamera(), [(n - 1) / 2 for n in shape], max(shape)
    camera.SetFocalPoint(*middle)
    x, y, z = middle
    camera.SetPosition(x + 2.4 * edge * math.cos(turn), y + 2.4 * edge * math.sin(turn), z + 0.6 * edge)
    camera.SetViewUp(0, 0, 1)
    camera.SetViewAngle(30)
    scene.ResetCameraClippingRange()
    start = time.process_time()
    shown.Render()
    shown.WaitForCompletion()
    return time.process_time() - start


settings = []
for bits in BITS:
    for step in a.steps:
        shown, scene = window(bits, step)
        frame(shown, scene, 0.3)
        # A turn that is hardly one: a picture of the same camera is not made again.
        seconds = statistics.median(frame(shown, scene, 0.3 + 1e-5 * (FRAMES - k)) for k in range(FRAMES + 1))
        quality = None
        if light is not None:
            shot = vtk.vtkWindowToImageFilter()
            shot.SetInput(shown)
            shot.Update()
            pixels = vtk_to_numpy(shot.GetOutput().GetPointData().GetScalars()).reshape(PIXELS, PIXELS, -1)
            seen = pixels[::-1, :, :3] / 255
            quality = round(max(psnr(seen[::STRIDE, ::STRIDE], shifted) for shifted in light), 2)
        settings.append({"setting": f"{bits} bits, step {step:g}", "seconds": round(seconds, 4), "psnr_db": quality})
emit(
    bench="B1", peer="vtk", version=vtk.vtkVersion.GetVTKVersion(), function=a.function, threads=a.threads,
    settings=settings,
)  # fmt: skip
