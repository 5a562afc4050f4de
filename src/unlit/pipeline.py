"""The main job from end to end: photo, perception, head model, the five stages, result."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np

from ._runtime import mitsuba
from .color import encode_srgb
from .errors import FaceError
from .head.fit import HeadFit, fit_head
from .head.model import HeadModel, default_model
from .optimize.problem import Estimate, Evidence, Problem, Progress, Shading
from .optimize.schedule import PRESETS, Settings, as_dict
from .optimize.stages import run_stages, start
from .perception.landmarks import Face, find_faces
from .perception.regions import Regions, segment
from .photo import Crop, Photo, face_crop, read_photo
from .reconstruction import Reconstruction
from .scene.camera import Camera
from .scene.cells import grid_cells
from .scene.lobes import CellRadiance

mi = mitsuba()

#: Distance of a face from the camera, cm, where the photo does not tell its focal length, and
#: the width of the crop there, cm: a portrait taken from a metre away.
PORTRAIT_DISTANCE = 100.0
CROP_WIDTH = 26.5

#: sRGB-encoded values from which a channel counts as saturated, and below which as crushed.
SATURATED = 0.996
CRUSHED = 0.004

Preview = Callable[[str, Reconstruction], None]


def _silent(stage: str, iteration: int, iterations: int, loss: float) -> None:
    pass


def reconstruct(
    photo: str | Path | Photo | np.ndarray,
    *,
    settings: Settings = PRESETS["paper"],
    face: str | int = "only",
    model: HeadModel | None = None,
    progress: Progress = _silent,
    preview: Preview | None = None,
) -> Reconstruction:
    """Reconstruct the face in `photo` (paper, sections 2 and 3).

    photo: a file, a Photo, or an array (H, W, 3): uint8 sRGB-encoded or float linear sRGB.
    face: "only" (several faces are an error), "largest", or a number counted from the largest, 0.
    model: the head model to fit; the default is MakeHuman's head.
    progress: called with (stage, iteration, iterations, loss). preview: called with the result so
    far after the fit and after every stage.

    Raises PhotoError, FaceError, ModelError or MachineError.
    """
    clock = _Clock()
    progress("photo", 0, 1, 0.0)
    photo = _as_photo(photo)
    clock.lap("photo")
    progress("perception", 0, 1, 0.0)
    found = choose(find_faces(photo.encoded8()), face, photo.source)
    height, width = photo.pixels.shape[:2]
    crop = face_crop(found.landmarks, settings.resolution, (width, height))
    image = np.maximum(crop.image(photo.pixels), 0).astype(np.float32)
    landmarks = in_crop(found, crop)
    regions = segment(image, landmarks, found.blendshapes)
    clock.lap("perception")
    progress("fit", 0, 1, 0.0)
    camera = crop_camera(photo, crop)
    model = model or default_model()
    fit = fit_head(model, landmarks, camera)
    clock.lap("fit")
    problem = Problem(
        evidence(image, regions, camera, landmarks, model, fit), settings, progress
    )
    history: dict[str, Any] = {"landmark_residual": fit.landmark_residual}

    def result(stage: str, estimate: Estimate, shading: Shading | None) -> Reconstruction:
        metrics = {
            **history,
            "losses": problem.history,
            "seconds": dict(clock.laps),
            "peak_memory_mb": _peak_memory(),
        }
        return _result(
            problem, estimate, shading, image, regions, crop, photo, model, settings, metrics
        )

    def after(stage: str, estimate: Estimate, shading: Shading) -> None:
        clock.lap(stage)
        if preview is not None:
            preview(stage, result(stage, estimate, shading))
            clock.lap("preview")

    if preview is not None:
        preview("fit", result("fit", start(problem), None))
        clock.lap("preview")
    estimate, shading = run_stages(problem, after)
    progress("finish", 0, 1, 0.0)
    return result("finish", estimate, shading)


def _as_photo(photo: str | Path | Photo | np.ndarray) -> Photo:
    if isinstance(photo, Photo):
        return photo
    if isinstance(photo, np.ndarray):
        return Photo.of(photo)
    return read_photo(photo)


def choose(faces: list[Face], which: str | int, source: str) -> Face:
    """The face that was asked for. Raises FaceError naming the photo and the remedy."""
    if not faces:
        raise FaceError(
            f"{source}: no face found; use a photo in which the face is upright, in focus and at "
            "least 80 pixels wide"
        )
    if which == "only":
        if len(faces) > 1:
            raise FaceError(
                f"{source}: {len(faces)} faces found; choose one with --face largest or --face N "
                f"(0 to {len(faces) - 1}, from large to small), or crop the photo"
            )
        return faces[0]
    if which == "largest":
        return faces[0]
    if isinstance(which, int) and 0 <= which < len(faces):
        return faces[which]
    raise FaceError(f"{source}: no face {which!r}; {len(faces)} found: use largest or 0 to "
                    f"{len(faces) - 1}")


def in_crop(face: Face, crop: Crop) -> np.ndarray:
    """The face's landmarks (478, 3) in crop pixels, z scaled alike."""
    xy = crop.points(face.landmarks[:, :2])
    return np.column_stack([xy, face.landmarks[:, 2] * crop.scale])


def crop_camera(photo: Photo, crop: Crop) -> Camera:
    """The photo's pinhole camera restricted to the crop; a portrait's where EXIF says nothing."""
    size = crop.resolution
    if photo.focal is None:
        return Camera(size, size, size * PORTRAIT_DISTANCE / CROP_WIDTH, size / 2, size / 2)
    height, width = photo.pixels.shape[:2]
    cx, cy = np.asarray(crop.points(np.array([[width / 2, height / 2]])))[0]
    return Camera(size, size, photo.focal * crop.scale, float(cx), float(cy))


def evidence(
    image: np.ndarray,
    regions: Regions,
    camera: Camera,
    landmarks: np.ndarray,
    model: HeadModel,
    fit: HeadFit,
) -> Evidence:
    """What the optimisation may use of the photo: soft masks, trust per pixel, fitted mesh."""
    encoded = encode_srgb(image)
    exposed = (encoded.max(axis=2) < SATURATED) & (encoded.max(axis=2) > CRUSHED)
    mask = regions.face > 0.5
    return Evidence(
        image=image,
        regions=regions.weights[..., :4],
        mask=mask,
        weight=(regions.face * exposed).astype(np.float32),
        camera=camera,
        vertices=fit.vertices,
        triangles=model.triangles,
        landmarks=landmarks[:, :2],
        landmark_triangle=model.landmark_triangle,
        landmark_barycentric=model.landmark_barycentric,
        landmark_weight=(model.landmark_triangle >= 0).astype(np.float32),
    )


def _result(
    problem: Problem,
    estimate: Estimate,
    shading: Shading | None,
    image: np.ndarray,
    regions: Regions,
    crop: Crop,
    photo: Photo,
    model: HeadModel,
    settings: Settings,
    metrics: dict[str, Any],
) -> Reconstruction:
    """Exact shading of `estimate` and everything else as NumPy arrays."""
    maps = problem.maps(estimate)
    shape = maps.specular_albedo.shape
    points = problem.points()
    mesh_normal = points.specular_normal
    bent = {
        "specular": mi.Vector3f(_rows(problem, maps.perturbation)),
        "diffuse": mi.Vector3f(_rows(problem, maps.diffuse_perturbation())),
    }
    normals = {name: dr.normalize(mesh_normal + e) for name, e in bent.items()}
    light = estimate.light()
    zero = np.zeros((*shape, 3), dtype=np.float32)
    e_image, s_image, render = zero, zero, zero
    if shading is not None:
        shading.points = problem.points(normals["diffuse"], normals["specular"])
        radiance = CellRadiance(shading.cells).of(light)
        shading.update(radiance, maps)
        e, s = shading.shade(radiance)
        e_image, s_image = problem.image(e, "zero"), problem.image(s, "zero")
        render = maps.diffuse_albedo * e_image + maps.specular_albedo[..., None] * s_image
    mask = np.zeros(shape, dtype=np.float32)
    mask.ravel()[problem.pixel] = regions.face.ravel()[problem.pixel]
    return Reconstruction(
        photo_name=Path(photo.source).name,
        image=image,
        camera=problem.camera,
        crop=crop,
        vertices=np.ascontiguousarray(estimate.vertices.numpy().T),
        triangles=model.triangles,
        uv=model.uv,
        triangle_uv=model.triangle_uv,
        diffuse_albedo=maps.diffuse_albedo,
        specular_albedo=maps.specular_albedo,
        roughness=maps.roughness,
        perturbation=maps.perturbation,
        specular_normal=problem.image(normals["specular"], "zero"),
        diffuse_normal=problem.image(normals["diffuse"], "zero"),
        diffuse_shading=e_image,
        specular_shading=s_image,
        render=render,
        mask=mask,
        regions=regions.weights,
        light=light,
        settings=as_dict(settings),
        metrics=metrics,
    )


def _rows(problem: Problem, image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(image.reshape(-1, 3)[problem.pixel].T)


class _Clock:
    """Wall-clock seconds by name."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = self.laps.get(name, 0.0) + now - self._last
        self._last = now


def _peak_memory() -> float:
    """Peak resident memory of this process, megabytes (10^6)."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6
