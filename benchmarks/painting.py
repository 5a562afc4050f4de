"""Painted faces: reflectance of known truth for heads that have a shape only, photographed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from scipy import ndimage

from unlit.evaluate.truth import Truth, visible_surface
from unlit.render.reference import face_body, trace
from unlit.scene.camera import Camera
from unlit.scene.maps import Maps
from unlit.scene.mesh import Mesh
from unlit.settings.regions import RoughnessByRegion

#: Diffuse albedo, linear sRGB, of the skins that subjects are painted with.
SKINS = {
    "light": (0.60, 0.39, 0.30),
    "medium": (0.36, 0.21, 0.145),
    "dark": (0.115, 0.065, 0.045),
}


@dataclass(frozen=True)
class Subject:
    """A head with known truth, seen by a camera.

    vertices (V, 3) world, cm; triangles (F, 3). maps: true reflectance in the camera's pixels.
    mask: (H, W) bool, face pixels on which results are compared.
    """

    name: str
    vertices: np.ndarray
    triangles: np.ndarray
    camera: Camera
    maps: Maps
    mask: np.ndarray

    def photograph(self, environment: np.ndarray, samples: int = 256, seed: int = 0) -> np.ndarray:
        """Path-traced image (H, W, 3), linear, with three inter-reflections of the face."""
        return trace(self.bodies, self.camera, environment, samples, bounces=3, seed=seed)

    @cached_property
    def bodies(self) -> dict[str, Any]:
        """The head as an object of a Mitsuba scene, by name."""
        mesh = Mesh(self.vertices, self.triangles)
        return {"face": face_body(mesh, self.camera, self.maps)}

    def mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices and triangles."""
        return self.vertices, self.triangles

    @cached_property
    def truth(self) -> Truth:
        """What the camera sees; `seen` is the face's mask."""
        position, normal = visible_surface(self.vertices, self.triangles, self.camera)
        bent = normal + self.maps.perturbation * (normal != 0).any(axis=-1, keepdims=True)
        bent /= np.maximum(np.linalg.norm(bent, axis=-1, keepdims=True), 1e-6)
        return Truth(self.maps.diffuse_albedo, self.maps.specular_albedo, bent, position, self.mask)


@dataclass(frozen=True)
class Features:
    """Where the painter finds a face's parts: contours in pixels of the camera, (N, 2) each, and
    the vertices of the eyes, (V,) bool.
    """

    lips: np.ndarray
    brows: tuple[np.ndarray, np.ndarray]
    eyes: np.ndarray


def paint(
    vertices: np.ndarray,
    triangles: np.ndarray,
    camera: Camera,
    features: Features,
    skin: str,
    seed: int,
    freckles: int = 150,
    lipstick: bool = False,
) -> Maps:
    """Paint a face: skin of varied tone, lips, eyebrows, eyes, freckles, pores.

    skin: a name in SKINS. The variation is procedural and made in image
    space, the same for every skin: log-albedo noise of 4 to 60 pixels at 512, redder cheeks.
    """
    rng = np.random.default_rng(seed)
    size = (camera.height, camera.width)
    unit = camera.width / 512

    def noise(sigma: float) -> np.ndarray:
        field = ndimage.gaussian_filter(rng.standard_normal(size), sigma * unit, mode="wrap")
        return (field / field.std()).astype(np.float32)

    mesh = Mesh(vertices, triangles)
    hits = mesh.camera_hits(camera)
    pixel = hits.pixel.numpy()
    corner = triangles[hits.triangle.numpy()]
    eyes = np.zeros(size, dtype=np.float32)
    eyes.ravel()[pixel] = features.eyes[corner].all(axis=1)

    log = np.log(np.array(SKINS[skin], dtype=np.float32)) + np.zeros((*size, 3), np.float32)
    log += (0.06 * noise(60) + 0.04 * noise(15) + 0.03 * noise(4))[..., None]
    log += (0.05 * noise(40))[..., None] * np.array([0.3, -1.0, -0.8], dtype=np.float32)
    spots = np.zeros(size, dtype=np.float32)
    for _ in range(freckles):
        y, x = rng.uniform(0.25, 0.7) * size[0], rng.uniform(0.25, 0.75) * size[1]
        cv2.circle(spots, (int(x), int(y)), max(1, round(rng.uniform(0.8, 2.2) * unit)), 1.0, -1)
    spots = ndimage.gaussian_filter(spots, 0.7 * unit)
    log -= spots[..., None] * np.array([0.25, 0.45, 0.5], dtype=np.float32)
    albedo = np.exp(log)

    def region(contour: np.ndarray, thickness: int = 0) -> np.ndarray:
        image = np.zeros(size, dtype=np.float32)
        points = np.round(contour * 8).astype(np.int32)
        if thickness:
            cv2.polylines(image, [points], False, 1.0, max(1, round(thickness * unit)), shift=3)
        else:
            cv2.fillPoly(image, [points], 1.0, shift=3)
        return ndimage.gaussian_filter(image, 1.2 * unit)

    lips = region(features.lips)
    brows = np.maximum(*(region(b, 9) for b in features.brows))
    lip_tone = np.array([0.42, 0.05, 0.08] if lipstick else [0.85, 0.5, 0.55], dtype=np.float32)
    albedo = _mix(albedo, lip_tone * (1.0 if lipstick else albedo), lips)
    albedo = _mix(albedo, 0.35 * albedo, 0.85 * brows)
    albedo = _mix(albedo, np.array([0.55, 0.52, 0.5], dtype=np.float32), eyes)
    for blob in _iris(eyes, unit):
        albedo = _mix(albedo, np.array([0.06, 0.04, 0.03], dtype=np.float32), blob)

    alpha = RoughnessByRegion()
    roughness = np.full(size, alpha.skin, dtype=np.float32)
    for name, mask in (("lips", lips), ("eyebrows", brows), ("eyes", eyes)):
        roughness += mask * (getattr(alpha, name) - alpha.skin)
    specular = np.clip(0.9 + 0.15 * noise(50), 0.3, 1.5)
    bump = 0.25 * unit * noise(1.2) + 0.4 * unit * noise(3.0)
    gy, gx = np.gradient(bump)
    perturbation = 0.15 * np.stack([-gx, gy, np.zeros_like(gx)], axis=2) * (1 - eyes[..., None])
    return Maps(
        np.clip(albedo, 0.005, 0.85).astype(np.float32),
        specular.astype(np.float32),
        roughness,
        perturbation.astype(np.float32),
    )


def _mix(below: np.ndarray, above: np.ndarray, share: np.ndarray) -> np.ndarray:
    return below + (above - below) * share[..., None]


def _iris(eyes: np.ndarray, unit: float) -> list[np.ndarray]:
    """A soft disc in the middle of each visible eye, within the eye."""
    found: Any = ndimage.label(eyes > 0.5)
    labels, count = found
    discs = []
    ys, xs = np.mgrid[0 : eyes.shape[0], 0 : eyes.shape[1]]
    for k in range(1, count + 1):
        inside = labels == k
        if inside.sum() < 60 * unit**2:
            continue
        cy, cx = ys[inside].mean(), xs[inside].mean()
        radius = 0.24 * (xs[inside].max() - xs[inside].min())
        distance = np.hypot(xs - cx, ys - cy)
        discs.append(np.clip(radius - distance + 0.5, 0, 1).astype(np.float32) * eyes)
    return discs
