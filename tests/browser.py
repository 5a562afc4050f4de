"""Pages in a real browser: Debian's Chromium, without a display, driven by Playwright.

What an auditor would look at: the rules of axe-core, room on a phone, the console, requests.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

_SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_MILLISECONDS = 240_000  # software rendering on a busy machine

#: Continuous integration sets it: what is missing then is a failure, not a reason to skip.
REQUIRED = bool(os.environ.get("UNLIT_REQUIRE_VIEWER"))

DESKTOP = {"width": 1100, "height": 800}
PHONE = {"width": 360, "height": 740}


@contextmanager
def chromium() -> Iterator[Any]:
    """The browser, which draws WebGL in software. Skips where there is none."""
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as driver, launched(driver.chromium, *_SOFTWARE) as running:
        yield running


@contextmanager
def launched(kind: Any, *flags: str) -> Iterator[Any]:
    """A browser of Playwright's `kind`, which one that runs has as `browser_type`."""
    executable = shutil.which("chromium")
    if executable is None and not REQUIRED:
        pytest.skip("there is no chromium on this machine")
    running = kind.launch(executable_path=executable, args=["--no-sandbox", *flags])
    yield running
    running.close()


class Open:
    """A page opened from disk; whatever goes wrong in it is collected."""

    def __init__(self, browser: Any, page: Path, **options: Any) -> None:
        self.context = browser.new_context(**options)
        self.page = self.context.new_page()
        self.page.set_default_timeout(_MILLISECONDS)
        self.trouble: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", self._said)
        self.page.on("pageerror", lambda error: self.trouble.append(str(error)))
        self.page.on("request", lambda request: self._asked(request.url))
        self.page.goto(page.as_uri())

    def _said(self, message: Any) -> None:
        # ANGLE tells that reading pixels back is slow, which is why it is done.
        if message.type in ("error", "warning") and "GPU stall" not in message.text:
            self.trouble.append(message.text)

    def _asked(self, url: str) -> None:
        if not url.startswith("data:"):
            self.requests.append(url)

    def width(self) -> int:
        """Of the page, which scrolls sideways where that is more than the window's."""
        return self.page.evaluate("document.documentElement.scrollWidth")

    def faults(self) -> list[str]:
        """What axe-core finds: rules of WCAG 2.2 A and AA, and its best practices."""
        axe = pytest.importorskip("axe_playwright_python.sync_playwright")
        found = axe.Axe().run(self.page).response["violations"]
        return [
            f"{fault['id']}: {fault['help']}: {[node['html'][:200] for node in fault['nodes']][:3]}"
            for fault in found
        ]
