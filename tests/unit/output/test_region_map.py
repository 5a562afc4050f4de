"""The ID map of the skin's regions, and the regions in a saved result."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from changed import changed
from small_head import SKIN_TRIANGLES, small_head
from unlit.face.reconstruction import Reconstruction
from unlit.head.skin_regions import SKIN_REGIONS
from unlit.output.arrays import read_arrays, write_arrays
from unlit.output.export import export
from unlit.output.region_map import REGION_COLOURS, REGION_MAP

SIZE = 512


@pytest.fixture(scope="module")
def r() -> Reconstruction:
    """The small head, whose left half is nose and right half cheeks, parted softly."""
    plain = small_head(64)
    vertices = plain.face.mesh.vertices
    nose = np.clip(0.5 - (vertices[:, :1] - vertices[:, :1].mean()) / 4, 0, 1)
    table = np.eye(len(SKIN_REGIONS), dtype=np.float32)
    one, other = (table[SKIN_REGIONS.index(name)] for name in ("nose", "cheeks"))
    return changed(plain, {"head.skin_regions": (nose * one + (1 - nose) * other)})


def test_every_region_has_a_colour_of_its_own() -> None:
    assert tuple(REGION_COLOURS) == SKIN_REGIONS
    assert len(set(REGION_COLOURS.values())) == len(SKIN_REGIONS)


def test_an_export_has_the_map_with_soft_borders(r: Reconstruction, tmp_path: Path) -> None:
    folder = export(r, tmp_path / "export", tmp_path, ["ply"], SIZE)
    picture = np.asarray(Image.open(folder / REGION_MAP)).astype(int)
    assert picture.shape == (SIZE, SIZE, 3)
    uv = r.face.mesh.uv[r.face.mesh.triangle_uv[:SKIN_TRIANGLES]].mean(axis=1)
    left = r.face.mesh.vertices[r.face.mesh.triangles[:SKIN_TRIANGLES], 0].mean(axis=1)
    column, row = np.floor(uv * SIZE).astype(int).T
    at = picture[SIZE - 1 - row, column]
    middle = r.face.mesh.vertices[:, 0].mean()
    assert (at[left < middle - 2.5] == REGION_COLOURS["nose"]).mean() > 0.98
    assert (at[left > middle + 2.5] == REGION_COLOURS["cheeks"]).mean() > 0.98
    between = at[np.abs(left - middle) < 1]
    assert np.abs(between[:, 1:].sum(axis=1) - 255).max() <= 1
    assert between[:, 1].min() > 30 and between[:, 1].max() < 225
    eyes = r.face.mesh.uv[r.face.mesh.triangle_uv[SKIN_TRIANGLES:]].mean(axis=1)
    column, row = np.floor(eyes * SIZE).astype(int).T
    assert not picture[SIZE - 1 - row, column].any()


def test_a_head_without_regions_has_no_map(tmp_path: Path) -> None:
    folder = export(small_head(64), tmp_path / "export", tmp_path, ["ply"], SIZE)
    assert not (folder / REGION_MAP).exists()


def test_a_result_keeps_its_regions(r: Reconstruction, tmp_path: Path) -> None:
    write_arrays(r, tmp_path / "reconstruction.npz")
    kept = read_arrays(tmp_path / "reconstruction.npz")["skin_regions"]
    np.testing.assert_array_equal(kept, r.head.skin_regions)
