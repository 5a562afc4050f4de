"""A small made-up result for the tests of the exporters: a head with a nose and two eyeballs.

Built from formulas alone: a latitude-longitude skin whose seam is at the back and whose layout is
its own mirror image about u = 0.5, and two balls that stand out of it, each a chart of its own.
The maps are smooth functions of the place on the surface, so that the truth is known everywhere.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable

import numpy as np
import pytest

from changed import changed
from unlit.face.conditions import Conditions
from unlit.face.face import Face, Normals, PosedMesh
from unlit.face.head import FittedHead
from unlit.face.photo import FacePhoto
from unlit.face.reconstruction import Images, Metrics, Reconstruction
from unlit.perception.regions import Regions
from unlit.perception.topology import FACE_OVAL
from unlit.photo.crop import Crop
from unlit.scene.camera import Camera
from unlit.scene.light import SphericalGaussians
from unlit.scene.maps import Maps, fill
from unlit.scene.mesh import Mesh, surface
from unlit.scene.surface_points import SurfacePoints
from unlit.settings.settings import Settings

DISTANCE = 80.0
CENTRE = np.array([0.3, -0.2, -DISTANCE])
ROWS, COLUMNS = 41, 64
SKIN_TRIANGLES = 2 * (ROWS - 1) * COLUMNS
EYE_COLOUR = np.array([0.1, 0.3, 0.7])


def grid_ball(
    rows: int, columns: int, chart: tuple[float, float, float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Unit directions (V, 3), triangles (F, 3), uv (T, 2) and triangle_uv (F, 3) of a ball.

    +z is in the middle of `chart` (u0, v0, u1, v1), the seam at the back.
    """
    s, t = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0.03, 0.97, rows))
    phi, theta = 2 * np.pi * s, np.pi * (1 - t)
    unit = np.stack(
        [-np.sin(phi) * np.sin(theta), np.cos(theta), -np.cos(phi) * np.sin(theta)], axis=-1
    )[:, :-1]
    u0, v0, u1, v1 = chart
    uv = np.stack([u0 + s * (u1 - u0), v0 + t * (v1 - v0)], axis=-1)
    corners, texture = [], []
    for i in range(rows - 1):
        for j in range(columns):
            square = [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)]
            for three in ((0, 1, 2), (0, 2, 3)):
                corners.append([square[k][0] * columns + square[k][1] % columns for k in three])
                texture.append([square[k][0] * (columns + 1) + square[k][1] for k in three])
    return unit.reshape(-1, 3), np.array(corners), uv.reshape(-1, 2), np.array(texture)


def geometry() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, triangles, uv, triangle_uv of the head, world frame, cm."""
    unit, triangles, uv, triangle_uv = grid_ball(ROWS, COLUMNS, (0.02, 0.35, 0.98, 0.98))
    nose = np.exp((unit @ (0.0, -0.1, 0.995) - 1) / 0.03)
    parts = [unit * (9 + 1.6 * nose)[:, None] * (0.85, 1.1, 1.0)]
    tables = [(triangles, uv, triangle_uv)]
    for x, chart in ((-2.8, (0.05, 0.05, 0.3, 0.25)), (2.8, (0.4, 0.05, 0.65, 0.25))):
        ball, triangles, uv, triangle_uv = grid_ball(13, 24, chart)
        parts.append(ball * 1.3 + (x, 2.0, 7.9))
        tables.append((triangles, uv, triangle_uv))
    at, at_uv, all_triangles, all_uv, all_triangle_uv = 0, 0, [], [], []
    for part, (triangles, uv, triangle_uv) in zip(parts, tables, strict=True):
        all_triangles.append(triangles + at)
        all_triangle_uv.append(triangle_uv + at_uv)
        all_uv.append(uv)
        at, at_uv = at + len(part), at_uv + len(uv)
    return (
        (np.concatenate(parts) + CENTRE).astype(np.float32),
        np.concatenate(all_triangles).astype(np.int32),
        np.concatenate(all_uv).astype(np.float32),
        np.concatenate(all_triangle_uv).astype(np.int32),
    )


def symmetric_albedo(point: np.ndarray) -> np.ndarray:
    """(..., 3) linear albedo at world points (..., 3), the same left and right."""
    x, y, _ = np.moveaxis(point - CENTRE, -1, 0) / 9
    wave = 0.06 * np.cos(6 * x) + 0.05 * np.sin(5 * y)
    return np.stack([0.5 + wave, 0.35 + 0.7 * wave, 0.3 + 0.5 * wave], axis=-1)


def small_head(
    size: int = 96,
    albedo: Callable[[np.ndarray], np.ndarray] = symmetric_albedo,
    bend: float = 0.1,
    shown: Callable[[np.ndarray], np.ndarray] = lambda point: np.ones(len(point), bool),
    eye_shift: int = 0,
) -> Reconstruction:
    """The head as a result. Its `render` is 0: the tests shade it themselves.

    albedo: of the skin. bend: length of the normals' perturbation. shown: of surface points
    (P, 3), which are in the mask. eye_shift: pixels by which the eyes' region is off to the
    right, as a segmentation may be.
    """
    vertices, triangles, uv, triangle_uv = geometry()
    camera = Camera(size, size, size * DISTANCE / 24.0, size / 2 - 1.2, size / 2 + 0.7)
    mesh = Mesh(vertices, triangles)
    hits = mesh.camera_hits(camera)
    at, normal, _ = surface(camera, hits, mesh.vertices, mesh.normals, mesh.triangles)
    pixel, at, normal = hits.pixel.numpy(), at.numpy().T, normal.numpy().T
    eye_pixel = np.zeros(size * size, bool)
    eye_pixel[pixel] = hits.triangle.numpy() >= SKIN_TRIANGLES
    region = np.roll(eye_pixel.reshape(size, size), eye_shift, axis=1).ravel()

    hit = np.zeros(size * size, bool)
    hit[pixel] = True
    mask = np.zeros(size * size, np.float32)
    mask[pixel[shown(at)]] = 1

    def image(values: np.ndarray) -> np.ndarray:
        full = np.zeros((size * size, values.shape[1]), np.float32)
        full[pixel] = values
        return fill(full.reshape(size, size, -1), (mask > 0).reshape(size, size))

    colour = np.where(region[pixel][:, None], EYE_COLOUR, albedo(at))
    phase = (at - CENTRE) / 9
    # Odd in x for the x component: the bend is its own mirror image.
    waves = np.stack([np.sin(5 * phase[:, 0]), np.cos(4 * phase[:, 1]), 0 * phase[:, 0]], axis=1)
    perturbation = image(bend * waves) * mask.reshape(size, size, 1)
    gloss = image(0.8 + 0.3 * np.sin(3 * phase[:, :1]))[..., 0]
    rough = image(0.3 + 0.05 * np.cos(3 * phase[:, 1:2]))[..., 0]
    maps = Maps(image(colour), gloss, rough, perturbation)
    mesh_normal = np.zeros((size * size, 3), np.float32)
    mesh_normal[pixel] = normal

    def bent(change: np.ndarray) -> np.ndarray:
        n = mesh_normal + change.reshape(-1, 3)
        n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-9)
        return (n * (mask * hit)[:, None]).reshape(size, size, 3).astype(np.float32)

    regions = np.zeros((size, size, 6), np.float32)
    regions[..., 2] = region.reshape(size, size)
    regions[..., 0] = 1 - regions[..., 2]
    zero = np.zeros((size, size, 3), np.float32)
    posed = PosedMesh(vertices, triangles, uv, triangle_uv)
    crop = Crop(np.eye(2, 3), size)
    return Reconstruction(
        FacePhoto("small head", zero, camera, crop, Regions(regions), np.zeros((478, 3))),
        FittedHead(posed, np.zeros((5, 2), np.float32), SurfacePoints.empty(5)),
        Conditions(),
        Face(
            camera,
            posed,
            maps,
            Normals(bent(perturbation), bent(maps.diffuse_perturbation())),
            mask.reshape(size, size),
        ),
        SphericalGaussians(
            np.array([[0.5, 0.5, 0.7], [-0.9, 0.1, 0.4]], np.float32),
            np.array([20.0, 3.0], np.float32),
            np.array([1.5, 0.5], np.float32),
        ),
        Images(zero, zero, zero),
        1.0,
        Settings(),
        Metrics({}, {}, 0.0),
    )


def with_outline(r: Reconstruction) -> Reconstruction:
    """The small head with the landmarks of a face's outline: a circle about the middle of u, v."""
    mesh = r.face.mesh
    middle = mesh.uv[mesh.triangle_uv[:SKIN_TRIANGLES]].mean(axis=1)
    triangle = np.full(478, -1, np.int32)
    angles = np.linspace(0, 2 * np.pi, len(FACE_OVAL), endpoint=False)
    for landmark, angle in zip(FACE_OVAL, angles, strict=True):
        place = (0.5 + 0.15 * np.sin(angle), 0.66 + 0.12 * np.cos(angle))
        triangle[landmark] = np.linalg.norm(middle - place, axis=1).argmin()
    weights = np.full((478, 3), 1 / 3, np.float32)
    return changed(r, {"head.landmark_points": SurfacePoints(triangle, weights)})


def save_quickly(patch: pytest.MonkeyPatch) -> None:
    """When a result is saved, let the albedo stand in for relit faces, and bake a small atlas."""

    def albedo(face: Face) -> Callable[[object], np.ndarray]:
        return lambda light: face.maps.diffuse_albedo

    patch.setattr(importlib.import_module("unlit.output.relit"), "Relighter", albedo)
    patch.setattr(importlib.import_module("unlit.output.save"), "atlas_size", lambda r: 64)
