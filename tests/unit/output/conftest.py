"""A small made-up result: a grey ball with a rosy half in front of a 32-pixel camera."""

from dataclasses import replace

import numpy as np
import pytest

from small_head import save_quickly
from unlit.face.conditions import Conditions, LightEstimate
from unlit.face.face import Face, Normals, PosedMesh
from unlit.face.head import FittedHead
from unlit.face.photo import FacePhoto
from unlit.face.reconstruction import Images, Metrics, Reconstruction
from unlit.perception.regions import Regions
from unlit.photo.crop import Crop
from unlit.scene.camera import Camera
from unlit.scene.light import SphericalGaussians
from unlit.scene.maps import Maps
from unlit.scene.surface_points import SurfacePoints
from unlit.settings.settings import PRESETS, override

SIZE = 32
DISTANCE = 60.0
RADIUS = 9.0


def _ball() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Latitude-longitude ball with a UV seam: (V, 3), (F, 3), (T, 2), (F, 3)."""
    rows, columns = 9, 16
    theta = np.linspace(0.02, np.pi - 0.02, rows)[:, None]
    phi = np.linspace(0, 2 * np.pi, columns + 1)[None]
    uv = np.stack(np.broadcast_arrays(phi / (2 * np.pi), 1 - theta / np.pi), axis=-1)
    unit = np.stack(
        np.broadcast_arrays(
            np.sin(phi) * np.sin(theta), np.cos(theta), np.cos(phi) * np.sin(theta)
        ),
        axis=-1,
    )[:, :-1]
    vertices = unit.reshape(-1, 3) * RADIUS + (0, 0, -DISTANCE)
    corners, texture = [], []
    for i in range(rows - 1):
        for j in range(columns):
            square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            for three in ((0, 1, 2), (0, 2, 3)):
                corners.append([square[k][0] * columns + square[k][1] % columns for k in three])
                texture.append([square[k][0] * (columns + 1) + square[k][1] for k in three])
    return (
        vertices.astype(np.float32),
        np.array(corners, np.int32),
        uv.reshape(-1, 2).astype(np.float32),
        np.array(texture, np.int32),
    )


@pytest.fixture(scope="session")
def face() -> Reconstruction:
    """A whole Reconstruction with awkward values in it: halves of units, tuples, small numbers."""
    random = np.random.default_rng(7)
    camera = Camera(SIZE, SIZE, focal=SIZE * DISTANCE / 26.0, cx=SIZE / 2 + 0.1, cy=SIZE / 2)
    vertices, triangles, uv, triangle_uv = _ball()
    offset = camera.directions()[..., :2] / -camera.directions()[..., 2:] * DISTANCE / RADIUS
    inside = (offset**2).sum(axis=-1) < 0.9
    z = np.sqrt(np.maximum(1 - (offset**2).sum(axis=-1), 0))
    normal = np.concatenate([offset, z[..., None]], axis=-1)
    normal = (normal / np.linalg.norm(normal, axis=-1, keepdims=True) * inside[..., None]).astype(
        "f4"
    )
    albedo = np.where(offset[..., :1] > 0, [0.6, 0.4, 0.3], [0.4, 0.4, 0.4]).astype("f4")
    albedo += random.uniform(0, 0.05, albedo.shape).astype("f4")
    shading = np.repeat(normal[..., 2:], 3, axis=-1)
    render = albedo * shading
    scalar = np.ones((SIZE, SIZE), np.float32)
    axis = random.normal(size=(12, 3))
    mesh = PosedMesh(vertices, triangles, uv, triangle_uv)
    points = SurfacePoints(
        np.array([0, 3, -1, 7, 2], np.int32), random.uniform(size=(5, 3)).astype(np.float32)
    )
    return Reconstruction(
        FacePhoto(
            name="grüße.jpg",
            image=render + random.uniform(0, 0.01, render.shape).astype("f4"),
            camera=camera,
            crop=Crop(np.array([[1 / 3, 0, -7.1], [0, 1 / 3, 2.3]]), SIZE),
            regions=Regions(
                random.uniform(size=(SIZE, SIZE, 6)).astype(np.float32),
                random.uniform(size=(192, 192, 13)).astype(np.float32),
            ),
            landmarks=random.uniform(0, SIZE, (478, 3)),
            white_luminance=1000 / 3,
        ),
        FittedHead(
            replace(mesh, vertices=vertices + np.float32(0.1)),
            random.uniform(0, SIZE, (5, 2)).astype(np.float32),
            points,
            landmark_residual=0.1 + 0.2,
            model="ball, CC0",
        ),
        Conditions(light_estimate=LightEstimate(used=False, kelvin=1e5 / 3, excess=1e-17)),
        Face(
            camera,
            mesh,
            Maps(albedo, 0.9 * scalar, 0.3 * scalar, np.zeros_like(normal)),
            Normals(normal, normal),
            inside.astype(np.float32),
        ),
        SphericalGaussians(
            (axis / np.linalg.norm(axis, axis=1, keepdims=True)).astype(np.float32),
            random.uniform(5, 50, 12).astype(np.float32),
            random.uniform(0, 1, 12).astype(np.float32),
        ),
        Images(shading, np.zeros_like(shading), render),
        gain=0.1 + 0.6,
        settings=override(PRESETS["draft"], {"clip": 0.1 + 0.2, "stage1.iterations": 3}),
        metrics=Metrics({"stage1": [(0, 1e-17), (2, 0.3)]}, {"photo": 1 / 3}, 700.5, ("dark",), 2),
    )


@pytest.fixture
def no_relight(monkeypatch: pytest.MonkeyPatch) -> None:
    """Relighting and a large atlas take seconds: where they do not matter, something small."""
    save_quickly(monkeypatch)
