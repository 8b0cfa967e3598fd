"""DICOM series that pydicom writes, and those it ships, land where its headers say."""


import cubes
import numpy as np
import pydicom
import pytest
from pydicom import uid
from pydicom.data import get_testdata_file
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset

# Decimal strings have room for 16 characters, of which a position takes up to six before its decimals.
ROUNDING = 1e-8

CODINGS = {
    "implicit": (uid.ImplicitVRLittleEndian, np.int16),
    "explicit": (uid.ExplicitVRLittleEndian, np.int16),
    "unsigned": (uid.ExplicitVRLittleEndian, np.uint16),
    "bytes": (uid.ExplicitVRLittleEndian, np.uint8),
    "words": (uid.ExplicitVRLittleEndian, np.int32),
    "big": (uid.ExplicitVRBigEndian, np.int16),
    "deflated": (uid.DeflatedExplicitVRLittleEndian, np.int16),
    "rle": (uid.RLELossless, np.int16),
}


def decimals(values):
    return [f"{value:.12f}"[:16] for value in values]


def image_of(coding, kind):
    """A data set with what all images have."""
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = uid.CTImageStorage
    meta.MediaStorageSOPInstanceUID = uid.generate_uid()
    # RLE packs what is there.
    meta.TransferSyntaxUID = uid.ExplicitVRLittleEndian if coding == uid.RLELossless else coding
    image = FileDataset("", {}, file_meta=meta, preamble=bytes(128))
    image.SOPClassUID, image.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
    image.Modality, image.SamplesPerPixel, image.PhotometricInterpretation = "CT", 1, "MONOCHROME2"
    bits = 8 * np.dtype(kind).itemsize
    image.BitsAllocated, image.BitsStored, image.HighBit = bits, bits, bits - 1
    image.PixelRepresentation = int(np.dtype(kind).kind == "i")
    return image


def save(image, path, coding, pixels):
    big = coding == uid.ExplicitVRBigEndian
    image.PixelData = (pixels.byteswap() if big else pixels).tobytes()
    image["PixelData"].VR = "OW" if pixels.itemsize > 1 else "OB"
    if coding == uid.RLELossless:
        image.compress(coding, generate_instance_uid=False)
    if big:
        pydicom.dcmwrite(path, image, little_endian=False, implicit_vr=False, force_encoding=True)
    else:
        pydicom.dcmwrite(path, image, enforce_file_format=True)


def series(folder, map, coding=uid.ExplicitVRLittleEndian, kind=np.int16, without=(), slope=None):
    """Writes the cube as a series, in an order that names and numbers do not tell."""
    lps = cubes.LPS @ map
    values = cubes.array().transpose(2, 1, 0).astype(kind)
    folder.mkdir()
    name = uid.generate_uid()
    for number, k in enumerate(np.random.default_rng(1).permutation(len(values))):
        if k in without:
            continue
        image = image_of(coding, kind)
        image.SeriesInstanceUID, image.InstanceNumber = name, number + 1
        spacing = np.linalg.norm(lps[:3, :3], axis=0)
        directions = lps[:3, :3] / spacing
        image.ImageOrientationPatient = decimals([*directions[:, 0], *directions[:, 1]])
        image.ImagePositionPatient = decimals(lps[:3, 2] * k + lps[:3, 3])
        image.PixelSpacing = decimals([spacing[1], spacing[0]])
        image.Rows, image.Columns = values.shape[1:]
        if slope:
            image.RescaleSlope, image.RescaleIntercept = str(slope), "-7"
        save(image, folder / f"{number}.dcm", coding, values[k])


@pytest.mark.parametrize("map", [cubes.STRAIGHT, cubes.OBLIQUE], ids=["straight", "oblique"])
@pytest.mark.parametrize("coding", CODINGS)
def test_series(cumulo, tmp_path, coding, map):
    series(tmp_path / "series", map, *CODINGS[coding])
    cubes.passes(cumulo, tmp_path / "series", map, tmp_path, tolerance=ROUNDING)


def test_mirrored_stacks_are_sorted(cumulo, tmp_path):
    """Slices along the normal are in ascending order, whichever way they were counted."""
    series(tmp_path / "series", cubes.MIRRORED)
    cumulo("convert", tmp_path / "series", tmp_path / "s.vdb")
    values, map = cubes.by_cumulo(cumulo, tmp_path / "s.vdb", tmp_path)
    cubes.agree(cubes.places(values, map), cubes.MIRRORED, ROUNDING)


def test_values_are_rescaled(cumulo, tmp_path):
    series(tmp_path / "series", cubes.STRAIGHT, slope=0.5)
    cumulo("convert", tmp_path / "series", tmp_path / "s.vdb")
    values, _ = cubes.by_cumulo(cumulo, tmp_path / "s.vdb", tmp_path)
    assert (values == cubes.array() * 0.5 - 7).all()


def test_a_missing_slice_is_named(cumulo, tmp_path):
    map = cubes.OBLIQUE @ np.diag([1, 1, 0.5, 1])
    series(tmp_path / "series", map)
    several = sorted((tmp_path / "series").iterdir())
    positions = {path: pydicom.dcmread(path).ImagePositionPatient for path in several}
    assert len({tuple(p) for p in positions.values()}) == len(several)
    # A slice beyond the last one, two steps on.
    far = pydicom.dcmread(several[0])
    lps = cubes.LPS @ map
    far.ImagePositionPatient = decimals(lps[:3, 2] * 4 + lps[:3, 3])
    pydicom.dcmwrite(tmp_path / "series" / "far.dcm", far)
    with pytest.raises(Exception, match="apart"):
        cumulo("convert", tmp_path / "series", tmp_path / "s.vdb")


def test_frames_of_one_file(cumulo, tmp_path):
    """An enhanced image, whose frames have places and scales of their own."""
    values, lps = cubes.array().transpose(2, 1, 0).astype(np.int16), cubes.LPS @ cubes.OBLIQUE
    order, frames = [2, 0, 1], []
    for k in order:
        position, frame = Dataset(), Dataset()
        position.ImagePositionPatient = decimals(lps[:3, 2] * k + lps[:3, 3])
        frame.PlanePositionSequence = [position]
        frames.append(frame)
    spacing = np.linalg.norm(lps[:3, :3], axis=0)
    orientation, measures, shared = Dataset(), Dataset(), Dataset()
    orientation.ImageOrientationPatient = decimals((lps[:3, :2] / spacing[:2]).T.ravel())
    measures.PixelSpacing = decimals([spacing[1], spacing[0]])
    shared.PlaneOrientationSequence, shared.PixelMeasuresSequence = [orientation], [measures]
    for coding in (uid.ExplicitVRLittleEndian, uid.RLELossless):
        image = image_of(coding, np.int16)
        image.SharedFunctionalGroupsSequence, image.PerFrameFunctionalGroupsSequence = [shared], frames
        image.NumberOfFrames, (image.Rows, image.Columns) = len(order), values.shape[1:]
        path = tmp_path / f"{coding.name}.dcm"
        save(image, path, coding, values[order])
        cubes.passes(cumulo, path, cubes.OBLIQUE, tmp_path, tolerance=ROUNDING)


SHIPPED = ["CT_small.dcm", "MR_small.dcm", "MR_small_bigendian.dcm", "MR_small_implicit.dcm", "MR_small_RLE.dcm"]


# Files that pydicom needs another library to unpack, and the same image without packing.
PACKED = {"MR_small_jp2klossless.dcm": "MR_small.dcm"}


@pytest.mark.parametrize("name", [*SHIPPED, *PACKED])
def test_shipped_files(cumulo, tmp_path, name):
    source = get_testdata_file(name)
    image = pydicom.dcmread(source)
    pixels = pydicom.dcmread(get_testdata_file(PACKED.get(name, name))).pixel_array
    wanted = pixels * float(image.get("RescaleSlope", 1)) + float(image.get("RescaleIntercept", 0))
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / name).write_bytes(open(source, "rb").read())
    report = cumulo("convert", tmp_path / "one", tmp_path / "s.vdb", "--as=float")
    assert report["grids"][0]["shape"] == [image.Columns, image.Rows, 1]
    made = cumulo("convert", tmp_path / "s.vdb", tmp_path / "s.npy")
    low, found = made["grid"]["index_origin"], np.load(tmp_path / "s.npy")[:, :, 0].T
    part = tuple(slice(start, start + size) for start, size in zip(low[1::-1], found.shape))
    assert (found == wanted[part]).all()
    first = np.array(report["grids"][0]["transform"])[:3, 3]
    assert np.abs(first - np.array(image.ImagePositionPatient, float) * [-1, -1, 1]).max() < ROUNDING
