"""tables.py: the line of a field in a TOML file."""

import pytest

from unlit.storage.tables import place_of

TEXT = """# a comment = 1
top = 1
"quoted" = 2

[first]
a = 1
b.c = 2  # = 3
rows = [
  [1, 2],
]
[first.inner]
a = { b = 1 }
[[many]]
x = 1
[[many]] # again
x = 2
[many.sub]
y = 3
[ spaced . name ]
z=4
"""


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("top", 2),
        ("quoted", 3),
        ("first", 5),
        ("first.a", 6),
        ("first.b.c", 7),
        ("first.rows[0][1]", 8),
        ("first.missing", 5),
        ("first.inner.a", 12),
        ("first.inner.a.b", 12),
        ("many[0].x", 14),
        ("many[1].x", 16),
        ("many[1].sub.y", 18),
        ("many[1].none", 15),
        ("spaced.name.z", 20),
        ("none.at.all", None),
        ("", None),
    ],
)
def test_lines(tmp_path, name, line):
    """Of fields, of tables where a field is missing, of the whole where a part is wrong."""
    path = tmp_path / "x.toml"
    path.write_text(TEXT)
    assert place_of(path, name) == (str(path) if line is None else f"{path}, line {line}")
