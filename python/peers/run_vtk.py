"""VTK's fixed-point ray caster on the smoke plume, frame by frame around it (B1).

    run_vtk.py smoke.npy [--function bump|ramp|thin] [--threads 2] [--light light_bump.f64]

`smoke.npy` is `[z, y, x]`, 256 cubed, whole multiples of 1/255: VTK casts unsigned bytes fastest. Samples lie half
a voxel apart. With `--light` the first frame is compared with the light that `cargo bench --bench kernels --
--pictures` wrote: `[shift, row, column, rgb]` in f64 for one of four pixels along each edge, half a row higher, there,
and half a row lower. The best of the three counts: VTK's rays do not go through the middles of pixels.
"""

import argparse
import math
import statistics
import time

import numpy as np
import vtk
from field import emit, psnr
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

FRAMES, PIXELS, STRIDE = 8, 512, 4
OPACITY = {
    "bump": lambda x: 0.25 * math.exp(-(((x - 0.25) / 0.08) ** 2)) + 0.5 * math.exp(-(((x - 0.7) / 0.1) ** 2)),
    "ramp": lambda x: 0.25 * x,
    "thin": lambda x: 0.0005 + 0.005 * x,
}

p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
p.add_argument("volume")
p.add_argument("--function", choices=sorted(OPACITY), default="bump")
p.add_argument("--threads", type=int, default=2)
p.add_argument("--light")
a = p.parse_args()

values = np.load(a.volume)
n = len(values)
image = vtk.vtkImageData()
image.SetDimensions(n, n, n)
image.GetPointData().SetScalars(numpy_to_vtk(np.round(255 * values).astype(np.uint8).ravel(), deep=True))
mapper = vtk.vtkFixedPointVolumeRayCastMapper()
mapper.SetInputData(image)
mapper.SetAutoAdjustSampleDistances(False)
mapper.SetSampleDistance(0.5)
mapper.SetInteractiveSampleDistance(0.5)
mapper.SetImageSampleDistance(1.0)
mapper.SetNumberOfThreads(a.threads)
color, opacity = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
for i in range(256):
    x = i / 255
    color.AddRGBPoint(i, x, 0.5 + 0.5 * math.sin(6 * x), 1 - x)
    opacity.AddPoint(i, OPACITY[a.function](x))
looks = vtk.vtkVolumeProperty()
looks.SetColor(color)
looks.SetScalarOpacity(opacity)
looks.SetScalarOpacityUnitDistance(1.0)
looks.SetInterpolationTypeToLinear()
looks.ShadeOff()
volume, scene, window = vtk.vtkVolume(), vtk.vtkRenderer(), vtk.vtkRenderWindow()
volume.SetMapper(mapper)
volume.SetProperty(looks)
scene.AddVolume(volume)
window.SetOffScreenRendering(True)
window.SetMultiSamples(0)
window.SetSize(PIXELS, PIXELS)
window.AddRenderer(scene)


def frame(number):
    """Seconds that the picture of this number takes."""
    camera, turn, middle = scene.GetActiveCamera(), 2 * math.pi * number / FRAMES + 0.3, (n - 1) / 2
    camera.SetFocalPoint(middle, middle, middle)
    camera.SetPosition(middle + 2.4 * n * math.cos(turn), middle + 2.4 * n * math.sin(turn), middle + 0.6 * n)
    camera.SetViewUp(0, 0, 1)
    camera.SetViewAngle(30)
    scene.ResetCameraClippingRange()
    start = time.perf_counter()
    window.Render()
    window.WaitForCompletion()
    return time.perf_counter() - start


frame(0)
seconds = statistics.median(frame(number) for number in range(1, FRAMES + 1))
quality = None
if a.light:
    # The last frame was the first camera's.
    shot = vtk.vtkWindowToImageFilter()
    shot.SetInput(window)
    shot.Update()
    seen = vtk_to_numpy(shot.GetOutput().GetPointData().GetScalars()).reshape(PIXELS, PIXELS, -1)[::-1, :, :3] / 255
    side = PIXELS // STRIDE
    light = np.fromfile(a.light).reshape(3, side, side, 3)
    quality = max(psnr(seen[::STRIDE, ::STRIDE], shifted) for shifted in light)
emit(
    bench="B1", peer="vtk", version=vtk.vtkVersion.GetVTKVersion(), function=a.function, threads=a.threads,
    seconds=round(seconds, 4), psnr_db=quality and round(quality, 2),
)  # fmt: skip
