"""The summary of a batch: batch.csv, batch.html, and batch.parquet where pyarrow is installed."""

from __future__ import annotations

import csv
import importlib.util
import io
from typing import Any

from ..storage.names import readable
from .folder import BatchFolder
from .page import as_html
from .record import BatchRow

#: A cell that a spreadsheet would take for a formula.
_FORMULA = ("=", "+", "-", "@")
#: Columns of text; all others are numbers.
_TEXT = ("photo", "status", "folder", "warnings", "error")


def write_tables(store: BatchFolder, rows: list[BatchRow], left: int = 0) -> None:
    """Write the summary of `rows`, a line each. left: photos still to do. Raises OutputError."""
    lines = table(rows)
    store.write("batch.csv", as_csv(lines))
    store.write("batch.html", as_html(rows, left))
    if importlib.util.find_spec("pyarrow") is not None:
        store.write("batch.parquet", as_parquet(lines))


def table(rows: list[BatchRow]) -> list[dict[str, Any]]:
    """Rows with the same columns each: str, float, or None where there is no such number."""
    steps = dict.fromkeys(step for row in rows for step in row.seconds)
    stages = dict.fromkeys(stage for row in rows for stage in row.losses)
    return [
        {
            "photo": readable(row.photo),
            "status": "failed" if row.error else "done",
            "folder": row.folder,
            "landmark_residual": row.landmark_residual,
            "render_psnr_db": row.render_psnr,
            **{f"loss_{stage}": row.losses.get(stage) for stage in stages},
            "seconds": sum(row.seconds.values()) if row.seconds else None,
            **{f"seconds_{step}": row.seconds.get(step) for step in steps},
            "warnings": readable("; ".join(row.warnings)),
            "error": readable(row.error),
        }
        for row in rows
    ]


def as_csv(lines: list[dict[str, Any]]) -> bytes:
    """UTF-8, with a header; numbers to the last digit, empty where there is none."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(lines[0] if lines else [])
    for line in lines:
        writer.writerow(
            f"'{cell}" if isinstance(cell, str) and cell.startswith(_FORMULA) else cell
            for cell in line.values()
        )
    return text.getvalue().encode()


def as_parquet(lines: list[dict[str, Any]]) -> bytes:
    """The same columns, as text and float64."""
    import pyarrow as pa
    import pyarrow.parquet as parquet

    columns = {name: [line[name] for line in lines] for name in (lines[0] if lines else {})}
    kinds = {name: pa.string() if name in _TEXT else pa.float64() for name in columns}
    buffer = io.BytesIO()
    parquet.write_table(
        pa.table({name: pa.array(cells, kinds[name]) for name, cells in columns.items()}), buffer
    )
    return buffer.getvalue()
