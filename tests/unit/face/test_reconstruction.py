"""What is printed of a result."""

from small_head import small_head


def test_it_is_shown_in_one_short_line():
    """Not as the digits of its arrays."""
    shown = repr(small_head())
    assert shown.startswith("Reconstruction('small head': 96 x 96 pixels, ")
    assert "2 lobes" in shown
    assert len(shown) < 200
