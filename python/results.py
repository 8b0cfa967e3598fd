#!/usr/bin/env python3
"""Writes `tests/benches/RESULTS.md` and `tests/benches/accuracy.svg`.

Figures noted by hand stand in `tests/benches/noted.json`, with the machine and the dates. What `bench.py` measured
takes the place of what was noted of the same work and program; the noted work may be the beginning of the measured
one's name. Run by itself this script writes the noted figures alone.
"""

import html
import json
import math
import pathlib

FOLDER = pathlib.Path(__file__).resolve().parents[1] / "tests" / "benches"
# The figures that a record may have: key, heading, format. A cell of the table holds one of them.
FIGURES = [
    ("volume_db", "volume, dB", ".1f"),
    ("held_out_db", "held-out views, dB", ".1f"),
    ("noise_floor_db", "noise floor, dB", ".2f"),
    ("picture_db", "picture, dB", ".0f"),
    ("flicker_db", "flicker, dB", ".1f"),
    ("ssim", "SSIM", ".5f"),
    ("rms", "RMS", ".2f"),
    ("entropy", "entropy", ".5f"),
    ("sampled", "best of 256", ".5f"),
    ("degrees", "rotation, °", ".3f"),
    ("percent", "position, %", ".3f"),
    ("iterations", "iterations", ".0f"),
    ("ratio", "ratio", ".2f"),
    ("least", "ratio, least", ".2f"),
    ("most", "ratio, most", ".2f"),
    ("share", "share, %", ".0f"),
    ("milliseconds", "time, ms", ".3g"),
    ("ms_least", "time, ms, least", ".3g"),
    ("ms_most", "time, ms, most", ".3g"),
    ("seconds", "time, s", ".3g"),
    ("minutes", "time, min", ".1f"),
    ("megabytes", "memory, MB", ".0f"),
]
# The plot: the works of B1, each with its color.
SERIES = {"256³, 512², bump": "#c2410c", "256³, 512², ramp": "#1d4ed8", "256³, 512², thin": "#15803d"}


def noted():
    """The figures noted by hand."""
    return json.loads((FOLDER / "noted.json").read_text(encoding="utf-8"))


def merged(document, measured):
    """The document's groups with measured records in the place of noted ones, and new groups for those without any."""
    groups = []
    for group in document["groups"]:
        own, rows = [r for r in measured if r["id"] == group["id"]], []
        for row in group["rows"]:
            same = [r for r in own if r["program"] == row["program"] and r["work"].startswith(row["work"])]
            rows += [r for r in same or [row] if r not in rows]
        groups.append({**group, "rows": rows + [r for r in own if r not in rows]})
    for name in sorted({r["id"] for r in measured} - {group["id"] for group in groups}):
        rows = [r for r in measured if r["id"] == name]
        groups.append({"id": name, "title": name, "about": "", "commands": ["make bench"], "rows": rows})
    return groups


def number(row, key, form):
    """A figure as text: noted ones with the digits they were noted with, measured ones without an exponent."""
    if key not in row:
        return ""
    if not row.get("measured"):
        return str(row[key])
    text = f"{row[key]:{form}}"
    return f"{float(text):.0f}" if "e" in text else text


def taken(row):
    """When the record was made, and by what."""
    kind = "measured" if row.get("measured") else "noted"
    return f"{kind} {row['date']}"


def table(rows):
    """A Markdown table, one figure a cell; columns without an entry are left out."""
    figures = [f for f in FIGURES if any(f[0] in row for row in rows)]
    texts = [t for t in ("setting", "remark") if any(row.get(t) for row in rows)]
    setting, remark = ([t for t in texts if t == name] for name in ("setting", "remark"))
    heads = ["work", "program", *setting, *(f[1] for f in figures), "taken", *remark]
    rule = ["---:" if any(h == f[1] for f in figures) else "---" for h in heads]
    lines = [f"| {' | '.join(heads)} |", f"|{'|'.join(rule)}|"]
    for row in rows:
        cells = [row["work"], row["program"], *(row.get("setting", "") for _ in setting)]
        cells += [number(row, f[0], f[2]) for f in figures]
        cells += [taken(row), *(row.get("remark", "") for _ in remark)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def page(document, measured=(), machine=None):
    """RESULTS.md as text."""
    lines = [
        "# Benchmark results",
        "",
        "`make bench` writes this page; `python3 python/results.py` writes it from the noted figures alone.",
        "",
        "- **noted** figures were taken by hand on the date given and are kept in `noted.json`. Machine: " + document["machine"] + ".",
    ]
    if measured:
        lines.append(f"- **measured** figures were taken by `make bench` on the date given. Machine: {machine}.")
    lines += ["", "![Accuracy against time of a picture through a transfer function](accuracy.svg)"]
    for group in merged(document, measured):
        lines += ["", f"## {group['title']}"]
        lines += [group["about"], ""] if group["about"] else [""]
        lines += ["```text", *group["commands"], "```", "", table(group["rows"])]
        if group.get("after"):
            lines += ["", group["after"]]
    return "\n".join(lines) + "\n"


def plot(document, measured=()):
    """The rows of B1 as SVG: accuracy over the time of a picture, a logarithmic axis."""
    rows = next((g["rows"] for g in merged(document, measured) if g["id"] == "B1"), [])
    width, height, left, right, top, bottom = 720, 400, 60, 150, 40, 52
    times, levels = [r["milliseconds"] for r in rows], [r["picture_db"] for r in rows]
    low, high = math.log(min(times) / 1.15), math.log(max(times) * 1.15)
    floor, roof = 10 * math.floor(min(levels) / 10), 10 * math.ceil(max(levels) / 10)

    def at(row):
        x = left + (math.log(row["milliseconds"]) - low) / (high - low) * (width - left - right)
        return x, height - bottom - (row["picture_db"] - floor) / (roof - floor) * (height - top - bottom)

    def text(x, y, words, more=""):
        return f'<text x="{x:.1f}" y="{y:.1f}" {more}>{html.escape(words)}</text>'

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'font-family="sans-serif" font-size="12" fill="#1f2328">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        text(left, 22, "Accuracy and time of a picture: 256³ voxels, 512² pixels, two threads", 'font-size="14"'),
    ]
    for level in range(floor, roof + 1, 10):
        y = at({"milliseconds": times[0], "picture_db": level})[1]
        parts.append(f'<line x1="{left}" x2="{width - right}" y1="{y:.1f}" y2="{y:.1f}" stroke="#d8dee4"/>')
        parts.append(text(left - 8, y + 4, str(level), 'text-anchor="end"'))
    for tick in (10, 20, 50, 100, 200, 500, 1000, 2000):
        if low <= math.log(tick) <= high:
            x = at({"milliseconds": tick, "picture_db": floor})[0]
            parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{top}" y2="{height - bottom}" stroke="#d8dee4"/>')
            parts.append(text(x, height - bottom + 18, str(tick), 'text-anchor="middle"'))
    parts.append(text((left + width - right) / 2, height - 12, "time of a picture, ms", 'text-anchor="middle"'))
    parts.append(text(-(top + height - bottom) / 2, 18, "PSNR against the exact integral, dB", 'text-anchor="middle" transform="rotate(-90)"'))
    for line, (work, color) in enumerate(SERIES.items()):
        name = work.rsplit(" ", 1)[-1]
        own = sorted((at(r) for r in rows if r["work"] == work and r["program"] == "Cumulo"))
        if own:
            points = " ".join(f"{x:.1f},{y:.1f}" for x, y in own)
            parts.append(f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="2"/>')
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{color}"/>' for x, y in own]
        for x, y in (at(r) for r in rows if r["work"] == work and r["program"] != "Cumulo"):
            parts.append(f'<rect x="{x - 4:.1f}" y="{y - 4:.1f}" width="8" height="8" fill="none" stroke="{color}" stroke-width="2"/>')
        x, y = width - right + 14, top + 14 + 40 * line
        parts.append(f'<circle cx="{x}" cy="{y - 4}" r="4" fill="{color}"/>' + text(x + 12, y, f"Cumulo, {name}"))
        parts.append(f'<rect x="{x - 4}" y="{y + 8}" width="8" height="8" fill="none" stroke="{color}" stroke-width="2"/>' + text(x + 12, y + 16, f"VTK, {name}"))
    return "\n".join([*parts, "</svg>"]) + "\n"


def write(measured=(), machine=None):
    """Writes both files and names them."""
    document = noted()
    paths = FOLDER / "RESULTS.md", FOLDER / "accuracy.svg"
    for path, content in zip(paths, (page(document, measured, machine), plot(document, measured))):
        path.write_text(content, encoding="utf-8")
    return paths


if __name__ == "__main__":
    for path in write():
        print(path)
