"""What is printed of a result."""

from dataclasses import replace

import pytest

from small_head import small_head


def test_it_is_shown_in_one_short_line():
    """Not as the digits of its arrays."""
    shown = repr(small_head())
    assert shown.startswith("Reconstruction('small head': 96 x 96 pixels, ")
    assert "2 lobes" in shown
    assert len(shown) < 200


@pytest.mark.parametrize("name", ["photo", "head", "conditions", "face", "light", "metrics"])
def test_its_parts_tell_shapes(name: str) -> None:
    """No part prints the numbers of its arrays or losses."""
    r = small_head()
    shown = repr(replace(r.metrics, losses={"stage1": [(k, 0.5) for k in range(0, 2000, 25)]}))
    if name != "metrics":
        shown = repr(getattr(r, name))
    assert "array(" not in shown and "..." not in shown
    assert len(shown) < 1200
