"""The committed classes of reports are those of the program's schemas."""

import dataclasses

import report_classes
from cumulo import results


def test_the_classes_are_those_of_the_schemas():
    assert report_classes.PLACE.read_text() == report_classes.text(), "run python/report_classes.py"


def test_every_class_is_public_and_every_key_has_a_type():
    assert set(results.__all__) == {*report_classes.CLASSES, "Report"}
    for name in report_classes.CLASSES:
        assert all("Any" != field.type for field in dataclasses.fields(getattr(results, name))), name
