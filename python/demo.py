#!/usr/bin/env python3
"""The main job in one go: a smoke, 32 pictures of it, and the volume found again from these alone.

`--blender` lets Cycles take the pictures (run it with .venvs/bpy/bin/python). Everything lands in
`demo-out/`; the last lines name the report and its figures.
"""

import argparse
import dataclasses
import pathlib
import shutil
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "python"))
import cumulo  # noqa: E402  from this checkout

OUT = ROOT / "demo-out"


def say(text):
    """A line that says what happens now."""
    print(f"\n== {text}", flush=True)


def options():
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blender", action="store_true", help="pictures by Blender's Cycles")
    parser.add_argument("--volume", type=pathlib.Path, help="this VDB instead of a smoke of its own")
    parser.add_argument("--voxels", type=int, default=64, help="edge of that smoke (64)")
    parser.add_argument("--views", type=int, default=32, help="pictures (32)")
    parser.add_argument("--size", default="128x128", help="of the pictures (128x128)")
    parser.add_argument("--samples", type=int, default=16, help="Cycles' samples a pixel (16)")
    parser.add_argument("--unbiased", action="store_true", help="Cycles walks by null collisions: noisier")
    return parser.parse_args()


def make_smoke(voxels):
    """The volume, by the fixtures' generator."""
    smoke = OUT / "smoke.vdb"
    say(f"a smoke of {voxels}^3 voxels: {smoke}")
    maker = ROOT / "fixtures" / "make_fixtures.py"
    subprocess.run([sys.executable, str(maker), "--plume", str(voxels), str(smoke)], check=True, stdout=subprocess.DEVNULL)
    return smoke


def main():
    """Makes the volume, takes the pictures, reconstructs, compares."""
    asked = options()
    start = time.monotonic()
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir()
    smoke = asked.volume or make_smoke(asked.voxels)
    found, pictures, report = OUT / "found.vdb", OUT / "pictures", OUT / "report"

    say(f"{asked.views} pictures of it, {asked.size}, by Cumulo: {pictures}")
    cumulo.render(smoke, pictures, views=asked.views, size=asked.size, density_scale="auto", progress=True)
    if asked.blender:
        from cumulo import blender as cycles
        from cumulo import noise
        from cumulo.capture import Capture
        from cumulo.exr import read_exr

        # The same cameras and the same scale.
        capture = Capture.read(pictures)
        cameras = [camera for camera, _ in capture.frames]
        settings = cycles.Settings(
            density_scale=capture.density_scale, background=capture.background, samples=asked.samples, step_rate=0.5,
            unbiased=asked.unbiased,
        )
        pictures = OUT / "pictures-cycles"
        say(f"{asked.views} pictures of it, {asked.size}, by Blender's Cycles: {pictures}")
        capture = cycles.render_capture(smoke, cameras, settings, pictures, progress=cycles.show_progress)

    say(f"the volume, from the pictures alone: {found}")
    result = cumulo.reconstruct.density(pictures, found, held_out=2, report=report, progress=True)
    [grid] = cumulo.diff(smoke, found).grids
    beside = []
    if asked.blender:
        # Another seed tells how noisy the pictures themselves are.
        say("the held-out views again, with another seed, and the found volume, by Blender's Cycles")
        held_out = result.held_out
        again = cycles.render_capture(smoke, [cameras[i] for i in held_out], dataclasses.replace(settings, seed=7001), OUT / "again")
        pairs = [(capture.frames[i][1], frame[1]) for i, frame in zip(held_out, again.frames)]
        powers = [noise.floor_of(read_exr(first), read_exr(second)).rms ** 2 for first, second in pairs]
        floor = noise.decibels((sum(powers) / len(powers)) ** 0.5)
        shown = [cameras[i] for i in result.shown]
        cycles.render_capture(found, shown, dataclasses.replace(settings, seed=9001), OUT / "found-cycles")
        beside = ["--beside", f"The found volume in Cycles={OUT / 'found-cycles'}"]
    page = cumulo.call("report", report, "--reference", smoke, *beside)["report"]

    say("done")
    print(f"report            {page}")
    print(f"volume PSNR       {grid.psnr_db:.2f} dB against {smoke}")
    print(f"held-out views    {result.held_out_psnr_db:.2f} dB")
    if asked.blender:
        print(f"their noise floor {floor:.2f} dB, from two seeds")
    print(f"reconstruction    {result.seconds:.1f} s, {result.iterations} iterations, {result.peak_memory_mb:.0f} MB")
    print(f"the whole demo    {time.monotonic() - start:.1f} s")


if __name__ == "__main__":
    try:
        main()
    except (cumulo.CumuloError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
