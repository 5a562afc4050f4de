"""The summary: the same numbers in every format, and no hostile name does harm."""

import csv
import io

import pytest

from unlit.batches.folder import BatchFolder
from unlit.batches.record import BatchRow
from unlit.batches.table import as_csv, as_parquet, table, write_tables

ROWS = [
    BatchRow(
        "/p/a.jpg", "a", "", ["w1", "w2"], {"fit": 1.5, "writing": 0.25}, 0.02, 31.5, {"s1": 1 / 3}
    ),
    BatchRow('/p/<script>"\n=1.jpg', error="=cmd|' /C calc'!A0"),
    BatchRow("/p/\udcff\x1b[2J.jpg", "b", "", [], {"fit": 2.0}, 0.03, 30.0, {"s2": 0.5}),
]


def test_csv_holds_every_number():
    """Steps and stages of all rows are columns; no number is an empty cell; no formulas."""
    lines = list(csv.DictReader(io.StringIO(as_csv(table(ROWS)).decode())))
    assert [line["status"] for line in lines] == ["done", "failed", "done"]
    assert float(lines[0]["loss_s1"]) == 1 / 3
    assert float(lines[0]["seconds"]) == 1.75
    assert lines[0]["warnings"] == "w1; w2"
    assert lines[1]["seconds"] == lines[1]["loss_s1"] == lines[2]["loss_s1"] == ""
    assert lines[1]["error"].startswith("'=")
    assert "\x1b" not in lines[2]["photo"]


def test_where_every_photo_failed():
    """Columns without a single number are empty."""
    lines = table(
        [BatchRow("/p/a.jpg", error="cut off"), BatchRow("/p/b.txt", error="not a picture")]
    )
    assert len(list(csv.DictReader(io.StringIO(as_csv(lines).decode())))) == 2
    assert as_parquet(lines)


def test_parquet_is_the_same_table():
    """Text and float64; empty columns keep their kind."""
    parquet = pytest.importorskip("pyarrow.parquet")
    lines = table(ROWS)
    found = parquet.read_table(io.BytesIO(as_parquet(lines)))
    assert found.to_pylist() == lines
    assert str(found.schema.field("loss_s2").type) == "double"
    only_failed = parquet.read_table(io.BytesIO(as_parquet(table(ROWS[1:2]))))
    assert str(only_failed.schema.field("landmark_residual").type) == "double"


def test_a_batch_of_nothing_has_a_summary(tmp_path):
    """No rows, no failure."""
    write_tables(BatchFolder(str(tmp_path)), [])
    assert (tmp_path / "batch.html").read_text().startswith("<!doctype html>")
