#!/usr/bin/env python3
"""Error against time: pictures through a transfer function beside VTK, paths beside Mitsuba 3 and Cycles, denoised and not.

    accuracy_plot.py PEERS_ENV [--rounds 5] [--panel 'transfer function'|paths] [--plot]

Writes `tests/benches/error-against-time.json` and `.svg`, which the README shows; `--panel` measures one of the panels and
keeps the other, `--plot` draws what the JSON has. Errors are root mean squares over the picture, divided by the picture's
own. Times are processor time of all threads, medians of runs in turn, without start, reading, tables and writing, which
are left out as the docstrings below say.

PEERS_ENV is the environment of `python/peers/requirements-peers.txt`; Blender's is `.venvs/bpy` (`python/setup.sh bpy`), or
BPY_ENV. Runs under Debian's Python with python3-numpy and python3-openvdb, as `bench.py` does. CUMULO is the program.
"""

import argparse
import datetime
import html
import json
import math
import os
import pathlib
import random
import statistics
import sys

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "python"), str(ROOT / "python" / "peers")]
import bench  # noqa: E402  from this checkout
import run_paths  # noqa: E402

RESULT = ROOT / "tests" / "benches" / "error-against-time.json"
OUT = bench.OUT / "error-against-time"
THREADS = 2
# B1's head through `bone`, as run_vtk.py and tests/benches/dvr.rs have them.
HEAD, FUNCTION, PIXELS, ANGLE, TURN, STRIDE = "head", "bone", 512, 30.0, 0.3, 8
KNOTS, OPACITIES = [0, 0.15, 0.25, 0.45, 0.55, 1], [0, 0, 0.03, 0.03, 0.53, 0.53]
STEPS = [4, 2, 1, 0.5]
RULES = ["midpoint:4", "midpoint:2", "midpoint:1", "midpoint:0.7", "midpoint:0.5", "preintegrated:0.1", "preintegrated", "exact"]
# Rays along each edge of a pixel, whose time beyond that of one ray counts.
EDGE = 2
# B8's plume in sun light; paths a pixel of pictures, of denoised sequences and of the reference.
SCENE, SAMPLES, DENOISED, REFERENCE = "sun", [16, 64, 256], [1, 4, 16], 4096
# Frames of a denoised sequence, whose middle one is compared, and degrees between them.
FRAMES, STEP = 25, 1.5


def pixels(picture):
    """Colors of an EXR."""
    bench.output([os.environ.get("CUMULO", "cumulo"), "convert", picture, OUT / "picture.npy"])
    return np.load(OUT / "picture.npy")[..., :3].astype(np.float64)


def relative(picture, truth):
    """Root mean square of the difference, divided by that of the truth."""
    return float(np.sqrt(np.mean((picture - truth) ** 2) / np.mean(truth**2)))


def around(turn, middle, eye):
    """Camera to world from `eye`, turned about a vertical axis through `middle`, towards it."""
    c, s = math.cos(turn), math.sin(turn)
    back = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ (np.array(eye) - middle)
    place = np.eye(4)
    place[:3, 3] = middle + back
    back /= np.linalg.norm(back)
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    place[:3, 0], place[:3, 1], place[:3, 2] = right, np.cross(back, right), back
    return place


class Head:
    """Pictures of the head through a transfer function: Cumulo's seconds are a third of what 2 x 2 rays a pixel take longer
    than one, VTK's those of a frame after the first one. The truth is the exact integral; rays of VTK may go elsewhere
    through a pixel, and the best of nine places counts for it."""

    def __init__(self, environment):
        self.python = environment / "bin" / "python"
        self.array, self.grid = bench.subject_of_pictures(HEAD)
        shape = np.load(self.array, mmap_mode="r").shape[::-1]
        middle, edge = (np.array(shape) - 1) / 2, max(shape)
        self.place = around(TURN, middle, middle + edge * np.array([2.4, 0, 0.6]))
        points = [[x, x, 0.5 + 0.5 * math.sin(6 * x), 1 - x, -math.log1p(-y)] for x, y in zip(KNOTS, OPACITIES)]
        document = {"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise", "points": points}}
        (OUT / "function.tf.json").write_text(json.dumps(document))
        shifts = [(0.5 * (k // 3 - 1), 0.5 * (k % 3 - 1)) for k in range(9)]
        truths = [self.render("exact", 1, shift, "--early-stop", 0)[0] for shift in shifts]
        self.truth = truths[4]
        np.stack([truth[::STRIDE, ::STRIDE] for truth in truths]).tofile(OUT / "light.f64")
        self.errors, self.seconds = {}, {}

    def render(self, rule, edge, shift=(0, 0), *options):
        """Picture and processor seconds of the whole command."""
        frame = {"file_path": "view_000.exr", "transform_matrix": self.place.tolist()}
        camera = {"w": PIXELS, "h": PIXELS, "fl_x": PIXELS / 2 / math.tan(math.radians(ANGLE / 2)), "frames": [frame]}
        camera |= {"cx": PIXELS / 2 - shift[1], "cy": PIXELS / 2 - shift[0]}
        (OUT / "head.json").write_text(json.dumps(camera))
        words = ["--tf", OUT / "function.tf.json", "--cameras", OUT / "head.json", "--quadrature", rule, "--supersample", edge, *options]
        seconds = run_paths.run("render", self.grid, *words, "--threads", THREADS, "-o", OUT / "head")[1]
        return pixels(OUT / "head" / "view_000.exr"), seconds

    def ours(self, rule):
        """A run of one rule."""
        picture, one = self.render(rule, 1)
        self.errors["Cumulo", rule] = relative(picture, self.truth)
        seconds = (self.render(rule, EDGE)[1] - one) / (EDGE**2 - 1)
        self.seconds.setdefault(("Cumulo", rule), []).append(seconds)

    def vtk(self):
        """A run of VTK's settings."""
        words = [self.array, "--function", FUNCTION, "--threads", THREADS, "--light", OUT / "light.f64", "--steps", *STEPS]
        line = json.loads(bench.output([self.python, bench.PEERS / "run_vtk.py", *words]).splitlines()[-1])
        size = np.sqrt(np.mean(self.truth**2))
        for setting in line["settings"]:
            bits, step = setting["setting"].split(", ")
            key = f"VTK, {bits}", step
            self.errors[key] = 10 ** (-setting["psnr_db"] / 20) / size
            self.seconds.setdefault(key, []).append(setting["seconds"])

    def tasks(self):
        """The runs of a round."""
        return [self.vtk, *((lambda rule=rule: self.ours(rule)) for rule in RULES)]

    def rows(self):
        """Points of the plot."""
        return [point("transfer function", *key, self.errors[key], of) for key, of in self.seconds.items()]


class Paths:
    """Path-traced pictures. Seconds are what a picture takes longer than one of a single path (`run_paths.py`); errors are
    deviations from the program's own mean, of which the picture's root mean square is taken, too."""

    def __init__(self, environment, rounds):
        blender = pathlib.Path(os.environ.get("BPY_ENV", ROOT / ".venvs" / "bpy"))
        self.pythons, self.rounds = {"mitsuba": environment, "cycles": blender}, rounds
        self.found = {}

    def run(self, peer):
        """All rounds beside a peer, in turn."""
        words = [bench.PEERS / "run_paths.py", *bench.smoke(128), "--peer", peer, "--only", SCENE, "--threads", THREADS]
        command = [self.pythons[peer] / "bin" / "python", *words, "--rounds", self.rounds, "--samples", *SAMPLES]
        printed = bench.output(command, PYTHONPATH=str(ROOT / "python"), **bench.llvm()).splitlines()
        lines = [json.loads(line) for line in printed if '"B8"' in line]
        for line in lines:
            for side, name in (("cumulo", "Cumulo"), (peer, {"mitsuba": "Mitsuba 3", "cycles": "Cycles"}[peer])):
                size = lines[-1][side]["rms"]
                found = self.found.setdefault((name, f"{line['samples']} paths"), (line[side]["deviation"] / size, []))
                found[1].extend(line[side]["runs"])

    def rows(self):
        """Points of the plot; Cumulo was measured beside each peer."""
        return [point("paths", *key, *of) for key, of in self.found.items()]


class Denoised:
    """The middle frame of a sequence whose camera turns about the plume, rendered with few paths and denoised. Seconds are those
    of both commands with start, reading and writing, divided by the number of frames."""

    def __init__(self):
        self.scene = run_paths.write_scene(run_paths.SCENES[SCENE], bench.smoke(128)[1], OUT)
        self.cameras, middle = OUT / "orbit.json", np.array(run_paths.TARGET)
        turns = [math.radians(STEP * (k - FRAMES // 2)) for k in range(FRAMES)]
        run_paths.write_cameras(self.cameras, [around(turn, middle, run_paths.EYE) for turn in turns])
        run_paths.write_cameras(OUT / "middle.json", [run_paths.camera_matrix()])
        self.render(OUT / "middle.json", REFERENCE, 10**6, OUT / "middle")
        self.truth = pixels(OUT / "middle" / "view_000.exr")
        self.found, self.seed = {}, 0

    def render(self, cameras, samples, seed, out, *options):
        """Seconds of a render."""
        words = ["--cameras", cameras, "--samples", samples, "--seed", seed, "--threads", THREADS, *options]
        return run_paths.run("render", self.scene, *words, "-o", out)[1]

    def ours(self, samples):
        """A run with so many paths."""
        self.seed += 1
        frames, middle = ("--frames", f"0-{FRAMES - 1}", "--aov", "motion"), f"frame.{FRAMES // 2:04}.exr"
        rendered = self.render(self.cameras, samples, 1000 * self.seed, OUT / "noisy", *frames)
        words = [OUT / "noisy" / "frame.%04d.exr", "--threads", THREADS, "-o", OUT / "quiet" / "frame.%04d.exr"]
        denoised = run_paths.run("denoise", *words)[1]
        for name, folder, seconds in (("rendered", "noisy", rendered), ("Cumulo, denoised", "quiet", rendered + denoised)):
            error = relative(pixels(OUT / folder / middle), self.truth)
            self.found.setdefault((name, f"{samples} paths"), []).append((error, seconds / FRAMES))

    def tasks(self):
        """The runs of a round."""
        return [(lambda samples=samples: self.ours(samples)) for samples in DENOISED]

    def rows(self):
        """Points, without the noise of the reference; those of the frames before denoising are not drawn."""
        square = {key: statistics.mean(error**2 for error, _ in of) for key, of in self.found.items()}
        noise = square["rendered", f"{DENOISED[-1]} paths"] * DENOISED[-1] / (DENOISED[-1] + REFERENCE)
        errors = {key: math.sqrt(max(of - noise, 0.0)) for key, of in square.items()}
        return [point("paths", *key, errors[key], [seconds for _, seconds in of]) for key, of in self.found.items()]


def point(panel, program, setting, error, seconds):
    """A point of the plot."""
    row = {"panel": panel, "program": program, "setting": setting, "error": float(f"{error:.4g}")}
    return row | {"seconds": float(f"{statistics.median(seconds):.4g}"), "runs": [round(s, 4) for s in seconds]}


def measure(environment, rounds, panel):
    """All points of a panel, and when and on which machine they were taken."""
    OUT.mkdir(parents=True, exist_ok=True)
    before, order = os.getloadavg()[0], random.Random(1)
    paths = Paths(environment, rounds) if panel == "paths" else None
    timed = Denoised() if paths else Head(environment)
    for number in range(rounds):
        tasks = timed.tasks()
        bench.say(f"{panel}: round {number + 1} of {rounds}")
        for task in order.sample(tasks, len(tasks)):
            task()
    for peer in paths.pythons if paths else ():
        bench.say(f"paths beside {peer}")
        paths.run(peer)
    machine = f"{bench.processor()}, {os.cpu_count()} cores, load {before:.1f} before and {os.getloadavg()[0]:.1f} after"
    taken = {"date": datetime.date.today().isoformat(), "machine": machine, "rounds": rounds}
    return taken, (paths.rows() if paths else []) + timed.rows()


def updated(document, environment, rounds, panels):
    """The document with these panels measured anew."""
    for panel in panels:
        document["taken"][panel], rows = measure(environment, rounds, panel)
        document["points"] = [row for row in document["points"] if row["panel"] != panel] + rows
    return document


def of(document, *programs):
    """Points of these programs by time."""
    return sorted((row for row in document["points"] if row["program"] in programs), key=lambda row: row["seconds"])


def summary(document):
    """The ratios that the README states, as sentences."""
    cast, vtk = [r for r in of(document, "Cumulo") if r["panel"] == "transfer function"], of(document, "VTK, 8 bits", "VTK, 16 bits")
    best = min(vtk, key=lambda row: row["error"])
    enough = min((row for row in cast if row["error"] <= best["error"]), key=lambda row: row["seconds"])
    default = next(row for row in cast if row["setting"] == "preintegrated")
    yield f"VTK at its best ({best['program']}, {best['setting']}): {best['error']:.2e} in {best['seconds']:.3f} s"
    for row in vtk:
        near = min((r for r in cast if r["error"] <= 1.01 * row["error"]), key=lambda r: r["seconds"])
        yield f"  at {row['program']}, {row['setting']}, {row['error']:.2e}: Cumulo, {near['setting']} in {near['seconds'] / row['seconds']:.2f} times the time"
    for row in (enough, default):
        errors, times = best["error"] / row["error"], row["seconds"] / best["seconds"]
        yield f"  Cumulo, {row['setting']}: {errors:.1f} times less error in {times:.2f} times the time"
    cost = {(row["program"], row["setting"]): row["seconds"] * row["error"] ** 2 for row in document["points"] if row["panel"] == "paths"}
    for peer in ("Cycles", "Mitsuba 3"):
        counts = [f"{n} paths" for n in SAMPLES if (peer, f"{n} paths") in cost]
        ratios = [cost[peer, n] / cost["Cumulo", n] for n in counts]
        yield f"{peer}: {', '.join(f'{r:.1f}' for r in ratios)} times Cumulo's time to equal error"
    # Of independent paths the error falls with the root of the time.
    plain = statistics.median(cost["Cumulo", f"{n} paths"] for n in SAMPLES)
    for row in of(document, "Cumulo, denoised"):
        times = plain / row["error"] ** 2 / row["seconds"]
        yield f"denoised, {row['setting']}: {row['error']:.2e} in {row['seconds']:.3f} s, which takes {times:.1f} times the time without"


# Series of the panels: program, its name, color (Okabe and Ito, distinct without color vision), shape, point with the name.
PANELS = {
    "transfer function": [("Cumulo", "Cumulo", "#0072b2", "circle", 0), ("VTK, 8 bits", "VTK", "#d55e00", "square", -1)],
    "paths": [("Cumulo", "Cumulo", "#0072b2", "circle", -1), ("Cumulo, denoised", "Cumulo, denoised", "#7e2f8e", "diamond", -1),
              ("Cycles", "Cycles", "#d55e00", "square", -1), ("Mitsuba 3", "Mitsuba 3", "#007a5a", "triangle", 0)],
}  # fmt: skip
# Points that are named, too.
NAMED = ("preintegrated", "exact")
TITLES = {"transfer function": "Scan of a head, transfer function, 512²", "paths": "Plume in sun light, path traced, 256²"}
SHAPES = {
    "circle": '<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5"/>',
    "square": '<path d="M{x:.1f} {y:.1f}m-4.2 -4.2h8.4v8.4h-8.4z"/>',
    "triangle": '<path d="M{x:.1f} {y:.1f}m0 -5.4l5 9h-10z"/>',
    "diamond": '<path d="M{x:.1f} {y:.1f}m0 -6l6 6l-6 6l-6 -6z"/>',
}
WIDTH, HEIGHT, TOP, BOTTOM = 880, 400, 46, 54
INK, GRID = "#1f2328", "#d8dee4"


def text(x, y, words, more=""):
    """A text of the plot."""
    return f'<text x="{x:.1f}" y="{y:.1f}" {more}>{html.escape(words)}</text>'


def power(exponent):
    """A power of ten."""
    return f"{10.0**exponent:g}" if -4 < exponent < 3 else "10" + "".join("⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".index(c)] for c in str(exponent))


def panel(document, name, left, width):
    """A panel: axes over powers of ten, lines with their names."""
    rows = {program: [r for r in of(document, program) if r["panel"] == name] for program, *_ in PANELS[name]}
    every = [row for found in rows.values() for row in found]
    ends = {}
    for key in ("seconds", "error"):
        values = [math.log10(row[key]) for row in every]
        ends[key] = math.floor(min(values)), math.ceil(max(values))
    (west, east), (floor, roof) = ends["seconds"], ends["error"]
    low = HEIGHT - BOTTOM

    def at(row):
        x = left + (math.log10(row["seconds"]) - west) / (east - west) * width
        return x, low - (math.log10(row["error"]) - floor) / (roof - floor) * (low - TOP)

    parts = [text(left, 24, TITLES[name], 'font-size="15" font-weight="600"')]
    for exponent in range(floor, roof + 1, 1 if roof - floor < 6 else 2):
        y = low - (exponent - floor) / (roof - floor) * (low - TOP)
        parts += [f'<path d="M{left} {y:.1f}h{width}" stroke="{GRID}"/>', text(left - 8, y + 4.5, power(exponent), 'text-anchor="end"')]
    for exponent in range(west, east + 1):
        x = left + (exponent - west) / (east - west) * width
        parts += [f'<path d="M{x:.1f} {TOP}V{low}" stroke="{GRID}"/>', text(x, low + 19, power(exponent), 'text-anchor="middle"')]
    parts.append(text(left + width / 2, HEIGHT - 12, "processor time, s", 'text-anchor="middle"'))
    for program, words, color, shape, named in PANELS[name]:
        places = [at(row) for row in rows[program]]
        line = "L".join(f"{x:.1f} {y:.1f}" for x, y in places)
        marks = "".join(SHAPES[shape].format(x=x, y=y) for x, y in places)
        parts.append(f'<path d="M{line}" fill="none" stroke="{color}" stroke-width="2"/><g fill="{color}">{marks}</g>')
        x, y = places[named]
        parts.append(text(x + 10, y + (5 if named else -7), words, f'fill="{color}" font-weight="600"'))
        notes = [(x, y, row["setting"]) for (x, y), row in zip(places, rows[program]) if row["setting"] in NAMED]
        parts += [text(x + 10, y + 5, words, f'fill="{color}"') for x, y, words in notes]
    return parts


def plot(document):
    """Both panels as SVG."""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        f'font-family="sans-serif" font-size="13" fill="{INK}">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>',
        text(-(TOP + HEIGHT - BOTTOM) / 2, 18, "root mean square error, relative", 'text-anchor="middle" transform="rotate(-90)"'),
        *panel(document, "transfer function", 76, 340),
        *panel(document, "paths", 506, 340),
    ]
    return "\n".join([*parts, "</svg>"]) + "\n"


def main():
    """Measures, or reads what was measured, and draws it."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("peers", type=pathlib.Path, nargs="?", metavar="PEERS_ENV")
    p.add_argument("--rounds", type=int, default=5)
    p.add_argument("--panel", choices=sorted(PANELS), action="append")
    p.add_argument("--plot", action="store_true")
    a = p.parse_args()
    if not a.plot:
        if a.peers is None:
            p.error("PEERS_ENV is missing (or --plot, to draw what was measured)")
        document = updated(json.loads(RESULT.read_text(encoding="utf-8")), a.peers, a.rounds, a.panel or list(PANELS))
        RESULT.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    document = json.loads(RESULT.read_text(encoding="utf-8"))
    RESULT.with_suffix(".svg").write_text(plot(document), encoding="utf-8")
    print("\n".join(summary(document)))


if __name__ == "__main__":
    main()
