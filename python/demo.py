#!/usr/bin/env python3
"""The main job in one go: a smoke, 32 pictures of it, and the volume found again from these alone.

`--blender` lets Cycles take the pictures (run it with .venvs/bpy/bin/python). Everything lands in
`demo-out/`; the last lines name the report and its figures.
"""

import argparse
import pathlib
import shutil
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "python"))
from cumulo.run import CumuloError, cumulo  # noqa: E402  from this checkout

# The smoke stands in a box of side 2.
VIEWS, SIZE, VOXELS = 32, "128x128", 64


def say(text):
    """A line that says what happens now."""
    print(f"\n== {text}", flush=True)


def main():
    """Makes the volume, takes the pictures, reconstructs, compares."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blender", action="store_true", help="pictures by Blender's Cycles")
    blender = parser.parse_args().blender
    start = time.monotonic()
    out = ROOT / "demo-out"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    smoke, found = out / "smoke.vdb", out / "found.vdb"
    pictures, report = out / "pictures", out / "report"

    say(f"a smoke of {VOXELS}^3 voxels: {smoke}")
    maker = ROOT / "fixtures" / "make_fixtures.py"
    subprocess.run([sys.executable, str(maker), "--plume", str(VOXELS), str(smoke)], check=True, stdout=subprocess.DEVNULL)

    say(f"{VIEWS} pictures of it, {SIZE}, by Cumulo: {pictures}")
    cumulo(
        "render", smoke, "--views", VIEWS, "--size", SIZE, "--model", "absorption", "--density-scale", "auto", "-o", pictures,
        json_report=False, progress=True,
    )  # fmt: skip
    if blender:
        from cumulo import blender as cycles
        from cumulo.capture import Capture

        # The same cameras and the same scale.
        capture = Capture.read(pictures)
        pictures = out / "pictures-cycles"
        say(f"{VIEWS} pictures of it, {SIZE}, by Blender's Cycles: {pictures}")
        cycles.render_capture(
            smoke,
            [camera for camera, _ in capture.frames],
            cycles.Settings(density_scale=capture.density_scale, background=capture.background, samples=16, step_rate=0.5),
            pictures,
            progress=cycles.show_progress,
        )

    say(f"the volume, from the pictures alone: {found}")
    result = cumulo(
        "reconstruct", "density", pictures / "transforms.json", "-o", found,
        "--voxel-size", 2.0 / VOXELS, "--held-out", 2, "--report", report, progress=True,
    )  # fmt: skip
    grid = cumulo("diff", smoke, found)["grids"][0]

    page = next(iter(sorted(report.glob("*.html"))), report)
    say("done")
    print(f"report            {page}")
    print(f"volume PSNR       {grid['psnr_db']:.2f} dB against {smoke.relative_to(ROOT)}")
    print(f"held-out views    {result['held_out_psnr_db']:.2f} dB")
    print(f"reconstruction    {result['seconds']:.1f} s, {result['iterations']} iterations")
    print(f"the whole demo    {time.monotonic() - start:.1f} s")


if __name__ == "__main__":
    try:
        main()
    except (CumuloError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
