"""Color ramps of Blender as transfer functions: what Blender evaluates is what the file says."""

import json

import bpy
import numpy as np
import pytest
from cumulo.transfer import transfer_from_color_ramp, write_transfer

ELEMENTS = [(0.1, (0.8, 0.1, 0.02, 0.0)), (0.35, (0.1, 0.3, 0.9, 0.25)), (0.7, (1.5, 0.6, 0.05, 1.0)), (0.9, (0, 0.2, 0, 0.5))]


def ramp_of(elements, interpolation="LINEAR", mode="RGB", hue="NEAR"):
    """A ramp of a fresh node tree; the tree comes along, for it owns the ramp."""
    tree = bpy.data.node_groups.new("ramps", "ShaderNodeTree")
    ramp = tree.nodes.new("ShaderNodeValToRGB").color_ramp
    ramp.color_mode = mode
    if mode == "RGB":
        ramp.interpolation = interpolation
    else:
        ramp.hue_interpolation = hue
    while len(ramp.elements) < len(elements):
        ramp.elements.new(0.5)
    for element, (position, color) in zip(ramp.elements, elements):
        element.position, element.color = position, color
    return tree, ramp


def value(points, density):
    """Between points, as documented: linear, constant outside, the upper side at a step."""
    points = np.array(points)
    above = np.searchsorted(points[:, 0], density, side="right")
    if above in (0, len(points)):
        return points[min(above, len(points) - 1), 1:]
    low, high = points[above - 1], points[above]
    f = (density - low[0]) / (high[0] - low[0])
    return (1 - f) * low[1:] + f * high[1:]


@pytest.mark.parametrize(
    "interpolation, mode, hue",
    [
        ("LINEAR", "RGB", None), ("CONSTANT", "RGB", None), ("EASE", "RGB", None), ("CARDINAL", "RGB", None),
        ("B_SPLINE", "RGB", None), (None, "HSV", "NEAR"), (None, "HSV", "FAR"), (None, "HSV", "CW"), (None, "HSL", "CCW"),
    ],
)  # fmt: skip
def test_a_ramp_keeps_its_values(cumulo, tmp_path, interpolation, mode, hue):
    _tree, ramp = ramp_of(ELEMENTS, interpolation, mode, hue)
    low, high, extinction = -0.5, 2.0, 12.0
    document = transfer_from_color_ramp(ramp, (low, high), extinction, name="a ramp")
    path = tmp_path / "ramp.tf.json"
    write_transfer(path, document)
    points = document["transfer"]["points"]
    report = cumulo("transfer", path)
    assert (report["kind"], report["source"], report["name"]) == ("piecewise", "cumulo", "a ramp")
    assert report["range"] == [points[0][0], points[-1][0]]
    assert report["peak_extinction"] == max(p[4] for p in points)
    if interpolation in ("LINEAR", "CONSTANT"):
        assert len(points) == (7 if interpolation == "CONSTANT" else 4), points
    # The program writes the same points.
    again = tmp_path / "again.tf.json"
    cumulo("transfer", path, "-o", again)
    assert json.loads(again.read_text())["transfer"] == document["transfer"]
    # Between samples 1/256 apart hues may turn a corner: up to h/4 times six times the value.
    allowed = 1e-6 if interpolation in ("LINEAR", "CONSTANT") else 1.5 * 6 / 256 / 4
    for position in np.linspace(0.0, 1.0, 331):
        blender = np.maximum(ramp.evaluate(position), 0.0) * (1, 1, 1, extinction)
        found = value(points, low + position * (high - low))
        assert np.abs(found - blender).max() <= allowed * extinction, (position, found, blender)


def test_steps_of_a_ramp_stay_steps():
    """Two elements in one place; Blender's own value there is of one side."""
    twice = [(0.0, (0, 0, 0, 0)), (0.5, (0, 0, 0, 0)), (0.5, (1, 1, 1, 1)), (1.0, (1, 1, 1, 1))]
    for interpolation in ("LINEAR", "EASE"):
        _tree, ramp = ramp_of(twice, interpolation)
        points = transfer_from_color_ramp(ramp)["transfer"]["points"]
        assert [p for p in points if p[0] == 0.5] == [[0.5, 0, 0, 0, 0], [0.5, 1, 1, 1, 1]], interpolation
        for position in (0.2, 0.499, 0.501, 0.8):
            assert np.allclose(value(points, position), ramp.evaluate(position), rtol=0, atol=1e-6)


def test_what_is_no_range_is_refused():
    _tree, ramp = ramp_of(ELEMENTS)
    for domain, extinction in (((1, 1), 1), ((0, float("inf")), 1), ((0, 1), -1), ((0, 1), float("nan"))):
        with pytest.raises(ValueError, match="expected"):
            transfer_from_color_ramp(ramp, domain, extinction)
