"""Which files are photos, and what their results are called: nothing escapes, nothing collides."""

import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unlit.batches.photos import find_photos, name_results, safe_name
from unlit.errors import PhotoError
from unlit.storage.folder import MARK


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    for name in (
        *("b/x.jpg", "a/x.JPG", "a/deep/y.heic", "a/notes.txt", "a/.hidden/z.jpg"),
        *("a/._x.jpg", f"results/{MARK}", "results/render.png", "results/export/atlas.png"),
        *("odd[1].png", "scan.raw"),
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("inputs", "expected"),
    [
        (["a"], ["a/deep/y.heic", "a/x.JPG"]),
        (["."], ["a/deep/y.heic", "a/x.JPG", "b/x.jpg", "odd[1].png"]),
        (["*/x.*"], ["a/x.JPG", "b/x.jpg"]),
        (["**/*.jpg", "b"], ["b/x.jpg"]),
        (["*"], ["a/deep/y.heic", "a/x.JPG", "b/x.jpg", "odd[1].png"]),
        (["**/*.png"], ["odd[1].png"]),
        (["odd[1].png", "scan.raw"], ["odd[1].png", "scan.raw"]),
        (["b/x.jpg", "a/../b/x.jpg"], ["b/x.jpg"]),
    ],
)
def test_files_folders_and_globs(here, inputs, expected):
    """Results, hidden files and texts are left out; a name with brackets is a name first."""
    found = find_photos(inputs)
    assert all(path.is_absolute() for path in found)
    assert sorted(str(path.relative_to(here)) for path in found) == sorted(expected)


@pytest.mark.parametrize("name", ["nothing.jpg", "a/*.gif", "results", "", "a\0b"])
def test_an_input_without_photos_is_named(here, name):
    """A misspelt name must not become a batch of nothing."""
    with pytest.raises(PhotoError, match="no photo"):
        find_photos([name])


def test_a_loop_of_links_ends(here):
    """A folder that links to itself is searched once, also by a glob, which follows links."""
    (here / "b" / "self").symlink_to(here / "b")
    assert find_photos(["b"]) == [here / "b" / "x.jpg"]
    (photo,) = find_photos(["b/**/*.jpg"])
    assert photo.samefile(here / "b" / "x.jpg")


@pytest.mark.parametrize(
    ("stem", "name"),
    [
        ("IMG_0001 (2)", "IMG_0001 (2)"),
        ("grüße", "grüße"),
        ("gru\u0308ße", "grüße"),
        ("हिन्दी", "हिन्दी"),
        ("顔", "顔"),
        ("../../etc/passwd", "_.._etc_passwd"),
        ("..", "photo"),
        ("", "photo"),
        ("-rf", "rf"),
        (".bashrc", "bashrc"),
        ("a\nb\x1b[31m", "a_b__31m"),
        ("x\u202egpj", "x_gpj"),
        ("a:b|c*?<>\"'$`;&\\", "a_b_c" + 11 * "_"),
        ("con", "photo con"),
        ("LPT1.x", "photo LPT1.x"),
        ("end. ", "end"),
        ("bytes\udcff", "bytes_"),
        ("=cmd()", "_cmd()"),
    ],
)
def test_names_are_made_harmless(stem, name):
    """Any script is kept; what a shell, a file system or a terminal would act on is not."""
    assert safe_name(stem) == name


@settings(deadline=None)
@given(st.text(st.characters(codec=None), max_size=400))
def test_every_name_is_one_short_visible_component(stem):
    """Whatever the photo is called, its result lies directly below the batch's folder."""
    name = safe_name(stem)
    assert 0 < len(name.encode()) <= 106
    assert name == Path(name).name
    assert name[0] not in ".- "
    assert Path(os.path.normpath(f"/out/{name}")).parent == Path("/out")
    assert name.isprintable()


def test_photos_of_one_name_get_different_results():
    """Whatever the order: the first keeps the plain name, and case makes no difference."""
    photos = [Path(f"/p/{name}") for name in ("a/x.jpg", "b/x.jpg", "b/X.png", "c/records.jpg")]
    names = name_results(photos, {}, ["records"])
    assert names[photos[0]] == "x"
    assert len({name.casefold() for name in names.values()} | {"records"}) == 5
    assert all(name.startswith(photo.stem) for photo, name in names.items())


def test_names_stay_when_photos_are_added():
    """What was done under a name is found under it again, whatever else comes before it."""
    old = [Path("/p/b/x.jpg"), Path("/p/c/x.jpg")]
    before = name_results(old, {}, [])
    owners = {name: str(photo) for photo, name in before.items()}
    after = name_results([Path("/p/a/x.jpg"), *reversed(old)], owners, [])
    assert {photo: after[photo] for photo in old} == before
    assert len(set(after.values())) == 3


def test_very_long_names_stay_apart():
    """Two names that differ only where they are cut off."""
    photos = [Path("/p/" + "長" * 80 + tail + ".jpg") for tail in "ab"]
    names = name_results(photos, {}, [])
    assert len(set(names.values())) == 2
    assert all(len(name.encode()) <= 109 for name in names.values())
