"""Sequences that are drawn, so that their truth is known: what `cumulo denoise` leaves of their noise, and what it tells of it.

    drawn_sequences.py FOLDER [--only NAME ...] [--noises NOISE ...] [--frames N] [--motion KIND] [--json OUT.json]
                       [--figure OUT.png] [--keep]

Thirty-four sequences of 24 frames of 128x128 pixels, at rest and moving, with motion and without, sharp and smooth, each
with Gaussian noise of deviations 0, 0.0001, 0.01 and 0.1 and with that of 64 and 2 paths of heavy tails. A row has decibels (of a
peak of 1) that go in and come out over all frames, the frame that gains least, the mean of all frames where the sequence is
at rest, and the noise and error that the program tells, in decibels, too, or a dash. Pictures are kept in FOLDER with `--keep`.
`--frames 1` takes the middle frame alone, and so on. `--motion unknown` writes motions that are not numbers, `--motion wrong`
such as are off by (5, 3) pixels. `--figure` draws some of them: noisy, denoised as published (`--method wrls`) and by default, and true.
Needs numpy, OpenEXR and Pillow (`peers/requirements-denoisers.txt`). CUMULO is the program, `cumulo` by default.
"""

import argparse
import json
import os
import pathlib
import shutil
import subprocess

import numpy as np
import OpenEXR
from PIL import Image, ImageDraw

SIDE = 128
FRAMES = 24
SHADE = np.array([1, 0.9, 0.7], np.float32)
Y, X = np.mgrid[0:SIDE, 0:SIDE].astype(np.float32) + 0.5
SLOW = (0.37, 0.21)


def hashed(i, j):
    """Random numbers, 0 to 1, by two whole numbers."""
    h = (i.astype(np.int64).astype(np.uint32) * np.uint32(0x9E3779B9)) ^ (j.astype(np.int64).astype(np.uint32) * np.uint32(0x85EBCA6B))
    h = (h ^ (h >> 15)) * np.uint32(0x2C1B3C6D)
    h = (h ^ (h >> 12)) * np.uint32(0x297A2D39)
    return ((h ^ (h >> 15)) >> 8).astype(np.float32) / 16777216


def grain(x, y):
    """Value noise of a period of 1."""
    i, j = np.floor(x), np.floor(y)
    u, v = (w * w * (3 - 2 * w) for w in (x - i, y - j))
    upper = hashed(i, j) * (1 - u) + hashed(i + 1, j) * u
    lower = hashed(i, j + 1) * (1 - u) + hashed(i + 1, j + 1) * u
    return upper * (1 - v) + lower * v


def checkers(x, y):
    return np.where((np.floor(x / 6) + np.floor(y / 6)) % 2 < 1, 0.8, 0.1)


def text(x, y):
    i, j = np.floor(x / 2), np.floor(y / 2)
    return np.where((j % 6 < 4) & (hashed(i, j) > 0.5), 0.05, 0.9)


def zone(x, y):
    return 0.5 + 0.4 * np.cos(0.015 * ((x - 64) ** 2 + (y - 64) ** 2))


def shades(x, y):
    return 0.5 + 0.4 * np.sin(0.05 * x) * np.cos(0.04 * y)


def texture(x, y):
    return 0.3 + 0.25 * grain(x / 3, y / 3) + 0.2 * grain(x / 9 + 7, y / 9) + 0.2 * grain(x / 1.7, y / 1.7 + 3)


def lines(x, y):
    return np.where(np.floor(x) % 16 == 3, 0.9, 0.1) + 0 * y


def spot(x, y, at=(64, 60), size=300):
    return 0.9 * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / size)


def smooth_pixels(of, x, y):
    """Means over 4x4 points of each pixel."""
    steps = (np.arange(4) + 0.5) / 4 - 0.5
    return sum(of(x + a, y + b) for a in steps for b in steps) / 16


def moving(of, by=SLOW, anti_aliased=True):
    def frame(t):
        x, y = X - by[0] * t, Y - by[1] * t
        return smooth_pixels(of, x, y) if anti_aliased else of(x, y)

    return frame


def disk(x, y):
    return np.where(np.hypot(x - 64, y - 64) < 50, 1.0, 0.0)


def turning(t):
    c, s = np.cos(0.02 * t), np.sin(0.02 * t)

    def of(x, y):
        a, b = x - 64, y - 64
        return disk(x, y) * texture(c * a + s * b, c * b - s * a)

    return smooth_pixels(of, X, Y)


def turn_motion():
    c, s = np.cos(0.02), np.sin(0.02)
    a, b = X - 64, Y - 64
    return np.stack([a - (c * a + s * b), b - (c * b - s * a)], -1)


def smoke(t):
    x = X - 0.8 * t
    shape = 1 - ((x - 50) / 35) ** 2 - ((Y - 64) / 40) ** 2
    return 1 - np.exp(-2 * np.clip(shape, 0, None) * (0.4 + 0.6 * grain(x / 12, Y / 12)))


def sequences():
    """By name: the picture at a time, its motion in pixels to the right and downwards a frame, and its alpha."""
    stars = np.where(hashed(X, Y) > 1 - 60 / SIDE**2, 0.8, 0.02)
    written, light = smooth_pixels(text, X, Y), np.random.default_rng(5).uniform(0.98, 1.02, FRAMES)
    wall, own = smooth_pixels(texture, X, Y), smooth_pixels(zone, X, Y)
    still = lambda picture: (lambda t: picture)  # noqa: E731
    lit = lambda picture, after: (lambda t: picture * (1 if t < 12 else after))  # noqa: E731
    mirrored = lambda t: spot(X if t < 12 else SIDE - X, Y, (40, 60), 500) + 0.1 * shades(X, Y)  # noqa: E731
    return {
        "rest checkers": (still(checkers(X, Y)), None, "full"),
        "rest checkers, no alpha": (still(checkers(X, Y)), None, None),
        "rest zone plate": (still(zone(X, Y)), None, None),
        "rest texture": (still(wall), None, "full"),
        "rest text": (still(text(X, Y)), None, None),
        "rest lines": (still(lines(X, Y)), None, None),
        "rest stars": (still(stars), None, None),
        "rest shades": (still(shades(X, Y)), None, None),
        "rest spot": (still(spot(X, Y)), None, None),
        "rest dark checkers": (still(0.1 * checkers(X, Y)), None, None),
        "rest letterbox": (still(np.where(abs(Y - 64) < 40, wall, 0)), None, None),
        "rest bright edge": (still(np.where(X < 64, 50.0, 0.05)), None, None),
        "rest flat": (still(np.full_like(X, 0.4)), None, None),
        "moving checkers": (moving(checkers), SLOW, "full"),
        "moving hard checkers": (moving(checkers, anti_aliased=False), SLOW, None),
        "moving checkers, whole pixels": (moving(checkers, (1, 1), False), (1, 1), None),
        "moving zone plate": (moving(zone), SLOW, None),
        "moving text": (moving(text), SLOW, None),
        "moving texture": (moving(texture), SLOW, "full"),
        "moving shades": (moving(shades), SLOW, None),
        "turning disk": (turning, turn_motion(), smooth_pixels(disk, X, Y)),
        "pan without motion": (moving(texture, (3, 0)), None, None),
        "spot without motion": (lambda t: spot(X, Y, (20 + 3 * t, 60), 150), None, None),
        "checkers without motion": (moving(checkers, (2, 0), False), None, None),
        "text without motion": (moving(text, (1, 0)), None, None),
        "hard text without motion": (moving(text, (1.5, 0), False), None, None),
        "light halved": (lit(shades(X, Y), 0.5), None, None),
        "light on texture": (lit(wall, 0.6), None, None),
        "light fades": (lambda t: shades(X, Y) * 0.93**t, None, None),
        "light flickers": (lambda t: wall * (1 + 0.3 * (t % 2)), None, None),
        "light at random": (lambda t: written * light[t], None, None),
        "mirrored": (mirrored, None, None),
        "cut": (lambda t: wall if t < 12 else own, None, None),
        "smoke before texture": (lambda t: 0.7 * smoke(t) + (1 - smoke(t)) * wall, (0.8, 0), smoke),
    }


def noisy(truth, noise, random):
    kind, amount = noise
    if kind == "gauss":
        return truth + amount * random.standard_normal(truth.shape).astype(np.float32)
    # Squares of exponential numbers have heavy tails; their mean is 2.
    paths = random.exponential(size=(int(amount), SIDE, SIDE, 1)) ** 2 / 2
    return (truth * paths.mean(0)).astype(np.float32)


NOISES = {"0": ("gauss", 0), "1e-4": ("gauss", 1e-4), "1%": ("gauss", 0.01), "10%": ("gauss", 0.1), "64 paths": ("paths", 64), "2 paths": ("paths", 2)}


def write(path, color, alpha, motion):
    channels = {c: np.ascontiguousarray(color[..., i]) for i, c in enumerate("RGB")}
    if alpha is not None:
        channels["A"] = np.ascontiguousarray(alpha, np.float32)
    if motion is not None:
        right, down = (np.broadcast_to(np.float32(motion)[..., i], (SIDE, SIDE)) for i in range(2))
        # To the place in the frame before, to the right and upwards, and the same from the frame after.
        planes = {"X": -right, "Y": down, "Z": -right, "W": down}
        channels |= {f"Vector.{c}": np.ascontiguousarray(plane, np.float32) for c, plane in planes.items()}
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels).write(str(path))


def decibels(square):
    return -10 * np.log10(max(square, 1e-20))


def draw(folder, name, noise, frames=FRAMES, kind="true"):
    """The true and the noisy pictures of so many frames of a sequence, `[frame, row, column, channel]`; the latter go to FOLDER/in."""
    of, motion, alpha = sequences()[name]
    if kind != "true":
        motion = np.add((0, 0) if motion is None else motion, np.nan if kind == "unknown" else (5, 3))
    random = np.random.default_rng(7)
    truth = np.stack([of(t)[..., None] * SHADE for t in range(FRAMES)]).astype(np.float32)
    given = np.stack([noisy(frame, NOISES[noise], random) for frame in truth])
    (folder / "in").mkdir(parents=True, exist_ok=True)
    first = (FRAMES - frames) // 2
    for t in range(first, first + frames):
        mask = np.ones((SIDE, SIDE)) if isinstance(alpha, str) else alpha(t) if callable(alpha) else alpha
        write(folder / f"in/frame.{t:04}.exr", given[t], mask, motion)
    return truth[first : first + frames], given[first : first + frames]


def denoise(folder, *words):
    """The pictures of FOLDER/in denoised, and the program's report."""
    command = [os.environ.get("CUMULO", "cumulo"), "denoise", folder / "in/frame.####.exr", "-o", folder / "out/frame.####.exr"]
    done = subprocess.run([*map(str, command), "--json", "--overwrite", *words], check=True, capture_output=True, text=True)
    found = []
    for path in sorted((folder / "out").iterdir()):
        with OpenEXR.File(str(path), separate_channels=True) as file:
            found.append(np.stack([file.channels()[c].pixels for c in "RGB"], -1))
    return np.stack(found), json.loads(done.stdout)


def figure(folder, path):
    """A sheet of crops of the middle frames of some sequences."""
    crop, zoom, margin, gap = 64, 3, 16, 4
    shown = [("light flickers", "10%"), ("rest text", "10%"), ("moving text", "1%")]
    step = crop * zoom
    sheet = Image.new("RGB", (4 * (step + gap) - gap, len(shown) * (step + margin) + margin), "black")
    pen = ImageDraw.Draw(sheet)
    for row, (name, noise) in enumerate(shown):
        truth, given = draw(folder / "figure", name, noise)
        pictures = [given, denoise(folder / "figure", "--method", "wrls")[0], denoise(folder / "figure")[0], truth]
        shutil.rmtree(folder / "figure")
        top = margin + row * (step + margin)
        for column, (title, picture) in enumerate(zip(("noisy", "wrls, as published", "wrls2", "true"), pictures, strict=True)):
            part = np.clip(picture[FRAMES // 2, 32 : 32 + crop, 32 : 32 + crop], 0, 1) ** (1 / 2.2)
            tile = Image.fromarray(np.uint8(255 * part + 0.5)).resize((step, step), Image.Resampling.NEAREST)
            left = column * (step + gap)
            sheet.paste(tile, (left, top + margin))
            error = decibels(((np.float64(picture) - truth) ** 2).mean())
            words = f"{name}, noise {noise}" if title == "noisy" else title if title == "true" else f"{title}: {error:.1f} dB"
            pen.text((left + 4, top + 2), words, fill="white")
    sheet.crop((0, margin, sheet.width, sheet.height)).save(path, optimize=True)


def run(folder, name, noise, options):
    """The row of a sequence."""
    folder = folder / f"{name}, {noise}".replace(" ", "_").replace(",", "").replace("%", "pc")
    truth, given = draw(folder, name, noise, options.frames, options.motion)
    found, report = denoise(folder)
    if not options.keep:
        shutil.rmtree(folder)
    square = lambda pictures: ((np.float64(pictures) - truth) ** 2).mean((1, 2, 3))  # noqa: E731
    before, after = square(given), square(found)
    gains = [decibels(b) - decibels(a) for a, b in zip(before, after, strict=True)]
    worst = int(np.argmin(gains))
    row = {"sequence": name, "noise": noise, "in": decibels(before.mean()), "out": decibels(after.mean()), "worst": gains[worst]}
    row |= {"worst_frame": worst, "mean": decibels(square(given.mean(0)[None])[0]) if name.startswith("rest") else None}
    told = report["estimate"]
    row |= {"told_in": told and decibels(told["noise"] ** 2), "told_out": told and decibels(told["error"] ** 2)}
    # What is told is of the frames that have two neighbours.
    inner = slice(1, -1) if len(truth) > 2 else slice(None)
    row |= {"true_in": decibels(before[inner].mean()), "true_out": decibels(after[inner].mean()), "cuts": report["cuts"]}
    return row


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--only", nargs="+", choices=sequences(), default=list(sequences()), metavar="NAME")
    parser.add_argument("--noises", nargs="+", choices=NOISES, default=list(NOISES), metavar="NOISE")
    parser.add_argument("--frames", type=int, choices=range(1, FRAMES + 1), default=FRAMES, metavar="N")
    parser.add_argument("--motion", choices=("true", "unknown", "wrong"), default="true")
    parser.add_argument("--json", type=pathlib.Path, metavar="OUT.json")
    parser.add_argument("--figure", type=pathlib.Path, metavar="OUT.png")
    parser.add_argument("--keep", action="store_true")
    options = parser.parse_args()
    if options.figure:
        return figure(options.folder, options.figure)
    print("| sequence | noise | in | out | least gain (frame) | mean of frames | inner frames: in, told | out, told | cuts |")
    print("|---|---|---|---|---|---|---|---|---|")
    rows = []
    for name in options.only:
        for noise in options.noises:
            row = run(options.folder, name, noise, options)
            rows.append(row)
            show = lambda key: "-" if row[key] is None else f"{row[key]:.1f}"  # noqa: E731
            cells = [name, noise, show("in"), show("out"), f"{row['worst']:+.1f} ({row['worst_frame']})", show("mean")]
            cells += [f"{show('true_in')}, {show('told_in')}", f"{show('true_out')}, {show('told_out')}"]
            print(f"| {' | '.join(cells)} | {', '.join(map(str, row['cuts']))} |", flush=True)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
