"""The picture of the guide's section on holdouts: a plume, the plume before a ring, and both together.

    holdout_pictures.py [OUT.png] [--size 360] [--samples 128]

The ring is a mesh, which holds the plume out, and a fog of it, which is rendered with shaded surfaces in place of
another renderer. CUMULO is the program, `cumulo` by default; needs OpenEXR and NumPy (`.venvs/imaging`).
"""

import argparse
import json
import os
import pathlib
import subprocess
import tempfile

import numpy as np
import OpenEXR

PLUME = pathlib.Path(__file__).resolve().parent.parent / "fixtures" / "plume.vdb"
CAMERA = "--eye 1,-2.6,2.1 --target 1,1,1.05 --up z --fov 30 --background 0,0,0 --quiet".split()
LIGHT = "--density-scale 6 --albedo 0.95 --sun 0.5,-0.6,1 --sun-color 3,2.9,2.7 --sky 0.25,0.3,0.4".split()
# Density, red, green, blue and extinction per world length.
OPAQUE = [[0.15, 0.75, 0.4, 0.2, 0], [0.25, 0.75, 0.4, 0.2, 3000], [1, 0.75, 0.4, 0.2, 3000]]


def write_ring(path, centre=(1, 1, 1.15), radius=0.62, thickness=0.09, tilt=0.35, steps=(96, 32)):
    """Writes a ring of quads as OBJ, in world units; it is tilted about the x axis by an angle in radians."""
    around, across = (np.linspace(0, 2 * np.pi, count, endpoint=False) for count in steps)
    turn, polar = np.meshgrid(around, across, indexing="ij")
    distance = radius + thickness * np.cos(polar)
    x, y, z = distance * np.cos(turn), distance * np.sin(turn), thickness * np.sin(polar)
    y, z = y * np.cos(tilt) - z * np.sin(tilt), y * np.sin(tilt) + z * np.cos(tilt)
    corners = np.stack([x, y, z], axis=-1) + centre
    numbers = np.arange(1, turn.size + 1).reshape(steps)
    beside = [np.roll(numbers, shift, axis=(0, 1)) for shift in [(0, 0), (-1, 0), (-1, -1), (0, -1)]]
    lines = [f"v {a:.6f} {b:.6f} {c:.6f}" for a, b, c in corners.reshape(-1, 3)]
    lines += ["f " + " ".join(map(str, face)) for face in np.stack(beside, axis=-1).reshape(-1, 4)]
    path.write_text("\n".join(lines) + "\n")


def pixels(path):
    """RGBA of a picture, [height, width, 4]."""
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return np.stack([channels[name].pixels for name in "RGBA"], axis=-1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", nargs="?", type=pathlib.Path, default=pathlib.Path("holdout.png"))
    parser.add_argument("--size", type=int, default=360)
    parser.add_argument("--samples", type=int, default=128)
    options = parser.parse_args()

    def cumulo(*words):
        subprocess.run([os.environ.get("CUMULO", "cumulo"), *map(str, words)], check=True)

    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        write_ring(folder / "ring.obj")
        cumulo("convert", folder / "ring.obj", folder / "ring.vdb", "--to", "fog", "--voxel-size", 0.01)
        function = {"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise", "points": OPAQUE}}
        (folder / "opaque.tf.json").write_text(json.dumps(function))

        def render(volume, picture, *words):
            size = f"{options.size}x{options.size}"
            cumulo("render", volume, *CAMERA, "--size", size, *words, "-o", folder / picture)
            return pixels(folder / picture)

        ring = render(folder / "ring.vdb", "ring.exr", "--tf", folder / "opaque.tf.json", "--shade", "--supersample", 3)
        lit = [*LIGHT, "--samples", options.samples]
        plume = render(PLUME, "plume.exr", *lit)
        before = render(PLUME, "before.exr", *lit, "--holdout", folder / "ring.obj")
        both = before + (1 - before[..., 3:]) * ring
        sheet = np.concatenate([plume, before, both], axis=1).astype(np.float32)
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, {name: sheet[..., c].copy() for c, name in enumerate("RGBA")}) as file:
            file.write(str(folder / "sheet.exr"))
        cumulo("convert", folder / "sheet.exr", folder / "sheet.png")
        options.output.write_bytes((folder / "sheet.png").read_bytes())


if __name__ == "__main__":
    main()
