"""Loss curves: the right points, on a logarithmic scale."""

import re
import xml.etree.ElementTree as ET

import pytest

from unlit.report.figures import loss_chart


def test_equal_factors_are_equal_heights():
    """1, 0.1 and 0.01 lie at equal distances; the axis starts and ends at the curve's ends."""
    root = ET.fromstring(loss_chart("stage1", [(0, 1.0), (10, 0.1), (20, 0.01)]))
    line = next(part.attrib["points"] for part in root if part.get("class") == "curve")
    xs, ys = zip(*(map(float, point.split(",")) for point in line.split()), strict=True)
    assert ys[1] - ys[0] == pytest.approx(ys[2] - ys[1], abs=0.11) and ys[0] < ys[2]
    assert xs[1] - xs[0] == pytest.approx(xs[2] - xs[1], abs=0.11)
    assert [part.text for part in root if part.tag == "text"] == ["1", "0.01", "0", "20"]


def test_it_says_what_it_shows():
    chart = loss_chart('st"age<1>', [(0, 0.5), (8, 0.25)])
    said = ET.fromstring(chart).get("aria-label")
    assert said == 'st"age<1>: loss from 0.5 to 0.25 in 8 iterations'


def test_a_flat_curve_stays_flat():
    assert not re.search("nan|inf", loss_chart("x", [(0, 0.1), (5, 0.1)]))
