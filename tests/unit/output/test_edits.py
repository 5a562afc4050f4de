"""Whichever map of a saved result was edited is found, and nothing else is changed by it."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from changed import changed
from unlit.color import decode_srgb
from unlit.errors import OutputError, PictureError
from unlit.face.reconstruction import Reconstruction
from unlit.output.edits import edited
from unlit.output.images import exr
from unlit.output.load import load
from unlit.output.save import save

pytestmark = pytest.mark.usefixtures("no_relight")


@pytest.fixture
def result(face, tmp_path) -> tuple[Reconstruction, Path]:
    """A result as it is loaded again, with skin where its mask is, and its folder."""
    regions = np.zeros_like(face.photo.regions.weights)
    regions[..., 0] = face.face.mask
    regions[..., 5] = 1 - face.face.mask
    save(changed(face, {"photo.regions.weights": regions}), tmp_path / "result")
    return load(tmp_path / "result"), tmp_path / "result"


def paint(path: Path, rows: slice, level: int | tuple[int, ...], mode: str | None = None) -> None:
    """Paint some rows of a PNG and save it as an editor would, perhaps in another mode."""
    image = Image.open(path)
    pixels = np.array(image)
    pixels[rows] = level
    Image.fromarray(pixels).convert(mode or image.mode).save(path)


def test_nothing_was_edited(result):
    """Files that were only saved again, in other bytes, are the same pictures."""
    r, folder = result
    paint(folder / "diffuse_albedo.png", slice(0), 0)
    paint(folder / "mask.png", slice(0), 0, "RGBA")
    (folder / "render.exr").unlink()
    again, files = edited(r, folder, 2)
    assert again is r
    assert files == []


def test_a_painted_png(result):
    """The painted pixels are decoded, all others keep the digits that a PNG has not."""
    r, folder = result
    paint(folder / "diffuse_albedo.png", slice(4, 9), (200, 100, 50))
    again, files = edited(r, folder, 2)
    assert files == ["diffuse_albedo.png"]
    painted = decode_srgb(np.array([200, 100, 50]) / 255)
    np.testing.assert_allclose(
        again.face.maps.diffuse_albedo[4:9], np.broadcast_to(painted, (5, 32, 3))
    )
    np.testing.assert_array_equal(
        again.face.maps.diffuse_albedo[9:], r.face.maps.diffuse_albedo[9:]
    )
    np.testing.assert_array_equal(again.face.mask, r.face.mask)


def test_an_edited_exr(result):
    """Linear values as they are; a grey map stays one."""
    r, folder = result
    values = r.face.maps.specular_albedo.copy()
    values[3] = 1.75
    (folder / "specular_albedo.exr").write_bytes(exr(values))
    again, files = edited(r, folder, 5)
    assert files == ["specular_albedo.exr"]
    np.testing.assert_array_equal(again.face.maps.specular_albedo, values)


def test_a_painted_mask_changes_the_regions(result):
    """Black takes skin away, white makes some where there was background; they sum to 1."""
    r, folder = result
    paint(folder / "mask.png", slice(0, 10), 255)
    paint(folder / "mask.png", slice(14, 16), 0)
    again, files = edited(r, folder, 1)
    assert files == ["mask.png"]
    face = again.photo.regions.weights[..., :5].sum(axis=-1)
    np.testing.assert_allclose(face[:10], 1)
    np.testing.assert_allclose(face[14:16], 0)
    np.testing.assert_array_equal(again.photo.regions.weights[16:], r.photo.regions.weights[16:])
    np.testing.assert_allclose(again.photo.regions.weights.sum(axis=-1), 1, atol=1e-6)
    assert again.photo.regions.weights.min() >= 0


@pytest.mark.parametrize(
    ("edit", "stage", "said"),
    [
        (("diffuse_albedo.png", "diffuse_albedo.exr"), 2, "were both edited; remove the one"),
        (("roughness.png",), 2, "roughness.png was edited, but it is a result only"),
        (("environment.exr",), 2, "environment.exr was edited, but it is a result only"),
        (("specular_albedo.png",), 1, "stage 1 makes it anew; go on from stage 2"),
    ],
)
def test_edits_that_cannot_be_used(result, edit, stage, said):
    """Never dropped in silence: one line that names the files."""
    r, folder = result
    for name in edit:
        if name.endswith("png"):
            paint(folder / name, slice(4, 9), 13)
        else:
            shape = load(folder).light.rasterize().shape if "env" in name else (32, 32, 3)
            (folder / name).write_bytes(exr(np.full(shape, 0.123, np.float32)))
    with pytest.raises(OutputError) as caught:
        edited(r, folder, stage)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_cannot_be_read(result):
    """Another size, values that are no numbers, no picture at all."""
    r, folder = result
    path = folder / "mask.png"
    Image.new("L", (31, 32)).save(path)
    with pytest.raises(OutputError, match=r"mask\.png: 31 x 32 pixels instead of 32 x 32"):
        edited(r, folder, 2)
    path.write_bytes(b"text")
    with pytest.raises(PictureError, match=r"mask\.png: "):
        edited(r, folder, 2)
    path.unlink()
    (folder / "mask.exr").write_bytes(exr(np.full((32, 32), np.nan, np.float32)))
    with pytest.raises(PictureError, match="not finite"):
        edited(r, folder, 2)
