"""The picture of the guide's page on scans: a head with shaded surfaces, the same head and a brain under a sun and a sky.

    scan_pictures.py [OUT.png] [--size 320] [--samples 24]

The scans are `ch2` and `ch2bet` of Debian's package mricron-data. CUMULO is the program, `cumulo` by default.
"""

import argparse
import json
import os
import pathlib
import subprocess
import tempfile

SCANS = pathlib.Path("/usr/share/mricron/templates")
LIGHT = "--albedo 1 --sun=-0.3,1,0.8 --sun-color 5 --sun-angle 8 --sky 0.5 --gradient-shading 8 --specular 0.04".split()
# Density, red, green, blue and extinction per millimetre.
SKIN = [[0, 0.9, 0.6, 0.5, 0], [25, 0.9, 0.6, 0.5, 0], [45, 0.85, 0.5, 0.4, 0.4], [90, 0.9, 0.75, 0.6, 1]]
SKIN += [[150, 1, 0.95, 0.85, 1.5], [255, 1, 1, 1, 2]]
BRAIN = [[0, 0.8, 0.45, 0.4, 0], [45, 0.8, 0.45, 0.4, 0], [65, 0.85, 0.5, 0.45, 0.6], [93, 0.95, 0.8, 0.7, 1.2], [133, 1, 1, 1, 1.5]]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", nargs="?", type=pathlib.Path, default=pathlib.Path("scans.png"))
    parser.add_argument("--size", type=int, default=320)
    parser.add_argument("--samples", type=int, default=24)
    options = parser.parse_args()

    def cumulo(*words):
        subprocess.run([os.environ.get("CUMULO", "cumulo"), *map(str, words)], check=True)

    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for title, points in (("skin", SKIN), ("brain", BRAIN)):
            function = {"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise", "points": points}}
            (folder / f"{title}.tf.json").write_text(json.dumps(function))

        def render(scan, title, picture, *words):
            size = f"{options.size}x{options.size}"
            function = folder / f"{title}.tf.json"
            cumulo("render", SCANS / scan, "--tf", function, "--size", size, "--gradient-scale", 1, *words, "-o", folder / picture)

        lit = [*LIGHT, "--samples", options.samples, "--denoise"]
        render("ch2.nii.gz", "skin", "shaded.exr", "--from", "anterior", "--shade", "--background", "1,1,1")
        render("ch2.nii.gz", "skin", "lit.exr", "--azimuth", 215, "--elevation", 12, *lit)
        render("ch2bet.nii.gz", "brain", "brain.exr", "--azimuth", 215, "--elevation", 25, *lit)
        panels = [folder / f"{name}.exr" for name in ("shaded", "lit", "brain")]
        marks = ["--label", "A,B,C", "--orientation", "anatomical", "--scale-bar", "--length-unit", "mm", "--width", "1200px", "--font-size", 5]
        cumulo("figure", *panels, *marks, "--overwrite", "-o", options.output)


if __name__ == "__main__":
    main()
