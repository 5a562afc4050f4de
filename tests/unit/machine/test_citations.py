"""What to cite: complete, of one table, and BibTeX that a parser would take."""

import re
from importlib.metadata import version
from pathlib import Path

import pytest

from unlit.machine.citations import Citation, bibtex, citations, in_words
from unlit.machine.manifest import ASSETS

CITATION_FILE = Path(__file__).parents[3] / "CITATION.cff"


def test_every_model_file_is_cited_once():
    """A file added to the manifest needs somebody to be thanked."""
    cited = [asset for entry in citations() for asset in entry.assets]
    assert sorted(cited) == sorted(ASSETS)


def test_keys_differ_and_unlit_comes_first():
    keys = [entry.key for entry in citations()]
    assert len(set(keys)) == len(keys)
    assert keys[0] == "unlit"


@pytest.mark.parametrize("entry", citations(), ids=lambda entry: entry.key)
def test_bibtex_is_balanced_and_complete(entry: Citation):
    text = bibtex(entry)
    assert text.startswith(f"@{entry.kind}{{{entry.key},\n")
    assert text.count("{") == text.count("}")
    fields = dict(re.findall(r"^  (\w+) += \{(.+)\},$", text, re.M))
    assert {"author", "title"} <= set(fields)
    assert ("year" in fields) == (entry.year is not None)
    assert fields["author"].split(" and ") == list(entry.authors)
    assert ("journal" in fields) == (entry.kind == "article")
    assert not set("%&#_$") & set(text.partition("\n")[2]), "BibTeX would want these escaped"


def test_a_line_has_who_what_and_when():
    line = in_words(next(entry for entry in citations() if entry.key == "flip"))
    assert line.startswith("Pontus Andersson et al. FLIP: A Difference Evaluator")
    assert "2020" in line


def test_our_version_is_that_of_the_package():
    assert f"version {version('unlit')}" in bibtex(citations()[0])


def test_the_citation_file_says_the_same():
    """CITATION.cff is read by hosts and reference managers, citations.toml by `unlit cite`."""
    text = CITATION_FILE.read_text()
    ours, paper = citations()[:2]
    assert f'title: "{ours.title}"' in text
    assert f"version: {version('unlit')}" in text
    assert f'title: "{paper.title}"' in text
    assert f"year: {paper.year}" in text
