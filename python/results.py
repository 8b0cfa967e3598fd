#!/usr/bin/env python3
"""Writes `tests/benches/RESULTS.md` and `tests/benches/accuracy.svg`.

Figures noted by hand stand in `tests/benches/noted.json`, with the machine and the dates. What `bench.py` measured
takes the place of what was noted of the same work and program; the noted work may be the beginning of the measured
one's name. Run by itself this script writes the noted figures alone. The page ends with `tests/benches/guide.md`, the
figures that the user's guide rests on.
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
# The plot: the settings of B1, each with its color.
SERIES = {
    "preintegrated": "#c2410c",
    "preintegrated:0.1": "#db2777",
    "exact": "#7e22ce",
    "midpoint:0.5": "#1d4ed8",
    "midpoint:0.7": "#0e7490",
    "midpoint:1": "#15803d",
    "midpoint:1.4": "#65a30d",
    "midpoint:2": "#ca8a04",
    "midpoint:2.8": "#a16207",
    "midpoint:4": "#57534e",
}


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
    lines += ["", "![Accuracy and time of pictures through transfer functions beside those of VTK](accuracy.svg)"]
    lines += ["", "![Error against time: through a transfer function beside VTK, paths beside Cycles and Mitsuba 3, denoised and not](error-against-time.svg)"]
    lines += ["", "`python3 python/accuracy_plot.py PEERS_ENV` measures and draws the second plot; its figures are in `error-against-time.json`."]
    for group in merged(document, measured):
        lines += ["", f"## {group['title']}"]
        lines += [group["about"], ""] if group["about"] else [""]
        lines += ["```text", *group["commands"], "```", "", table(group["rows"])]
        if group.get("after"):
            lines += ["", group["after"]]
    guide = (FOLDER / "guide.md").read_text(encoding="utf-8")
    return "\n".join(lines) + "\n\n" + guide


def beside_peer(rows):
    """The rows of Cumulo in B1 as (setting, time over the peer's, decibels above the peer's)."""
    peers = {row["work"]: row for row in rows if row["program"] != "Cumulo"}
    for row in rows:
        peer = peers.get(row["work"])
        if peer and row["program"] == "Cumulo":
            yield row["setting"], row["milliseconds"] / peer["milliseconds"], row["picture_db"] - peer["picture_db"]


def plot(document, measured=()):
    """B1 as SVG: decibels above the peer's over the time relative to the peer's, a logarithmic axis."""
    rows = next((g["rows"] for g in merged(document, measured) if g["id"] == "B1"), [])
    points = list(beside_peer(rows))
    width, height, left, right, top, bottom = 720, 420, 60, 160, 40, 52
    times, levels = [1.0, *(p[1] for p in points)], [0.0, *(p[2] for p in points)]
    low, high = math.log(min(times) / 1.3), math.log(max(times) * 1.3)
    floor, roof = 20 * math.floor(min(levels) / 20), 20 * math.ceil(max(levels) / 20)

    def at(time, level):
        x = left + (math.log(time) - low) / (high - low) * (width - left - right)
        return x, height - bottom - (level - floor) / (roof - floor) * (height - top - bottom)

    def text(x, y, words, more=""):
        return f'<text x="{x:.1f}" y="{y:.1f}" {more}>{html.escape(words)}</text>'

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'font-family="sans-serif" font-size="12" fill="#1f2328">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        text(left, 22, "Pictures through transfer functions beside VTK: 20 cases, 512² pixels", 'font-size="14"'),
    ]
    for level in range(floor, roof + 1, 20):
        y = at(1.0, level)[1]
        color = "#57606a" if level == 0 else "#d8dee4"
        parts.append(f'<line x1="{left}" x2="{width - right}" y1="{y:.1f}" y2="{y:.1f}" stroke="{color}"/>')
        parts.append(text(left - 8, y + 4, str(level), 'text-anchor="end"'))
    for tick in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200):
        if low <= math.log(tick) <= high:
            x = at(tick, 0)[0]
            color = "#57606a" if tick == 1 else "#d8dee4"
            parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{top}" y2="{height - bottom}" stroke="{color}"/>')
            parts.append(text(x, height - bottom + 18, f"{tick:g}", 'text-anchor="middle"'))
    parts.append(text((left + width - right) / 2, height - 12, "processor time over that of VTK at its best", 'text-anchor="middle"'))
    parts.append(text(-(top + height - bottom) / 2, 18, "decibels above VTK's", 'text-anchor="middle" transform="rotate(-90)"'))
    for line, (setting, color) in enumerate(SERIES.items()):
        own = [at(time, level) for name, time, level in points if name == setting]
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{color}" fill-opacity="0.8"/>' for x, y in own]
        x, y = width - right + 14, top + 14 + 22 * line
        parts.append(f'<circle cx="{x}" cy="{y - 4}" r="4" fill="{color}"/>' + text(x + 12, y, setting))
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
