"""An evaluation's figures as JSON, and as tables laid out like those of the paper.

The paper's own figures (Digital Emily, its Tables 2 and 3) stand beside ours.
"""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import Any

PSNR_LPIPS = tuple[str, str]

#: Table 2 of the paper: input -> method -> relit under -> (PSNR, LPIPS). [RBG23] sees many photos.
TABLE_2: dict[str, dict[str, dict[str, PSNR_LPIPS]]] = {
    "uniform": {
        "[RBG23], many photos": {"flash": ("25.3", "0.11"), "uniform": ("23.5", "0.081")},
        "[DBA*21]": {"flash": ("19.7", "0.15"), "uniform": ("15.9", "0.13")},
        "[LMP*21]": {"flash": ("21.4", "0.13"), "uniform": ("21.2", "0.11")},
        "the paper": {"flash": ("23.4", "0.12"), "uniform": ("25.9", "0.077")},
    },
    "flash": {
        "[RBG23], many photos": {"flash": ("26.4", "0.085"), "uniform": ("22.6", "0.11")},
        "[DBA*21]": {"flash": ("19.6", "0.16"), "uniform": ("15.6", "0.13")},
        "[LMP*21]": {"flash": ("21.8", "0.13"), "uniform": ("21.3", "0.12")},
        "the paper": {"flash": ("28.1", "0.065"), "uniform": ("24.1", "0.071")},
    },
}
#: Table 3 of the paper: (input, relit under) -> (PSNR, LPIPS), whole and without each stage.
TABLE_3: dict[tuple[str, str], tuple[PSNR_LPIPS, ...]] = {
    ("uniform", "flash"): (
        *(("23.4", "0.12"), ("16.2", "0.22"), ("22.3", "0.14"), ("21.9", "0.17")),
        *(("23.2", "0.12"), ("22.1", "0.15")),
    ),
    ("flash", "uniform"): (
        *(("24.1", "0.07"), ("17.0", "0.17"), ("23.2", "0.08"), ("22.8", "0.15")),
        *(("23.9", "0.08"), ("23.1", "0.09")),
    ),
}


@dataclass(frozen=True)
class Table:
    """A titled table of text."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def tables(result: dict[str, Any]) -> list[Table]:
    """The tables of an evaluation's result (docs/evaluation.md)."""
    full = [row for row in result["rows"] if row["variant"] == "full"]
    lights = [cell["light"] for cell in full[0]["relit"]]
    found = [_table_2(full, lights), _every_metric(full), _maps(result["rows"])]
    if any(row["variant"] != "full" for row in result["rows"]):
        found.insert(1, _table_3(result["rows"]))
    return found


def _pair(metrics: dict[str, Any], how: str, where: str = "face") -> PSNR_LPIPS:
    values = metrics[how][where]
    return f"{values['psnr']:.1f}", f"{values['lpips']:.3f}"


def _table_2(rows: list[dict[str, Any]], lights: list[str]) -> Table:
    header = ["input", "method"]
    for light in lights:
        header += [f"relit: {light}, PSNR", "LPIPS"]
    body = []
    for row in rows:
        for method, cells in TABLE_2.get(row["input"], {}).items():
            known = [cells.get(light, ("", "")) for light in lights]
            body.append((row["input"], method, *(value for pair in known for value in pair)))
        for how, name in (("gained", "unlit, one gain"), ("raw", "unlit, raw")):
            for where in ("face", "crop"):
                pairs = [_pair(cell["metrics"], how, where) for cell in row["relit"]]
                ours = (value for pair in pairs for value in pair)
                body.append((row["input"], f"{name}, {where}", *ours))
    return Table(
        "Relighting (the paper's Table 2)",
        tuple(header),
        tuple(body),
        "PSNR in dB, sRGB-encoded. face: mean over the face's mask; crop: mean over the picture, "
        "black outside the mask. The paper's figures are of Digital Emily.",
    )


def _table_3(rows: list[dict[str, Any]]) -> Table:
    variants = list(dict.fromkeys(row["variant"] for row in rows))
    body = []
    for (photo, light), paper in TABLE_3.items():
        cells = {
            row["variant"]: _pair(cell["metrics"], "gained")
            for row in rows
            for cell in row["relit"]
            if (row["input"], cell["light"]) == (photo, light)
        }
        if not cells:
            continue
        for k, metric in enumerate(("PSNR", "LPIPS")):
            label = f"{photo} to {light}"
            body.append((label, "the paper", metric, *(pair[k] for pair in paper)))
            ours = (cells[v][k] if v in cells else "" for v in variants)
            body.append((label, "unlit, one gain, face", metric, *ours))
    return Table("Ablation (the paper's Table 3)", ("", "method", "metric", *variants), tuple(body))


def _every_metric(rows: list[dict[str, Any]]) -> Table:
    names = ("psnr", "psnr_linear", "ssim", "lpips", "flip")
    body = []
    for row in rows:
        for cell in row["relit"]:
            for how in ("raw", "gained"):
                values = cell["metrics"][how]["face"]
                gain = cell["metrics"]["gain"] if how == "gained" else 1.0
                figures = (f"{values[n]:.{1 if n.startswith('psnr') else 3}f}" for n in names)
                body.append((row["input"], cell["light"], f"{gain:.2f}", *figures))
    header = ("input", "relit", "gain", "PSNR", "PSNR, linear", "SSIM", "LPIPS", "FLIP")
    return Table("Every metric, inside the face", header, tuple(body))


def _maps(rows: list[dict[str, Any]]) -> Table:
    body = []
    for row in rows:
        m = row["maps"]
        correlation = m["specular_correlation"]
        body.append(
            (
                row["input"],
                row["variant"],
                f"{m['albedo_psnr_raw']:.1f}",
                f"{m['albedo_psnr']:.1f}",
                f"{m['specular_level']:.2f}",
                "" if correlation is None else f"{correlation:.2f}",
                f"{m['normal_degrees']:.1f}",
                f"{m['mesh_normal_degrees']:.1f}",
                f"{m['mesh_mm']['mean']:.2f} / {m['mesh_mm']['p95']:.2f}",
            )
        )
    header = (
        *("input", "variant", "albedo PSNR, raw", "one gain", "specular level", "correlation"),
        *("normals, degrees", "of the mesh", "mesh mm, mean / 95 %"),
    )
    note = (
        "Specular level: our median over the true one. Mesh: distance to the true surface after a "
        "rigid alignment."
    )
    return Table("Maps and mesh against the truth", header, tuple(body), note)


def markdown(title: str, facts: list[str], found: list[Table]) -> str:
    """The tables as a Markdown page."""
    lines = [f"# {title}", "", *(f"- {fact}" for fact in facts), ""]
    for table in found:
        lines += [f"## {table.title}", ""]
        lines += [
            f"| {' | '.join(cells)} |" for cells in (table.header, ["---"] * len(table.header))
        ]
        lines += [f"| {' | '.join(cells)} |" for cells in table.rows]
        lines += ["", *([table.note, ""] if table.note else [])]
    return "\n".join(lines)


_STYLE = (
    "body{font:14px sans-serif;margin:2em}table{border-collapse:collapse}"
    "td,th{border:1px solid #999;padding:.2em .6em;text-align:right}"
    "td:first-child,td:nth-child(2),th{text-align:left}img{max-width:100%}"
)


def page(title: str, facts: list[str], found: list[Table], pictures: list[str]) -> str:
    """The tables and pictures as one HTML page."""
    text = html.escape
    parts = [f"<h1>{text(title)}</h1>", "<ul>", *(f"<li>{text(f)}</li>" for f in facts), "</ul>"]
    for table in found:
        parts += [f"<h2>{text(table.title)}</h2>", "<table>"]
        parts.append(f"<tr>{''.join(f'<th>{text(c)}</th>' for c in table.header)}</tr>")
        parts += [
            f"<tr>{''.join(f'<td>{text(c)}</td>' for c in cells)}</tr>" for cells in table.rows
        ]
        parts += ["</table>", f"<p>{text(table.note)}</p>"]
    parts += [f'<p><img src="{text(name)}" alt="{text(name)}"></p>' for name in pictures]
    head = f'<meta charset="utf-8"><title>{text(title)}</title><style>{_STYLE}</style>'
    return f"<!doctype html><html><head>{head}</head><body>{''.join(parts)}</body></html>\n"
