"""What a batch keeps of a photo: read back the same, and nothing else is taken for it."""

import json
from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from unlit.batches.record import BatchRow, Record
from unlit.storage.identity import Identity

IDENTITY = Identity("a.jpg", "c", "only", "", {"clip": "1.0"}, "h", "1", "k", "llvm")
ROW = BatchRow(
    photo="/p/caf\udce9.jpg",
    folder="cafe",
    warnings=["small"],
    seconds={"stage1": 1 / 3},
    landmark_residual=0.1,
    losses={"stage1": 1e-17},
)


def test_read_back_the_same():
    """Also a name that is no text, and numbers to the last digit."""
    record = Record(ROW.photo, IDENTITY, [ROW, BatchRow("/p/b.jpg", error="no face")])
    assert Record.decode(record.encode()) == record


_json = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=6,
)


@settings(deadline=None)
@given(st.binary(max_size=50))
def test_bytes_that_are_no_record(content):
    """Any bytes: None, no error."""
    assert Record.decode(content) is None


@settings(deadline=None)
@given(st.data())
def test_fields_of_wrong_types(data):
    """A record with one value replaced by anything is read as a whole record or not at all."""
    values = json.loads(Record("/p/a.jpg", IDENTITY, [ROW]).encode())
    table = data.draw(st.sampled_from([values, values["rows"][0]]))
    table[data.draw(st.sampled_from(sorted(table)))] = data.draw(_json)
    found = Record.decode(json.dumps(values).encode())
    assert found is None or Record.decode(found.encode()) is not None


def test_huge_nesting_is_no_record():
    """Brackets without end."""
    assert Record.decode(b"[" * 100_000) is None


def test_results_of_another_identity_are_none():
    """Nor are those of a photo or head model that could not be read."""
    record = Record("p", IDENTITY, [ROW, BatchRow("p", error="no face")])
    assert record.results(IDENTITY) == {"cafe": ROW}
    assert record.results(replace(IDENTITY, code="other")) == {}
    assert Record("p", None, [ROW]).results(None) == {}
