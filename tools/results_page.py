"""The tables of docs/results.md, from benchmarks/quality_reference.json."""

from __future__ import annotations

import json
from pathlib import Path

REFERENCE = Path(__file__).resolve().parents[1] / "benchmarks" / "quality_reference.json"
LIGHTS = ("flash", "uniform", "side")
NAMES = {
    "own-light": "default head, light skin",
    "own-dark": "default head, dark skin",
    "ict-light": "ICT head, light skin",
    "ict-dark": "ICT head, dark skin",
    "lee-perry-smith": "Lee Perry-Smith scan",
}


def page() -> str:
    """Markdown: a line per subject and input light, PSNR in dB."""
    figures: dict[str, float] = json.loads(REFERENCE.read_text(encoding="utf-8"))
    lines: list[str] = []
    for preset in sorted({key.split("/")[0] for key in figures}):
        lines += [f"Preset `{preset}`.", ""]
        lines += [
            f"| subject | photo's light | {' | '.join(f'relit: {x}' for x in LIGHTS)} | albedo |"
        ]
        lines += ["|" + "---|" * 6]
        of_preset = [key for key in figures if key.startswith(f"{preset}/")]
        subjects = {key.split("/")[1] for key in of_preset}
        for subject in sorted(subjects, key=lambda name: [*NAMES, name].index(name)):
            for light in LIGHTS:
                keys = [f"{preset}/{subject}/{light}/{cell}" for cell in (*LIGHTS, "albedo")]
                if any(key in figures for key in keys):
                    cells = [f"{figures[key]:.1f}" if key in figures else "" for key in keys]
                    name = NAMES.get(subject, subject)
                    lines.append(f"| {name} | {light} | {' | '.join(cells)} |")
        lines.append("")
    return "\n".join(lines) + "\n"
