"""Images that other programs write land where these programs see them, and so does what Cumulo makes of them."""

import cubes
import nibabel
import nrrd
import numpy as np
import pytest
import SimpleITK as sitk
import tifffile
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkStructuredPoints
from vtkmodules.vtkIOLegacy import vtkStructuredPointsWriter
from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

maps = pytest.mark.parametrize("map", [map for _, map in cubes.MAPS], ids=[name for name, _ in cubes.MAPS])


@maps
@pytest.mark.parametrize("ending", ["nii", "nii.gz", "img"])
@pytest.mark.parametrize("kind", [np.int16, np.uint8, np.float32, ">i4"])
def test_nibabel(cumulo, tmp_path, map, ending, kind):
    image = {"img": nibabel.Nifti1Pair}.get(ending, nibabel.Nifti1Image)(cubes.array().astype(kind), map)
    path = tmp_path / f"in.{ending}"
    nibabel.save(image, path)
    cubes.passes(cumulo, path, map, tmp_path, tolerance=cubes.SINGLE)


@maps
def test_nifti_2_and_the_qform(cumulo, tmp_path, map):
    nibabel.save(nibabel.Nifti2Image(cubes.array(), map), tmp_path / "two.nii")
    cubes.passes(cumulo, tmp_path / "two.nii", map, tmp_path, tolerance=cubes.DOUBLE)
    image = nibabel.Nifti1Image(cubes.array(), None)
    image.set_qform(map, code=1)
    image.set_sform(None, code=0)
    nibabel.save(image, tmp_path / "q.nii")
    cubes.passes(cumulo, tmp_path / "q.nii", map, tmp_path, tolerance=cubes.SINGLE)


def test_scaled_values(cumulo, tmp_path):
    """Slope and intercept are applied, as nibabel applies them."""
    values = np.linspace(-1000, 2000, 60).reshape(cubes.SIZE)
    image = nibabel.Nifti1Image(values, cubes.STRAIGHT)
    image.set_data_dtype(np.int16)
    nibabel.save(image, tmp_path / "s.nii")
    cumulo("convert", tmp_path / "s.nii", tmp_path / "s.vdb", "--as", "double")
    wanted = nibabel.load(tmp_path / "s.nii").get_fdata()
    cumulo("convert", tmp_path / "s.vdb", tmp_path / "s.npy")
    # A product and a sum of doubles, in the same order; the slope is single precision in both.
    assert np.abs(np.load(tmp_path / "s.npy") - wanted).max() <= 4 * 2000 * np.finfo(np.float64).eps


@maps
@pytest.mark.parametrize("ending", ["nii", "nii.gz", "nrrd", "nhdr", "mha", "mhd"])
@pytest.mark.parametrize("packed", [False, True])
def test_itk(cumulo, tmp_path, map, ending, packed):
    path = tmp_path / f"in.{ending}"
    sitk.WriteImage(cubes.to_itk(cubes.array(), map), str(path), useCompression=packed)
    tolerance = cubes.SINGLE if ending.startswith("nii") else 8 * cubes.DOUBLE
    cubes.passes(cumulo, path, map, tmp_path, tolerance=tolerance)


@maps
@pytest.mark.parametrize("encoding", ["raw", "gzip", "ascii"])
@pytest.mark.parametrize("space", ["left-posterior-superior", "right-anterior-superior", "left-anterior-superior"])
@pytest.mark.parametrize("detached", [False, True])
def test_pynrrd(cumulo, tmp_path, map, encoding, space, detached):
    flip = np.diag([-1.0 if space.startswith("left") else 1.0, -1.0 if "posterior" in space else 1.0, 1.0, 1.0])
    stored = flip @ map
    header = {"space": space, "space directions": stored[:3, :3].T, "space origin": stored[:3, 3], "encoding": encoding}
    path = tmp_path / ("in.nhdr" if detached else "in.nrrd")
    nrrd.write(str(path), cubes.array(), header, detached_header=detached)
    cubes.passes(cumulo, path, map, tmp_path, tolerance=cubes.DOUBLE)


def vtk_image(map, cells=False):
    image = vtkImageData()
    size = np.array(cubes.SIZE)
    spacing = np.linalg.norm(map[:3, :3], axis=0)
    directions = map[:3, :3] / spacing
    image.SetDimensions(*(size + 1 if cells else size).tolist())
    image.SetSpacing(*spacing.tolist())
    image.SetDirectionMatrix(*directions.ravel().tolist())
    # A cell's centre lies half a voxel further in than its first point.
    image.SetOrigin(*(map[:3, 3] - (map[:3, :3] @ [0.5, 0.5, 0.5] if cells else 0)).tolist())
    values = numpy_to_vtk(cubes.array().ravel(order="F"), deep=True)
    values.SetName("labels")
    (image.GetCellData() if cells else image.GetPointData()).SetScalars(values)
    return image


@maps
@pytest.mark.parametrize("mode", ["ascii", "binary", "appended", "raw"])
@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("cells", [False, True])
def test_vti(cumulo, tmp_path, map, mode, packed, cells):
    writer = vtkXMLImageDataWriter()
    writer.SetFileName(str(tmp_path / "in.vti"))
    writer.SetInputData(vtk_image(map, cells))
    {"ascii": writer.SetDataModeToAscii, "binary": writer.SetDataModeToBinary}.get(mode, writer.SetDataModeToAppended)()
    writer.SetEncodeAppendedData(mode == "appended")
    if packed:
        writer.SetCompressorTypeToZLib()
    else:
        writer.SetCompressorTypeToNone()
    assert writer.Write() == 1
    cubes.passes(cumulo, tmp_path / "in.vti", map, tmp_path, tolerance=4 * cubes.DOUBLE)


@maps
@pytest.mark.parametrize("size", [64, 1 << 15])
def test_vti_in_blocks_of_lz4(cumulo, tmp_path, map, size):
    writer = vtkXMLImageDataWriter()
    writer.SetFileName(str(tmp_path / "in.vti"))
    writer.SetInputData(vtk_image(map))
    writer.SetCompressorTypeToLZ4()
    writer.SetBlockSize(size)
    assert writer.Write() == 1
    cubes.passes(cumulo, tmp_path / "in.vti", map, tmp_path, tolerance=4 * cubes.DOUBLE)


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("cells", [False, True])
@pytest.mark.parametrize("rich", [False, True])
def test_legacy_vtk(cumulo, tmp_path, binary, cells, rich):
    image = vtkStructuredPoints()
    image.DeepCopy(vtk_image(cubes.STRAIGHT, cells))
    if rich:
        # The time of the file, and names of components, which come before and among what counts.
        time = numpy_to_vtk(np.array([1.5]), deep=True)
        time.SetName("TIME")
        image.GetFieldData().AddArray(time)
        tensor = numpy_to_vtk(np.zeros((60, 2)), deep=True)
        tensor.SetName("two")
        tensor.SetComponentName(0, "first")
        (image.GetCellData() if cells else image.GetPointData()).AddArray(tensor)
    writer = vtkStructuredPointsWriter()
    writer.SetFileName(str(tmp_path / "in.vtk"))
    writer.SetInputData(image)
    (writer.SetFileTypeToBinary if binary else writer.SetFileTypeToASCII)()
    assert writer.Write() == 1
    cubes.passes(cumulo, tmp_path / "in.vtk", cubes.STRAIGHT, tmp_path, tolerance=cubes.DOUBLE)


STYLES = [(kind, style) for kind in (np.uint8, np.uint16, np.int16, np.float32) for style in ("imagej", "ome", "plain", "folder")]


# ImageJ has no signed integers.
@pytest.mark.parametrize("kind, style", [pair for pair in STYLES if pair != (np.int16, "imagej")])
def test_tiff(cumulo, tmp_path, kind, style):
    pages = np.ascontiguousarray(cubes.array().transpose(2, 1, 0)).astype(kind)
    x, y, z = (float(v) for v in np.diag(cubes.STRAIGHT)[:3])
    path, options = tmp_path / "in.tif", ["--origin=10.5,-20.25,30.125"]
    if style == "imagej":
        tifffile.imwrite(path, pages, imagej=True, resolution=(1 / x, 1 / y), metadata={"spacing": z, "unit": "mm", "axes": "ZYX"})
    elif style == "ome":
        metadata = {"axes": "ZYX", "PhysicalSizeX": x, "PhysicalSizeY": y, "PhysicalSizeZ": z, "PhysicalSizeXUnit": "mm"}
        path = tmp_path / "in.ome.tif"
        tifffile.imwrite(path, pages, metadata=metadata)
    elif style == "plain":
        tifffile.imwrite(path, pages, photometric="minisblack", compression="zlib", metadata=None, bigtiff=True, byteorder=">")
        options.append(f"--spacing={x},{y},{z}")
    else:
        path = tmp_path / "slices"
        path.mkdir()
        for number, page in enumerate(pages):
            tifffile.imwrite(path / f"s{number + 9}.tif", page)
        options.append(f"--spacing={x},{y},{z}")
    # Resolutions are ratios of 32-bit integers.
    cubes.passes(cumulo, path, cubes.STRAIGHT, tmp_path, *options, tolerance=1e-8)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.uint32])
def test_tiff_whose_low_values_are_bright(cumulo, tmp_path, kind):
    """Values are those that are stored, as tifffile gives them."""
    pages = np.ascontiguousarray(cubes.array().transpose(2, 1, 0)).astype(kind)
    tifffile.imwrite(tmp_path / "in.tif", pages, photometric="miniswhite", metadata=None)
    options = ["--origin=10.5,-20.25,30.125", "--spacing=0.5,0.75,1.25"]
    cubes.passes(cumulo, tmp_path / "in.tif", cubes.STRAIGHT, tmp_path, *options, tolerance=0)


def test_ome_sizes_in_several_units(cumulo, tmp_path):
    pages = np.ascontiguousarray(cubes.array().transpose(2, 1, 0))
    sizes = {"PhysicalSizeX": 0.5, "PhysicalSizeY": 750.0, "PhysicalSizeZ": 1250000.0}
    units = {"PhysicalSizeXUnit": "mm", "PhysicalSizeYUnit": "µm", "PhysicalSizeZUnit": "nm"}
    tifffile.imwrite(tmp_path / "in.ome.tif", pages, metadata={"axes": "ZYX"} | sizes | units)
    options = ["--origin=10.5,-20.25,30.125"]
    cubes.passes(cumulo, tmp_path / "in.ome.tif", cubes.STRAIGHT, tmp_path, *options, tolerance=cubes.DOUBLE)


def test_numpy(cumulo, tmp_path):
    options = ["--transform=" + ",".join(repr(float(v)) for v in cubes.OBLIQUE[:3].ravel()), "--as=int"]
    np.save(tmp_path / "in.npy", cubes.array())
    cubes.passes(cumulo, tmp_path / "in.npy", cubes.OBLIQUE, tmp_path, *options, tolerance=0)
    np.save(tmp_path / "zyx.npy", np.ascontiguousarray(cubes.array().T))
    cubes.passes(cumulo, tmp_path / "zyx.npy", cubes.OBLIQUE, tmp_path, *options, "--axes=zyx", tolerance=0)
    np.savez_compressed(tmp_path / "in.npz", labels=np.asfortranarray(cubes.array()), other=np.arange(4))
    cubes.passes(cumulo, tmp_path / "in.npz", cubes.OBLIQUE, tmp_path, *options, tolerance=0)


def test_vectors(cumulo, tmp_path):
    """Vectors keep their components."""
    values = np.arange(1, 181, dtype=np.float32).reshape(*cubes.SIZE, 3)
    image = sitk.GetImageFromArray(np.ascontiguousarray(values.transpose(2, 1, 0, 3)), isVector=True)
    for ending in ("nii.gz", "nrrd", "mha", "vti"):
        source = tmp_path / f"in.{'mha' if ending == 'vti' else ending}"
        sitk.WriteImage(image, str(source))
        cumulo("convert", source, tmp_path / "v.vdb")
        cumulo("convert", tmp_path / "v.vdb", tmp_path / "v.npy")
        assert (np.load(tmp_path / "v.npy") == values).all(), ending
        out = tmp_path / f"out.{ending}"
        cumulo("convert", tmp_path / "v.vdb", out)
        if ending != "vti":
            found = sitk.GetArrayFromImage(sitk.ReadImage(str(out))).transpose(2, 1, 0, 3)
            assert (found == values).all(), ending
