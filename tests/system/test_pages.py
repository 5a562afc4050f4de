"""The pages about several results in a real browser (tests/browser.py)."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from browser import DESKTOP, PHONE, Open, chromium
from changed import changed
from report_head import report_head
from unlit.output.relit import LIGHTS
from unlit.report.comparison import Side, comparison_html

pytest.importorskip("fsspec", reason="needs the extra 'batch'")

from unlit.batches.page import as_html
from unlit.batches.record import BatchRow

ROWS = [
    *(
        BatchRow(
            f"/photos/{name}.jpg",
            name,
            warnings=warnings,
            seconds={"fit": seconds},
            landmark_residual=residual,
            render_psnr=30 - 100 * residual,
            report=True,
            thumbnail=True,
        )
        for name, warnings, seconds, residual in (
            ("zoe", ["Small face: it is small."], 30.0, 0.02),
            ("anna", ["Hair: it covers 30 % of the face.", "Small face: it is small."], 10.0, 0.07),
            ("mia", [], 20.0, 0.04),
        )
    ),
    BatchRow("/photos/landscape.jpg", error="/photos/landscape.jpg: no face found"),
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def gallery(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("batch")
    for row in ROWS[:3]:
        (folder / row.folder).mkdir()
        (folder / row.folder / "report.html").write_text("the report")
        stream = io.BytesIO()
        Image.fromarray(np.full((224, 672, 3), 90, np.uint8)).save(stream, "WEBP")
        (folder / row.folder / "thumbnail.webp").write_bytes(stream.getvalue())
    (folder / "batch.html").write_bytes(as_html(ROWS))
    return folder / "batch.html"


@pytest.fixture(scope="module")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> Path:
    one = report_head(64)
    other = changed(one, {"face.maps.diffuse_albedo": one.face.maps.diffuse_albedo * 0.5})
    pictures = {name: np.zeros((64, 64, 3), np.uint8) for name in LIGHTS}
    path = tmp_path_factory.mktemp("comparison") / "page.html"
    path.write_text(comparison_html(Side("one", one, pictures), Side("other", other, pictures)))
    return path


def shown(opened: Open) -> list[str]:
    """The names on the cards that are to be seen, in order."""
    cards = opened.page.locator(".card:not([hidden]) h2")
    return [text.strip() for text in cards.all_text_contents()]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
@pytest.mark.parametrize("name", ["gallery", "comparison"])
def test_everyone_can_read_it(
    browser: Any, name: str, size: Any, scheme: str, request: pytest.FixtureRequest
) -> None:
    """Names, labels, headings, landmarks, contrast; no scrolling sideways; nothing goes wrong."""
    opened = Open(browser, request.getfixturevalue(name), viewport=size, color_scheme=scheme)
    assert opened.faults() == []
    assert opened.width() <= size["width"]
    channels = opened.page.evaluate(
        "getComputedStyle(document.body).backgroundColor.match(/\\d+/g)"
    )
    assert (max(map(int, channels)) < 64) == (scheme == "dark")
    assert opened.trouble == []
    opened.context.close()


def test_the_gallery_shows_its_pictures_and_loads_nothing_else(browser: Any, gallery: Path) -> None:
    opened = Open(browser, gallery, viewport=DESKTOP)
    widths = opened.page.evaluate(
        "Promise.all([...document.images].map(async (i) => (await i.decode(), i.naturalWidth)))"
    )
    assert widths == [672] * 3
    beside = {(gallery.parent / row.folder / "thumbnail.webp").as_uri() for row in ROWS[:3]}
    assert set(opened.requests) == {gallery.as_uri()} | beside
    opened.page.locator(".card", has_text="anna").click(position={"x": 20, "y": 20})
    assert opened.page.url.endswith("/anna/report.html")
    opened.context.close()


def test_the_gallery_is_sorted_and_filtered(browser: Any, gallery: Path) -> None:
    opened = Open(browser, gallery, viewport=DESKTOP)
    page = opened.page
    assert shown(opened) == ["zoe", "anna", "mia", "landscape.jpg"]
    orders = {
        "name": ["anna", "landscape.jpg", "mia", "zoe"],
        "-residual": ["anna", "mia", "zoe", "landscape.jpg"],
        "match": ["anna", "mia", "zoe", "landscape.jpg"],
        "-warnings": ["anna", "zoe", "mia", "landscape.jpg"],
        "-seconds": ["zoe", "mia", "anna", "landscape.jpg"],
        "order": ["zoe", "anna", "mia", "landscape.jpg"],
    }
    for order, names in orders.items():
        page.select_option("#order", order)
        assert shown(opened) == names, order
    for control, value, names in (
        ("#name", "NN", ["anna"]),
        ("#least", "3", ["anna", "mia"]),
        ("#status", "failed", ["landscape.jpg"]),
        ("#kind", "Hair", ["anna"]),
        ("#kind", "some", ["zoe", "anna"]),
        ("#kind", "none", ["mia"]),
    ):
        choice = control in ("#status", "#kind")
        (page.select_option if choice else page.fill)(control, value)
        assert shown(opened) == names, (control, value)
        assert page.text_content("#shown") == f"{len(names)} of 4 shown."
        (page.select_option if choice else page.fill)(control, "")
    assert opened.trouble == []
    opened.context.close()


def test_the_gallery_without_scripts_is_the_table_s_order(browser: Any, gallery: Path) -> None:
    opened = Open(browser, gallery, viewport=DESKTOP, java_script_enabled=False)
    assert shown(opened) == ["zoe", "anna", "mia", "landscape.jpg"]
    assert opened.page.get_by_text("no face found").is_visible()
    assert not opened.page.locator("#filters").is_visible()
    opened.context.close()


def test_a_thousand_results_open_at_once(browser: Any, tmp_path: Path) -> None:
    """Pictures out of sight are not asked for."""
    page = tmp_path / "batch.html"
    page.write_bytes(as_html([ROWS[k % 3] for k in range(1000)]))
    opened = Open(browser, page, viewport=DESKTOP)
    opened.page.wait_for_load_state("load")
    # Three files serve all cards, so requests do not count them: ask the browser for each.
    begun = opened.page.evaluate("[...document.images].filter((i) => i.complete).length")
    assert begun < 100
    opened.context.close()


def test_a_comparison_names_what_differs(browser: Any, comparison: Path) -> None:
    opened = Open(browser, comparison, viewport=DESKTOP)
    words = opened.page.text_content("#differences")
    assert "Diffuse albedo, mean" in words and "50% less" in words
    assert "normals differ by 0.0 degrees" in words
    assert "No settings differ." in words
    assert opened.requests == [comparison.as_uri()]
    opened.context.close()
