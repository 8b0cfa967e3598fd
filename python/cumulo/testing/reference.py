"""References: pictures of a renderer that is believed, kept with all that they depend on."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib
import importlib.metadata
import json
import os
import pathlib
import tempfile
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ..capture import Camera
from ..options import Path

# Renders by a seed into an EXR at the path, or returns [row, column, channel] to be written there.
Render = Callable[[int, pathlib.Path], Any]
MANIFEST = "reference.json"


class ReferenceProblem(Exception):
    """A reference is missing, or was made of other inputs than the test names."""


@dataclasses.dataclass(frozen=True)
class Reference:
    """Pictures by seed of one scene.

    `render(seed, path)` makes one; its other inputs are `inputs`, files whose content counts, and
    `settings`, which JSON can hold. `renderer` is the Python distribution whose version counts, such as
    "bpy"; where it is not installed, kept pictures are taken as they are. `discover()` returns further
    files, known after rendering only, such as those that a .blend links.
    """

    name: str
    render: Render
    inputs: Sequence[Path] = ()
    settings: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    renderer: str | None = "bpy"
    discover: Callable[[], Sequence[Path]] | None = None

    def __post_init__(self) -> None:
        """Raises ValueError for a name that is not that of a folder within the folder of references."""
        if not self.name or self.name.startswith(".") or set(self.name) & set("/\\:\0"):
            raise ValueError(
                f"a reference named {self.name!r}: its pictures are kept in a folder of that name, so that it may not begin"
                " with a dot, nor hold a slash, a backslash or a colon; give a plain name such as 'smoke'"
            )


def volume(vdb: Path, camera: Camera, settings: Any, *, grid: str = "density", name: str | None = None) -> Reference:
    """Pictures by Cycles of a VDB, before their background is laid behind: RGBA, premultiplied.

    `camera` is a `cumulo.capture.Camera`, `settings` a `cumulo.blender.Settings` or a dict of its fields. Raises TypeError
    where `camera` or `settings` is something else.
    """
    if not isinstance(camera, Camera):
        raise TypeError(
            f"camera is of type {type(camera).__name__}, and a cumulo.capture.Camera is expected; take one of a capture,"
            ' `camera, _ = cumulo.capture.Capture.read("shots").frames[0]`, or make one by `cumulo.capture.Camera(...)`'
        )
    if not (isinstance(settings, Mapping) or (dataclasses.is_dataclass(settings) and not isinstance(settings, type))):
        raise TypeError(
            f"settings is of type {type(settings).__name__}, and a cumulo.blender.Settings or a dict of its fields is"
            ' expected, such as {"model": "scattering", "albedo": (0.8, 0.8, 0.8), "sky": (1, 1, 1)}'
        )

    def render(seed: int, path: pathlib.Path) -> Any:
        blender: Any = importlib.import_module("cumulo.blender")
        made = settings if dataclasses.is_dataclass(settings) else blender.Settings(**settings)
        return blender.Stage(made, vdb, grid).film(camera, seed)

    # What sets the scene up is an input as well.
    here = pathlib.Path(__file__).resolve().parents[1]
    sky = _fields(settings).get("sky_file")
    parts = sorted((here / "cycles").glob("*.py"))
    files = [vdb, here / "blender.py", here / "exr.py", here / "padding.py", *parts, *([sky] if sky else [])]
    described = {"camera": plain(camera), "settings": {k: v for k, v in plain(settings).items() if k != "sky_file"}, "grid": grid}
    return Reference(name or pathlib.Path(vdb).stem, render, files, described)


def _fields(settings: Any) -> dict[str, Any]:
    return dict(settings) if isinstance(settings, Mapping) else dict(vars(settings))


def blend_file(path: Path, *, frame: int | None = None, camera: str | None = None, size: tuple[int, int] | None = None,
               samples: int = 64, inputs: Sequence[Path] = (), name: str | None = None) -> Reference:  # fmt: skip
    """Pictures of a .blend as its scene renders: scene-linear RGBA, without denoising and adaptive sampling, each
    pixel the mean over its square so that pixels are independent.

    `camera` names an object (default: the scene's), `size` is (width, height). Files that the .blend links
    are found by Blender and count as inputs, of sequences the frame that is loaded.
    """
    linked: list[Path] = []

    def render(seed: int, out: pathlib.Path) -> Any:
        from . import blend

        linked[:] = blend.render(pathlib.Path(path), out, seed, frame, camera, size, samples)

    settings = {"frame": frame, "camera": camera, "size": size, "samples": samples}
    # What sets the scene up is an input as well.
    files = [path, pathlib.Path(__file__).resolve().with_name("blend.py"), *inputs]
    return Reference(name or pathlib.Path(path).stem, render, files, settings, discover=lambda: linked)


def plain(value: Any) -> Any:
    """A value as JSON holds it: dataclasses as dicts with the name of their class, arrays as lists."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"class": type(value).__name__, **fields}
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def digest(path: Path) -> str:
    """SHA-256 of a file's content."""
    sha = hashlib.sha256()
    with open(path, "rb") as file:
        while chunk := file.read(1 << 20):
            sha.update(chunk)
    return sha.hexdigest()


def changes(before: Any, now: Any, where: str = "") -> list[str]:
    """What differs between two JSON values, a line each."""
    if isinstance(before, dict) and isinstance(now, dict):
        lines = []
        for key in sorted(before.keys() | now.keys()):
            lines += changes(before.get(key), now.get(key), f"{where}.{key}" if where else key)
        return lines
    return [] if before == now else [f"{where}: {_short(before)} then, {_short(now)} now"]


def _short(value: Any) -> str:
    text = "absent" if value is None else json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


@dataclasses.dataclass(frozen=True)
class Store:
    """A folder of references, one folder each: the EXRs by seed, and what they were made of.

    `missing` says what becomes of a reference that is not there, or is of other inputs: "fail", or "render" for
    a cache that nobody keeps.
    """

    folder: pathlib.Path
    root: pathlib.Path
    missing: str = "fail"
    regenerate: bool = False

    def pictures(self, reference: Reference, seeds: Sequence[int]) -> tuple[list[pathlib.Path], dict[str, Any], bool]:
        """Paths of the EXRs by seed, what they were made of, and whether they were rendered just now.

        Raises ReferenceProblem where they are missing or of other inputs, and may not be rendered.
        """
        folder = self.folder / reference.name
        problem = self._problem(reference, seeds, folder)
        if self.regenerate or (problem and self.missing == "render"):
            self._render(reference, seeds, folder)
        elif problem:
            raise ReferenceProblem(f"reference {reference.name!r}: {problem}\n  to render it: pytest --cumulo-regenerate")
        made = json.loads((folder / MANIFEST).read_text())
        return [folder / f"seed_{seed}.exr" for seed in seeds], made, bool(self.regenerate or problem)

    def _problem(self, reference: Reference, seeds: Sequence[int], folder: pathlib.Path) -> str | None:
        try:
            made = json.loads((folder / MANIFEST).read_text())
            kept = {name: digest(folder / name) for name in made["pictures"]}
        except (OSError, ValueError, KeyError) as error:
            return f"there is none in {folder}" if isinstance(error, FileNotFoundError) else f"{folder}: {error!r}"
        if kept != made["pictures"]:
            return f"its pictures in {folder} are not those that were rendered"
        missing = [seed for seed in seeds if f"seed_{seed}.exr" not in kept]
        if missing:
            return f"seed {missing[0]} was not rendered"
        # Files that only the renderer finds are checked where they were found.
        own = self._files(reference, [])
        found = [self.root / name for name in made.get("inputs", {}) if name not in own] if reference.discover else []
        now = self._described(reference, found)
        if reference.renderer and now["renderer"] is None:
            now["renderer"] = made["renderer"]
        lines = changes({key: made.get(key) for key in now}, now)
        return "it is of other inputs:\n    " + "\n    ".join(lines) if lines else None

    def _described(self, reference: Reference, found: Sequence[Path]) -> dict[str, Any]:
        files = self._files(reference, found)
        version = None
        if reference.renderer:
            try:
                version = f"{reference.renderer} {importlib.metadata.version(reference.renderer)}"
            except importlib.metadata.PackageNotFoundError:
                pass
        return {
            "inputs": {name: digest(path) if os.path.exists(path) else None for name, path in sorted(files.items())},
            "settings": json.loads(json.dumps(plain(reference.settings))),
            "renderer": version,
        }

    def _files(self, reference: Reference, found: Sequence[Path]) -> dict[str, Path]:
        """Inputs by their names: those that the test names, and those that the renderer found."""
        files: dict[str, Path] = {}
        for path in reference.inputs:
            name, number = self._name(path), 1
            while name in files and pathlib.Path(files[name]).absolute() != pathlib.Path(path).absolute():
                # Files of one name in several folders away from the checkout.
                number += 1
                name = f"{self._name(path)} ({number})"
            files[name] = path
        own = {pathlib.Path(path).absolute() for path in files.values()}
        for path in found:
            absolute = pathlib.Path(path).absolute()
            if absolute not in own:
                # Nobody but the renderer knows where it is, so that its name has to say it.
                within = absolute.relative_to(self.root).as_posix() if absolute.is_relative_to(self.root) else None
                files[within if within and within not in files else absolute.as_posix()] = absolute
        return files

    def _name(self, path: Path) -> str:
        """Name of an input, which stays when the checkout moves."""
        absolute = pathlib.Path(path).absolute()
        package = pathlib.Path(__file__).resolve().parents[1]
        for name, folder in (("", self.root), ("cumulo", package)):
            if absolute.is_relative_to(folder):
                return str(pathlib.PurePosixPath(name) / absolute.relative_to(folder).as_posix())
        return absolute.name

    def _render(self, reference: Reference, seeds: Sequence[int], folder: pathlib.Path) -> None:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".rendering-") as draft_name:
            draft = pathlib.Path(draft_name)
            for seed in seeds:
                render_to(reference.render, seed, draft / f"seed_{seed}.exr")
            found = list(reference.discover()) if reference.discover else []
            pictures = {path.name: digest(path) for path in sorted(draft.glob("*.exr"))}
            manifest = {"name": reference.name, **self._described(reference, found), "pictures": pictures}
            (draft / MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n")
            folder.mkdir(exist_ok=True)
            # The manifest comes last: without it, the folder is no reference.
            (folder / MANIFEST).unlink(missing_ok=True)
            for old in folder.glob("seed_*.exr"):
                old.unlink()
            for path in [*sorted(draft.glob("*.exr")), draft / MANIFEST]:
                os.replace(path, folder / path.name)


def render_to(render: Render, seed: int, path: pathlib.Path) -> None:
    """Lets a function make an EXR, and writes it if the function returns an array instead.

    Raises ReferenceProblem if there is no picture afterwards.
    """
    made = render(seed, path)
    if made is not None and not isinstance(made, (str, os.PathLike)):
        from .. import arrays

        arrays.write_picture(path, made)
    elif made is not None and pathlib.Path(made) != path:
        path.write_bytes(pathlib.Path(made).read_bytes())
    if not path.is_file():
        raise ReferenceProblem(f"{path.name} was not written; the function must write it, or return the picture")
