"""Surfaces shaded by `--shade` against VTK's fixed-point ray caster, a light at the camera on either side.

With an opacity of 1 - exp(-extinction) per unit of length, and colours that both multiply by it, VTK's picture is ours.
Its raw picture of 15 bits counts, for the window's is stretched by a pixel and has 8. It takes one direction of view of
all pixels, hence parallel rays. What remains of the difference is

- that VTK shades at the voxels, by normals that it rounds to 65536 directions, and interpolates the shade, while Cumulo
  interpolates the gradient and shades by it. `modelled` integrates both in f64 along the same rays, with VTK's own code
  for directions; what they differ by is added to our picture, and must be small;
- VTK's steps of a quarter of a voxel, and its rounding to 15 bits at each of them. The first error at least halves with
  the step, the second at most doubles, so that the differences of its pictures at steps of 1/2 and 1/4, and of 1/4 and
  1/8, bound both. They are measured, and must be small;
- VTK's end of rays whose transmittance is below EARLY, which leaves out at most that share of the brightest radiance.

Our steps of a twentieth of a voxel err by less than 1e-4, by the model.
"""

import ctypes
import functools
import json

import numpy as np
import pytest
from cumulo.capture import Camera, Capture, look_at
from cumulo.exr import read_exr
from scipy import ndimage
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import (
    vtkColorTransferFunction,
    vtkLight,
    vtkRenderer,
    vtkRenderWindow,
    vtkVolume,
    vtkVolumeProperty,
)
from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper, vtkSphericalDirectionEncoder

import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  windows
import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401  what shows the caster's picture

CELLS, PIXELS, WIDTH = 48, 64, 60.0
TOP = 2**16 - 1
STEPS = (0.5, 0.25, 0.125)
OURS = 0.05
# VTK ends rays of a smaller transmittance.
EARLY = 255 / (2**15 - 1)


def blob(x, y, z):
    """One that is longer along some axes than along others."""
    return 0.95 * np.exp(-0.6 * (((x - 23.5) / 11) ** 2 + ((y - 22) / 9) ** 2 + ((z - 25) / 10) ** 2))


def sphere(x, y, z):
    """Its density falls within four voxels, and a little everywhere, so that there are normals."""
    away = np.sqrt((x - 23.5) ** 2 + (y - 23.0) ** 2 + (z - 24.0) ** 2)
    return 0.4 * (1 - np.tanh(0.5 * (away - 15))) + 0.15 * np.maximum(1 - away / 30, 0)


def ripples(x, y, z):
    """Two blobs that overlap, with waves across them."""
    first = np.exp(-(((x - 18) / 12) ** 2) - ((y - 22) / 11) ** 2 - ((z - 27) / 12) ** 2)
    second = np.exp(-(((x - 30) / 9) ** 2) - ((y - 27) / 12) ** 2 - ((z - 20) / 10) ** 2)
    return 0.65 * (first + 0.8 * second) * (1 + 0.1 * np.sin(0.5 * x) * np.sin(0.45 * y + 1) * np.sin(0.4 * z + 2))


VOLUMES = {"blob": (blob, (1.0, 1.0, 1.0)), "sphere": (sphere, (1.0, 0.8, 1.3)), "ripples": (ripples, (1.0, 1.0, 1.0))}
# Density, red, green, blue and extinction: a mist, and walls within it.
MIST = [[0.2, 0.9, 0.4, 0.2, 0.0], [0.45, 0.8, 0.6, 0.3, 0.1], [0.95, 0.3, 0.7, 0.9, 1.5]]
WALL = [[0.2, 0.2, 0.9, 0.5, 0.0], [0.4, 0.9, 0.7, 0.5, 1.0], [0.6, 0.9, 0.6, 0.5, 0.2], [1.0, 0.9, 0.2, 0.1, 0.8]]
FUNCTIONS = {"mist": MIST, "wall": WALL}
# Ambient, diffuse and specular share, exponent.
SHADES = {"ambient": (0.4, 0.0, 0.0, 1.0), "diffuse": (0.0, 0.9, 0.0, 1.0), "specular": (0.0, 0.0, 0.9, 12.0),
          "all": (0.15, 0.5, 0.3, 25.0)}  # fmt: skip


def values_of(name):
    """Densities [x, y, z] in 16 bits, and the edges of a voxel."""
    field, spacing = VOLUMES[name]
    values = field(*np.meshgrid(*(np.arange(CELLS),) * 3, indexing="ij"))
    return np.round(TOP * values).astype(np.uint16), np.array(spacing)


def camera_of(spacing):
    """Parallel rays towards the middle of the volume."""
    middle = 0.5 * (CELLS - 1) * spacing
    matrix, half = look_at(middle + (47.0, -81.0, 52.0), middle, (0, 0, 1)), 0.5 * PIXELS
    return Camera(matrix, PIXELS / WIDTH, PIXELS / WIDTH, half, half, PIXELS, PIXELS, orthographic=True)


def at(function, density):
    """Red, green, blue and extinction."""
    points = np.array(function)
    return [np.interp(density, points[:, 0], points[:, channel]) for channel in range(1, 5)]


def raw(mapper):
    """The picture of 15 bits of a ray caster, [row, column, channel]; it begins at the bottom."""
    image = mapper.GetRayCastImage()
    (wide, high), (width, height), (left, low) = (
        image.GetImageMemorySize(), image.GetImageInUseSize(), image.GetImageOrigin(),
    )  # fmt: skip
    # VTK gives the address of an array as text, _address_p_void.
    numbers = (ctypes.c_uint16 * (4 * wide * high)).from_address(int(image.GetImage().split("_")[1], 16))
    picture = np.zeros((PIXELS, PIXELS, 4))
    picture[low : low + height, left : left + width] = np.array(numbers).reshape(high, wide, 4)[:height, :width]
    return picture[::-1, :, :3] / (2**15 - 1)


def by_vtk(name, function, shade, step, sides=2):
    """VTK's picture at steps of so many world units, lit on one side of surfaces or on both."""
    values, spacing = values_of(name)
    image = vtkImageData()
    image.SetDimensions(values.shape)
    image.SetSpacing(spacing)
    image.GetPointData().SetScalars(numpy_to_vtk(values.ravel(order="F"), deep=True))
    mapper = vtkFixedPointVolumeRayCastMapper()
    mapper.SetInputData(image)
    mapper.SetAutoAdjustSampleDistances(False)
    mapper.SetSampleDistance(step)
    mapper.SetInteractiveSampleDistance(step)
    mapper.SetImageSampleDistance(1.0)
    # At borders between the parts of its threads VTK takes gradients by one side.
    mapper.SetNumberOfThreads(1)
    color, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
    for density in np.linspace(0, 1, 1021).tolist():
        *rgb, extinction = at(function, density)
        color.AddRGBPoint(TOP * density, *rgb)
        opacity.AddPoint(TOP * density, -np.expm1(-extinction))
    looks = vtkVolumeProperty()
    looks.SetColor(color)
    looks.SetScalarOpacity(opacity)
    looks.SetScalarOpacityUnitDistance(1.0)
    looks.SetInterpolationTypeToLinear()
    looks.ShadeOn()
    looks.SetAmbient(shade[0])
    looks.SetDiffuse(shade[1])
    looks.SetSpecular(shade[2])
    looks.SetSpecularPower(shade[3])
    volume, scene, light, shown = vtkVolume(), vtkRenderer(), vtkLight(), vtkRenderWindow()
    volume.SetMapper(mapper)
    volume.SetProperty(looks)
    scene.AddVolume(volume)
    scene.AutomaticLightCreationOff()
    scene.SetTwoSidedLighting(sides == 2)
    light.SetLightTypeToHeadlight()
    # By itself a light has no ambient part.
    light.SetAmbientColor(1.0, 1.0, 1.0)
    scene.AddLight(light)
    shown.SetOffScreenRendering(True)
    shown.SetSize(PIXELS, PIXELS)
    shown.AddRenderer(scene)
    matrix = camera_of(spacing).camera_to_world
    camera = scene.GetActiveCamera()
    camera.ParallelProjectionOn()
    camera.SetParallelScale(0.5 * WIDTH)
    camera.SetPosition(matrix[:3, 3])
    camera.SetFocalPoint(0.5 * (CELLS - 1) * spacing)
    camera.SetViewUp(0, 0, 1)
    scene.ResetCameraClippingRange()
    shown.Render()
    return raw(mapper)


def by_cumulo(cumulo, folder, name, function, shade=None):
    """Our picture, shaded or not, [row, column, channel]."""
    values, spacing = values_of(name)
    np.save(folder / "volume.npy", (values / TOP).astype(np.float32))
    points = {"kind": "piecewise", "points": function}
    path = folder / "function.tf.json"
    path.write_text(json.dumps({"format": "cumulo-transfer-function", "version": 1, "transfer": points}))
    Capture([(camera_of(spacing), folder / "view.exr")]).write(folder / "transforms.json")
    shading = [f"--shade={','.join(map(str, shade))}"] if shade else []
    cumulo(
        "render", folder / "volume.npy", f"--spacing={','.join(map(str, spacing))}", "--tf", path,
        "--cameras", folder / "transforms.json", "--quadrature", f"midpoint:{OURS}", "--background", "0", *shading,
        "--overwrite", "-o", folder / "given",
    )  # fmt: skip
    ((_, picture),) = Capture.read(folder / "given").frames
    return read_exr(picture)[..., :3].astype(np.float64)


@functools.cache
def gradients_of(name):
    """Gradients by world length [axis, x, y, z], and unit normals as VTK codes them."""
    values, spacing = values_of(name)
    gradient = np.stack(np.gradient(values / TOP, *spacing))
    encoder = vtkSphericalDirectionEncoder()
    normals = -gradient / np.maximum(np.linalg.norm(gradient, axis=0), 1e-30)
    codes = map(encoder.GetEncodedDirection, normals.reshape(3, -1).T.tolist())
    return gradient, np.array([encoder.GetDecodedGradient(code) for code in codes]).T.reshape(gradient.shape)


def modelled(name, function, shade, step):
    """What VTK's picture is to have more than ours."""
    values, spacing = values_of(name)
    gradient, coded = gradients_of(name)
    origin, direction = (v[0] for v in camera_of(spacing).rays())
    view = direction[0, 0]
    distances = np.arange(60.0, 155.0, step) + 0.5 * step
    places = np.moveaxis((origin[..., None, :] + distances[:, None] * view) / spacing, -1, 0)

    def sampled(voxels):
        return ndimage.map_coordinates(voxels, places, order=1)

    def factors(normal):
        cosine = np.abs(np.tensordot(view, normal, 1)) / np.maximum(np.linalg.norm(normal, axis=0), 1e-30)
        return np.stack([shade[0] + shade[1] * cosine, shade[2] * cosine ** shade[3]])

    *rgb, extinction = at(function, sampled(values / TOP))
    depth = step * extinction
    weight = np.exp(depth - np.cumsum(depth, axis=-1)) * -np.expm1(-depth)
    matt, shine = np.stack(list(map(sampled, factors(coded)))) - factors(np.stack(list(map(sampled, gradient))))
    return np.stack([(weight * (channel * matt + shine)).sum(axis=-1) for channel in rgb], axis=-1)


def judge(ours, name, function, shade, sides=2):
    """The largest difference from VTK's picture over what is allowed."""
    theirs = [by_vtk(name, function, shade, step, sides) for step in STEPS]
    more = modelled(name, function, shade, STEPS[1])
    steps = [np.abs(theirs[0] - theirs[1]).max(), np.abs(theirs[1] - theirs[2]).max()]
    brightest = (shade[0] + shade[1]) * max(max(point[1:4]) for point in function) + shade[2]
    found, allowed = np.abs(ours + more - theirs[1]).max(), sum(steps) + EARLY * brightest
    print(f"{found:.4f} of {allowed:.4f}, by steps {steps[0]:.4f} and {steps[1]:.4f}; added {np.abs(more).max():.4f}")
    assert allowed < 0.021 and np.abs(more).max() < 0.08 and theirs[1].max() > 0.2
    return found / allowed


@pytest.mark.parametrize("shade", SHADES)
@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("name", VOLUMES)
def test_shaded_surfaces_are_those_of_vtk(cumulo, tmp_path, name, function, shade):
    function, shade = FUNCTIONS[function], SHADES[shade]
    assert judge(by_cumulo(cumulo, tmp_path, name, function, shade), name, function, shade) < 1.0


@pytest.mark.parametrize("name", VOLUMES)
def test_ambient_light_dims_all_alike(cumulo, tmp_path, name):
    """But for another integrator's rounding in f32 of some hundred steps."""
    plain = by_cumulo(cumulo, tmp_path, name, MIST)
    ambient = by_cumulo(cumulo, tmp_path, name, MIST, (0.4, 0.0, 0.0, 1.0))
    assert np.abs(ambient - 0.4 * plain).max() < 2e-5


OTHERS = {"diffuse": (0.15, 0.45, 0.3, 25.0), "specular": (0.15, 0.5, 0.25, 25.0), "exponent": (0.15, 0.5, 0.3, 18.0),
          "ambient": (0.12, 0.5, 0.3, 25.0)}  # fmt: skip


@pytest.mark.parametrize("changed", OTHERS)
def test_other_numbers_are_told(cumulo, tmp_path, changed):
    assert judge(by_cumulo(cumulo, tmp_path, "blob", MIST, OTHERS[changed]), "blob", MIST, SHADES["all"]) > 1.5


def test_normals_to_one_side_are_told(cumulo, tmp_path):
    """Far sides of a mist are lit too: VTK's picture with surfaces lit on one side is another."""
    shade = SHADES["diffuse"]
    assert judge(by_cumulo(cumulo, tmp_path, "blob", MIST, shade), "blob", MIST, shade, sides=1) > 1.5
