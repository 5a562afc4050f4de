"""The examples in the public functions' docstrings, run in the order a user would."""

import doctest
import inspect
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from skimage.data import astronaut

import unlit

IN_ORDER = ("Settings", "override", "Photo", "read_photo", "UnlitError")
IN_ORDER += ("reconstruct", "Result", "relight", "resume", "save", "load", "export", "batch")


@pytest.fixture(scope="module")
def shared_names(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    """What the examples share: each goes on with what the one before it made."""
    place = tmp_path_factory.mktemp("api")
    Image.fromarray(astronaut()).save(place / "photo.png")
    return {"unlit": unlit, "np": np, "folder": place / "result", "file": place / "photo.png"}


@pytest.mark.parametrize("name", IN_ORDER)
def test_example(name: str, shared_names: dict[str, object]) -> None:
    text = inspect.getdoc(getattr(unlit, name)) or ""
    example = doctest.DocTestParser().get_doctest(text, shared_names, name, None, None)
    assert example.examples, "no example"
    flags = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    said: list[str] = []
    runner = doctest.DocTestRunner(optionflags=flags)
    runner.run(example, out=said.append, clear_globs=False)
    shared_names.update(example.globs)
    assert not runner.failures, "".join(said)


def test_every_public_name_is_documented() -> None:
    for name in unlit.__all__:
        value = getattr(unlit, name)
        if not isinstance(value, str | dict):
            text = getattr(value, "__doc__", None) or ""
            assert text and not text.startswith(f"{name}("), name
    others = {"PRESETS", "__version__", "lights"}  # no functions and no classes
    errors = {name for name in unlit.__all__ if name.endswith("Error")}
    assert {*IN_ORDER} == {*unlit.__all__} - others - errors | {"UnlitError"}
    assert set(unlit.__all__) <= set(dir(unlit))


def test_a_result_shows_itself(shared_names: dict[str, object], tmp_path: Path) -> None:
    """In a notebook it is the montage, and its text is short."""
    result = shared_names["result"]
    assert isinstance(result, unlit.Result)
    assert result._repr_png_()[:8] == b"\x89PNG\r\n\x1a\n"
    assert len(repr(result)) < 200
    own = result.relight("photo")
    assert np.abs(own - result.images.render)[result.face.mask > 0.5].mean() < 0.05
    with pytest.raises(unlit.SettingsError, match="shape"):
        result.relight(np.ones(5))
    with pytest.raises(unlit.SettingsError, match="save the result first"):
        unlit.export(result)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            lambda: unlit.reconstruct("a.jpg", "papper"),
            "preset='papper': choose paper or standard or draft",
        ),
        (lambda: unlit.reconstruct("a.jpg", settings={"stage9": 1}), "stage9"),
        (lambda: unlit.reconstruct("no-such.jpg", progress=False), "no-such.jpg"),
        (lambda: unlit.reconstruct("no.jpg", face="leftmost", progress=False), "face='leftmost': "),
        (lambda: unlit.batch(["no.jpg"], "no", face="leftmost"), "face='leftmost': choose only"),
        (lambda: unlit.load("no-such-folder"), "no-such-folder"),
        (lambda: unlit.resume("no-such-folder", 4), "no-such-folder"),
        (lambda: unlit.reconstruct("a.jpg", model="no-such-head", progress=False), "a.jpg|head"),
    ],
)
def test_mistakes_are_named(call: object, said: str) -> None:
    with pytest.raises(unlit.UnlitError, match=said):
        call()  # type: ignore[operator]
