"""The user's mask: as large as the photo, white where skin may be used."""

import numpy as np
import pytest
from PIL import Image

from unlit.errors import FaceError, PhotoError
from unlit.perception.mask import painted, read_mask
from unlit.perception.regions import Regions
from unlit.photo.photo import Photo


@pytest.fixture
def photo() -> Photo:
    return Photo.of(np.full((70, 90, 3), 128, np.uint8), "a.jpg")


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "1"])
def test_grey_levels_as_stored(photo, tmp_path, mode):
    """White is 1 and black is 0 in any kind of picture; grey is its level, not its light."""
    levels = np.zeros((70, 90), np.uint8)
    levels[:, 45:] = 255
    levels[:10] = 0 if mode == "1" else 51
    Image.fromarray(levels).convert(mode).save(tmp_path / "m.png")
    np.testing.assert_allclose(read_mask(tmp_path / "m.png", photo), levels / 255, atol=1e-3)


def test_an_array(photo):
    """From Python; values outside 0 to 1 are clipped."""
    assert read_mask(np.full((70, 90), 3.0), photo).max() == 1
    assert read_mask(np.full((70, 90), 51, np.uint8), photo).max() == pytest.approx(0.2)
    with pytest.raises(PhotoError, match="not finite"):
        read_mask(np.full((70, 90), np.nan), photo)


def test_another_size_is_refused(photo, tmp_path):
    """One line with both sizes; also for the crop's own mask.png, which is an easy mistake."""
    Image.new("L", (256, 256)).save(tmp_path / "mask.png")
    with pytest.raises(PhotoError) as caught:
        read_mask(tmp_path / "mask.png", photo)
    assert "mask.png: 256 x 256 pixels, but a.jpg has 90 x 70" in str(caught.value)
    assert "\n" not in str(caught.value)
    with pytest.raises(PhotoError, match="90 x 70"):
        read_mask(np.zeros((90, 70)), photo)


def test_painted_regions():
    """Parts keep their proportions, what is added is skin, and untouched pixels keep their bits."""
    rows = np.array(
        [
            [0.5, 0.3, 0, 0, 0.1, 0.1],
            [0.5, 0.3, 0, 0, 0.1, 0.1],
            [0.5, 0.3, 0, 0, 0.1, 0.1],
            [0, 0, 0, 0, 0.7, 0.3],
        ],
        np.float32,
    )
    regions = Regions(rows.reshape(2, 2, 6))
    face = regions.face.copy()
    face[0, 0], face[0, 1], face[1, 1] = 0.4, 1.0, 0.6
    found = painted(regions, face).weights.reshape(4, 6)
    np.testing.assert_allclose(found[0], np.array([2, 1.2, 0, 0, 0.4, 5.4]) / 9, atol=1e-6)
    np.testing.assert_allclose(found[1], [0.6, 0.3, 0, 0, 0.1, 0], atol=1e-6)
    np.testing.assert_array_equal(found[2], rows[2])
    np.testing.assert_allclose(found[3], [0, 0, 0, 0, 0.6, 0.4], atol=1e-6)


def test_the_mask_follows_the_crop(monkeypatch):
    """What is black in the photo is no face at that place of the crop; all black is an error."""
    from skimage.data import astronaut

    from unlit.pipeline.observe import observe

    photo = Photo.of(astronaut(), "astronaut.png")
    whole = observe(photo, 256, "largest")
    mask = np.ones(photo.pixels.shape[:2], np.float32)
    x = whole.crop.inverse_points(whole.landmarks[1, :2])[0]  # the tip of the nose
    mask[:, : int(x)] = 0
    half = observe(photo, 256, "largest", mask=mask)
    split = int(whole.landmarks[1, 0])
    assert half.regions.face[:, : split - 3].max() == 0
    kept = np.s_[:, split + 3 :]
    np.testing.assert_array_equal(half.regions.weights[kept], whole.regions.weights[kept])
    with pytest.raises(FaceError, match="the mask leaves nothing"):
        observe(photo, 256, "largest", mask=0 * mask)
