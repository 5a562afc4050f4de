"""What the stages share: the roughness of each pixel; when highlights are carried anew."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tiny_run
from unlit.head.model import HeadModel
from unlit.head.skin_regions import SKIN_REGIONS, skin_regions
from unlit.optimize.problem import Problem
from unlit.perception.regions import REGIONS
from unlit.render.interreflection import IndirectLight
from unlit.scene.camera import Camera


def test_gloss_is_kept_while_the_light_hardly_changes(monkeypatch):
    """Made at every refresh where no change of the light is allowed, else for each geometry."""
    made = {}
    original = IndirectLight.specular_transfer

    def counted(self, radiance):
        made[change] += 1
        return original(self, radiance)

    monkeypatch.setattr(IndirectLight, "specular_transfer", counted)
    for change in (0.0, 1.0):
        made[change] = 0
        tiny_run.run(None, tiny_run.settings(gloss_change=change))
    assert 0 < made[1.0] < made[0.0] - 3


ALPHA = {"forehead": 0.9, "nose": 0.1, "cheeks": 0.7, "lids": 0.8, "chin": 0.5, "upper_lip": 0.3}
#: The landmark in the middle of each: forehead, tip of the nose, a cheek, chin, upper lip.
MIDDLES = {"forehead": 151, "nose": 4, "cheeks": 425, "chin": 199, "upper_lip": 164}


@pytest.mark.parametrize("turn", [0, 35])
def test_roughness_follows_the_head(head: HeadModel, turn: float) -> None:
    """Where a region's middle is seen, the roughness is its own, however the head is turned."""
    rotation = Rotation.from_euler("yx", [turn, 5], degrees=True).as_matrix()
    vertices = (head.neutral @ rotation.T + (0, 1, -80)).astype(np.float32)
    size = 96
    camera = Camera(size, size, size * 80 / 24, size / 2, size / 2)
    regions = np.zeros((size, size, len(REGIONS)), np.float32)
    regions[..., 0] = 1
    one = np.ones((size, size), np.float32)
    seen = problem_of(
        settings={f"roughness.{name}": alpha for name, alpha in ALPHA.items()},
        image=np.full((size, size, 3), 0.3, np.float32),
        regions=regions,
        mask=one > 0,
        weight=one,
        fitted=one > 0,
        camera=camera,
        vertices=vertices,
        triangles=head.triangles,
        skin_regions=skin_regions(head),
    )
    roughness = seen.image(seen.roughness)
    points = head.landmarks(vertices)
    for name, landmark in MIDDLES.items():
        x, y = np.floor(camera.project(points[landmark])).astype(int)
        assert roughness[y, x] == pytest.approx(ALPHA[name], abs=0.09), name


def test_lips_and_eyes_keep_the_photos_roughness_and_a_bare_mesh_has_one() -> None:
    bare = problem_of(settings={"roughness.nose": 0.1, "roughness.skin": 0.4})
    shares = bare.regions
    expected = shares[:, 0] * 0.4 + shares[:, 1] * bare.settings.roughness.lips
    np.testing.assert_allclose(bare.roughness.numpy(), expected, rtol=1e-5)
    assert not bare.log_level.numpy().any()
    nose = problem_of(settings={"roughness.nose": 0.1}, skin_regions=one_region("nose"))
    expected = shares[:, 0] * 0.1 + shares[:, 1] * bare.settings.roughness.lips
    np.testing.assert_allclose(nose.roughness.numpy(), expected, rtol=1e-5)


def test_the_specular_map_has_the_levels_of_the_settings() -> None:
    """The left half is nose and gets three times the gloss that it would have."""
    fitted = tiny_run.head()
    half = (fitted.mesh.vertices[:, 0] < 0)[:, None]
    known = np.where(half, one_region("nose"), one_region("cheeks"))
    found = {}
    for level in (1.0, 3.0):
        settings = tiny_run.settings(
            **{"specular_level.nose": level, "detail.highlight_most": 0.0, "solver": "primal-dual"}
        )
        head = replace(fitted, skin_regions=known)
        made = tiny_run.run(None, settings, known=tiny_run.steps(fitted=head))
        skin = (made.face.mask > 0) & (made.photo.regions.skin > 0.9)
        left = np.arange(tiny_run.SIZE) < tiny_run.SIZE // 2 - 2
        right = np.arange(tiny_run.SIZE) > tiny_run.SIZE // 2 + 2
        map_ = made.face.maps.specular_albedo
        found[level] = np.median(map_[skin & left]) / np.median(map_[skin & right])
    assert found[3.0] / found[1.0] == pytest.approx(3, rel=0.15)


def one_region(name: str) -> np.ndarray:
    """(V, 8) for the tiny head: all of one region."""
    row = np.eye(len(SKIN_REGIONS), dtype=np.float32)[SKIN_REGIONS.index(name)]
    return np.tile(row, (len(tiny_run.head().mesh.vertices), 1))


def problem_of(settings: dict[str, float], **changes: Any) -> Problem:
    return tiny_run.problem(tiny_run.settings(**settings), **changes)
