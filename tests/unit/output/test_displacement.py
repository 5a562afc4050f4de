"""The displacement map: millimetres whose slopes are the bent normals, outwards above zero."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from changed import changed
from small_head import CENTRE, SKIN_TRIANGLES, small_head
from unlit.face.reconstruction import Reconstruction
from unlit.machine.runtime import mitsuba
from unlit.output import images
from unlit.output.displacement import displacement
from unlit.scene.height import PixelFrames
from unlit.scene.mesh import Mesh, surface

SIZE = 192


class Surface:
    """What the pixels of a reconstruction show: frames, normals, points (P, ...)."""

    def __init__(self, r: Reconstruction) -> None:
        mesh = Mesh(r.face.mesh.vertices, r.face.mesh.triangles)
        hits = mesh.camera_hits(r.face.camera)
        at, normal, _ = surface(r.face.camera, hits, mesh.vertices, mesh.normals, mesh.triangles)
        self.pixel = hits.pixel.numpy().astype(np.int64)
        self.at, self.normal = at.numpy().T, normal.numpy().T
        self.frames = PixelFrames.of(r.face.camera, self.pixel, self.at, self.normal)
        self.skin = (hits.triangle.numpy() < SKIN_TRIANGLES) & (self.frames.facing > 0.5)
        # The eyeballs stand out: beside them the pixels' neighbours are no neighbours on the skin.
        self.skin &= np.abs(self.at[:, 1] - CENTRE[1] - 2) > 2

    def rows(self, image: np.ndarray) -> np.ndarray:
        return image.reshape(-1, *image.shape[2:])[self.pixel]


def raised(bumps: Callable[[np.ndarray], np.ndarray]) -> tuple[Reconstruction, Surface]:
    """A head whose maps bend the normals as the relief `bumps` (points (P, 3) to cm) does."""
    r = small_head(SIZE, bend=0)
    seen = Surface(r)
    e = np.zeros((SIZE * SIZE, 3), np.float32)
    e[seen.pixel] = seen.frames.perturbation_of(bumps(seen.at - CENTRE))
    e = e.reshape(SIZE, SIZE, 3) * (r.face.mask[..., None] > 0)
    n = seen.normal + seen.rows(e)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    specular = np.zeros((SIZE * SIZE, 3), np.float32)
    specular[seen.pixel] = n
    change = {
        "face.maps": replace(r.face.maps, perturbation=e),
        "face.normals.specular": specular.reshape(SIZE, SIZE, 3),
    }
    return changed(r, change), seen


def wrinkles(point: np.ndarray) -> np.ndarray:
    """0.2 mm high, 1.3 cm apart."""
    return 0.02 * np.sin(2 * np.pi * point[:, 1] / 1.3) * np.cos(2 * np.pi * point[:, 0] / 1.9)


def bump(point: np.ndarray) -> np.ndarray:
    """One millimetre towards the viewer, on the forehead, 1 cm wide."""
    away = np.hypot(point[:, 0], point[:, 1] - 6)
    return 0.1 * np.exp(-((away / 0.5) ** 2))


def angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    a, b = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (a, b))
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)))


@pytest.mark.parametrize("relief", [wrinkles, bump])
def test_normals_of_the_height_are_those_of_the_map(relief) -> None:
    """Within a degree, and far nearer than the mesh's own; wrong signs and units would not be."""
    r, seen = raised(relief)
    height = seen.rows(displacement(r)) / 10
    normal = seen.rows(r.face.normals.specular)
    bent = seen.skin & (angle(seen.normal, normal) > 1)
    assert bent.sum() > 50
    found = angle(seen.normal + seen.frames.perturbation_of(height), normal)
    assert found[seen.skin].mean() < 1
    assert found[bent].mean() < 0.25 * angle(seen.normal, normal)[bent].mean()
    wrong = angle(seen.normal - seen.frames.perturbation_of(height), normal)
    assert wrong[bent].mean() > angle(seen.normal, normal)[bent].mean()


def test_a_bump_towards_the_viewer_is_above_zero_and_in_millimetres() -> None:
    """1 mm high; a little less, since what is broad is left out."""
    r, seen = raised(bump)
    height = seen.rows(displacement(r))
    top = height[np.argmax(bump(seen.at - CENTRE))]
    assert top == pytest.approx(height.max(), abs=0.02)
    assert 0.7 < top < 1.05
    assert height.min() > -0.2


def test_broad_slopes_are_no_displacement() -> None:
    """Normals that are off by a degree all over do not add up to hills of centimetres."""
    r, seen = raised(lambda point: 0.02 * point[:, 1])
    assert np.abs(seen.rows(displacement(r))[seen.skin]).max() < 0.3
    assert np.abs(0.02 * (seen.at - CENTRE)[:, 1]).max() > 0.15  # cm: 1.5 mm


def test_only_skin_and_lips_are_raised_and_the_rim_fades() -> None:
    """Regions of eyes are flat; beyond the mask the height dies away, and never ends in a step."""
    r, _ = raised(wrinkles)
    regions = np.zeros_like(r.photo.regions.weights)
    regions[..., 2] = 1
    flat = displacement(changed(r, {"photo.regions.weights": regions}))
    assert np.abs(flat).max() == 0
    mask = r.face.mask * (np.arange(SIZE) < 0.5 * SIZE)
    half = displacement(changed(r, {"face.mask": mask.astype(np.float32)}))
    whole = displacement(r)
    rows = slice(int(0.2 * SIZE), int(0.3 * SIZE))
    assert np.abs(half[rows, int(0.65 * SIZE) :]).max() < 1e-3
    assert np.abs(whole[rows, int(0.65 * SIZE) :]).max() > 0.1
    steps = np.abs(np.diff(half[rows], axis=1))
    assert steps.max() < 2 * np.abs(np.diff(whole[rows, SIZE // 4 : -SIZE // 4], axis=1)).max()


def test_without_a_face_it_is_zero() -> None:
    r = small_head(32)
    empty = displacement(changed(r, {"face.mask": np.zeros_like(r.face.mask)}))
    assert empty.shape == (32, 32)
    assert empty.dtype == np.float32
    assert not empty.any()


def test_files_hold_millimetres(tmp_path) -> None:
    """EXR to the bit; the PNG's 16 bits to a ten-thousandth of a millimetre."""
    height = displacement(raised(bump)[0])
    (tmp_path / "a.exr").write_bytes(images.exr(height))
    read = np.array(mitsuba().Bitmap(str(tmp_path / "a.exr"))).reshape(height.shape)
    np.testing.assert_array_equal(read, height)
    levels = np.asarray(Image.open(io.BytesIO(images.png(images.height_levels(height)))))
    assert levels.dtype == np.uint16
    np.testing.assert_allclose(levels / 65535 * 10 - 5, height, atol=1e-4)
    ends = images.height_levels(np.array([0, -5, 5, -7, 9.0]))
    assert ends.tolist() == [32768, 0, 65535, 0, 65535]
