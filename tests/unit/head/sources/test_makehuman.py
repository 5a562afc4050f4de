"""The default model: anatomy, orientation, basis, regions, cache."""

import time

import numpy as np
import pytest

from unlit.errors import ModelError
from unlit.head.basis import vertex_areas
from unlit.head.contact import LOWER_RIM, UPPER_RIM, pieces
from unlit.head.model import LANDMARKS, VERTEX_REGIONS, HeadModel
from unlit.head.sources import makehuman
from unlit.head.sources.makehuman import inner_product_weights
from unlit.head.sources.makehuman_learnt import shipped_prior
from unlit.perception.topology import BLENDSHAPE_NAMES
from unlit.scene.surface_points import SurfacePoints


def region(head: HeadModel, name: str) -> np.ndarray:
    return head.vertex_region == VERTEX_REGIONS.index(name)


def test_size_and_names(head):
    """About 18,000 vertices, all landmarks carried, the units whose scores the landmarker gives."""
    assert 15_000 < len(head.neutral) < 20_000
    assert (head.landmark_points.triangle >= 0).all()
    assert set(BLENDSHAPE_NAMES[1:]) <= set(head.expression_names)
    assert len(head.expression_names) == 52
    assert "CC0" in head.licence
    assert (head.uv >= 0).all() and (head.uv <= 1).all()


def test_frame_and_anatomy(head):
    """The subject's left is +x, up is +y, the nose points along +z; adult measures in cm."""
    points = head.landmarks(head.neutral)
    assert points[263, 0] > 2 > -2 > points[33, 0]
    assert points[10, 1] > points[1, 1] > points[152, 1]
    assert points[1, 2] > points[152, 2] and points[1, 2] > points[10, 2]
    assert np.linalg.norm(points[468] - points[473]) == pytest.approx(6.3, abs=0.3)
    assert 12 < np.ptp(head.neutral[region(head, "skin"), 0]) < 18
    assert 3 < np.linalg.norm(points[61] - points[291]) < 6
    assert 15 < head.neutral[:, 1].max() - points[152, 1] < 26


def test_triangles_face_outward(head):
    """Signed volumes are positive, and the fronts of the face and of the teeth look to the front.

    Rows of teeth are open behind the gums: they have no volume.
    """
    piece = pieces(head)
    of_triangle = piece[head.triangles[:, 0]]
    teeth = region(head, "teeth")[head.triangles[:, 0]]
    assert piece.max() + 1 == 6 and len(np.unique(of_triangle[teeth])) == 2
    a, b, c = (head.neutral[head.triangles[:, i]].astype(float) for i in range(3))
    volume = np.einsum("fx,fx->f", a, np.cross(b, c)) / 6
    volumes = np.bincount(of_triangle[~teeth], volume[~teeth], 6)
    assert (volumes[np.unique(of_triangle[~teeth])] > 0).all()
    normal = np.cross(b - a, c - a)
    front = teeth & (np.abs(a[:, 0]) < 1) & (a[:, 2] > a[teeth, 2].max() - 0.5)
    assert normal[front, 2].mean() > 0
    nose = head.landmark_points.triangle[[4, 5, 195, 6, 151, 199]]
    assert (normal[nose, 2] > 0).all()


def test_identity_basis_is_orthogonal_and_plausible(head):
    """Orthogonal under area and region weights; 3 mm at most a mode, 3-7 mm all together.

    The displacements, which follow the axes' components, are not orthogonal to them.
    """
    weights = inner_product_weights(head.neutral, head.triangles, head.vertex_region)
    basis = head.identity[: len(shipped_prior().components)].astype(np.float64)
    gram = np.einsum("ivx,v,jvx->ij", basis, weights, basis, optimize=True)
    size = np.diag(gram)
    # The areas are those of the artist's neutral; the learnt mean's differ a little.
    assert np.abs(gram - np.diag(size)).max() < 0.03 * size[0]
    rms = 10 * np.sqrt(size / weights.sum())
    assert 1.5 < rms[0] < 3.5 and (np.diff(rms) < 0.05).all()
    assert 3 < np.sqrt((rms**2).sum()) < 7


def test_lips_are_closed_and_eyes_filled(head):
    """The neutral's lip rims meet, and looking into each eye one meets the eyeball."""
    rims = head.landmarks(head.neutral)[[UPPER_RIM, LOWER_RIM]]
    assert (rims[0, 1:-1, 1] - rims[1, 1:-1, 1]).max() < 0
    irises = head.triangles[head.landmark_points.triangle[[468, 473]]]
    assert region(head, "eyes")[irises].all()


def test_regions(head):
    """Every region has vertices, and lips lie below eyes below eyebrows."""
    height = [head.neutral[region(head, n), 1].mean() for n in ("lips", "eyes", "eyebrows")]
    assert height[0] < height[1] - 4 < height[2] - 4.5
    for name in VERTEX_REGIONS:
        assert region(head, name).sum() > 50, name
    area = vertex_areas(head.neutral, head.triangles)
    assert 6 < area[region(head, "lips")].sum() < 25


def test_teeth_and_tongue_stand_in_the_mouth(head):
    """Below the nose and behind the lips; the jaw carries the lower row, the skull the upper."""
    points = head.landmarks(head.neutral)
    piece = pieces(head)
    teeth = region(head, "teeth")
    rows = [piece == number for number in np.unique(piece[teeth])]
    lower, upper = sorted(rows, key=lambda row: head.neutral[row, 1].mean())
    assert points[152, 1] < head.neutral[lower, 1].min()
    assert head.neutral[upper, 1].max() < points[1, 1]
    assert head.neutral[teeth, 2].max() < points[13, 2]
    jaw = head.expression[head.expression_names.index("jawOpen")]
    assert np.abs(jaw[upper]).max() == 0
    assert jaw[lower, 1].max() < -0.5
    moves = np.abs(head.identity[:, teeth]).max(axis=(1, 2))
    assert moves.max() > 0.05  # a broad jaw has broad rows


def test_every_unit_moves_something(head):
    """No expression unit is empty or moves a vertex by more than a jaw can."""
    largest = np.linalg.norm(head.expression, axis=-1).max(axis=1)
    assert (largest > 0.05).all() and (largest < 6).all()


def test_cache_is_fast(head):
    """A cached model loads in well under a second."""
    start = time.perf_counter()
    makehuman.cached_model()
    assert time.perf_counter() - start < 1


def test_damaged_cache_is_rebuilt(head, tmp_path, monkeypatch):
    """A cached file that was cut short is built anew, not reported."""
    monkeypatch.setattr(makehuman, "cache_folder", lambda: tmp_path / "models")
    monkeypatch.setattr(makehuman, "asset", lambda name: tmp_path)
    monkeypatch.setattr(makehuman, "build", lambda *_: (head, None, None))
    makehuman.cached_model()
    (file,) = (tmp_path / "heads").iterdir()
    file.write_bytes(file.read_bytes()[:1000])
    assert makehuman.cached_model() is head
    assert HeadModel.load(file).name == head.name


def test_wrong_wheel_is_named(tmp_path):
    """A file that is not the expected data gives one line with its path."""
    path = tmp_path / "other.whl"
    path.write_text("no")
    with pytest.raises(ModelError, match=r"other\.whl: not the MakeHuman data"):
        makehuman.build(path, SurfacePoints.empty(LANDMARKS))
