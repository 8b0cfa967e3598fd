"""The page of a failing comparison: one HTML file with all pictures in it, and the EXRs beside it."""

from __future__ import annotations

import base64
import dataclasses
import html
import json
import pathlib
from typing import Any

import numpy as np

from .. import arrays, results
from . import pictures

# Width in which pictures are shown, about, in pixels of the screen.
SHOWN = 280
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1c1c1c; max-width: 1240px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.4em; } h2 { font-size: 1.1em; margin-top: 2em; }
.verdict { border-left: 4px solid #b2182b; padding: .4em .8em; background: #fbeeee; }
.row { display: flex; flex-wrap: wrap; gap: 1em; } figure { margin: 0; } figcaption { font-size: .85em; color: #555; max-width: 280px; }
.picture { position: relative; } .picture { border: 1px solid #ccc; width: fit-content; } .picture img { display: block; image-rendering: pixelated; }
.mark { position: absolute; box-sizing: border-box; border: 2px solid #f5a623; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; } td, th { padding: .15em .8em; text-align: right; border-bottom: 1px solid #ddd; }
td:first-child, th:first-child, td.text, th.text { text-align: left; } tr.found td { background: #fbeeee; font-weight: 600; }
code, pre { font-size: .85em; background: #f4f4f4; } pre { padding: .6em; overflow-x: auto; }
"""


@dataclasses.dataclass(frozen=True)
class Failure:
    """A comparison that failed: `made` is what the reference was made of, `candidate` how the candidate is made."""

    test: str
    words: str
    found: results.Report
    made: dict[str, Any]
    expected: list[pathlib.Path]
    actual: list[pathlib.Path]
    candidate: str


def write(folder: pathlib.Path, failure: Failure) -> pathlib.Path:
    """Leaves expected, actual and difference as EXR and PNG, and index.html; returns the path of that."""
    folder.mkdir(parents=True)
    expected, actual = (_mean(paths) for paths in (failure.expected, failure.actual))
    figures = []
    exposure = pictures.exposure(expected)
    mark = _mark(failure.found)
    for name, picture in (("expected", expected), ("actual", actual)):
        arrays.write_picture(folder / f"{name}.exr", picture)
        caption = f"{name}, mean of {len(getattr(failure, name))}, exposure {exposure:.3g}"
        figures.append(_figure(folder, name, pictures.display(picture, exposure), caption, mark))
    if expected.shape == actual.shape:
        figures += _differences(folder, actual - expected, mark)
    page = folder / "index.html"
    page.write_text(_html(failure, figures), encoding="utf-8")
    return page


def _mean(paths: list[pathlib.Path]) -> pictures.Floats:
    read = [arrays.read_picture(path).values.astype(np.float64) for path in paths]
    mean: pictures.Floats = np.mean(read, axis=0)
    if mean.shape[-1] == 1:
        mean = np.repeat(mean, 3, axis=-1)
    return mean if mean.shape[-1] in (3, 4) else mean[..., :3]


def _differences(folder: pathlib.Path, difference: pictures.Floats, mark: str) -> list[str]:
    """The difference by pixel, and its means over small blocks, in which structure stands out from noise."""
    arrays.write_picture(folder / "difference.exr", difference)
    colors = difference[..., :3].mean(axis=-1)
    edge = max(2, min(colors.shape) // 12)
    shown = []
    for name, values, what in (
        ("difference", colors, "actual - expected, mean of the colors"),
        ("difference_blocks", pictures.blocks(colors, edge), f"means over {edge}x{edge} pixels"),
    ):
        scale = pictures.scale_of(values)
        caption = f"{what}: red above, blue below, full at {scale:.2e}"
        shown.append(_figure(folder, name, pictures.signed(values, scale), caption, mark))
    return shown


def _mark(found: results.Report) -> str:
    """Outline, in percent of the picture, of the region that differs most."""
    if not isinstance(found, results.Statistics):
        return ""
    regions = [(test.p, test.worst) for c in found.channels for test in (c.tiles, c.pixels) if test.worst and test.p is not None]
    if not regions:
        return ""
    region = min(regions, key=lambda r: r[0])[1]
    width, height = found.size
    places = {"left": region.x / width, "top": region.y / height, "width": region.width / width, "height": region.height / height}
    style = "; ".join(f"{key}: {100 * value:.3f}%" for key, value in places.items())
    return f'<div class="mark" style="{style}" title="differs most"></div>'


def _figure(folder: pathlib.Path, name: str, pixels: Any, caption: str, mark: str) -> str:
    data = pictures.png(pixels)
    (folder / f"{name}.png").write_bytes(data)
    times = max(1, SHOWN // pixels.shape[1])
    size = f'width="{times * pixels.shape[1]}" height="{times * pixels.shape[0]}"'
    url = "data:image/png;base64," + base64.b64encode(data).decode()
    return (
        f'<figure><div class="picture"><img alt="{name}" {size} src="{url}">{mark}</div>'
        f"<figcaption>{html.escape(caption)}</figcaption></figure>"
    )


def _statistics(found: results.Statistics) -> str:
    """Table of the tests; rows that found a difference are marked."""
    rows = []
    # Each test is one of as many as there are rows.
    limit = 1 - (1 - (found.false_alarm or 0)) ** (1 / (4 * len(found.channels)))
    for c in found.channels:
        interval = f"{c.mean.interval[0]:+.2e} to {c.mean.interval[1]:+.2e}" if c.mean.interval else "unknown"
        rows.append((c.channel, "mean", c.mean.t, c.mean.p, f"{c.mean.difference:+.2e} ({interval} with 95 % confidence)"))
        for name, test in (("tiles", c.tiles), ("pixels", c.pixels)):
            where = "none"
            if test.worst:
                r = test.worst
                where = f"{r.difference:+.2e} ± {r.standard_error:.1e} at ({r.x}, {r.y}), {r.width}x{r.height} pixels, of {test.count}"
            rows.append((c.channel, name, test.worst.t if test.worst else 0.0, test.p, where))
        spread = f"mean square {c.spread.mean_square:.2e}, variance {c.spread.mean_variance:.2e}"
        rows.append((c.channel, "spread", c.spread.z, c.spread.p, spread))
    lines = ["<table><tr><th>channel</th><th class='text'>test</th><th>t or z</th><th>p</th><th class='text'>found</th></tr>"]
    for channel, name, t, p, where in rows:
        statistic = "inf" if t is None else f"{t:.2f}"
        lines.append(
            f"<tr{' class=found' if p < limit else ''}><td>{channel}</td><td class='text'>{name}</td><td>{statistic}</td>"
            f"<td>{p:.2e}</td><td class='text'>{where}</td></tr>"
        )
    a, b = found.sides
    noise = "; ".join(
        f"{name}: {side.source}, {side.pictures} picture(s)" + (f" ({html.escape(side.remark)})" if side.remark else "")
        for name, side in (("actual", a), ("expected", b))
    )
    return (
        "".join(lines) + f"</table><p>Noise: {noise}. A difference of {found.tolerance:g} counts as none. "
        f"A test is called at p &lt; {limit:.1e}, so that equal pictures fail with probability {found.false_alarm:g} at most.</p>"
    )


def _comparison(found: results.Comparison) -> str:
    figures = {"largest difference": found.max_abs, "of alpha": found.alpha_max_abs, "RMS": found.rms, "PSNR in dB": found.psnr_db, "SSIM": found.ssim}
    rows = "".join(f"<tr><td>{key}</td><td>{value:.6g}</td></tr>" for key, value in figures.items() if value is not None)
    return f"<table>{rows}</table>"


def _html(failure: Failure, figures: list[str]) -> str:
    found = failure.found
    tests = _statistics(found) if isinstance(found, results.Statistics) else ""
    tests = _comparison(found) if isinstance(found, results.Comparison) else tests
    name = html.escape(str(failure.made["name"]))
    inputs = "".join(f"<tr><td>{html.escape(k)}</td><td class='text'><code>{v}</code></td></tr>" for k, v in failure.made["inputs"].items())
    settings = html.escape(json.dumps(failure.made["settings"], indent=1))
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{name} differs</title><style>{STYLE}</style></head><body>
<h1>{name} differs from its reference</h1>
<p><code>{html.escape(failure.test)}</code></p>
<p class="verdict">{html.escape(failure.words)}</p>
<div class="row">{"".join(figures)}</div>
<h2>Tests</h2>{tests}
<h2>Where the pictures come from</h2>
<p>Actual: <code>{html.escape(failure.candidate)}</code></p>
<p>Expected: {html.escape(str(failure.made["renderer"] or "rendered by a function"))}, of these inputs (SHA-256):</p><table>{inputs}</table>
<details><summary>Settings of the reference</summary><pre>{settings}</pre></details>
<p>If the change was meant, render the reference again with <code>pytest --cumulo-regenerate</code>, and look at it.</p>
<details><summary>All figures</summary><pre>{html.escape(json.dumps(found.json, indent=1))}</pre></details>
</body></html>
"""
