"""Comparison of a candidate with a reference, and what a failing one leaves."""

from __future__ import annotations

import dataclasses
import math
import pathlib
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from typing import Any, NoReturn, Union

import pytest

from .. import commands, results
from .reference import Reference, ReferenceProblem, Render, Store, render_to

# A function as of `Reference.render`, or a command with the words {seed} and {output} in it.
Candidate = Union[Render, "Sequence[object]"]


def rounding(steps: int, largest: float) -> float:
    """Largest error of a value computed in single precision by so many roundings of numbers up to `largest`: the
    tolerance of a deterministic picture whose arithmetic is known."""
    return steps * 2.0**-24 * largest


@dataclasses.dataclass
class Parity:
    """Compares pictures of candidates with references; the fixture `cumulo_parity`.

    `failures` is the folder for what this test leaves, `scratch` one for pictures of candidates.
    """

    store: Store
    failures: pathlib.Path
    scratch: pathlib.Path
    test: str = ""
    pages: list[pathlib.Path] = dataclasses.field(default_factory=list)
    regenerated: list[str] = dataclasses.field(default_factory=list)

    def statistical(self, reference: Reference, candidate: Candidate, *, seeds: Sequence[int] = (1, 2),
                    candidate_seeds: Sequence[int] = (1, 2), tolerance: float = 0.0, false_alarm: float = 1e-3,
                    tile: int = 16, noiseless: str | None = None) -> results.Statistics:  # fmt: skip
        """Tests whether noisy pictures have the same expected values (`cumulo compare --statistical`).

        The noise is known from the pictures of several seeds, or, of one seed, from the layers `variance` or
        `half_a` and `half_b`; `noiseless` ("reference" or "candidate") says that a side has none. A test of
        equal expected values fails with probability `false_alarm` at most. `tolerance` is a difference of
        expected values that counts as none, `tile` the edge of a tile in pixels.
        """
        expected, made, actual = self._pictures(reference, candidate, seeds, candidate_seeds)
        sides = {None: None, "candidate": "a", "reference": "b"}
        if noiseless not in sides:
            raise ValueError(f"noiseless is {noiseless!r}; 'reference' or 'candidate' is expected")
        found = commands.compare_statistical(
            actual[0], expected[0], repeat_a=actual[1:], repeat_b=expected[1:], noiseless=sides[noiseless],
            tolerance=tolerance, false_alarm=false_alarm, tile=tile,
        )  # fmt: skip
        if not found:
            worst = min(
                ((name, c.channel, test.p) for c in found.channels for name, test in _tests(c)), key=lambda t: t[2]
            )
            p = f"p = {found.p:.1e}" if found.p else "p below 1e-300"
            words = f"the expected values differ, {p} of all tests; most clearly {worst[0]} of {worst[1]}"
            self._fail(reference, words, found, made, (expected, actual), candidate)
        return found

    def exact(self, reference: Reference, candidate: Candidate, *, tolerance: float, seed: int = 1) -> results.Comparison:
        """Compares deterministic pictures: no sample may differ by more than `tolerance` (see `rounding`)."""
        if not (math.isfinite(tolerance) and tolerance >= 0):
            raise ValueError(f"tolerance is {tolerance}; a number from 0 on is expected")
        expected, made, actual = self._pictures(reference, candidate, [seed], [seed])
        found = commands.compare(actual[0], expected[0], tolerance=tolerance)
        if not found:
            # A difference that is not finite is None.
            most = max(math.inf if found.max_abs is None else found.max_abs, found.alpha_max_abs or 0)
            sample = f"a sample differs by {most:.3e}, {tolerance:.3e} is allowed"
            words = sample if most > tolerance else f"they differ: {'; '.join(found.differences)}"
            self._fail(reference, words, found, made, (expected, actual), candidate)
        return found

    def _pictures(
        self, reference: Reference, candidate: Candidate, seeds: Sequence[int], candidate_seeds: Sequence[int]
    ) -> tuple[list[pathlib.Path], dict[str, Any], list[pathlib.Path]]:
        if not seeds or not candidate_seeds:
            raise ValueError("no seeds: give one at least to either side")
        try:
            expected, made, rendered = self.store.pictures(reference, seeds)
        except ReferenceProblem as error:
            pytest.fail(str(error), pytrace=False)
        if self.store.regenerate:
            self.regenerated.append(reference.name)
            pytest.fail(
                f"reference {reference.name!r} was rendered again: look at {expected[0].parent}, then run without "
                "--cumulo-regenerate",
                pytrace=False,
            )
        self.scratch.mkdir(parents=True, exist_ok=True)
        actual = [self._run(candidate, seed, f"{reference.name}_{seed}.exr") for seed in candidate_seeds]
        return expected, made, actual

    def _run(self, candidate: Candidate, seed: int, name: str) -> pathlib.Path:
        path = self.scratch / name
        path.unlink(missing_ok=True)
        if callable(candidate):
            render_to(candidate, seed, path)
            return path
        words = [str(word).replace("{seed}", str(seed)).replace("{output}", str(path)) for word in candidate]
        done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        if done.returncode != 0 or not path.is_file():
            what = f"exit code {done.returncode}" if done.returncode else "it wrote no picture to {output}"
            pytest.fail(f"the candidate failed, {what}: {shlex.join(words)}\n{done.stderr.strip()}", pytrace=False)
        return path

    def _fail(self, reference: Reference, words: str, found: results.Report, made: dict[str, Any],
              pictures: tuple[list[pathlib.Path], list[pathlib.Path]], candidate: Candidate) -> NoReturn:  # fmt: skip
        from . import page

        folder = self.failures / reference.name
        shutil.rmtree(folder, ignore_errors=True)
        shown = shlex.join(str(word) for word in candidate) if not callable(candidate) else _name(candidate)
        self.pages.append(page.write(folder, page.Failure(self.test, words, found, made, *pictures, shown)))
        pytest.fail(f"{reference.name}: {words}\n  see {self.pages[-1]}", pytrace=False)


def _name(function: Any) -> str:
    """A function as a page names it."""
    module, name = getattr(function, "__module__", None), getattr(function, "__qualname__", None)
    return f"the function {name} of {module}" if name else "a function"


def _tests(channel: results.ChannelTests) -> list[tuple[str, Any]]:
    return [("the mean", channel.mean), ("a pixel", channel.pixels), ("a tile", channel.tiles), ("the spread", channel.spread)]
