"""Whatever decides a result tells it from another, and is named."""

from dataclasses import asdict, fields, replace

import msgspec
import pytest

from unlit.storage.identity import Identity

KEPT = Identity("a.jpg", "c", "only", "m", {"clip": "1.0", "bounces": "3"}, "h", "1", "k", "llvm")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"photo": "b.jpg"}, "another photo (a.jpg, not b.jpg)"),
        ({"content": "d"}, "another photo of that name"),
        ({"face": "left"}, "another face (only, not left)"),
        ({"mask": ""}, "another mask"),
        ({"settings": {"clip": "2.0"}}, "other settings (bounces 3, not None, clip 1.0, not 2.0)"),
        ({"head": "i"}, "another head model"),
        ({"release": "2"}, "another version of unlit (1, not 2)"),
        ({"code": "l"}, "another version of unlit (other code)"),
        ({"renderer": "cuda"}, "another renderer (llvm, not cuda)"),
    ],
)
def test_each_difference_is_named(changes, said):
    """And changes the key."""
    now = replace(KEPT, **changes)
    assert KEPT.difference(now) == said
    assert KEPT.key != now.key


def test_every_field_counts():
    """A field that is added later must not be forgotten in words."""
    for field in fields(Identity):
        value = {} if field.name == "settings" else "other"
        assert KEPT.difference(replace(KEPT, **{field.name: value}))


def test_nothing_differs():
    """Also after it was kept in a file."""
    again = msgspec.convert(asdict(KEPT), Identity)
    assert again == KEPT
    assert again.key == KEPT.key
    assert KEPT.difference(again) == ""
