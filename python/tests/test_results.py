"""The page of benchmark results: a figure a cell, and measured records in the place of noted ones."""

import re

import pytest

import results


def cells(page):
    """The cells of all tables of a page, rows of headings and rules left out."""
    for table in re.findall(r"(?m)(?:^\|.*\n)+", page):
        heads, _, *rows = [[c.strip() for c in line.strip().strip("|").split("|")] for line in table.splitlines()]
        for row in rows:
            assert len(row) == len(heads), row
            yield from zip(heads, row)


def test_a_cell_holds_one_figure():
    headings = {heading for _, heading, _ in results.FIGURES}
    figures = [cell for head, cell in cells(results.page(results.noted())) if head in headings]
    assert len(figures) > 100
    for figure in figures:
        assert re.fullmatch(r"|\d+(\.\d+)?", figure), figure


def test_what_was_measured_replaces_what_was_noted_of_the_same_work():
    document = results.noted()
    work = "128³ from 64 parallel-beam angles"
    new = {"id": "B5", "work": work, "program": "Cumulo", "setting": "", "volume_db": 51.234, "date": "2030-01-01", "measured": True}
    groups = {group["id"]: group["rows"] for group in results.merged(document, [new])}
    assert [row for row in groups["B5"] if row["program"] == "Cumulo"] == [new]
    assert any(row["program"] == "ASTRA" for row in groups["B5"])
    page = results.page(document, [new], "a machine")
    assert "| 51.2 |" in page and "measured 2030-01-01" in page and "a machine" in page


@pytest.mark.parametrize("name", ["RESULTS.md", "accuracy.svg"])
def test_both_files_are_there(name):
    assert (results.FOLDER / name).stat().st_size > 1000
