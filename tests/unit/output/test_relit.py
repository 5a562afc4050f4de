"""The three new lights: computed once for all that a result's files show of them."""

import io

import numpy as np
import pytest
from PIL import Image

from small_head import save_quickly, small_head
from unlit.output import save as save_module
from unlit.output.relit import LIGHTS, relit
from unlit.output.save import save
from unlit.output.thumbnail import SIDE, thumbnail_webp
from unlit.storage.folder import REPORT, THUMBNAIL


@pytest.fixture
def face(monkeypatch):
    save_quickly(monkeypatch)
    return small_head(64)


def test_montage_and_pages_share_them(face, tmp_path, monkeypatch):
    made = []
    monkeypatch.setattr(save_module, "relit", lambda r: made.append(relit(r)) or made[-1])
    seen = []
    pages = {
        REPORT: lambda atlas, pictures: seen.append(pictures) or b"page",
        THUMBNAIL: lambda atlas, pictures: seen.append(pictures) or b"picture",
    }
    save(face, tmp_path / "out", pages=pages)
    assert len(made) == 1
    assert all(pictures is made[0] for pictures in seen) and len(seen) == 2
    assert made[0].keys() == LIGHTS.keys()
    assert (tmp_path / "out" / THUMBNAIL).read_bytes() == b"picture"
    save(face, tmp_path / "out")
    assert not (tmp_path / "out" / THUMBNAIL).exists()  # of the older result


def test_a_thumbnail_is_photo_albedo_and_outdoors(face):
    pictures = {name: np.full((64, 64, 3), 200, np.uint8) for name in LIGHTS}
    shown = np.asarray(Image.open(io.BytesIO(thumbnail_webp(face, pictures))), float)
    assert shown.shape == (SIDE, 3 * SIDE, 3)
    assert np.abs(shown[:, 2 * SIDE + 4 :] - 200).mean() < 3
    corner = shown[:20, SIDE + 8 : SIDE + 28]  # beside the face there is no albedo
    assert corner.mean() < 8
