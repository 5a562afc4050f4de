"""What every page of ours is: one file, closed to the outside, on light paper or dark.

The pages' words and looks lie in web/; `document` sets a page's body into the frame.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping, Sequence
from html import escape
from string import Template

from .bundle import WEB


def document(
    title: str,
    body: str,
    scripts: Sequence[str] = (),
    styles: Sequence[str] = ("page.css",),
    images: str = "data:",
) -> str:
    """A whole page. Its own policy forbids the browser to load anything but `images`.

    title: plain text. body: HTML. scripts: programs. styles: names of files in web/. images: the
    policy's sources of pictures.
    """
    style = "".join(map(web, styles))
    return filled(
        "document.html",
        title=escape(title),
        policy=_policy(style, scripts, images),
        style=style,
        body=body,
        scripts="".join(f"<script>{script}</script>\n" for script in scripts),
    )


def filled(name: str, **parts: str) -> str:
    """The file `name` of web/ with `parts`, which are HTML, in their places."""
    return Template(web(name)).substitute(parts)


def web(name: str) -> str:
    """The file `name` of web/."""
    return (WEB / name).read_text(encoding="utf-8")


def table(rows: Mapping[str, str]) -> str:
    """A table of names and what is said of them, plain text."""
    body = "".join(
        f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}</td></tr>'
        for name, value in rows.items()
    )
    return f"<table>{body}</table>"


def _policy(style: str, scripts: Sequence[str], images: str) -> str:
    def digest(text: str) -> str:
        return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"

    allowed = " ".join(map(digest, scripts)) or "'none'"
    return (
        f"default-src 'none'; img-src {images}; style-src {digest(style)}; script-src {allowed}; "
        "base-uri 'none'; form-action 'none'"
    )
