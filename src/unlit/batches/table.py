"""The summary of a batch: batch.csv, batch.html, and batch.parquet where pyarrow is installed."""

from __future__ import annotations

import csv
import html
import importlib.util
import io
import urllib.parse
from typing import Any

from .folder import BatchFolder
from .record import BatchRow, readable

#: A cell that a spreadsheet would take for a formula.
_FORMULA = ("=", "+", "-", "@")
#: Columns of text; all others are numbers.
_TEXT = ("photo", "status", "folder", "warnings", "error")
_STYLE = """
body { font: 14px/1.4 system-ui, sans-serif; margin: 2em; }
table { border-collapse: collapse; }
th, td { padding: .25em .6em; border-bottom: 1px solid #ddd; text-align: left; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
tr.failed { background: #fdecea; }
"""


def write_tables(store: BatchFolder, rows: list[BatchRow]) -> None:
    """Write the summary of `rows`, a line each. Raises OutputError."""
    lines = table(rows)
    store.write("batch.csv", as_csv(lines))
    store.write("batch.html", as_html(lines))
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


def as_html(lines: list[dict[str, Any]]) -> bytes:
    """One page without scripts, with a link to each result's montage."""
    failed = sum(line["status"] == "failed" for line in lines)

    def cell(name: str, value: Any) -> str:
        if name not in _TEXT:
            return f'<td class="number">{"" if value is None else f"{value:.4g}"}</td>'
        text = html.escape(value)
        if name == "folder" and value:
            text = f'<a href="{urllib.parse.quote(value)}/montage.png">{text}</a>'
        return f"<td>{text}</td>"

    def title(name: str) -> str:
        kind = "" if name in _TEXT else ' class="number"'
        return f"<th{kind}>{html.escape(name.replace('_', ' '))}</th>"

    head = "".join(title(name) for name in (lines[0] if lines else {}))
    body = "\n".join(
        f'<tr class="{line["status"]}">{"".join(cell(*item) for item in line.items())}</tr>'
        for line in lines
    )
    return (
        '<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n<title>unlit batch</title>\n'
        f"<style>{_STYLE}</style>\n<h1>unlit batch</h1>\n"
        f"<p>{len(lines) - failed} done, {failed} failed</p>\n"
        f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>\n</html>\n"
    ).encode()


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
