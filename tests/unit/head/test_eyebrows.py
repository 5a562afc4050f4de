"""Finding the eyebrows of a head."""

from unlit.head.eyebrows import eyebrow_vertices
from unlit.head.model import HeadModel
from unlit.perception.topology import LEFT_EYE


def test_eyebrow_vertices(head: HeadModel) -> None:
    """Vertices inside the outline are on the forehead's side of the eye."""
    chosen = eyebrow_vertices(head.landmarks(head.neutral), head.neutral)
    assert 20 < chosen.sum() < 500
    assert head.neutral[chosen, 1].mean() > head.landmarks(head.neutral)[list(LEFT_EYE), 1].max()
    assert (head.neutral[chosen, 2] > -2).all()
