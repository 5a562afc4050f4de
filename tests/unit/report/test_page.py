"""The page: whole, closed to the outside, and no place for what a file's name may hold."""

import base64
import hashlib
import io
import re
import tomllib
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from changed import changed
from unlit.face.reconstruction import Metrics
from unlit.report import bundle, page
from unlit.report.page import report_html
from unlit.report.stages import stage_pictures
from unlit.settings.settings import as_dict

PROGRAM = 'const end = "</script>"; void end;'


class Parsed(HTMLParser):
    """Elements in order, with their attributes; texts of script, style and pre."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.texts: list[tuple[str, str]] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, {name: value or "" for name, value in attrs}))
        self.open.append(tag)

    def handle_endtag(self, tag):
        self.open.append("")

    def handle_data(self, data):
        if self.open and self.open[-1] in ("script", "style", "pre"):
            self.texts.append((self.open[-1], data))

    def ids(self) -> list[str]:
        return [attributes["id"] for _, attributes in self.tags if "id" in attributes]


def matched(pattern: str, text: str) -> str:
    """The first group of the pattern's first place in the text."""
    match = re.search(pattern, text, re.S)
    assert match, pattern
    return match[1]


@pytest.fixture(scope="module")
def text(face, atlas):
    patch = pytest.MonkeyPatch()
    patch.setattr(page, "program", lambda: PROGRAM)
    one = stage_pictures(face)
    stages = [("fit", {k: one[k] for k in ("albedo", "normals")}), ("stage1", one), ("stage2", one)]
    yield report_html(face, atlas, stages)
    patch.undo()


def test_nothing_is_loaded_from_elsewhere(text):
    """Every address is data or a place in the page, and the policy allows no other."""
    for tag, attributes in Parsed(text).tags:
        for name in ("src", "href", "action", "data", "poster", "srcset"):
            value = attributes.get(name)
            assert value is None or value.startswith(("data:", "#")), (tag, name)
        assert "style" not in attributes and not any(n.startswith("on") for n in attributes)
    assert "default-src 'none'" in text and "connect-src" not in text


def test_the_policy_names_exactly_the_page_s_scripts_and_style(text):
    parsed = Parsed(text)
    policy = next(a["content"] for tag, a in parsed.tags if tag == "meta" and "http-equiv" in a)
    scripts = re.findall(r"<script>(.*?)</script>", text, re.S)
    style = re.findall(r"<style>(.*?)</style>", text, re.S)
    assert len(scripts) == 2 and len(style) == 1
    for content in (*scripts, *style):
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy
    assert policy.count("sha256-") == 3


def test_a_script_cannot_end_early(text):
    assert PROGRAM.replace("</script", "<\\/script") in text
    assert PROGRAM not in text


def test_names_and_settings_are_text_and_come_back(text, face):
    assert "<b>" not in text.split("</head>")[1].split("<script")[0]
    assert "grüße &lt;b&gt;&amp;.jpg" in text
    settings = matched(r'aria-label="Settings">(.*?)</pre>', text)
    assert tomllib.loads(unescape(settings)) == as_dict(face.settings)


def test_pictures_are_whole_and_labelled(text):
    images = [a for tag, a in Parsed(text).tags if tag == "img"]
    assert len(images) > 20
    ids = set(Parsed(text).ids())
    for attributes in images:
        assert "alt" in attributes
        if "data-from" in attributes:
            assert attributes["data-from"] in ids
            continue
        content = base64.b64decode(attributes["src"].partition("base64,")[2])
        Image.open(io.BytesIO(content)).load()


def test_ids_are_unique_and_links_lead_somewhere(text):
    parsed = Parsed(text)
    ids = parsed.ids()
    assert len(ids) == len(set(ids))
    links = {a["href"][1:] for tag, a in parsed.tags if tag == "a"}
    assert links <= set(ids)
    needed = {"scene", "arrays", "view", "light", "atlas-diffuse-albedo", "atlas-material"}
    assert needed <= set(ids)


def test_the_atlas_is_exact(text, atlas):
    """The viewer computes with these pixels."""
    source = matched(r'id="atlas-specular-normal" alt="" src="([^"]*)"', text)
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(source.partition("base64,")[2]))))
    assert np.abs(pixels / 127.5 - 1 - atlas.specular_normal).max() < 0.5 / 127


def test_stages_begin_with_the_photo(text):
    """Stage 1 has no re-rendering before it, stage 2 has that of stage 1."""
    pairs = re.findall(r'data-from="([^"]*-render|photo)" alt="(before|after)"', text)
    assert pairs == [
        *(("photo", "before"), ("stage1-render", "after")),
        *(("stage1-render", "before"), ("stage2-render", "after")),
    ]


def test_without_stages_metrics_or_program_it_says_so(face, atlas, monkeypatch):
    monkeypatch.setattr(page, "program", lambda: None)
    monkeypatch.setattr(page, "missing_because", lambda: "npm was away")
    bare = report_html(changed(face, {"metrics": Metrics({"stage1": []}, {}, 0.0)}), atlas)
    assert "npm was away" in bare and "pip install" in bare
    assert "No pictures of the stages" in bare
    assert "No losses" in bare and "No times" in bare
    assert 'id="scene"' not in bare


def test_the_reason_of_a_build_without_npm_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(bundle, "_REASON", tmp_path / "viewer.missing.txt")
    assert "never built" in bundle.missing_because()
    (tmp_path / "viewer.missing.txt").write_text("npm ci failed:\nno network\n")
    assert bundle.missing_because() == "npm ci failed: no network"
