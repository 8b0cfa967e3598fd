"""How far the plans of reconstructions are from what these take.

    plan_accuracy.py FOLDER [--kinds KIND ...] [--repeats N] [--threads N]

Renders captures of several kinds of a fixture to FOLDER, and of each runs in turn `cumulo plan` and `cumulo reconstruct
density` with the same options. A row has the medians over the repeats of the expected and the measured seconds, their
ratio, the smallest and largest ratio of a plan to the run after it, the ratios of memory and of unknowns, and the
iterations. The process exits with 1 if a ratio of times is not within 30 %. Other programs on the machine make both
sides slower, at different times: repeat, or look at the medians. CUMULO is the program, `cumulo` by default.
Needs numpy.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[1]
PLUME = ROOT / "fixtures" / "plume.vdb"
RENDER = "--density-scale auto"
# Options of `render`, and those of `reconstruct density` and `plan`.
KINDS = {
    "clean": (f"--views 24 --size 128x128 {RENDER}", ""),
    "fine": (f"--views 16 --layout ring --size 128x128 {RENDER}", "--resolution 96"),
    "few views": (f"--views 5 --layout ring --size 160x160 {RENDER}", ""),
    "large pictures": (f"--views 10 --size 512x512 {RENDER}", "--bounds 0.6,0.6,0.6,1.4,1.4,1.4"),
    "noisy": (f"--views 16 --size 128x128 {RENDER} --background 1,1,1", ""),
    "photographs": (f"--views 12 --size 128x128 {RENDER} --model emission-absorption", ""),
    "held out": (f"--views 20 --size 96x96 {RENDER}", "--held-out 4 --smoothing 2"),
}


def program(*words, threads):
    """Runs the program and returns its document."""
    call = [os.environ.get("CUMULO", "cumulo"), *map(str, words), "--threads", str(threads), "--json", "--quiet"]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(done.stdout or done.stderr)
    return json.loads(done.stdout)


def add_noise(folder, threads):
    """Adds noise of a deviation of 2 % to the colors of all pictures, whose alpha becomes 1."""
    for number, path in enumerate(sorted(folder.glob("*.exr"))):
        array = path.with_suffix(".npy")
        program("convert", path, array, threads=threads)
        pixels = np.load(array)
        rng = np.random.default_rng(number)
        pixels[..., :3] += rng.normal(0, 0.02, pixels[..., :3].shape)
        pixels[..., 3] = 1
        np.save(array, pixels.astype(np.float32))
        path.unlink()
        program("convert", array, path, threads=threads)
        array.unlink()


def capture(folder, kind, threads):
    """Renders the capture of a kind, once."""
    shots = folder / kind.replace(" ", "-")
    if not shots.exists():
        program("render", PLUME, *KINDS[kind][0].split(), "-o", shots, threads=threads)
        if kind == "noisy":
            add_noise(shots, threads)
        if kind == "photographs":
            # As `capture convert --photographs` states them.
            path = shots / "transforms.json"
            path.write_text(json.dumps(json.loads(path.read_text()) | {"pictures": "photographs"}))
    return shots


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    a = parser.parse_args()
    a.folder.mkdir(parents=True, exist_ok=True)
    print("| capture | expected s | measured s | ratio | ratios | memory | unknowns | iterations | expected |")
    print("|---|" + "---:|" * 8)
    off = False
    for kind in a.kinds:
        shots, words = capture(a.folder, kind, a.threads), KINDS[kind][1].split()
        plans, runs = [], []
        for _ in range(a.repeats):
            plans.append(program("plan", shots, *words, threads=a.threads))
            output = a.folder / "found.vdb"
            output.unlink(missing_ok=True)
            runs.append(program("reconstruct", "density", shots, *words, "-o", output, threads=a.threads))
        expected = [plan["expected"]["seconds"] for plan in plans]
        measured = [run["seconds"] for run in runs]
        ratios = [e / m for e, m in zip(expected, measured, strict=True)]
        ratio = statistics.median(expected) / statistics.median(measured)
        off |= not 0.7 <= ratio <= 1.3
        plan, run = plans[-1], runs[-1]
        memory = plan["expected"]["memory_mb"] / run["peak_memory_mb"]
        unknowns = plan["expected"]["unknowns"] / run["unknowns"]
        times = f"{statistics.median(expected):.2f} | {statistics.median(measured):.2f} | {ratio:.2f}"
        ranges = f"{min(ratios):.2f}-{max(ratios):.2f} | {memory:.2f} | {unknowns:.2f}"
        print(f"| {kind} | {times} | {ranges} | {run['iterations']} | {plan['iterations'][1]:.0f} |", flush=True)
        stages = {stage["name"]: stage["seconds"] for stage in plan["stages"]}
        pairs = (f"{s['name']} {stages.get(s['name'], 0):.2f}/{s['seconds']:.2f}" for s in run["stages"])
        print("  " + ", ".join(pairs), file=sys.stderr, flush=True)
    return int(off)


if __name__ == "__main__":
    sys.exit(main())
