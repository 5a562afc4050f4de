"""The diagrams of the five stages in docs/pictures: `python tools/stage_diagrams.py`.

Boxes in colours that can be read before a light and a dark page.
"""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"

#: By stage: what is unknown, what is held, what the render is compared with.
STAGES = (
    (("light: 648 lobes", "colour, gloss by region"), ("mesh",), ("image",)),
    (("light: 648 lobes", "albedo maps"), ("mesh",), ("image", "smooth albedo 10, 1")),
    (
        ("light: 648 lobes", "albedo maps", "vertices"),
        (),
        ("image", "smooth albedo 10, 1", "landmarks, shape"),
    ),
    (
        ("albedo maps", "normal perturbation e"),
        ("mesh", "light"),
        ("image", "smooth albedo 10, 1", "|e|\u00b2"),
    ),
    (
        ("albedo maps", "normal perturbation e"),
        ("mesh", "light"),
        ("image", "smooth albedo 1, 0.1", "|e|\u00b2"),
    ),
)
_WIDTH, _BOX, _LINE, _GAP, _TOP = 660, 180, 30, 8, 26
_COLUMNS = (10, 240, 470)
_FILL = {"unknown": "#ffb74d", "held": "#b0bec5", "render": "#90caf9", "loss": "#a5d6a7"}


def box(x: float, y: float, text: str, kind: str) -> str:
    """A rounded box with a line of text in its middle."""
    middle = f'x="{x + _BOX / 2}" y="{y + _LINE / 2 + 4.5}"'
    return (
        f'<rect x="{x}" y="{y}" width="{_BOX}" height="{_LINE}" rx="6" fill="{_FILL[kind]}"/>'
        f'<text {middle} text-anchor="middle" fill="#1b1b1b">{text}</text>'
    )


def arrow(x: float, y: float, end: float, back: bool = False) -> str:
    """A line with a head at `end`, broken for what goes back as gradients."""
    dash = ' stroke-dasharray="5 4"' if back else ""
    side = -6 if end > x else 6
    return (
        f'<path d="M{x} {y}H{end}" stroke="#808080" stroke-width="2" fill="none"{dash}/>'
        f'<path d="M{end} {y}l{side} -4v8z" fill="#808080"/>'
    )


def diagram(unknown: tuple[str, ...], held: tuple[str, ...], losses: tuple[str, ...]) -> str:
    """One stage as SVG: what is unknown and held, the render, the losses, the gradient back."""
    left = [(text, "unknown") for text in unknown] + [(text, "held") for text in held]
    rows = max(len(left), len(losses))
    height = _TOP + rows * (_LINE + _GAP) + 24
    middle = _TOP + (rows * (_LINE + _GAP) - _GAP) / 2

    def column(x: float, boxes: list[tuple[str, str]]) -> list[str]:
        top = middle - (len(boxes) * (_LINE + _GAP) - _GAP) / 2
        return [box(x, top + k * (_LINE + _GAP), *each) for k, each in enumerate(boxes)]

    parts = [
        *(
            f'<text x="{x + _BOX / 2}" y="14" text-anchor="middle" fill="#808080">{title}</text>'
            for x, title in zip(_COLUMNS, ("unknown, held", "", "losses"), strict=True)
        ),
        *column(_COLUMNS[0], left),
        *column(_COLUMNS[1], [("rho_d E + rho_s S", "render")]),
        *column(_COLUMNS[2], [(text, "loss") for text in losses]),
        arrow(_COLUMNS[0] + _BOX + 6, middle, _COLUMNS[1] - 6),
        arrow(_COLUMNS[1] + _BOX + 6, middle, _COLUMNS[2] - 6),
        arrow(_COLUMNS[2] + _BOX, height - 12, _COLUMNS[0], back=True),
        f'<text x="{_WIDTH / 2}" y="{height - 18}" text-anchor="middle" fill="#808080">'
        "gradient, to what is unknown</text>",
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" '
        f'font-family="sans-serif" font-size="14">\n' + "\n".join(parts) + "\n</svg>\n"
    )


def main() -> None:
    """Write the five of them."""
    for number, stage in enumerate(STAGES, 1):
        path = FOLDER / f"stage-{number}.svg"
        path.write_text(diagram(*stage), encoding="utf-8")
        print(path)


if __name__ == "__main__":
    main()
