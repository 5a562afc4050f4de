"""Tutorials: pages of Markdown whose Python blocks run one after the other.

The same text is the page, a notebook to download (`notebook`) and a test (`code`), so that none of
them can fall behind the others.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "tutorials"
_BLOCK = re.compile(r"^```python\n(.*?)^```\n", re.M | re.S)


def code(text: str) -> list[str]:
    """The Python blocks of a page, in order."""
    return _BLOCK.findall(text)


def notebook(text: str) -> str:
    """The page as a Jupyter notebook, nbformat 4.5, without outputs and pictures."""
    cells: list[dict[str, Any]] = []
    for number, part in enumerate(_BLOCK.split(text)):
        plain = part if number % 2 else re.sub(r"^!\[.*\)\n", "", part, flags=re.M)
        plain = re.sub(r"\[([^]]+)\]\([^)]*\.md[^)]*\)", r"\1", plain)
        if not plain.strip():
            continue
        cell = {"id": f"part-{number}", "metadata": {}, "source": plain.strip("\n")}
        if number % 2:
            cell |= {"cell_type": "code", "execution_count": None, "outputs": []}
        else:
            cell |= {"cell_type": "markdown"}
        cells.append(cell)
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    content = {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4}
    return json.dumps(content | {"nbformat_minor": 5}, indent=1, ensure_ascii=False) + "\n"
