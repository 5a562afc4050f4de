"""Subjects with known truth."""

import numpy as np
import pytest
from painting import SKINS, Features, Subject, paint

from bumpy_head import bumpy_head, camera, view
from unlit.evaluate.truth import visible_surface
from unlit.scene.light import flash, uniform
from unlit.scene.maps import Maps
from unlit.settings.regions import RoughnessByRegion

SIZE = 64


def painted(skin: str, lipstick: bool = False) -> Maps:
    vertices, triangles = bumpy_head()
    lips = SIZE * np.array([[0.4, 0.68], [0.6, 0.68], [0.5, 0.74]])
    brow = SIZE * np.array([[0.3, 0.35], [0.42, 0.33]])
    eyes = np.abs(vertices[:, 1] - 2.0) < 1.0
    features = Features(lips, (brow, brow + np.array([0.28 * SIZE, 0])), eyes)
    return paint(vertices, triangles, camera(SIZE), features, skin, 4, lipstick=lipstick)


@pytest.mark.parametrize("skin", SKINS)
def test_paint(skin: str) -> None:
    """Maps of the right shape and range, the median the skin's own, the same for a seed."""
    maps = painted(skin)
    assert maps.diffuse_albedo.shape == (SIZE, SIZE, 3)
    assert maps.diffuse_albedo.min() > 0
    assert maps.diffuse_albedo.max() < 0.9
    median = np.median(maps.diffuse_albedo.reshape(-1, 3), axis=0)
    assert median == pytest.approx(np.array(SKINS[skin]), rel=0.15)
    assert maps.roughness.max() == pytest.approx(RoughnessByRegion().eyebrows, abs=0.02)
    assert np.median(maps.roughness) == pytest.approx(RoughnessByRegion().skin)
    assert painted(skin).diffuse_albedo == pytest.approx(maps.diffuse_albedo)


def test_lipstick_is_red() -> None:
    """Only the lips change."""
    plain, red = painted("light"), painted("light", lipstick=True)
    inside = (int(0.7 * SIZE), SIZE // 2)
    ratio = red.diffuse_albedo[inside] / plain.diffuse_albedo[inside]
    assert ratio[1] < 0.5 * ratio[0]
    assert red.diffuse_albedo[2, 2] == pytest.approx(plain.diffuse_albedo[2, 2])


def test_photograph_and_normals() -> None:
    """A photograph is lit where the head is; flash darkens what is turned away."""
    vertices, triangles = bumpy_head()
    maps = painted("medium")
    seen = view(vertices, triangles, camera(SIZE), maps)
    mask = seen.inside(3)
    subject = Subject("test", vertices, triangles, camera(SIZE), maps, mask)
    even, lit = subject.photograph(uniform(), 32), subject.photograph(flash(), 32)
    assert even.shape == (SIZE, SIZE, 3)
    assert even[0, 0].max() == 0
    ratio = (lit.mean(axis=2)[mask] / even.mean(axis=2)[mask]).clip(0, 3)
    normals = visible_surface(vertices, triangles, camera(SIZE))[1]
    assert np.linalg.norm(normals[mask], axis=1) == pytest.approx(1.0, abs=1e-4)
    assert np.corrcoef(ratio, normals[mask][:, 2])[0, 1] > 0.5
