"""batch.html: a gallery of a batch's results, to be sorted and searched, beside its table.

The page itself holds words and numbers, about 1 kB a result; the pictures are files in the
results' folders, which the browser loads as they come into sight. It names nothing but what lies
beside it, so the folder can be moved, and it reads without a script, too, in the table's order.
"""

from __future__ import annotations

import urllib.parse
from html import escape
from importlib.metadata import version
from pathlib import PurePath

from ..output.thumbnail import SIDE
from ..report.document import document, filled, web
from ..storage.folder import REPORT, THUMBNAIL
from ..storage.names import readable
from .record import BatchRow

#: The kind of the warning about a landmark residual (face/warnings.py).
_MISFIT = "Large landmark residual"


def as_html(rows: list[BatchRow], left: int = 0) -> bytes:
    """The page about `rows`, in their order. left: photos that are still to be done."""
    failed = sum(bool(row.error) for row in rows)
    warned = sum(bool(row.warnings) for row in rows)
    counts = f"{len(rows) - failed} done, {failed} failed, {warned} with warnings"
    if left:
        counts = f"{left} still to do; so far {counts}"
    kinds = dict.fromkeys(kind for row in rows for kind in _kinds(row))
    body = filled(
        "batch.html",
        counts=counts,
        version=escape(version("unlit")),
        kinds="".join(f"<option>{escape(kind)}</option>" for kind in sorted(kinds)),
        cards="\n".join(_card(number, row) for number, row in enumerate(rows)),
    )
    # Beside a page on disk, or on a server.
    images = "'self' file: data:"
    styles = ("page.css", "batch.css")
    return document("unlit batch", body, [web("batch.js")], styles, images).encode()


def _kinds(row: BatchRow) -> list[str]:
    """What the warnings are about: what stands before their colon."""
    return list(dict.fromkeys(readable(text.partition(":")[0]) for text in row.warnings))


def _card(number: int, row: BatchRow) -> str:
    name = readable(row.folder or PurePath(row.photo).name)
    known = {
        "order": str(number),
        # As batch.js lowers what is searched for: casefold() would make "ss" of "ß".
        "name": f"{name} {readable(row.photo)}".lower(),
        "status": "failed" if row.error else "done",
        "kinds": "\n".join(_kinds(row)),
        "warnings": str(len(row.warnings)),
        "residual": _number(row.landmark_residual),
        "match": _number(row.render_psnr),
        "seconds": _number(sum(row.seconds.values()) if row.seconds else None),
    }
    data = " ".join(f'data-{key}="{escape(value)}"' for key, value in known.items())
    inner = _failure(row, name) if row.error else _result(row, name)
    return f'<li class="card {known["status"]}" {data}>{inner}</li>'


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


def _failure(row: BatchRow, name: str) -> str:
    return f"<h2>{escape(name)}</h2><p><strong>Failed.</strong> {escape(readable(row.error))}</p>"


def _result(row: BatchRow, name: str) -> str:
    place = urllib.parse.quote(row.folder)
    target = f"{place}/{REPORT if row.report else 'montage.png'}"
    shown = ""
    if row.thumbnail:
        what = f"Photo, diffuse albedo and outdoor light of {name}"
        shown = (
            f'<img src="{place}/{THUMBNAIL}" alt="{escape(what)}" loading="lazy" '
            f'decoding="async" width="{3 * SIDE}" height="{SIDE}">'
        )
    # One link for each card: who goes from link to link hears the name once.
    title = f'<h2><a href="{target}">{escape(name)}</a></h2>'
    items = "".join(f"<li>{escape(readable(text))}</li>" for text in row.warnings)
    listed = ""
    if items:
        plural = "" if len(row.warnings) == 1 else "s"
        listed = (
            f"<details><summary>{len(row.warnings)} warning{plural}: "
            f"{escape(', '.join(_kinds(row)))}</summary><ul>{items}</ul></details>"
        )
    return f"{shown}{title}<p>{'; '.join(_figures(row))}</p>{listed}"


def _figures(row: BatchRow) -> list[str]:
    said = []
    if row.landmark_residual is not None:
        mark = ", look at the fit" if _MISFIT in _kinds(row) else ""
        said.append(f"residual {row.landmark_residual:.1%}{mark}")
    if row.render_psnr is not None:
        said.append(f"match {row.render_psnr:.1f} dB")
    if row.seconds:
        said.append(f"{sum(row.seconds.values()):.0f} s")
    return said
