"""The main job from end to end: photo, perception, head model, the five stages, result."""

from __future__ import annotations

import contextlib
import copy
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from threadpoolctl import threadpool_limits

from ..color import is_white, luminance
from ..conditions import illuminant
from ..conditions.cast_shadow import attenuation, cast_shadow
from ..conditions.illuminant import WHITE
from ..conditions.light_color import estimated_color
from ..errors import FaceError
from ..face import gain as exposure
from ..face.reconstruction import Fit, Reconstruction
from ..face.warnings import findings
from ..fit.landmarks import HeadFit, LandmarkProblem
from ..fit.shading import photometric_fit
from ..head.model import LANDMARKS, HeadModel
from ..head.sources.library import head_model, model_key
from ..machine.runtime import mitsuba
from ..optimize.checkpoint import Checkpoint
from ..optimize.problem import Estimate, Evidence, Problem, Progress, Shading
from ..optimize.stages import Begin, run_stages, start
from ..perception.landmarks import Face, find_faces
from ..perception.mask import painted, read_mask
from ..perception.measures import upwards
from ..perception.regions import Regions, segment
from ..perception.topology import NOSE_BASE
from ..photo.crop import Crop, face_crop
from ..photo.photo import Photo, read_photo
from ..scene.arrays import device
from ..scene.camera import Camera
from ..scene.lobes import CellRadiance
from ..settings.fit import LandmarkFit, ShadingFit
from ..settings.settings import PRESETS, Settings, as_dict
from ..storage.keys import key

resource: Any = None
with contextlib.suppress(ImportError):  # Unix only
    import resource

mi = mitsuba()

#: Distance of a face from the camera, cm, where the photo does not tell its focal length, and
#: the width of the crop there, cm: a portrait taken from a metre away.
PORTRAIT_DISTANCE = 100.0
CROP_WIDTH = 26.5

Preview = Callable[[str, Reconstruction], None]


def _silent(stage: str, iteration: int, iterations: int, loss: float) -> None:
    pass


@dataclass(frozen=True)
class Capture:
    """A photo's face crop and what perception says of it, at the crop's size S x S.

    image: (S, S, 3) linear sRGB. landmarks: (478, 3) crop pixels. Together with `camera`, all
    that the later steps see of the photo. light_color: (3,) linear sRGB (`illuminant.fitting`).
    light_found: what an estimate of it says of itself, for metrics.json. unit: as in Photo. lit:
    (S, S) in [0, 1], 0 in the shadow of something else (optimize/cast_shadow.py); None without one.
    """

    photo_name: str
    image: np.ndarray
    camera: Camera
    crop: Crop
    regions: Regions
    landmarks: np.ndarray
    light_color: np.ndarray = field(default_factory=WHITE.copy)
    light_found: dict[str, float] | None = None
    unit: float | None = None
    lit: np.ndarray | None = None

    @property
    def balanced(self) -> np.ndarray:
        """The image as it would be under white light."""
        return self.image if is_white(self.light_color) else self.image / self.light_color


@dataclass(frozen=True)
class Head:
    """The mesh the stages start from, in the world frame, cm, with its layout and landmarks.

    Arrays as in HeadModel and HeadFit. landmarks and landmark_residual are None for a mesh that
    was not fitted: stage 3 then takes the capture's landmarks as they are. model: name and licence
    of the head model.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    triangle_uv: np.ndarray
    landmark_triangle: np.ndarray
    landmark_barycentric: np.ndarray
    landmarks: np.ndarray | None = None
    landmark_residual: float | None = None
    model: str | None = None

    @staticmethod
    def of_mesh(vertices: np.ndarray, triangles: np.ndarray) -> Head:
        """A bare mesh (V, 3), (F, 3), as where the true one is known: no layout, no landmarks."""
        return Head(
            vertices.astype(np.float32),
            triangles.astype(np.int32),
            np.zeros((1, 2), dtype=np.float32),
            np.zeros((len(triangles), 3), dtype=np.int32),
            np.full(LANDMARKS, -1, dtype=np.int32),
            np.zeros((LANDMARKS, 3), dtype=np.float32),
        )

    @staticmethod
    def of_fit(model: HeadModel, fit: HeadFit) -> Head:
        """`model` as it was fitted."""
        return Head(
            fit.vertices,
            model.triangles,
            model.uv,
            model.triangle_uv,
            model.landmark_points.triangle,
            model.landmark_points.barycentric,
            fit.landmarks,
            fit.landmark_residual,
            f"{model.name}, {model.licence}",
        )


def reconstruct(
    photo: str | Path | Photo | np.ndarray,
    *,
    settings: Settings = PRESETS["paper"],
    face: str | int = "only",
    model: HeadModel | None = None,
    mask: str | Path | np.ndarray | None = None,
    progress: Progress = _silent,
    preview: Preview | None = None,
    checkpoint: Checkpoint | None = None,
) -> Reconstruction:
    """Reconstruct the face in `photo` (paper, sections 2 and 3).

    photo: a file, a Photo, or an array (H, W, 3): uint8 sRGB-encoded or float linear sRGB.
    face: "only" (several faces are an error), "largest", "left" or "right" (the leftmost or
        rightmost in the picture), or a number counted from the largest, 0.
    model: the head model to fit; the default is the one that the settings name.
    mask: a picture file or an array (H, W) of the photo's size, uint8 to 255 or others in [0, 1]; 0
        leaves skin out.
    progress: called with (stage, iteration, iterations, loss). preview: called with the result so
    far after the fit and after every stage. checkpoint: where the state is kept after every stage,
    and from where it is resumed; `save` removes it from the result's folder.

    Raises PhotoError, FaceError, ModelError, SettingsError, OutputError or MachineError.
    """
    clock = _Clock()
    progress("photo", 0, 1, 0.0)
    loaded = _as_photo(photo)
    kept = None if mask is None else read_mask(mask, loaded)
    model = model or head_model(settings.head_model)
    if checkpoint is not None:
        pixels = key(loaded.pixels, loaded.focal)
        own = model_key(model)
        choices = {"face": face, "mask": None if kept is None else key(kept), "model": own}
        checkpoint.belongs_to((Path(loaded.source).name, pixels), settings, choices)
    clock.lap("photo")
    progress("perception", 0, 1, 0.0)
    capture = observe(loaded, settings.resolution, face, mask=kept)
    _check_known(capture, loaded, settings)
    clock.lap("perception")
    progress("fit", 0, 1, 0.0)
    head = fitted_head(capture, model)
    clock.lap("fit")
    capture = with_light_color(capture, head, loaded, settings)
    if capture.light_found is not None:
        clock.lap("light color")
    capture = without_cast_shadow(capture, head, settings)
    clock.lap("cast shadow")
    if checkpoint is None:
        return solve(capture, head, settings, progress, preview, clock)
    return solve(
        capture, head, settings, progress, preview, clock, checkpoint.begin, checkpoint.keep
    )


def observe(
    photo: Photo,
    resolution: int,
    face: str | int = "only",
    camera: Camera | None = None,
    mask: np.ndarray | None = None,
) -> Capture:
    """Find the face, cut it out, and segment it.

    With `camera` the photo is taken as the crop itself, as seen by that camera. mask: (H, W) of
    the photo's size, which the face's region is multiplied with. Raises FaceError.
    """
    found = choose(find_faces(photo.encoded8()), face, photo.source)
    height, width = photo.pixels.shape[:2]
    if camera is None:
        crop = face_crop(found.landmarks, resolution, (width, height))
        camera = crop_camera(photo, crop)
    else:
        crop = Crop(np.eye(2, 3), camera.width)
    image = np.maximum(crop.image(photo.pixels), 0).astype(np.float32)
    xy = crop.points(found.landmarks[:, :2])
    landmarks = np.column_stack([xy, found.landmarks[:, 2] * crop.scale])
    regions = segment(image, landmarks, found.blendshapes)
    if mask is not None:
        regions = painted(regions, regions.face * crop.image(mask))
    name = Path(photo.source).name
    return Capture(name, image, camera, crop, regions, landmarks, unit=photo.unit)


def _check_known(capture: Capture, photo: Photo, settings: Settings) -> None:
    """Raise SettingsError, before the long work, for what the photo cannot tell as it was told."""
    card = illuminant.parse(settings.light_color).card
    if card is not None:
        illuminant.of_card(photo, card)
    known = exposure.parse(settings.exposure)
    exposure.check_unit(known, photo.unit)
    exposure.patch(known, capture.crop, capture.regions.face > 0.5, capture.regions.skin)


def fitted_head(capture: Capture, model: HeadModel) -> Head:
    """`model` fitted to the capture's landmarks, then to its shading. Raises FaceError."""
    closed = bool(capture.regions.mouth.max() < 0.5)
    problem = LandmarkProblem(
        model, capture.landmarks, capture.camera, LandmarkFit(), image=capture.image
    )
    with threadpool_limits(1, user_api="blas"):
        fit = photometric_fit(
            problem, problem.solve(closed), capture.image, capture.regions, ShadingFit(), closed
        )
    return Head.of_fit(model, fit)


def with_light_color(capture: Capture, head: Head, photo: Photo, settings: Settings) -> Capture:
    """`capture`, of `photo`, with the light's colour that the settings ask for.

    Raises SettingsError where a grey card cannot be read.
    """
    asked = illuminant.parse(settings.light_color)
    if asked.card is not None:
        color, found = illuminant.of_card(photo, asked.card), None
    elif asked.color is not None:
        color, found = asked.color, None
    else:
        color, found = estimated_color(evidence(capture, head), settings)
    face = capture.image[capture.regions.face > 0.5]
    return replace(capture, light_color=illuminant.fitting(color, face), light_found=found)


def without_cast_shadow(capture: Capture, head: Head, settings: Settings) -> Capture:
    """`capture` with what lies in the shadow of something else marked, if the settings ask."""
    if settings.cast_shadows == "keep":
        return capture
    landmarks = capture.landmarks[:, :2]
    up = upwards(landmarks)
    pixels = np.indices(capture.image.shape[:2])[::-1] + 0.5
    above = np.tensordot(up, pixels, axes=1) > up @ landmarks[NOSE_BASE]
    return replace(capture, lit=cast_shadow(evidence(capture, head), above, settings))


def solve(
    capture: Capture,
    head: Head,
    settings: Settings,
    progress: Progress = _silent,
    preview: Preview | None = None,
    clock: _Clock | None = None,
    begin: Callable[[Problem, dict[str, float]], Begin | None] | None = None,
    keep: Callable[[str, Problem, Estimate, Shading, dict[str, float]], None] | None = None,
) -> Reconstruction:
    """The five stages on one capture, starting from the mesh `head`.

    begin: given the problem and the seconds so far, what the stages go on from. keep: called at
    the end of each stage. Raises FaceError, and SettingsError where the patch of a known albedo is
    not on the face.
    """
    lap = clock or _Clock()
    try:
        problem = Problem(evidence(capture, head), settings, progress)
    except ValueError as error:
        raise FaceError(f"{capture.photo_name}: {error}; use a photo with a clearer view") from None
    pin = _pin(capture, problem)

    def result(estimate: Estimate, shading: Shading | None) -> Reconstruction:
        metrics = {
            "landmark_residual": head.landmark_residual,
            "head_model": head.model,
            "losses": problem.history,
            "seconds": dict(lap.laps),
            "peak_memory_mb": _peak_memory(),
        }
        if capture.unit is not None:
            metrics["unit_cd_m2"] = capture.unit
        if capture.light_found is not None:
            metrics["light_color"] = capture.light_found
        return _result(capture, head, problem, estimate, shading, pin, metrics)

    def after(stage: str, estimate: Estimate, shading: Shading) -> None:
        lap.lap(stage)
        if keep is not None:
            keep(stage, problem, estimate, shading, lap.laps)
        if preview is not None:
            preview(stage, result(estimate, shading))
            lap.lap("preview")

    first = None if begin is None else begin(problem, lap.laps)
    if preview is not None:
        preview("fit", result(first.estimate if first else start(problem), None))
        lap.lap("preview")
    # Two pools of threads that both spin while waiting cost 2 to 7 times the time: the cores
    # belong to Dr.Jit.
    with threadpool_limits(1, user_api="blas"):
        estimate, shading = run_stages(problem, after, first)
    progress("finish", 0, 1, 0.0)
    whole = result(estimate, shading)
    return replace(whole, metrics=whole.metrics | {"warnings": findings(whole)})


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
                f"{source}: {len(faces)} faces found; choose one with --face largest, left, right "
                f"or N (0 to {len(faces) - 1}, from large to small), or crop the photo"
            )
        return faces[0]
    if which == "largest":
        return faces[0]
    if which in ("left", "right"):
        return (min if which == "left" else max)(faces, key=lambda face: face.box[0] + face.box[2])
    if isinstance(which, int) and 0 <= which < len(faces):
        return faces[which]
    if len(faces) == 1:
        raise FaceError(f"{source}: no face {which!r}; only one found: leave --face out")
    raise FaceError(
        f"{source}: no face {which!r}; {len(faces)} found: use largest, left, right or 0 to "
        f"{len(faces) - 1}"
    )


def crop_camera(photo: Photo, crop: Crop) -> Camera:
    """The photo's pinhole camera restricted to the crop; a portrait's where EXIF says nothing."""
    size = crop.resolution
    if photo.focal is None:
        return Camera(size, size, size * PORTRAIT_DISTANCE / CROP_WIDTH, size / 2, size / 2)
    height, width = photo.pixels.shape[:2]
    cx, cy = np.asarray(crop.points(np.array([[width / 2, height / 2]])))[0]
    return Camera(size, size, photo.focal * crop.scale, float(cx), float(cy))


def evidence(capture: Capture, head: Head) -> Evidence:
    """What the optimisation may use of the photo: soft masks, trust per pixel, the mesh."""
    face = capture.regions.face
    weight = face if capture.lit is None else face * capture.lit
    return Evidence(
        image=capture.balanced,
        regions=capture.regions.weights[..., :4],
        mask=face > 0.5,
        weight=weight,
        camera=capture.camera,
        vertices=head.vertices,
        triangles=head.triangles,
        landmarks=capture.landmarks[:, :2] if head.landmarks is None else head.landmarks,
        landmark_triangle=head.landmark_triangle,
        landmark_barycentric=head.landmark_barycentric,
        landmark_weight=(head.landmark_triangle >= 0).astype(np.float32),
    )


def _result(
    capture: Capture,
    head: Head,
    problem: Problem,
    estimate: Estimate,
    shading: Shading | None,
    pin: Callable[[np.ndarray, np.ndarray], float],
    metrics: dict[str, Any],
) -> Reconstruction:
    """Exact shading of `estimate` and everything else as NumPy arrays."""
    maps = problem.maps(estimate)
    shape = maps.specular_albedo.shape
    points = problem.points()
    mesh_normal = points.specular_normal
    bent = {
        "specular": device(mi.Vector3f, _rows(problem, maps.perturbation)),
        "diffuse": device(mi.Vector3f, _rows(problem, maps.diffuse_perturbation())),
    }
    normals = {name: dr.normalize(mesh_normal + e) for name, e in bent.items()}
    zero = np.zeros((*shape, 3), dtype=np.float32)
    e_image, s_image, render = zero, zero, zero
    gain = 1.0
    if shading is not None:
        shading = copy.copy(shading)  # what the stages go on with is left as it is
        shading.points = problem.points(normals["diffuse"], normals["specular"])
        e_image, s_image = _shade(problem, shading, estimate)
        gain = pin(maps.diffuse_albedo, e_image)
        if gain == problem.skin_gain(maps.diffuse_albedo):  # inter-reflection has it already
            estimate = estimate.brightened(gain)
            e_image, s_image = e_image / gain, s_image / gain
        else:
            estimate = _pinned(problem, shading, estimate, gain, e_image)
            e_image, s_image = _shade(problem, shading, estimate, gain=1.0)
        maps = problem.maps(estimate)
        e_image, s_image = e_image * capture.light_color, s_image * capture.light_color
        render = maps.diffuse_albedo * e_image + maps.specular_albedo[..., None] * s_image
        if capture.lit is not None:
            left = attenuation(capture.image, render, capture.lit)
            e_image, s_image, render = e_image * left, s_image * left, render * left
    mask = np.zeros(shape, dtype=np.float32)
    mask.ravel()[problem.pixel] = capture.regions.face.ravel()[problem.pixel]
    return Reconstruction(
        photo_name=capture.photo_name,
        image=capture.image,
        camera=capture.camera,
        crop=capture.crop,
        vertices=np.ascontiguousarray(estimate.vertices.numpy().T),
        triangles=head.triangles,
        uv=head.uv,
        triangle_uv=head.triangle_uv,
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
        regions=capture.regions.weights,
        light=replace(estimate.light(), color=capture.light_color),
        settings=as_dict(problem.settings),
        metrics=metrics,
        gain=gain,
        lit=capture.lit,
        fit=Fit(
            np.asarray(head.vertices, np.float32),
            np.asarray(problem.evidence.landmarks, np.float32),
            np.asarray(head.landmark_triangle, np.int32),
            np.asarray(head.landmark_barycentric, np.float32),
        ),
    )


def _shade(
    problem: Problem, shading: Shading, estimate: Estimate, gain: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Exact E and S of `estimate` under its white light, (S, S, 3); 0 where nothing is seen.

    gain: as for `Shading.update`.
    """
    radiance = CellRadiance(shading.cells).of(estimate.light())
    shading.update(radiance, problem.maps(estimate), gain)
    e, s = shading.shade(radiance)
    return problem.image(e, "zero"), problem.image(s, "zero")


def _pin(capture: Capture, problem: Problem) -> Callable[[np.ndarray, np.ndarray], float]:
    """What finds the gain that the settings ask for, from diffuse albedo and E (S, S, 3).

    What is known is told to the problem, too, for inter-reflection.
    """
    known = exposure.parse(problem.settings.exposure)
    if known == exposure.Known():
        return lambda albedo, _: problem.skin_gain(albedo)
    inside = np.zeros(capture.image.shape[:2], dtype=bool)
    inside.ravel()[problem.pixel] = True
    measured = inside if capture.lit is None else inside & (capture.lit > 0.5)
    where = exposure.patch(known, capture.crop, measured, capture.regions.skin)
    exposure.check_unit(known, capture.unit)
    # In the stages the best-lit skin has E = 1 before the light's colour.
    full_in_stages = float(luminance(capture.light_color))

    def pin(albedo: np.ndarray, e: np.ndarray) -> float:
        full = exposure.full_light(e[inside] * capture.light_color)
        return exposure.gain(known, albedo[where], full, capture.unit)

    def in_stages(albedo: np.ndarray) -> float:
        gain = exposure.gain(known, albedo[where], full_in_stages, capture.unit)
        # A measured illuminance may be wrong by any factor.
        return gain if known.lux is None else min(gain, exposure.within_one(albedo[inside]))

    problem.skin_gain = in_stages
    return pin


def _pinned(
    problem: Problem, shading: Shading, estimate: Estimate, gain: float, e: np.ndarray
) -> Estimate:
    """`estimate` with albedo times `gain` and a light under which it is as bright as before.

    The light is not divided by `gain` alone: the stages had another, and light from skin to skin
    changes with it.
    """
    changed = estimate.brightened(gain)
    full = [
        exposure.full_light(_rows(problem, image))
        for image in (e, _shade(problem, shading, changed, gain=1.0)[0])
    ]
    rest = float(np.log(full[0] / (gain * full[1])))
    return replace(changed, log_amplitude=changed.log_amplitude + rest)


def _rows(problem: Problem, image: np.ndarray) -> np.ndarray:
    return image.reshape(-1, 3)[problem.pixel]


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
    """Peak resident memory of this process, megabytes (10^6); 0 where the system does not tell."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss if resource else 0
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6
