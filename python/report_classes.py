#!/usr/bin/env python3
"""Writes `cumulo/results.py`: the reports of the program as dataclasses, from the schemas that `cumulo schema` prints.

    python3 python/report_classes.py

A class stands for one definition of a schema, or for several that are told apart by no key; what no class stands for
stays JSON. To be run after a report of the program has changed; a test compares the file with the schemas.
"""

from __future__ import annotations

import functools
import keyword
import pathlib
import textwrap
from typing import Any

import cumulo

PLACE = pathlib.Path(__file__).resolve().parent / "cumulo" / "results.py"
WIDTH = 120

# Classes by name: the command whose schema has the definitions, these, and the keys that are paths of files.
CLASSES: dict[str, tuple[str, str, str]] = {
    "Caution": ("pose", "Warning", ""),
    "Failed": ("denoise", "Failed", ""),
    "Renewed": ("denoise", "Renewed", "input"),
    "Stage": ("reconstruct-density", "Stage", ""),
    "Provenance": ("gradient", "Provenance", ""),
    "Up": ("render", "ChosenUp", ""),
    "Rendered": ("render", "ViewsReport", "output"),
    "Iteration": ("reconstruct-density reconstruct-tf", "Step", ""),
    "Reconstruction": ("reconstruct-density", "Run", "capture output report"),
    "TransferFunction": ("reconstruct-tf", "TransferRun", "capture volume output report"),
    "PosedCamera": ("pose", "CameraReport", ""),
    "Posed": ("pose", "PoseReport", "output report"),
    "Start": ("viewpoint", "Start", ""),
    "Viewpoints": ("viewpoint", "ViewpointReport", "output pictures report"),
    "Accuracy": ("denoise", "Accuracy", ""),
    "Denoised": ("denoise", "DenoiseReport", ""),
    "FigurePanel": ("figure", "PanelReport", "picture"),
    "Figure": ("figure", "FigureReport", "output"),
    "Merged": ("merge", "MergeReport", "output"),
    "Motion": ("motion", "MotionReport", ""),
    "FrameFigures": ("compare", "Figures", ""),
    "Comparison": ("compare", "PicturesReport SequencesReport", "report"),
    "MeanTest": ("compare", "MeanTest", ""),
    "Region": ("compare", "Region", ""),
    "RegionTests": ("compare", "RegionTests", ""),
    "SpreadTest": ("compare", "SpreadTest", ""),
    "ChannelTests": ("compare", "ChannelTests", ""),
    "Noise": ("compare", "Noise", ""),
    "Statistics": ("compare", "StatisticalReport", ""),
    "GridDifference": ("diff", "Compared", ""),
    "Difference": ("diff", "FilesReport", ""),
    "FileInfo": ("info", "Described", "path"),
    "Files": ("info", "InfoReport", ""),
    "Sheet": ("view", "FileSheet", "input output"),
    "Viewed": ("view", "ViewReport", ""),
    "FileFindings": ("validate", "Checked", "path"),
    "Validation": ("validate", "ValidateReport", ""),
    "ArrayGrid": ("convert", "GridPlace", ""),
    "ArrayLayer": ("convert", "LayerPlace", ""),
    "Converted": ("convert", "FileReport", "input output more"),
    "Effect": ("plan", "Planned", ""),
    "Plan": ("plan", "ScenePlan", "input"),
    "PlannedStage": ("plan", "PlannedStage", ""),
    "PlannedMemory": ("plan", "MemoryPlan", ""),
    "MachineTime": ("plan", "Scaled", ""),
    "PlannedScaling": ("plan", "ScalingPlan", ""),
    "ReconstructionPlan": ("plan", "CapturePlan", "capture"),
    "Derivative": ("gradient", "Row", ""),
    "Gradient": ("gradient", "GradientReport", "input output report"),
    "Transfer": ("transfer", "Described", "input output"),
    "SuggestedBoundary": ("transfer", "NumberedBoundary", ""),
    "Material": ("transfer", "Material", ""),
    "SuggestedFunction": ("transfer", "CandidateReport", ""),
    "Suggestion": ("transfer", "Suggested", "suggest output sheet"),
    "Preset": ("transfer", "Builtin", ""),
    "Presets": ("transfer", "List", ""),
    "AuthoredVolume": ("usd-author", "Written", ""),
    "Authored": ("usd-author", "AuthorReport", "output"),
    "LintFinding": ("usd-lint", "Told", ""),
    "LintedStage": ("usd-lint", "Checked", "path"),
    "Linted": ("usd-lint", "LintReport", "layer"),
}

# Keys of lists that are tuples though their length is not fixed.
TUPLES = {"axes", "background", "shape"}

# Truth values of reports: the result of a check.
TRUTH = {"Comparison": "not self.differ", "Statistics": "not self.differ", "Difference": "self.same",
         "Validation": "self.valid", "Linted": "self.clean"}  # fmt: skip

# Properties: name, type, docstring and value.
PROPERTIES = {
    "FileInfo": ("grids", "list[dict[str, Any]]", "Grids of a VDB, as the program describes them; empty for other files.",
                 'list(self.extra.get("grids", []))'),
    "Iteration": ("objective", "float | None", "The loss, or the RMS.", "self.rms if self.loss is None else self.loss"),
    "Statistics": ("sides", "tuple[Noise, Noise]", "Noise of the two sides.",
                   'Noise.of(self.noise["a"]), Noise.of(self.noise["b"])'),
}  # fmt: skip

HEAD = '''"""Reports of the program as dataclasses.

Fields have the names of the JSON's keys. Keys that a class does not know (of a newer program, or of one kind of files
alone) are kept in `extra`, and `json` is the report as it came. Paths are `pathlib.Path`; lengths are in world units,
positions and matrices in world space, matrices row by row and acting on columns, times in seconds. A figure that is not
finite is None.

Written by python/report_classes.py from the program's schemas, not by hand.
"""

from __future__ import annotations

import dataclasses
import pathlib
from typing import Any

from .report import Report
'''

Schema = dict[str, Any]


@functools.cache
def schema(command: str) -> Schema:
    """The schema of a command's documents."""
    return cumulo.call("schema", command)


def definitions(name: str) -> list[tuple[str, Schema]]:
    """The definitions that a class stands for, each with its command."""
    commands, names, _ = CLASSES[name]
    return [(command, schema(command)["$defs"][one]) for command in commands.split() for one in names.split()]


def target(command: str, part: Schema) -> Schema:
    """The definition that a part of a schema refers to."""
    return dict(schema(command)["$defs"][part["$ref"].removeprefix("#/$defs/")])


def merged(parts: list[tuple[dict[str, Schema], set[str]]]) -> tuple[dict[str, Schema], set[str]]:
    """Keys of alternatives: all of them, and those that each requires."""
    keys = {key: rule for some, _ in reversed(parts) for key, rule in some.items()}
    return keys, set.intersection(*(required for _, required in parts)) if parts else set()


def keys_of(command: str, part: Schema) -> tuple[dict[str, Schema], set[str]]:
    """Keys of an object with their schemas, and those that are always there. Of alternatives that a key tells apart,
    those that all have."""
    keys: dict[str, Schema] = {}
    required: set[str] = set()
    if "$ref" in part:
        keys, required = keys_of(command, target(command, part))
    for alternatives in (part[word] for word in ("anyOf", "oneOf") if word in part):
        found, always = merged([keys_of(command, one) for one in alternatives if one])
        if any("const" in rule for rule in found.values()):
            found = {key: rule for key, rule in found.items() if key in always}
        keys |= found
        # An alternative without keys: all of them may be missing.
        required |= always if {} not in alternatives else set()
    return keys | part.get("properties", {}), required | set(part.get("required", []))


def class_of(command: str, part: Schema) -> str | None:
    """The class that stands for a definition."""
    found = target(command, part)
    return next((name for name in CLASSES for _, own in definitions(name) if own == found), None)


def hint(command: str, part: Schema, key: str) -> str:
    """The type of a value."""
    if "$ref" in part:
        return class_of(command, part) or hint(command, target(command, part), key)
    for alternatives in (part[word] for word in ("anyOf", "oneOf") if word in part):
        return " | ".join(dict.fromkeys(hint(command, one, key) for one in alternatives))
    words = {"integer": "int", "number": "float", "string": "str", "boolean": "bool", "null": "None"}
    kinds = part.get("type", [])
    kinds = kinds if isinstance(kinds, list) else [kinds]
    return " | ".join(words.get(kind) or container(command, kind, part, key) for kind in kinds) or "Any"


def container(command: str, kind: str, part: Schema, key: str) -> str:
    """The type of an array or an object."""
    if kind == "object":
        values = part.get("additionalProperties")
        return f"dict[str, {hint(command, values, key) if isinstance(values, dict) else 'Any'}]"
    fixed = part.get("minItems") is not None and part.get("minItems") == part.get("maxItems")
    # Places, colors and matrices are finite.
    inner = hint(command, part["items"], key).removesuffix(" | None") if "items" in part else "Any"
    return f"tuple[{inner}, ...]" if fixed or key in TUPLES else f"list[{inner}]"


def documented(text: str, indent: int) -> str:
    """A docstring."""
    space = " " * indent
    text = text.replace("[`", "`").replace("`]", "`").replace("\\", "\\\\")
    lines = textwrap.wrap(f'"""{text}"""', WIDTH - indent, break_long_words=False, break_on_hyphens=False)
    return "".join(f"{space}{line}\n" for line in lines)


def field(command: str, key: str, rule: Schema, needed: bool, paths: list[str]) -> str:
    """A field of a class."""
    kind = hint(command, rule, key)
    if key in paths:
        kind = kind.replace("str", "pathlib.Path")
    default = ""
    if not needed and kind.startswith("list["):
        default = " = dataclasses.field(default_factory=list)"
    elif not needed:
        kind, default = (kind if kind == "Any" or kind.endswith("None") else f"{kind} | None"), " = None"
    name = f"{key}_" if keyword.iskeyword(key) else key
    text = rule.get("description")
    return f"    {name}: {kind}{default}\n" + (documented(text, 4) if text else "")


def class_text(name: str) -> str:
    """A class."""
    found = [(command, *keys_of(command, part)) for command, part in definitions(name)]
    commands = {key: command for command, keys, _ in reversed(found) for key in keys}
    keys, required = merged([(keys, always) for _, keys, always in found])
    out = f"\n\n@dataclasses.dataclass(frozen=True, kw_only=True)\nclass {name}(Report):\n"
    truth = f" Truth value: `{TRUTH[name].replace('self.', '')}`." if name in TRUTH else ""
    out += documented(definitions(name)[0][1]["description"] + truth, 4) + "\n"
    paths = CLASSES[name][2].split()
    out += "".join(field(commands[key], key, keys[key], key in required, paths) for key in sorted(keys))
    if name in TRUTH:
        out += f"\n    def __bool__(self) -> bool:\n        return {TRUTH[name]}\n"
    if name in PROPERTIES:
        what, kind, text, value = PROPERTIES[name]
        out += f"\n    @property\n    def {what}(self) -> {kind}:\n{documented(text, 8)}        return {value}\n"
    return out


def text() -> str:
    """The whole file."""
    names = "".join(f'    "{name}",\n' for name in sorted([*CLASSES, "Report"]))
    return f"{HEAD}\n__all__ = [\n{names}]\n" + "".join(map(class_text, CLASSES))


if __name__ == "__main__":
    PLACE.write_text(text())
