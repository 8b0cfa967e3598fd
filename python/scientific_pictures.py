"""The guide's picture of other arrays and scans: electrons of C60, a DICOM series, a field with two signs, and labels.

    scientific_pictures.py [OUT.png] [--size 390] [--keep DIR]

The scans are `inia19-t1-brain` and `aal` of Debian's package mricron-data. It needs the packages of `requirements-imaging.txt`; CUMULO is
the program, `cumulo` by default. With --keep the inputs of the panels stay in a folder.
"""

import argparse
import json
import os
import pathlib
import shlex
import subprocess
import sys
import tempfile

import nibabel
import numpy as np
import pydicom
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian, MRImageStorage, generate_uid

sys.path.insert(0, str(pathlib.Path(__file__).parent / "peers"))
import c60  # noqa: E402

BRAIN = pathlib.Path("/usr/share/mricron/templates/inia19-t1-brain.nii.gz")
ATLAS = BRAIN.with_name("aal.nii.gz")
# Density, red, green, blue and extinction per ångström: one peak for each shell.
SHELLS = [[0.12, 0.9, 0.3, 0.15, 0], [0.2, 0.9, 0.3, 0.15, 0.4], [0.28, 0.9, 0.3, 0.15, 0]]
SHELLS += [[0.42, 0.25, 0.75, 0.25, 0], [0.5, 0.25, 0.75, 0.25, 2.5], [0.58, 0.25, 0.75, 0.25, 0]]
SHELLS += [[0.7, 0.15, 0.35, 0.9, 0], [0.8, 0.15, 0.35, 0.9, 6]]
LIGHT = "--albedo 1 --sun-color 5 --sun-angle 8 --specular 0.04 --denoise"


def electrons(folder):
    """A density like that of the electrons of C60, and a function that shows three of its surfaces."""
    np.save(folder / "c60.npy", c60.field(128))
    function = {"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise", "points": SHELLS}}
    (folder / "shells.tf.json").write_text(json.dumps(function))


def series(folder):
    """A scan as a DICOM series of one file for each slice."""
    scan = nibabel.load(BRAIN)
    stored = np.round(np.asarray(scan.dataobj)).astype("<u2")
    to_lps = np.diag([-1, -1, 1, 1]) @ scan.affine
    step = np.linalg.norm(to_lps[:3, :3], axis=0)
    # What the slices have in common.
    of_all = {"SeriesInstanceUID": generate_uid(), "StudyInstanceUID": generate_uid(), "FrameOfReferenceUID": generate_uid()}
    of_all |= {"SOPClassUID": MRImageStorage, "Modality": "MR", "PatientName": "INIA19", "PatientID": "1"}
    of_all |= {"PixelSpacing": [float(step[1]), float(step[0])], "SliceThickness": float(step[2])}
    of_all |= {"ImageOrientationPatient": [round(float(v), 6) for v in (to_lps[:3, :2] / step[:2]).T.ravel()]}
    of_all |= {"Columns": stored.shape[0], "Rows": stored.shape[1], "SamplesPerPixel": 1, "PhotometricInterpretation": "MONOCHROME2"}
    of_all |= {"BitsAllocated": 16, "BitsStored": 16, "HighBit": 15, "PixelRepresentation": 0}
    (folder / "series").mkdir(exist_ok=True)
    for number in range(stored.shape[2]):
        image = Dataset()
        for name, value in of_all.items():
            setattr(image, name, value)
        image.SOPInstanceUID = generate_uid()
        image.InstanceNumber = number + 1
        image.ImagePositionPatient = [round(float(v), 6) for v in to_lps[:3, 3] + to_lps[:3, 2] * number]
        image.PixelData = stored[:, :, number].T.tobytes()
        image.file_meta = FileMetaDataset()
        image.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        pydicom.dcmwrite(folder / "series" / f"{number + 1:03}.dcm", image, enforce_file_format=True)


def vorticity(folder, n=128, turn=0.45):
    """The vertical component of the vorticity of a vortex along a trefoil knot, ±300 per second at most; a voxel is a millimetre."""
    t = np.linspace(0, 2 * np.pi, 20000, endpoint=False)
    across, upwards = np.sin(t) + 2 * np.sin(2 * t), 2 * np.cos(2 * t) - np.cos(t)
    across, upwards = np.cos(turn) * across - np.sin(turn) * upwards, np.sin(turn) * across + np.cos(turn) * upwards
    knot = 17 * np.stack([1.2 * np.sin(3 * t), across, upwards])
    # Of a closed curve with a Gaussian section, which has no divergence.
    field = np.zeros((n, n, n))
    np.add.at(field, tuple(np.round(knot + n / 2).astype(int)), np.gradient(knot[2]))
    square = sum((2 * np.pi * wave) ** 2 for wave in np.meshgrid(*[np.fft.fftfreq(n)] * 3, indexing="ij"))
    vertical = np.fft.ifftn(np.fft.fftn(field) * np.exp(-square * 3**2 / 2)).real
    np.save(folder / "vorticity.npy", (300 * vertical / abs(vertical).max()).astype(np.float32))


# Name, what makes the input, and the words of `cumulo render`; one panel each.
PANELS = [
    (
        "c60",
        electrons,
        "c60.npy --voxel-size 0.079 --tf shells.tf.json --shade --gradient-scale 1 --azimuth 20 --elevation 15 --distance 19.5 --fov 30",
    ),
    (
        "series",
        series,
        f"series --tf mr-default --tf-range 20,130 --tf-unit-distance 0.1 --azimuth 235 --elevation 20 {LIGHT} --sun=-0.7,0.9,0.8"
        " --sky 0.5 --gradient-shading 10 --gradient-scale 1 --samples 16",
    ),
    (
        "vorticity",
        vorticity,
        f"vorticity.npy --voxel-size 1 --tf diverging --tf-range=-300,300 --tf-extinction 1.2 --azimuth 75 --elevation 20 --distance 240"
        f" --fov 30 {LIGHT} --sun=1,-1,0.8 --sky 0.6 --gradient-shading 100 --samples 32",
    ),
    (
        "atlas",
        lambda folder: None,
        f"{ATLAS} --tf labels --azimuth 215 --elevation 25 --distance 500 --fov 27 {LIGHT} --sun=-0.3,1,0.8 --sky 0.5 --gradient-shading 0.1 --samples 32",
    ),
]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", nargs="?", type=pathlib.Path, default=pathlib.Path("scientific.png"))
    parser.add_argument("--size", type=int, default=390)
    parser.add_argument("--keep", type=pathlib.Path)
    options = parser.parse_args()

    output = options.output.resolve()

    with tempfile.TemporaryDirectory() as name:
        folder = options.keep or pathlib.Path(name)
        folder.mkdir(exist_ok=True)

        def cumulo(*words):
            subprocess.run([os.environ.get("CUMULO", "cumulo"), *map(str, words)], check=True, cwd=folder)

        for title, make, words in PANELS:
            make(folder)
            size = f"{options.size}x{options.size}"
            cumulo("render", *shlex.split(words), "--background", "1,1,1", "--size", size, "-o", f"{title}.exr")
        letters = ",".join("ABCDEFGH"[: len(PANELS)])
        columns = 2 if len(PANELS) == 4 else min(len(PANELS), 3)
        marks = ["--label", letters, "--orientation", "axes", "--scale-bar", "--columns", columns, "--width", f"{400 * columns}px"]
        panels = [f"{title}.exr" for title, _, _ in PANELS]
        cumulo("figure", *panels, *marks, "--font-size", 5, "--overwrite", "-o", output)


if __name__ == "__main__":
    main()
