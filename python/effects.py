"""What each effect of light costs in time, and what its omission costs in accuracy: a table in Markdown, and a sheet.

    effects.py SMOKE.vdb [--samples 64] [--size 256] [--rounds 3] [--sheet SHEET.png]

SMOKE is a fog volume in the unit cube with densities up to 1, such as `make bench` makes (target/bench/smoke128.vdb).
Four scenes are rendered in full and without one effect after the other. Time is that of the rendering without the effect,
as a share of the full one, the median of rounds in turn; the error is the root mean square difference from the full
picture over its root mean square, after blocks of 8² pixels are averaged; the bound is what `cumulo plan` says.
Runs in Blender's environment. CUMULO is the program, `cumulo` by default.
"""

import argparse
import copy
import json
import os
import pathlib
import statistics
import subprocess
import tempfile

import bpy
import numpy as np

bpy.utils.expose_bundled_modules()
from cumulo.exr import read_exr  # noqa: E402  needs what was just exposed
from cumulo.sheet import blocks, srgb, write_png  # noqa: E402

SUN = {"type": "DistantLight", "direction": [0.4, -0.5, 0.8], "irradiance": [3, 3, 3], "angle": 0.53}
PANEL = {"type": "RectLight", "corner": [-0.5, -1.5, 2.0], "edges": [[0, 2, 0], [2, 0, 0]], "radiance": [4, 4, 4]}
SKY = {"type": "DomeLight", "radiance": [0.15, 0.2, 0.3]}
GLOW = {"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise", "points": [
    [0.02, 0, 0, 0, 0], [0.2, 0.6, 0.15, 0.02, 0.3], [0.5, 0.1, 0.1, 0.3, 0.2], [1, 0.9, 0.9, 0.8, 1]]}}  # fmt: skip

SCENES = {
    "thin plume, sun and sky": ({"density_scale": 2, "albedo": [0.9] * 3, "anisotropy": 0.3}, [SUN, SKY]),
    "smoke, white sky": ({"density_scale": 20, "albedo": [0.9] * 3}, [{**SKY, "radiance": [1, 1, 1]}]),
    "dense cloud, sun and sky": ({"density_scale": 100, "albedo": [0.99] * 3, "anisotropy": 0.85}, [SUN, SKY]),
    "transfer function, panel": ({"density_scale": 20, "albedo": [0.7] * 3, "transfer": "glow.tf.json"}, [PANEL]),
}


def without(scene, effect):
    """The scene file and options that leave an effect out; None where it is not there."""
    scene = copy.deepcopy(scene)
    medium, lights = scene["volumes"][0]["medium"], scene["lights"]
    domes = [light for light in lights if light["type"] == "DomeLight"]
    if effect == "full":
        return scene, []
    if effect == "scattering":
        return scene, ["--max-bounces", "0"]
    if effect == "multiple-scattering":
        return scene, ["--max-bounces", "1"]
    if effect == "anisotropy" and medium.pop("anisotropy", None):
        return scene, []
    if effect == "emission" and "transfer" in medium:
        medium["transfer"] = "dark.tf.json"
        return scene, []
    if effect == "light-0" and len(domes) < len(lights):
        return {**scene, "lights": domes}, []
    if effect == "environment" and domes:
        return {**scene, "lights": [light for light in lights if light not in domes]}, []
    return None


EFFECTS = ["scattering", "multiple-scattering", "anisotropy", "emission", "light-0", "environment"]


def run(*words):
    """The JSON of a command."""
    command = [os.environ.get("CUMULO", "cumulo"), *map(str, words), "--json", "--quiet"]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)


def study(scene, folder, a):
    """Pictures, seconds and bounds by effect."""
    variants = {effect: of for effect in ["full", *EFFECTS] if (of := without(scene, effect))}
    view = ["--views", 1, "--layout", "ring", "--size", f"{a.size}x{a.size}", "--background", 0]
    pictures, seconds, bounds = {}, {effect: [] for effect in variants}, {}
    for effect, (variant, _) in variants.items():
        (folder / f"{effect}.json").write_text(json.dumps(variant))
    plan = run("plan", folder / "full.json", *view, "--samples", a.samples)
    bounds = {planned["name"]: planned["bound"] for planned in plan["effects"]}
    for number in range(a.rounds):
        for effect, (_, options) in variants.items():
            options = [*options, "--samples", a.samples, "--seed", number, "--force", "scattering"]
            out = folder / effect
            report = run("render", folder / f"{effect}.json", *view, *options, "--overwrite", "-o", out)
            seconds[effect].append(report["seconds"])
            pictures.setdefault(effect, []).append(read_exr(out / "view_000.exr"))
    means = {effect: np.mean(of, axis=0) for effect, of in pictures.items()}
    return means, {effect: statistics.median(of) for effect, of in seconds.items()}, bounds


def main():
    """Prints the table and writes the sheet."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("smoke", type=pathlib.Path)
    p.add_argument("--samples", type=int, default=64)
    p.add_argument("--size", type=int, default=256)
    p.add_argument("--rounds", type=int, default=3)
    p.add_argument("--sheet", type=pathlib.Path)
    a = p.parse_args()
    print("| scene | without | time | error | bound |\n|---|---|---:|---:|---:|")
    rows = []
    for name, (medium, lights) in SCENES.items():
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            dark = copy.deepcopy(GLOW)
            for point in dark["transfer"]["points"]:
                point[1:4] = [0, 0, 0]
            (folder / "glow.tf.json").write_text(json.dumps(GLOW))
            (folder / "dark.tf.json").write_text(json.dumps(dark))
            volume = {"file": str(a.smoke.resolve()), "medium": medium}
            means, seconds, bounds = study({"volumes": [volume], "lights": lights}, folder, a)
        full = means["full"]
        print(f"| {name} | nothing | {seconds['full']:.2f} s | - | - |")
        for effect in (effect for effect in EFFECTS if effect in means):
            error = np.sqrt(np.mean((blocks(means[effect], 8) - blocks(full, 8)) ** 2) / np.mean(blocks(full, 8) ** 2))
            bound = bounds.get(effect)
            text = "-" if bound is None else f"{bound:.2g}"
            print(f"| | {effect} | {100 * seconds[effect] / seconds['full']:.0f} % | {100 * error:.1f} % | {text} |", flush=True)
        exposure = 0.8 / np.percentile(full[..., :3], 99.7)
        shown = ["full", "multiple-scattering", "anisotropy" if "anisotropy" in means else "emission", "environment", "light-0"]
        black = np.zeros_like(full)
        rows.append(np.hstack([srgb(blocks(means.get(effect, black), 2), exposure) for effect in shown]))
    if a.sheet:
        write_png(a.sheet, np.vstack(rows))


if __name__ == "__main__":
    main()
