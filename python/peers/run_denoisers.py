"""B9: what denoisers leave of the noise of path-traced sequences, beside each other.

    run_denoisers.py FOLDER [--only VOLUME-SCENARIO ...] [--methods NAME ...] [--json OUT.json]
                     [--markdown OUT.md] [--report DIR] [--figure OUT.png]
    run_denoisers.py FOLDER/VOLUME-SCENARIO --time [--threads 2] [--repeats 5]

FOLDER holds what `python/scenarios.py` rendered. Every sequence goes through `cumulo denoise` by each of its methods, through
Open Image Denoise (OIDN) frame by frame, by colors alone and with the noisy albedo beside them, and through an
exponential moving average over OIDN's frames. `cumulo compare` computes the figures of the judged frames against the
references. PSNR and flicker are those of display values (sRGB); `linear` ones are in the JSON, too. Denoised frames are kept in FOLDER/VOLUME-SCENARIO/METHOD, and those that are newer than the
noisy ones are taken as they are.

`--time` runs `cumulo denoise` and OIDN in turn on the noisy frames of a sequence, and prints milliseconds a frame, of denoising
alone and from file to file; all layers pass through on both sides. CUMULO is the program, `cumulo` by default.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np
import OpenEXR
import pyoidn
from PIL import Image, ImageDraw

CUMULO = os.environ.get("CUMULO", "cumulo")
METHODS = ["wrls2", "wrls", "rls", "svgf", "ema"]
PEERS = ["oidn", "oidn-albedo", "oidn-ema"]
FRAME = "frame.####.exr"
QUALITY = {"fast": 4, "balanced": 5, "high": 6}


def cumulo(*words):
    """Runs a command and returns its report. Exit code 1 says that pictures differ."""
    done = subprocess.run([CUMULO, *map(str, words), "--json", "--quiet"], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode not in (0, 1):
        sys.exit(f"cumulo {' '.join(map(str, words))} ended with {done.returncode}")
    return json.loads(done.stdout)


class Oidn:
    """Open Image Denoise on pictures of one size: `color` and `albedo` are `[height, width, 3]` f32, filled by the caller."""

    def __init__(self, width, height, albedo, quality="high", threads=2):
        self.color, self.output = (np.zeros((height, width, 3), np.float32) for _ in range(2))
        self.albedo = np.zeros_like(self.color) if albedo else None
        self.device = pyoidn.Device()
        self.device.set_int("numThreads", threads)
        self.device.set_bool("setAffinity", False)
        self.device.commit()
        self.filter = pyoidn.Filter(self.device, "RT")
        self.filter.set_image("color", self.color, pyoidn.OIDN_FORMAT_FLOAT3)
        self.filter.set_image("output", self.output, pyoidn.OIDN_FORMAT_FLOAT3)
        if albedo:
            self.filter.set_image("albedo", self.albedo, pyoidn.OIDN_FORMAT_FLOAT3)
        self.filter.set_bool("hdr", True)
        self.filter.set_quality(QUALITY[quality])
        self.filter.commit()

    def execute(self):
        """Denoises `color` to `output`."""
        self.filter.execute()
        error = self.device.get_error()
        if error and str(error[0] if isinstance(error, tuple) else error) not in ("0", "None"):
            sys.exit(f"OIDN: {error}")


def read(path):
    """Channels of a picture by name, each `[height, width]`."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: channel.pixels for name, channel in file.channels().items()}


def colors(channels, layer=""):
    """`[height, width, 3]` of a layer."""
    return np.stack([channels[layer + c] for c in "RGB"], -1)


def write(path, color):
    """Writes `[height, width, 3]`."""
    write_channels(path, {c: np.ascontiguousarray(color[..., i]) for i, c in enumerate("RGB")})


def write_channels(path, channels):
    """Writes channels by name, each `[height, width]`."""
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels).write(str(path))


def is_new(made, noisy):
    """True if all frames are there and newer than the noisy ones."""
    pairs = [(made / frame.name, frame) for frame in sorted(noisy.glob("frame.*.exr"))]
    return all(a.exists() and a.stat().st_mtime > b.stat().st_mtime for a, b in pairs)


def run_oidn(noisy, made, albedo):
    """Denoises each frame on its own."""
    oidn = None
    for frame in sorted(noisy.glob("frame.*.exr")):
        channels = read(frame)
        color = colors(channels)
        oidn = oidn or Oidn(color.shape[1], color.shape[0], albedo)
        oidn.color[:] = color
        if albedo:
            oidn.albedo[:] = colors(channels, "Denoising Albedo.")
        oidn.execute()
        write(made / frame.name, oidn.output)


def denoise(folder, method):
    """Frames by a method in FOLDER/METHOD."""
    noisy, made = folder / "noisy", folder / method
    if is_new(made, noisy):
        return
    made.mkdir(exist_ok=True)
    # Frames of other programs have their motion beside them.
    motions = folder / "motion"
    motion = ["--motion", f"files:{motions / FRAME}"] if motions.exists() else []
    if method == "oidn-ema":
        denoise(folder, "oidn")
        motion = motion or ["--motion", f"files:{noisy / FRAME}"]
        cumulo("denoise", folder / "oidn" / FRAME, "-o", made / FRAME, "--overwrite", "--method", "ema", *motion)
    elif method in COMPOSED:
        COMPOSED[method](folder, made)
    elif method in PEERS:
        run_oidn(noisy, made, method == "oidn-albedo")
    else:
        words = VARIANTS.get(method, ["--method", method])
        cumulo("denoise", noisy / FRAME, "-o", made / FRAME, "--overwrite", *words, *motion)


# Variants of wrls2: each without a part of it.
VARIANTS = {"forward": ["--direction", "forward"], "no-guide": ["--guide", "none"]}


def apart(folder, made):
    """Direct and indirect light, denoised apart and added."""
    layers = ["Volume Direct", "Volume Indirect"]
    cumulo("denoise", folder / "noisy" / FRAME, "-o", made / FRAME, "--overwrite", "--layers", ",".join(layers))
    for frame in sorted(made.glob("frame.*.exr")):
        channels = read(frame)
        write(frame, sum(colors(channels, layer + ".") for layer in layers))


def demodulated(folder, made):
    """Colors over the albedo of first collisions, and that albedo, denoised apart and multiplied."""
    parts = made / "parts"
    parts.mkdir(exist_ok=True)
    frames = sorted((folder / "noisy").glob("frame.*.exr"))
    for frame in frames:
        channels = read(frame)
        albedo = colors(channels, "Denoising Albedo.")
        channels |= {c: np.where(a > 0, channels[c] / np.maximum(a, 1e-3), 0) for c, a in zip("RGB", np.moveaxis(albedo, -1, 0))}
        write_channels(parts / frame.name, channels)
    for layer, to in (("Denoising Albedo", "albedo"), ("", "ratio")):
        (made / to).mkdir(exist_ok=True)
        words = ["--layers", layer] if layer else []
        cumulo("denoise", parts / FRAME, "-o", made / to / FRAME, "--overwrite", *words)
    for frame in frames:
        albedo = colors(read(made / "albedo" / frame.name), "Denoising Albedo.")
        write(made / frame.name, colors(read(made / "ratio" / frame.name)) * albedo)


COMPOSED = {"apart": apart, "demodulated": demodulated}


def figures(folder, method):
    """PSNR, flicker and others of the frames that the reference has."""
    pair = [folder / method / FRAME, folder / "reference" / FRAME]
    linear, display = cumulo("compare", *pair), cumulo("compare", *pair, "--display", "--flip")
    keys = ["psnr_db", "flicker_psnr_db", "ssim", "rel_mse"]
    return {"linear": {k: linear[k] for k in keys}} | {k: display[k] for k in [*keys, "flip"]}


def table(rows, methods, key, digits):
    """A Markdown table of one figure: sequences down, methods across."""
    lines = ["| sequence | " + " | ".join(methods) + " |", "|---|" + "---|" * len(methods)]
    for name, of in rows.items():
        cells = [f"{of[m][key]:.{digits}f}" if m in of else "" for m in methods]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    means = [statistics.mean(of[m][key] for of in rows.values() if m in of) for m in methods]
    lines.append("| mean | " + " | ".join(f"{v:.{digits}f}" for v in means) + " |")
    return "\n".join(lines)


def figure(folders, path):
    """A frame of each sequence as noise, by OIDN, by wrls2 and converged, and the errors below, 12 times enlarged."""
    methods = {"noisy": "few paths", "oidn-albedo": "Open Image Denoise with albedo", "wrls2": "cumulo denoise", "reference": "reference"}
    lines = []
    for folder in folders:
        references = sorted((folder / "reference").glob("frame.*.exr"))
        frame = references[len(references) // 2].name
        linear = [np.clip(colors(read(folder / method / frame)), 0, 1) for method in methods]
        shown = [np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 1e-9) ** (1 / 2.4) - 0.055) for v in linear]
        lines += [np.concatenate(shown, 1), np.concatenate([np.clip(12 * abs(v - shown[-1]), 0, 1) for v in shown], 1)]
    picture = Image.fromarray((255 * np.concatenate(lines, 0) + 0.5).astype(np.uint8))
    draw = ImageDraw.Draw(picture)
    height, width = (n // d for n, d in zip(np.concatenate(lines, 0).shape, (len(lines), len(methods))))
    for place, text in enumerate(methods.values()):
        draw.text((place * width + 6, 4), text, fill=(230, 230, 230))
    for row in range(1, len(lines), 2):
        draw.text((6, row * height + 4), "errors x 12", fill=(230, 230, 230))
    picture.quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)


def judge(rows, peer):
    """How many sequences `wrls2` wins: in flicker, and in PSNR."""
    wins = [[of["wrls2"][k] >= of[peer][k] for of in rows.values()] for k in ("flicker_psnr_db", "psnr_db")]
    both = sum(a and b for a, b in zip(*wins))
    return f"wrls2 beside {peer}: steadier in {sum(wins[0])}, nearer in {sum(wins[1])}, both in {both} of {len(rows)}"


def quality(a):
    """Tables of all sequences."""
    rows = {}
    methods = a.methods or ["noisy", *METHODS, *PEERS]
    for folder in sorted(path.parent for path in a.folder.glob("*/reference")):
        if a.only and folder.name not in a.only:
            continue
        for method in methods:
            if method != "noisy":
                denoise(folder, method)
        rows[folder.name] = {method: figures(folder, method) for method in methods}
        print(folder.name, *(f"{m} {rows[folder.name][m]['psnr_db']:.1f}/{rows[folder.name][m]['flicker_psnr_db']:.1f}" for m in methods), file=sys.stderr, flush=True)
        if a.report:
            words = ["--beside", folder / "noisy" / FRAME, "--flip", "--report", a.report / folder.name]
            cumulo("compare", folder / "wrls2" / FRAME, folder / "reference" / FRAME, *words)
    titles = [("psnr_db", "PSNR, dB", 1), ("flicker_psnr_db", "PSNR of the changes from frame to frame, dB", 1)]
    titles += [("ssim", "SSIM", 4), ("flip", "FLIP", 4)]
    parts = [f"{title}\n\n{table(rows, methods, key, digits)}" for key, title, digits in titles]
    if "wrls2" in methods:
        parts.append("\n".join(f"- {judge(rows, m)}" for m in methods if m not in ("noisy", "wrls2")))
    text = "\n\n".join(parts) + "\n"
    print(text)
    if a.markdown:
        a.markdown.write_text(text)
    if a.json:
        a.json.write_text(json.dumps(rows, indent=1))
    if a.figure:
        figure([a.folder / name for name in rows], a.figure)


def timing(a):
    """Milliseconds a frame, in turn."""
    noisy = sorted((a.folder / "noisy").glob("frame.*.exr"))
    ways = {"both directions": [], "forward": ["--direction", "forward"], "as published": ["--method", "wrls"]}
    rows = {(name, end): [] for name in [*ways, "oidn"] for end in ("alone", "file to file")}
    with tempfile.TemporaryDirectory() as name:
        out = pathlib.Path(name)
        height, width, _ = colors(read(noisy[0])).shape
        oidn = Oidn(width, height, False, "high", a.threads)
        for _ in range(a.repeats):
            for way, words in ways.items():
                words = [*words, "--threads", a.threads, "--overwrite"]
                report = cumulo("denoise", a.folder / "noisy" / FRAME, "-o", out / FRAME, *words)
                rows[way, "alone"].append(1e3 * report["seconds_denoising"] / len(noisy))
                rows[way, "file to file"].append(1e3 * report["seconds"] / len(noisy))
            began, alone = time.perf_counter(), 0.0
            for frame in noisy[: a.oidn_frames]:
                channels = read(frame)
                oidn.color[:] = colors(channels)
                start = time.perf_counter()
                oidn.execute()
                alone += time.perf_counter() - start
                channels |= {c: np.ascontiguousarray(oidn.output[..., i]) for i, c in enumerate("RGB")}
                write_channels(out / frame.name, channels)
            rows["oidn", "alone"].append(1e3 * alone / a.oidn_frames)
            rows["oidn", "file to file"].append(1e3 * (time.perf_counter() - began) / a.oidn_frames)
    print(f"{width}x{height}, {a.threads} threads\n\n| way | alone, ms | file to file, ms | OIDN file to file over it |\n|---|---|---|---|")
    for way in [*ways, "oidn"]:
        times = [statistics.median(rows[way, end]) for end in ("alone", "file to file")]
        ratios = [o / m for o, m in zip(rows["oidn", "file to file"], rows[way, "file to file"])]
        print(f"| {way} | {times[0]:.0f} | {times[1]:.0f} | {statistics.median(ratios):.1f} |")


def main():
    """Parses the command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("folder", type=pathlib.Path)
    p.add_argument("--only", nargs="+")
    p.add_argument("--methods", nargs="+")
    p.add_argument("--json", type=pathlib.Path)
    p.add_argument("--markdown", type=pathlib.Path)
    p.add_argument("--report", type=pathlib.Path)
    p.add_argument("--figure", type=pathlib.Path)
    p.add_argument("--time", action="store_true")
    p.add_argument("--threads", type=int, default=2)
    p.add_argument("--repeats", type=int, default=5)
    p.add_argument("--oidn-frames", type=int, default=6)
    a = p.parse_args()
    if a.time:
        timing(a)
    else:
        quality(a)


if __name__ == "__main__":
    main()
