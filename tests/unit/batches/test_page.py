"""The gallery: what a photo's name holds is text, links stay inside, and a script is not needed."""

from dataclasses import replace
from html.parser import HTMLParser

import pytest

pytest.importorskip("fsspec", reason="needs the extra 'batch'")

from unlit.batches.page import as_html
from unlit.batches.record import BatchRow
from unlit.face.warnings import _misfit

FAILED = BatchRow('/p/<script>"\n=1.jpg', error="cut <b>off</b>")
DONE = BatchRow(
    "/p/a.jpg",
    "a",
    warnings=["Small face: it is small.", _misfit(0.062)],
    seconds={"fit": 1.5, "writing": 0.5},
    landmark_residual=0.062,
    render_psnr=31.5,
    report=True,
    thumbnail=True,
)
HOSTILE = BatchRow("/p/c", 'x" onclick="alert(1)', thumbnail=True)


class Reader(HTMLParser):
    """Cards by their attributes, links, pictures, and all text."""

    def __init__(self, rows: list[BatchRow]) -> None:
        super().__init__()
        self.cards, self.links, self.images = [], [], []
        self.words, self.style = "", ""
        self.open = ""
        self.feed(as_html(rows).decode())

    def handle_starttag(self, tag, attrs):
        attributes, self.open = dict(attrs), tag
        assert not any(name.startswith("on") or name == "style" for name in attributes)
        if tag == "li" and "card" in (attributes.get("class") or ""):
            self.cards.append(attributes)
        if tag == "a":
            self.links.append(attributes["href"])
        if tag == "img":
            self.images.append(attributes)

    def handle_data(self, data):
        if self.open not in ("script", "style"):
            self.words += data


def test_a_result_leads_to_its_report_and_shows_its_picture() -> None:
    page = Reader([DONE])
    assert "a/report.html" in page.links
    (image,) = page.images
    assert image["src"] == "a/thumbnail.webp" and image["loading"] == "lazy" and image["alt"]
    assert image["width"] and image["height"]  # nothing jumps when it comes
    assert "residual 6.2%, look at the fit; match 31.5 dB; 2 s" in page.words
    assert "2 warnings: Small face, Large landmark residual" in page.words


def test_a_fit_is_to_be_looked_at_where_its_result_warns() -> None:
    """There is one threshold, that of the warning."""
    assert "residual 5.3%;" in Reader([replace(DONE, landmark_residual=0.053, warnings=[])]).words


def test_without_a_report_it_leads_to_the_montage() -> None:
    assert "b/montage.png" in Reader([BatchRow("/p/b.jpg", "b")]).links
    assert Reader([BatchRow("/p/b.jpg", "b")]).images == []


def test_a_failure_is_told_with_its_reason() -> None:
    page = Reader([FAILED, DONE])
    assert "1 done, 1 failed, 1 with warnings" in page.words
    assert "cut <b>off</b>" in page.words
    assert [card["data-status"] for card in page.cards] == ["failed", "done"]


def test_names_are_text_and_links_stay_inside() -> None:
    page = Reader([FAILED, DONE, HOSTILE])
    assert page.links[-1] == "x%22%20onclick%3D%22alert%281%29/montage.png"
    relative = [*page.links, *(image["src"] for image in page.images)]
    for address in relative:
        assert address.startswith("#") or not (address.startswith(("/", ".")) or ":" in address)


def test_names_are_lowered_as_the_script_lowers_what_is_searched_for() -> None:
    """toLowerCase() keeps the sharp s."""
    (card,) = Reader([BatchRow("/p/Straße.jpg", "Straße")]).cards
    assert card["data-name"] == "straße /p/straße.jpg"


def test_what_can_be_sorted_is_a_number_or_nothing() -> None:
    for card in Reader([FAILED, DONE]).cards:
        for name in ("residual", "match", "seconds"):
            assert card[f"data-{name}"] == "" or float(card[f"data-{name}"]) > 0
    assert Reader([DONE]).cards[0]["data-kinds"] == "Small face\nLarge landmark residual"


def test_a_thousand_results_are_a_small_page() -> None:
    """The pictures are no part of it."""
    assert len(as_html([DONE] * 1000)) < 1_500_000
