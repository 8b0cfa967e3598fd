"""A small volume whose corners are told apart, and where other programs see them in the world."""

import itertools

import nibabel
import nrrd
import numpy as np
import SimpleITK as sitk
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLImageDataReader

SIZE = (5, 4, 3)
LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
"""From left, posterior, superior, as ITK has it, to right, anterior, superior; and back."""


def rotation(x, y, z):
    """A rotation about the three axes in turn."""
    turns = []
    for axis, angle in enumerate((x, y, z)):
        turn, (a, b) = np.eye(3), [i for i in range(3) if i != axis]
        turn[a, a] = turn[b, b] = np.cos(angle)
        turn[a, b], turn[b, a] = -np.sin(angle), np.sin(angle)
        turns.append(turn)
    return turns[0] @ turns[1] @ turns[2]


def affine(directions=None):
    """Voxels that are no cubes, at an origin."""
    map = np.eye(4)
    map[:3, :3] = (np.eye(3) if directions is None else directions) @ np.diag([0.5, 0.75, 1.25])
    map[:3, 3] = 10.5, -20.25, 30.125
    return map


STRAIGHT = affine()
OBLIQUE = affine(rotation(0.3, -0.5, 0.7))
MIRRORED = affine(rotation(-0.2, 0.4, 1.1) @ np.diag([1.0, 1.0, -1.0]))

CORNERS = {
    1 + bits: tuple((size - 1) * (bits >> axis & 1) for axis, size in enumerate(SIZE)) for bits in range(8)
}
"""Index of each label."""


def array():
    """`array[x, y, z]`: labels at the corners, 9 in the middle, else 0."""
    values = np.zeros(SIZE, np.int16)
    for label, index in CORNERS.items():
        values[index] = label
    values[2, 2, 1] = 9
    return values


def expected(map):
    """Position of each label."""
    return {label: map[:3, :3] @ index + map[:3, 3] for label, index in CORNERS.items()}


def places(values, map):
    """Positions of the labels in `values[x, y, z]`."""
    found = {}
    for label in CORNERS:
        (index,) = np.argwhere(values == label)
        found[label] = map[:3, :3] @ index + map[:3, 3]
    return found


def agree(found, map, tolerance):
    wanted = expected(map)
    assert found.keys() == wanted.keys()
    apart = max(np.abs(found[label] - wanted[label]).max() for label in wanted)
    assert apart <= tolerance, apart


def by_nibabel(path):
    image = nibabel.load(path)
    return np.asarray(image.dataobj), image.affine


def by_itk(path):
    """Values and map to RAS, as SimpleITK reads them."""
    image = sitk.ReadImage(str(path))
    return sitk.GetArrayFromImage(image).transpose(2, 1, 0), LPS @ itk_affine(image)


def itk_affine(image):
    map = np.eye(4)
    map[:3, :3] = np.array(image.GetDirection()).reshape(3, 3) @ np.diag(image.GetSpacing())
    map[:3, 3] = image.GetOrigin()
    return map


def to_itk(values, map):
    """An image of SimpleITK with this map to RAS."""
    image = sitk.GetImageFromArray(np.ascontiguousarray(values.transpose(2, 1, 0)))
    lps = LPS @ map
    spacing = np.linalg.norm(lps[:3, :3], axis=0)
    image.SetSpacing(spacing.tolist())
    image.SetDirection((lps[:3, :3] / spacing).ravel().tolist())
    image.SetOrigin(lps[:3, 3].tolist())
    return image


def by_pynrrd(path):
    values, header = nrrd.read(str(path))
    map = np.eye(4)
    map[:3, :3], map[:3, 3] = np.array(header["space directions"]).T, header["space origin"]
    assert header["space"] == "left-posterior-superior"
    return values, LPS @ map


def by_vtk(path):
    reader = vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    image = reader.GetOutput()
    size = image.GetDimensions()
    values = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(size, order="F")
    directions = np.array([[image.GetDirectionMatrix().GetElement(r, c) for c in range(3)] for r in range(3)])
    map = np.eye(4)
    map[:3, :3], map[:3, 3] = directions @ np.diag(image.GetSpacing()), image.GetOrigin()
    return values, map


def by_cumulo(cumulo, vdb, folder):
    """Values and map of a VDB's only grid, by Cumulo's array and report."""
    report = cumulo("convert", vdb, folder / "seen.npy")
    return np.load(folder / "seen.npy"), np.array(report["grid"]["transform"])


READERS = {
    "nii": (by_nibabel, by_itk),
    "nii.gz": (by_nibabel, by_itk),
    "nrrd": (by_pynrrd, by_itk),
    "mha": (by_itk,),
    "mhd": (by_itk,),
    "vti": (by_vtk,),
}
"""Who reads which of Cumulo's files."""

# Coordinates below 64: sums of four products round by a few units in the last place.
DOUBLE = 64 * 8 * np.finfo(np.float64).eps
SINGLE = 64 * 8 * np.finfo(np.float32).eps


def passes(cumulo, source, map, folder, *options, tolerance):
    """A file lands where it belongs in the VDB, and in every file that is made of that."""
    vdb = folder / "x.vdb"
    report = cumulo("convert", source, vdb, *options)
    assert np.abs(np.array(report["grid"]["transform"]) - map).max() <= tolerance
    values, found = by_cumulo(cumulo, vdb, folder)
    agree(places(values, found), map, tolerance)
    assert (values == array()).all()
    for ending, readers in READERS.items():
        path = folder / f"out.{ending}"
        cumulo("convert", vdb, path)
        for reader in readers:
            values, found = reader(path)
            single = ending.startswith("nii")
            agree(places(values, found), map, max(tolerance, SINGLE if single else 2 * DOUBLE))
            assert (values == array()).all(), (ending, reader)
            assert np.issubdtype(values.dtype, np.integer) == (report["grid"]["value_type"] == "int32"), ending


MAPS = list(itertools.zip_longest(["straight", "oblique", "mirrored"], [STRAIGHT, OBLIQUE, MIRRORED]))
