"""The layers of --passes, read back with the library of the format's makers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from saved_head import SIZE, Saved
from unlit.photo.photo import read_photo
from unlit.relighting.passes import passes, passes_exr
from unlit.render.relighter import Relighter
from unlit.scene.light import disc, uniform

OpenEXR = pytest.importorskip("OpenEXR")

NAMES = {
    *"RGBA",
    *(f"{layer}.{c}" for layer in ("diffuse", "specular", "indirect", "albedo") for c in "RGB"),
    *(f"normal.{c}" for c in "XYZ"),
    *("depth.Z", "specular_albedo.Y", "roughness.Y", "visibility.Y", "mask.Y"),
}
LIGHT = disc((0.8, 0.3, 0.5)) + uniform(0.1)


def _read(content: bytes, folder: Path) -> dict[str, np.ndarray]:
    file = folder / "passes.exr"
    file.write_bytes(content)
    channels = OpenEXR.File(str(file), separate_channels=True).channels()
    return {name: channel.pixels for name, channel in channels.items()}


def _stacked(found: dict[str, np.ndarray], layer: str, letters: str = "RGB") -> np.ndarray:
    return np.stack([found[f"{layer}{c}"] for c in letters], axis=-1)


def test_the_layers(saved: Saved, tmp_path: Path) -> None:
    """Diffuse and specular sum to the beauty, which is the fast picture times the mask."""
    face = saved.face.face
    found = _read(passes_exr(saved.face, LIGHT, 20.0), tmp_path)
    assert set(found) == NAMES
    assert all(values.shape == (SIZE, SIZE) for values in found.values())
    assert all(values.dtype == np.float32 for values in found.values())
    beauty, diffuse, specular, indirect = (
        _stacked(found, layer) for layer in ("", "diffuse.", "specular.", "indirect.")
    )
    np.testing.assert_allclose(diffuse + specular, beauty, atol=1e-6)
    fast = Relighter(face).under(LIGHT, [20.0]).image(0)
    np.testing.assert_allclose(beauty, fast * face.mask[..., None], atol=1e-5)
    assert indirect.max() > 0
    assert (indirect <= beauty + 1e-6).all()
    inside = found["A"] > 0
    np.testing.assert_array_equal(found["A"], found["mask.Y"])
    np.testing.assert_allclose(found["A"][inside], face.mask[inside])
    normal = _stacked(found, "normal.", "XYZ")
    np.testing.assert_allclose(np.linalg.norm(normal[inside], axis=1), 1, atol=1e-3)
    assert normal[inside][:, 2].mean() > 0.5
    assert 60 < found["depth.Z"][inside].min() < found["depth.Z"][inside].max() < 90
    assert (found["depth.Z"][~inside] == 0).all()
    seen = found["visibility.Y"][inside]
    assert 0 <= seen.min() < 0.9
    assert 0.99 < seen.max() <= 1


def test_in_the_photo_s_frame(saved: Saved, tmp_path: Path) -> None:
    photo = read_photo(saved.photo)
    small = _read(passes_exr(saved.face, LIGHT), tmp_path)
    found = _read(passes_exr(saved.face, LIGHT, photo=photo), tmp_path)
    assert found["R"].shape == photo.pixels.shape[:2]
    beauty, diffuse, specular = (_stacked(found, x) for x in ("", "diffuse.", "specular."))
    np.testing.assert_allclose(diffuse + specular, beauty, atol=1e-6)
    assert beauty.max() > 0.5 * _stacked(small, "").max()
    there = found["depth.Z"] > 0
    assert found["depth.Z"][there].min() > 60  # no mean of a face and nothing
    np.testing.assert_allclose(
        np.linalg.norm(_stacked(found, "normal.", "XYZ")[there], axis=1), 1, atol=1e-3
    )


def test_visibility_has_no_unit(saved: Saved) -> None:
    """A light in other units is as visible."""
    bright, dim = (passes(saved.face, LIGHT * np.float32(x))["visibility"] for x in (1, 1e-8))
    assert bright.max() > 0.99
    np.testing.assert_allclose(dim, bright, atol=1e-3)


def test_no_light(saved: Saved, tmp_path: Path) -> None:
    found = _read(passes_exr(saved.face, np.zeros((18, 36), np.float32)), tmp_path)
    assert found["R"].max() == 0
    assert found["visibility.Y"].max() == 0
    assert found["A"].max() > 0
