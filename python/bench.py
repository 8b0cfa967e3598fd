#!/usr/bin/env python3
"""Our figures beside those of other programs, as one Markdown table on stdout and `target/bench/results.json`.

    bench.py [--only B4 B6 ...] [--data DIR] [--peers PEERS_ENV RTK_ENV] [--write]

`--write` writes `tests/benches/RESULTS.md` and its plot too (`python/results.py`): what was measured, and what was
noted of the rest.

TF finds transfer functions of ever more texels, VIEW the best viewpoints; both look at an MRI of a head
(`ch2` of Debian's mricron-data) among others. Kernels (B3, B10, B11) come from `cargo bench --bench kernels`, pictures and gradients through a transfer function (B1,
B2) from the same program; B4 to B7 reconstruct exact data sets
(`python/peers/`, made where they are missing by the environment `python/setup.sh bench` sets up) with ever
more iterations until the goal's PSNR is reached. With `--peers` the other programs run too, in turn with
ours; else their figures are those noted when a quiet machine ran them, marked `noted`.

Runs under Debian's Python with python3-numpy and python3-openvdb.
"""

import argparse
import datetime
import glob
import json
import os
import pathlib
import platform
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass

import numpy as np
import pyopenvdb as vdb

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "python"))
sys.path.insert(0, str(ROOT / "python" / "peers"))
import cumulo  # noqa: E402  from this checkout
import field  # noqa: E402
import results as results_page  # noqa: E402

OUT = ROOT / "target" / "bench"
PEERS = ROOT / "python" / "peers"
# Iterations on the finest level; the shortest run that reaches the goal counts.
LADDER = (5, 10, 20, 24, 30, 50)
# A run shorter than this is repeated: its median counts.
SHORT, REPEATS = 10.0, 3


# An MRI of Debian's mricron-data.
HEAD = pathlib.Path("/usr/share/mricron/templates/ch2.nii.gz")
# TF: numbers of texels.
TEXELS = (16, 32, 64, 128, 256)
# B1 and B2: threads of both sides; functions; seconds of PyTorch, where they were measured.
THREADS = 2
FUNCTIONS = ("bump", "ramp", "thin", "bone")
VOLUMES = ("plume", "cloud", "wisps", "ct", "head")
# Decibels below VTK's best that a setting of it may have to count as its best.
WORSE = 1.0
PYTORCH = 0.41
# B2: rules and sizes of ours.
GRADIENTS = [("exact", 128), ("preintegrated:0.1", 128), *(("preintegrated", pixels) for pixels in (128, 512, 1024))]


@dataclass
class Set:
    """A data set, what the peer makes of it, and what we want to be."""

    id: str
    name: str
    work: str
    make: list
    # Name, decibels (clipped to 0..1 where that is better) and seconds on a quiet machine, if they are known.
    peer: str
    noted: tuple
    # Decibels to reach beyond the peer's, or in all; how many times faster than the peer, if that is a goal.
    above: float = 0.0
    decibels: float | None = None
    faster: float | None = None


def cone(views, noted, **goal):
    """B4 with so many views."""
    work = f"128³ from {views} views on a sphere"
    return Set("B4", f"b4_{views}", work, ["b4", "--views", str(views)], "RTK CG", noted, **goal)


SETS = [
    cone(8, (30.07, None)),
    cone(16, (35.16, None)),
    cone(32, (39.79, None)),
    cone(64, (46.97, 22.0), decibels=48.0, faster=5.0),
    cone(128, (53.17, None)),
    Set("B5", "b5", "128³ from 64 parallel-beam angles", ["b5"], "ASTRA SIRT", (54.4, 97.0), faster=10.0),
    Set("B6", "b6", "64³ from 16 views", ["b6"], "Mitsuba 3", (27.9, 81.0), above=10.0, faster=100.0),
    Set("B7", "b7", "256³ from 64 parallel-beam angles", ["b7"], "ASTRA SIRT, 150 it", (55.69, None), faster=1.0),
]  # fmt: skip


# The peers' names and settings in RESULTS.md.
PEER = {
    "B4": ("ITK-RTK", "30 iterations of conjugate gradients"),
    "B5": ("ASTRA", "SIRT, 150 iterations"),
    "B6": ("Mitsuba 3", "100 steps of 4 views"),
    "B7": ("ASTRA", "SIRT, 150 iterations"),
    "B2": ("PyTorch", "checkpointed"),
}


def record(group, work, program="Cumulo", setting="", **figures):
    """A measured record for RESULTS.md; figures are those of `results.FIGURES`."""
    known = {key: value for key, value in figures.items() if value is not None}
    date = datetime.date.today().isoformat()
    return {"id": group, "work": work, "program": program, "setting": setting, **known, "date": date, "measured": True}


def say(text):
    """Progress, on stderr."""
    print(text, file=sys.stderr, flush=True)


def output(command, **environment):
    """What a command prints on stdout; its stderr passes through."""
    done = subprocess.run(
        [str(word) for word in command], stdout=subprocess.PIPE, text=True, check=True, env=os.environ | environment
    )
    return done.stdout


def data_set(wanted, folder):
    """The folder of a data set, made in target/bench where it is missing. (Not in `folder`, which is the user's.)"""
    for place in filter(None, (folder, OUT)):
        # The truth is written last.
        if (place / wanted.name / "truth.vdb").is_file():
            return place / wanted.name
    python = ROOT / ".venvs" / "bench" / "bin" / "python"
    if not python.is_file():
        raise FileNotFoundError(f"{python} is missing; run python/setup.sh bench, or give finished sets with --data")
    say(f"making {OUT / wanted.name}")
    output([python, PEERS / "projections.py", wanted.make[0], OUT / wanted.name, *wanted.make[1:]])
    return OUT / wanted.name


def psnr(path, truth):
    """Decibels over all voxels of the lattice, peak 1: what the peers' scripts print."""
    grid = vdb.read(str(path), "density")
    found = np.zeros(truth.shape[::-1], np.float32)
    grid.copyToArray(found)
    error = np.mean((found.transpose(2, 1, 0).astype(np.float64) - truth) ** 2)
    return float(-10 * np.log10(max(error, 1e-20)))


def ours(data, iterations):
    """Decibels, and seconds from the first picture read to the volume ready to be written."""
    path = OUT / f"{data.name}.vdb"
    report = cumulo.call("reconstruct", "density", data, "-o", path, "--held-out", 0, "--iterations", iterations)
    return psnr(path, np.load(data / "truth.npy")), report["seconds"]


def llvm():
    """The environment in which Mitsuba finds an LLVM that it works with."""
    library = os.environ.get("DRJIT_LIBLLVM_PATH") or next(iter(glob.glob("/usr/lib/*/libLLVM-19.so")), "")
    return {"DRJIT_LIBLLVM_PATH": library} if library else {}


def theirs(wanted, data, environments):
    """Decibels and seconds of the peer."""
    peers, rtk = (env / "bin" / "python" for env in environments)
    command = {
        "B4": [rtk, PEERS / "run_rtk.py", data, "--alg", "cg"],
        "B5": [peers, PEERS / "run_astra.py", data, "--alg", "SIRT"],
        "B6": [peers, PEERS / "run_mitsuba.py", data],
        "B7": [peers, PEERS / "run_astra.py", data, "--alg", "SIRT", "--iters", "150"],
    }[wanted.id]
    line = json.loads(output(command, **llvm()).splitlines()[-1])
    return max(line["psnr_db"], line.get("psnr_clipped_db", 0.0)), line["seconds"]


def reconstruction(wanted, folder, environments, rounds):
    """The row of one data set."""
    data = data_set(wanted, folder)
    say(f"{wanted.id}: {wanted.work}")
    measured = [theirs(wanted, data, environments)] if environments else []
    peer_db = measured[0][0] if measured else wanted.noted[0]
    target = wanted.decibels or peer_db + wanted.above
    trail = []
    for iterations in LADDER:
        quality, seconds = ours(data, iterations)
        trail.append({"iterations": iterations, "psnr_db": round(quality, 2), "seconds": round(seconds, 3)})
        say(f"  {iterations} iterations: {quality:.2f} dB in {seconds:.2f} s (goal {target:.2f} dB)")
        if quality >= target:
            break
    best = max(trail, key=lambda step: step["psnr_db"])
    times = [best["seconds"]]
    while len(times) < REPEATS and best["seconds"] < SHORT:
        times.append(ours(data, best["iterations"])[1])
    for _ in range(rounds - 1 if measured else 0):
        measured.append(theirs(wanted, data, environments))
        times.append(ours(data, best["iterations"])[1])
    seconds = statistics.median(times)
    peer_seconds = statistics.median(s for _, s in measured) if measured else wanted.noted[1]
    reached = best["psnr_db"] >= target
    ratio = peer_seconds / seconds if peer_seconds else None
    fast = wanted.faster is None or (ratio is not None and ratio >= wanted.faster)
    goal = f">= {target:.1f} dB" + (f", {wanted.faster:g}x faster" if wanted.faster else "")
    duration = f" in {peer_seconds:.1f} s" if peer_seconds else ""
    figures = [record(wanted.id, wanted.work, volume_db=best["psnr_db"], seconds=seconds, iterations=best["iterations"])]
    if measured:
        figures.append(record(wanted.id, wanted.work, *PEER[wanted.id], volume_db=peer_db, seconds=peer_seconds))
    return {
        "figures": figures,
        "id": wanted.id,
        "work": wanted.work,
        "peer": f"{wanted.peer}: {peer_db:.1f} dB{duration}{'' if measured else ' (noted)'}",
        "ours": f"{best['psnr_db']:.1f} dB in {seconds:.2f} s ({best['iterations']} iterations)",
        "ratio": ratio,
        "goal": goal,
        # Without the peer's time nobody knows.
        "met": reached and fast if ratio or wanted.faster is None else None,
        "detail": {"trail": trail, "seconds": times, "peer": measured},
    }


def smoke(voxels):
    """The plume as NPY and VDB, in the unit cube."""
    array, grid = OUT / f"smoke{voxels}.npy", OUT / f"smoke{voxels}.vdb"
    if not newer(grid, PEERS / "field.py"):
        values = field.smoke(voxels)
        lattice = np.diag([1 / voxels] * 3 + [1.0])
        lattice[:3, 3] = 0.5 / voxels
        np.save(array, values)
        output([sys.executable, PEERS / "write_vdb.py", array, grid, json.dumps(lattice.tolist())])
    return array, grid


def bench_program(*arguments):
    """What `cargo bench --bench kernels` prints with these arguments."""
    target = os.environ.get("CARGO_TARGET_DIR", str(ROOT / "target"))
    command = ["cargo", "bench", "--quiet", "--locked", "--manifest-path", ROOT / "Cargo.toml", "--bench", "kernels"]
    return output([*command, "--", *arguments], CARGO_TARGET_DIR=target)


def subject_of_pictures(name):
    """A volume of B1 as NPY and VDB with unit voxels."""
    array, grid = OUT / f"b1_{name}.npy", OUT / f"b1_{name}.vdb"
    if not newer(grid, PEERS / "volumes.py"):
        output([sys.executable, PEERS / "volumes.py", name, array, *([HEAD] if name == "head" else [])])
        output([sys.executable, PEERS / "write_vdb.py", array, grid, json.dumps(np.eye(4).tolist())])
    return array, grid


def best(settings):
    """The fastest of VTK's settings among those about as near to the truth as any."""
    most = max(setting["psnr_db"] for setting in settings)
    return min((s for s in settings if s["psnr_db"] >= most - WORSE), key=lambda s: s["seconds"])


def pictures(environments, rounds):
    """B1: a row for each volume, function and rule; the peer in turn with ours."""
    say("B1: pictures through transfer functions")
    for volume in VOLUMES:
        array, grid = subject_of_pictures(volume)
        shape = list(np.load(array, mmap_mode="r").shape[::-1])
        ours, theirs = [], {name: [] for name in FUNCTIONS}
        for _ in range(rounds):
            ours.append(json.loads(bench_program("--pictures", grid, THREADS, OUT, shape)))
            for name in theirs if environments else ():
                run = [environments[0] / "bin" / "python", PEERS / "run_vtk.py", array, "--function", name]
                light = OUT / f"light_{name}.f64"
                line = json.loads(output([*run, "--threads", THREADS, "--light", light]).splitlines()[-1])
                theirs[name].append(best(line["settings"]))
        for name, seen in theirs.items():
            work = f"{volume}, {name}"
            seconds = statistics.median(line["seconds"] for line in seen) if seen else None
            decibels = seen[0]["psnr_db"] if seen else None
            for rule, first in ours[0][name].items():
                own = statistics.median(run[name][rule]["seconds"] for run in ours)
                figures = [record("B1", work, setting=rule, picture_db=first["psnr_db"], milliseconds=1e3 * own)]
                if seen and rule == list(ours[0][name])[-1]:
                    setting = f"fixed-point ray caster, {seen[0]['setting']}"
                    figures.append(record("B1", work, "VTK", setting, picture_db=decibels, milliseconds=1e3 * seconds))
                yield {
                    "figures": figures,
                    "id": "B1",
                    "work": f"{work}, {rule}",
                    "peer": f"VTK: {decibels:.1f} dB, {1e3 * seconds:.0f} ms" if seen else None,
                    "ours": f"{first['psnr_db']:.1f} dB, at most {first['largest']:.5f} off, {1e3 * own:.0f} ms",
                    "ratio": seconds / own if seen else None,
                    "goal": f">= 1, >= {decibels:.1f} dB" if seen else None,
                    "met": seconds >= own and first["psnr_db"] >= decibels if seen else None,
                    "detail": {"ours": [run[name][rule]["seconds"] for run in ours], "peer": seen},
                }


def gradients(environments, rounds):
    """B2: a row for each rule and way; the peer in turn with ours."""
    array, grid = smoke(128)
    say("B2: gradients through a transfer function")
    ours, theirs = [], []
    for _ in range(rounds):
        ours.append({kind: json.loads(bench_program("--gradient", grid, THREADS, *kind)) for kind in GRADIENTS})
        if environments:
            run = [environments[0] / "bin" / "python", PEERS / "run_torch.py", array, "--threads", THREADS]
            theirs.append(json.loads(output(run).splitlines()[-1]))
    peer = statistics.median(line["seconds"] for line in theirs) if theirs else PYTORCH
    for (rule, pixels), figures in ours[0].items():
        for way in ("tape", "replay"):
            own = statistics.median(run[rule, pixels][way] for run in ours)
            value = statistics.median(run[rule, pixels]["value"] for run in ours)
            # The peer had one size of picture.
            ratio = peer / own if pixels == 128 else None
            used = figures["megabytes"] if way == "tape" else None
            records = [
                record("B2", f"128³, {pixels}²", setting=f"{rule}, by {way}", milliseconds=1e3 * own, megabytes=used),
                record("B3", f"transfer function, {rule}, {pixels}²", setting=way, ratio=own / value),
            ]
            if theirs and (rule, pixels, way) == ("preintegrated", 128, "tape"):
                records.append(record("B2", "128³, 128²", *PEER["B2"], milliseconds=1e3 * peer))
            yield {
                "figures": records,
                "id": "B2",
                "work": f"128³, {pixels}², {rule}, gradient by {way}",
                "peer": f"PyTorch: {1e3 * peer:.0f} ms{'' if theirs else ' (noted)'}",
                "ours": f"{1e3 * own:.1f} ms, {own / value:.2f} of the value, {figures['megabytes']:.0f} MB",
                "ratio": ratio,
                "goal": ">= 40" if ratio else None,
                "met": ratio >= 40 if ratio else None,
                "detail": {"ours": [run[rule, pixels] for run in ours], "peer": theirs},
            }


def subject(name):
    """A volume and its transfer function: `head` or `c60`."""
    volume, function = OUT / f"{name}.vdb", OUT / f"{name}.tf.json"
    if not (volume.is_file() and newer(function, PEERS / f"{name}.py")):
        given = [HEAD] if name == "head" else []
        output([sys.executable, PEERS / f"{name}.py", *given, volume, function])
    return volume, function


def transfers(rounds):
    """TF: a row for each number of texels, from pictures made with 256."""
    say("TF: transfer functions of a known volume")
    volume, function = subject("head")
    views = ["--views", 9, "--size", "512x512", "--density-scale", "auto"]
    cumulo.call("render", volume, "--tf", function, *views, "--overwrite", "-o", OUT / "head")
    runs = {texels: [] for texels in TEXELS}
    for _ in range(rounds):
        for texels, of in runs.items():
            out = OUT / "found.tf.json"
            given = ["--volume", volume, "-o", out, "--texels", texels]
            of.append(cumulo.call("reconstruct", "tf", OUT / "head", *given))
    seconds = {texels: statistics.median(run["seconds"] for run in of) for texels, of in runs.items()}
    for texels, of in runs.items():
        quality, likeness = of[0]["held_out_psnr_db"], of[0]["held_out_ssim"]
        goal = {"goal": ">= 42.6 dB, SSIM >= 0.999, <= 300 s"} if texels == 64 else {"goal": None}
        work = f"head, 8 views 512², {texels} texels"
        yield {
            "figures": [record("TF", work, held_out_db=quality, ssim=likeness, seconds=seconds[texels])],
            "id": "TF",
            "work": work,
            "peer": "Weiss & Westermann, 64 texels: 42.6 dB in 5 min on a GPU" if texels == 64 else None,
            "ours": f"{quality:.1f} dB, SSIM {likeness:.5f}, {seconds[texels]:.1f} s",
            "ratio": None,
            **goal,
            "met": quality >= 42.6 and likeness >= 0.999 and seconds[texels] <= 300 if texels == 64 else None,
            "detail": {"seconds": [run["seconds"] for run in of]},
        }


def viewpoints():
    """VIEW: a row for each volume: eight starts against 256 views spread evenly."""
    say("VIEW: best viewpoints")
    plume = smoke(128)[1]
    subjects = {name: subject(name) for name in ("head", "c60")} | {"plume": (plume, None), "plume, peaks": (plume, subject("c60")[1])}
    for name, (volume, function) in subjects.items():
        seen = ["--tf", function] if function else []
        options = [*seen, "--density-scale", "auto", "--size", "128x128", "--samples", 256, "--overwrite"]
        found = cumulo.call("viewpoint", volume, *options, "-o", OUT / "best.json")
        best, sampled = found["entropy"], found["sampled_best_entropy"]
        cost = found["equivalent_renders"] / 256
        work, share = f"{name}, 8 starts, 128²", 100 * cost
        yield {
            "figures": [record("VIEW", work, entropy=best, sampled=sampled, share=share, seconds=found["seconds"])],
            "id": "VIEW",
            "work": work,
            "peer": f"best of 256 views: {sampled:.5f}",
            "ours": f"{best:.5f}, {found['seconds']:.1f} s, {100 * cost:.0f} % of 256 renders",
            "ratio": None,
            "goal": "no less, <= 25 %",
            "met": best >= sampled and cost <= 0.25,
            "detail": {key: value for key, value in found.items() if key != "provenance"},
        }


def newer(path, source):
    """True if `path` is there and was made from `source` as it is."""
    return path.is_file() and path.stat().st_mtime >= source.stat().st_mtime


def kernels(volume):
    """The rows of `cargo bench`; `volume` asks for reading and writing too."""
    report, options = OUT / "kernels.json", []
    if volume:
        noise, peer, source = OUT / "noise256.vdb", OUT / "vdb_read", PEERS / "vdb_read.cpp"
        if not newer(noise, PEERS / "vdb_noise.py"):
            output([sys.executable, PEERS / "vdb_noise.py", noise])
        if not newer(peer, source):
            say("compiling OpenVDB's side")
            libraries = ["-lopenvdb", "-ltbb", "-lImath-3_1"]
            output(["g++", "-O3", "-DNDEBUG", "-std=c++17", source, "-o", peer, *libraries])
        options = ["--vdb", noise, peer, OUT]
    say("kernels")
    bench_program("--json", report, *options)
    return [row | {"figures": kernel_records(row)} for row in json.loads(report.read_text())]


def kernel_records(row):
    """The records of a row of `cargo bench`; how fast rays are says nothing beside other programs."""
    if row["id"] == "rate":
        return []
    if row["id"] == "B3":
        light, way = row["work"].removesuffix(" against value").split(", gradient by ")
        return [record("B3", light, setting=way, ratio=row["ratio"])]
    return [record(row["id"], row["work"], ratio=row["ratio"])]


def processor():
    """The processor's name."""
    try:
        lines = pathlib.Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def table(rows):
    """The rows as Markdown."""
    lines = ["| id | work | peer | ours | ratio | goal | met |", "|---|---|---|---|---|---|---|"]
    for row in rows:
        ratio = "–" if row["ratio"] is None else f"{row['ratio']:.2f}"
        met = {True: "yes", False: "NO", None: "–"}[row["met"]]
        words = [row["id"], row["work"], row["peer"] or "–", row["ours"], ratio, row["goal"] or "–", met]
        lines.append(f"| {' | '.join(words)} |")
    return "\n".join(lines)


def main():
    """Measures, writes the JSON, prints the table."""
    every = ["TF", "VIEW", "B1", "B2", "B3", "B4", "B5", "B6", "B7", "B10", "B11"]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=every, default=every, metavar="ID", help=f"of {' '.join(every)}")
    parser.add_argument("--data", type=pathlib.Path, help="folder of finished data sets (b4_8, ..., b5, b6)")
    parser.add_argument("--peers", nargs=2, type=pathlib.Path, metavar=("PEERS_ENV", "RTK_ENV"), help="run the peers too")
    parser.add_argument("--rounds", type=int, default=1, help="runs of a peer, in turn with ours (default: 1)")
    parser.add_argument("--write", action="store_true", help="write tests/benches/RESULTS.md and its plot too")
    a = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    if {"TF", "VIEW", "B1"} & set(a.only) and not HEAD.is_file():
        parser.error(f"{HEAD} is missing: run python/setup.sh bench, or install Debian's mricron-data (TF, VIEW and B1 need it)")
    start, before = time.monotonic(), os.getloadavg()[0]
    rows = []
    if {"B3", "B10", "B11"} & set(a.only):
        shown = {*a.only, "rate"}
        rows += [row for row in kernels("B10" in a.only) if row["id"] in shown]
    if "TF" in a.only:
        rows += transfers(a.rounds)
    if "VIEW" in a.only:
        rows += viewpoints()
    if "B1" in a.only:
        rows += pictures(a.peers, a.rounds)
    if "B2" in a.only:
        rows += gradients(a.peers, a.rounds)
    rows += [reconstruction(s, a.data, a.peers, a.rounds) for s in SETS if s.id in a.only]
    machine = {"cores": os.cpu_count(), "load_before": before, "load_after": os.getloadavg()[0]}
    machine["seconds"] = round(time.monotonic() - start, 1)
    results = OUT / "results.json"
    results.write_text(json.dumps({"machine": machine, "rows": rows}, indent=1, ensure_ascii=False) + "\n")
    print(table(rows))
    print(f"\n{machine['cores']} cores, load {before:.1f} before and {machine['load_after']:.1f} after; {results} has all times.")
    if a.write:
        figures = [figure for row in rows for figure in row["figures"]]
        described = f"{processor()}, {machine['cores']} cores, load {before:.1f} before and {machine['load_after']:.1f} after"
        for path in results_page.write(figures, described):
            say(f"{path}: written")


if __name__ == "__main__":
    try:
        main()
    except (cumulo.CumuloError, OSError, subprocess.CalledProcessError) as error:
        say(f"error: {error}")
        sys.exit(2)
