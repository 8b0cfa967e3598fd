"""Volumes of labels against VTK's fixed-point ray caster with nearest-neighbour interpolation, and against samples in f64.

Every voxel has the color and the extinction of its label, and nothing lies between two of them. VTK samples at steps and
rounds each of them to 15 bits: its picture at the finer step is taken, and twice what that changes is allowed, as errors
by the step are about as large as the change. VTK ends rays whose transmittance is below EARLY.
"""

import json

import numpy as np
import pytest
from cumulo.capture import Capture
from cumulo.exr import read_exr
from test_shading import CELLS, EARLY, PIXELS, WIDTH, camera_of, raw
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction, vtkRenderer, vtkRenderWindow, vtkVolume, vtkVolumeProperty
from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper

SPACING = np.array([1.0, 0.8, 1.3])
STEPS = (0.25, 0.125)
# Label, red, green, blue and extinction: opaque ones, mists, and one without extinction. Labels 3 and 5 are not listed.
THIN = {1: (0.9, 0.1, 0.1, 0.03), 2: (0.1, 0.8, 0.2, 0.4), 4: (0.2, 0.3, 0.9, 0.1), 6: (0.9, 0.9, 0.2, 0.0)}
DENSE = {label: (*rgb, 40 * extinction) for label, (*rgb, extinction) in THIN.items()}


def nested():
    """Shells one in another, cut by a wall of another label."""
    x, y, z = np.meshgrid(*(np.arange(CELLS) - 23.5,) * 3, indexing="ij")
    away = np.sqrt(x**2 + (1.1 * y) ** 2 + (0.9 * z) ** 2)
    labels = np.select([away < 6, away < 11, away < 15, away < 20], [4, 3, 2, 1], 0)
    return np.where((labels > 0) & (np.abs(x - 3) < 2), 6 - labels, labels)


def scattered():
    """Boxes of random labels, a few voxels wide."""
    boxes = np.random.default_rng(7).integers(0, 7, (12, 16, 8))
    return np.repeat(np.repeat(np.repeat(boxes, 4, 0), 3, 1), 6, 2)[:CELLS, :CELLS, :CELLS]


VOLUMES = {"nested": nested, "scattered": scattered}


def by_cumulo(cumulo, folder, labels, classes):
    np.save(folder / "labels.npy", labels.astype(np.uint8))
    listed = [{"label": label, "rgbs": values} for label, values in classes.items()]
    function = {"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "labels", "classes": listed}}
    (folder / "function.tf.json").write_text(json.dumps(function))
    Capture([(camera_of(SPACING), folder / "view.exr")]).write(folder / "transforms.json")
    cumulo(
        "render", folder / "labels.npy", f"--spacing={','.join(map(str, SPACING))}", "--tf", folder / "function.tf.json",
        "--cameras", folder / "transforms.json", "--background", "0", "-o", folder / "given",
    )  # fmt: skip
    ((_, picture),) = Capture.read(folder / "given").frames
    return read_exr(picture)[..., :3].astype(np.float64)


def by_vtk(labels, classes, step):
    image, mapper = vtkImageData(), vtkFixedPointVolumeRayCastMapper()
    # VTK's voxels lie between their own place and the next one's, so that the last ones have no extent.
    labels = np.pad(labels, ((0, 1),) * 3)
    image.SetOrigin(-0.5 * SPACING)
    image.SetDimensions(labels.shape)
    image.SetSpacing(SPACING)
    image.GetPointData().SetScalars(numpy_to_vtk(labels.astype(np.uint16).ravel(order="F"), deep=True))
    mapper.SetInputData(image)
    mapper.SetAutoAdjustSampleDistances(False)
    mapper.SetSampleDistance(step)
    mapper.SetInteractiveSampleDistance(step)
    mapper.SetImageSampleDistance(1.0)
    color, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
    for label in range(8):
        *rgb, extinction = classes.get(label, (0.0, 0.0, 0.0, 0.0))
        color.AddRGBPoint(label, *rgb)
        opacity.AddPoint(label, -np.expm1(-extinction))
    looks = vtkVolumeProperty()
    looks.SetColor(color)
    looks.SetScalarOpacity(opacity)
    looks.SetScalarOpacityUnitDistance(1.0)
    looks.SetInterpolationTypeToNearest()
    volume, scene, shown = vtkVolume(), vtkRenderer(), vtkRenderWindow()
    volume.SetMapper(mapper)
    volume.SetProperty(looks)
    scene.AddVolume(volume)
    shown.SetOffScreenRendering(True)
    shown.SetSize(PIXELS, PIXELS)
    shown.AddRenderer(scene)
    camera = scene.GetActiveCamera()
    camera.ParallelProjectionOn()
    camera.SetParallelScale(0.5 * WIDTH)
    camera.SetPosition(camera_of(SPACING).camera_to_world[:3, 3])
    camera.SetFocalPoint(0.5 * (CELLS - 1) * SPACING)
    camera.SetViewUp(0, 0, 1)
    scene.ResetCameraClippingRange()
    shown.Render()
    return raw(mapper)


def by_samples(labels, classes, step=0.01):
    """Light along our rays from samples of the nearest voxel, [row, column, channel]."""
    table = np.zeros((8, 4))
    for label, values in classes.items():
        table[label] = values
    origin, direction = (v[0] for v in camera_of(SPACING).rays())
    light, depth = np.zeros((PIXELS, PIXELS, 3)), np.zeros((PIXELS, PIXELS))
    for distance in np.arange(60.0, 155.0, step) + 0.5 * step:
        voxel = np.round((origin + distance * direction) / SPACING).astype(int)
        inside = ((voxel >= 0) & (voxel < CELLS)).all(axis=-1)
        values = np.where(inside[..., None], table[labels[tuple(np.moveaxis(np.clip(voxel, 0, CELLS - 1), -1, 0))]], 0.0)
        own = step * values[..., 3]
        light += (np.exp(-depth) * -np.expm1(-own))[..., None] * values[..., :3]
        depth += own
    return light


@pytest.mark.parametrize("classes", [THIN, DENSE], ids=["thin", "dense"])
@pytest.mark.parametrize("name", VOLUMES)
def test_labels_are_those_of_the_nearest_voxels(cumulo, tmp_path, name, classes):
    labels = VOLUMES[name]()
    ours = by_cumulo(cumulo, tmp_path, labels, classes)
    # A sample stands for its step: at each of some forty faces half of one is taken for the other label's.
    apart = np.abs(ours - by_samples(labels, classes))
    print(f"samples: mean {apart.mean():.1e}, largest {apart.max():.3f}")
    assert ours.max() > 0.3 and apart.mean() < 1e-3 and np.quantile(apart, 0.99) < 0.02
    coarse, fine = (by_vtk(labels, classes, step) for step in STEPS)
    apart, steps = np.abs(ours - fine), np.abs(fine - coarse)
    allowed = 2 * steps.mean() + EARLY
    print(f"VTK: mean {apart.mean():.4f} of {allowed:.4f}")
    assert apart.mean() < allowed < 0.025


def test_labels_elsewhere_are_told(cumulo, tmp_path):
    """Of a volume that is shifted by a voxel the picture is another."""
    labels = nested()
    apart = np.abs(by_cumulo(cumulo, tmp_path, np.roll(labels, 1, axis=0), DENSE) - by_samples(labels, DENSE))
    assert np.quantile(apart, 0.99) > 0.1
