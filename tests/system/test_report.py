"""The report in a real browser (tests/browser.py).

Skips where there is no Chromium, no Playwright, or where unlit was built without its viewer.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from browser import DESKTOP, PHONE, REQUIRED, Open, chromium, launched
from changed import changed
from report_head import report_head
from unlit.color import encode_srgb
from unlit.output.atlas import bake
from unlit.relighting.lights import environment_map, with_unit_irradiance
from unlit.render.relighter import Relighter
from unlit.report.bundle import program
from unlit.report.page import report_html
from unlit.report.stages import stage_pictures

SIZE = 192
pytestmark = pytest.mark.skipif(
    program() is None and not REQUIRED, reason="unlit was built without its viewer"
)


@pytest.fixture(scope="module")
def face() -> Any:
    """The small head under its own light, shaded by our renderer."""
    head = report_head(SIZE)
    return changed(head, {"images.render": Relighter(head.face)(head.light)})


@pytest.fixture(scope="module")
def report(face: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    before, after = (
        stage_pictures(changed(face, {"images.render": face.images.render * f})) for f in (0.5, 1)
    )
    path = tmp_path_factory.mktemp("report") / "report.html"
    stages = [("stage1", before), ("stage2", after)]
    path.write_text(report_html(face, bake(face, 512), stages), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as running:
        yield running


class ViewerPage(Open):
    """The report with its viewer at hand."""

    def show_viewer(self) -> None:
        """Bring the viewer into sight, and its canvas to the size of the crop."""
        self.page.locator("#view").scroll_into_view_if_needed()
        self.page.wait_for_selector("#viewer[data-ready]", state="attached")
        place = {"width": f"{SIZE}px", "position": "fixed", "left": 0, "top": 0, "zIndex": 9}
        self.page.evaluate(
            "(place) => Object.assign(document.getElementById('view').style, place)", place
        )

    def picture(self) -> np.ndarray:
        """What the canvas shows at rest, (SIZE, SIZE, 3), sRGB-encoded."""
        # The fine picture comes 600 ms after the last change; then two frames for it to appear.
        self.page.evaluate(
            "() => new Promise((done) => setTimeout(() => requestAnimationFrame(() => "
            "requestAnimationFrame(done)), 900))"
        )
        png = self.page.locator("#view").screenshot()
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")) / 255

    def set(self, control: str, value: Any) -> None:
        """Give a control of the page a value, as a user's hand does."""
        self.page.evaluate(
            "([id, value]) => { const control = document.getElementById(id);"
            "if (control.type === 'checkbox') control.checked = value; else control.value = value;"
            "for (const kind of ['input', 'change'])"
            "control.dispatchEvent(new Event(kind, { bubbles: true })); }",
            [control, value],
        )


@pytest.fixture(scope="module")
def view(browser: Any, report: Path) -> Iterator[ViewerPage]:
    opened = ViewerPage(browser, report, viewport=DESKTOP, reduced_motion="reduce")
    opened.show_viewer()
    opened.set("light", "photo")
    yield opened
    opened.context.close()


def change(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).mean())


def test_the_viewer_agrees_with_our_renderer(view: ViewerPage, face: Any) -> None:
    """At the photo's camera and light, inside the mask."""
    inside = face.face.mask > 0
    error = (view.picture() - np.clip(encode_srgb(face.images.render), 0, 1))[inside]
    assert -10 * np.log10(np.mean(error**2)) > 30


def test_it_can_be_turned_lit_and_switched(view: ViewerPage) -> None:
    """Each control changes the picture, and the reset brings the first one back."""
    canvas = view.page.locator("#view")
    first = view.picture()
    canvas.focus()
    for keys in (["ArrowLeft", "ArrowLeft"], ["ArrowUp"], ["+"], ["d", "d", "d"], ["w"]):
        for key in keys:
            canvas.press(key)
        assert change(view.picture(), first) > 0.003, keys
        canvas.press("0")
    assert change(view.picture(), first) < 0.002
    switches = {
        **dict.fromkeys(("useDiffuse", "useSpecular", "useShadow", "useDiffuseAlbedo"), False),
        **dict.fromkeys(("useSpecularAlbedo", "useRoughness"), False),
        **dict.fromkeys(("useDiffuseNormal", "useSpecularNormal"), False),
        "onlyMeasured": True,
    }
    for name, value in switches.items():
        view.set(name, value)
        assert change(view.picture(), first) > 1e-4, name
        view.set(name, not value)
    for name, value, back in (("light", "sky", "photo"), ("exposure", 1, 0)):
        view.set(name, value)
        assert change(view.picture(), first) > 0.01, name
        view.set(name, back)
    assert change(view.picture(), first) < 0.002
    assert "0 degrees" in view.page.text_content("#view-state")


def test_a_drag_turns_the_head(view: ViewerPage) -> None:
    first = view.picture()
    mouse = view.page.mouse
    mouse.move(SIZE / 2, SIZE / 2)
    mouse.down()
    mouse.move(SIZE / 2 + 50, SIZE / 2, steps=4)
    mouse.up()
    assert change(view.picture(), first) > 0.01
    view.page.locator("#view").press("0")


def test_an_hdri_lights_it(view: ViewerPage, tmp_path: Path) -> None:
    """A blue light from the file; what is no such file is refused in words."""
    import cv2

    blue = np.zeros((16, 32, 3), np.float32)
    blue[..., 0] = 1  # OpenCV has blue first
    cv2.imwrite(str(tmp_path / "blue.hdr"), blue)
    (tmp_path / "broken.hdr").write_bytes(b"no picture")
    view.page.set_input_files("#light-file", tmp_path / "broken.hdr")
    view.page.locator("#view-state", has_text="no Radiance").wait_for()
    view.page.set_input_files("#light-file", tmp_path / "blue.hdr")
    view.page.locator("#view-state", has_text="Lit by blue").wait_for()
    centre = view.picture()[SIZE // 3 : SIZE // 2, SIZE // 3 : -SIZE // 3]
    assert centre[..., 2].mean() > 0.2
    assert centre[..., 0].mean() < 0.05
    view.set("light", "photo")


def test_an_hdri_is_as_strong_as_for_relight(view: ViewerPage, face: Any, tmp_path: Path) -> None:
    """A strong side and a weak sky, in units of their own: our renderer's picture, its exposure."""
    import cv2

    sky = np.full((36, 72, 3), 40, np.float32)
    sky[10:16, 42:50] = (900, 1300, 1700)
    path = tmp_path / "sky.hdr"
    cv2.imwrite(str(path), sky)
    view.page.set_input_files("#light-file", path)
    view.page.locator("#view-state", has_text="Lit by sky").wait_for()
    light = with_unit_irradiance(environment_map(str(path)), path.name)
    wanted = Relighter(face.face)(light)
    error = (view.picture() - np.clip(encode_srgb(wanted), 0, 1))[face.face.mask > 0]
    assert -10 * np.log10(np.mean(error**2)) > 27
    view.set("light", "photo")


def test_sliders_move_the_cut(view: ViewerPage) -> None:
    """Left of the cut is the state before, right of it the state after."""
    for figure in view.page.locator("figure.compare").all():
        pair = figure.locator(".pair").first
        view.page.evaluate("document.getElementById('view').style.visibility = 'hidden'")
        pictures = []
        for value in ("0", "100"):
            figure.locator("input").fill(value)
            pictures.append(np.asarray(Image.open(io.BytesIO(pair.screenshot())).convert("L")))
        assert np.abs(pictures[0].astype(float) - pictures[1]).mean() > 3
    view.page.evaluate("document.getElementById('view').style.visibility = ''")


def test_stages_show_what_is_chosen(view: ViewerPage) -> None:
    view.page.locator("input[name=kind][value=normals]").check()
    assert view.page.locator("[data-kind=normals]").first.is_visible()
    assert not view.page.locator("[data-kind=render]").first.is_visible()


def test_pictures_can_be_enlarged(view: ViewerPage) -> None:
    button = view.page.locator("button.picture").first
    before = button.bounding_box()["width"]
    button.click()
    assert button.get_attribute("aria-pressed") == "true"
    assert button.bounding_box()["width"] > 1.5 * before


def test_nothing_went_wrong_and_nothing_was_loaded(view: ViewerPage, report: Path) -> None:
    """After all of the above: no error or warning on the console, one request, for the file."""
    assert view.trouble == []
    assert view.requests == [report.as_uri()]


def test_it_turns_until_it_is_touched(browser: Any, report: Path) -> None:
    """And when asked to again; not by itself where every picture is slow, as it is here."""
    opened = ViewerPage(browser, report, viewport=DESKTOP)
    opened.show_viewer()
    button, canvas = opened.page.locator("#view-turn"), opened.page.locator("#view")
    for touch in (button.click, lambda: canvas.press("ArrowUp"), canvas.click):
        if button.get_attribute("aria-pressed") == "false":
            button.click()
        first = opened.picture()
        assert any(change(opened.picture(), first) > 0.002 for _ in range(20))
        touch()
        assert button.get_attribute("aria-pressed") == "false"
        still = [opened.picture() for _ in range(4)]  # the last drawing may come late
        assert change(still[-1], still[-2]) < 1e-4
    assert opened.trouble == []
    opened.context.close()


def test_it_does_not_turn_for_who_asked_for_less_motion(view: ViewerPage) -> None:
    assert view.page.get_attribute("#view-turn", "aria-pressed") == "false"


def test_without_webgl_pictures_stand_in(browser: Any, report: Path) -> None:
    """In place of canvas and controls, and in words."""
    with launched(browser.browser_type, "--disable-3d-apis") as blind:
        opened = Open(blind, report, viewport=DESKTOP)
        opened.page.locator("#viewer[data-failed]").wait_for()
        assert not opened.page.locator("#view").is_visible()
        assert not opened.page.locator("#light").is_visible()
        assert opened.page.locator("#relit-outdoors").is_visible()
        assert "WebGL" in opened.page.text_content("#view-state")
        assert opened.faults() == []
        opened.context.close()


def test_without_scripts_nothing_is_missing_but_motion(browser: Any, report: Path) -> None:
    """Pictures of light, maps and stages; no control that would do nothing."""
    opened = Open(browser, report, viewport=DESKTOP, java_script_enabled=False)
    page = opened.page
    for shown in ("#relit-flash", "#stage1-render", "#photo", "noscript p"):
        assert page.locator(shown).first.is_visible(), shown
    for hidden in ("#view", "#light", "input[type=range]", "input[name=kind]"):
        assert not page.locator(hidden).first.is_visible(), hidden
    opened.context.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_everyone_can_read_it(browser: Any, report: Path, size: Any, scheme: str) -> None:
    """Names, labels, headings, landmarks, contrast; no scrolling sideways; nothing goes wrong."""
    opened = ViewerPage(browser, report, viewport=size, color_scheme=scheme)
    opened.show_viewer()
    for folded in opened.page.locator("summary").all():
        folded.click()
    assert opened.faults() == []
    assert opened.width() <= size["width"]
    assert opened.trouble == []
    opened.context.close()


def test_a_phone_in_dark_mode(browser: Any, report: Path) -> None:
    """Dark paper, no scrolling sideways, text and controls of a size to read and touch."""
    phone = Open(
        browser, report, viewport={"width": 390, "height": 844}, color_scheme="dark", has_touch=True
    )
    page = phone.page
    for folded in page.locator("summary").all():
        folded.click()
    assert phone.width() <= 390
    channels = page.evaluate("getComputedStyle(document.body).backgroundColor.match(/\\d+/g)")
    assert max(map(int, channels)) < 64
    assert page.evaluate("parseFloat(getComputedStyle(document.body).fontSize)") >= 16
    heights = page.evaluate(
        "[...document.querySelectorAll('.controls label')].map((e) => e.offsetHeight)"
    )
    assert min(heights) >= 24  # WCAG 2.2, target size
    unnamed = page.evaluate(
        "[...document.querySelectorAll('input, select, button')].filter((e) => !("
        "e.labels?.length || e.ariaLabel || e.textContent.trim())).map((e) => e.outerHTML)"
    )
    assert unnamed == []
    assert phone.trouble == []
    phone.context.close()
