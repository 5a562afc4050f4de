"""The protocol: photograph a known subject, reconstruct it, relight it, compare (paper, Table 2).

Every light is exposed so that the 99th percentile of the subject's brightest channel is at 0.8,
as a photographer would; the photo is rounded to 8 bits like any other. The reconstruction sees
the photo and its focal length, nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import SubjectError
from ..face.reconstruction import Reconstruction
from ..head.model import HeadModel
from ..head.sources.library import head_model, model_key
from ..optimize.run_record import RunRecord
from ..output.images import encoded
from ..photo.photo import Photo
from ..pipeline.chain import fitting, known_mesh, run_chain, steps_of
from ..pipeline.identity import identity_of
from ..progress.callbacks import StageProgress, silent
from ..render.relighter import path_traced
from ..settings.settings import Settings
from ..storage.keys import RENDERING, code, key
from .metrics import angle, best_gain, compare, psnr, surface_distance
from .step_cache import StepCache
from .truth import KnownSubject, visible_surface

_EXPOSURE = 0.8
#: Which face of the photograph.
_FACE = "largest"
#: Points of each surface that take part in the distance of meshes.
_POINTS = 20_000
#: The code that decides the errors of the maps, and the metrics of a picture.
_MAPS = ("evaluate/metrics.py", "evaluate/protocol.py", "evaluate/truth.py", "scene")
_METRICS = ("evaluate/metrics.py", "evaluate/lpips.py")
#: The subject's seed is 2 k, the reconstruction's 2 k + 1: their noise must not agree.
_RELIT = 1

#: Entered with a reconstruction's name, gives what is told of its progress.
ReconstructionWatch = Callable[[str], AbstractContextManager[StageProgress]]


@dataclass(frozen=True)
class NamedLight:
    """A light by name: latitude-longitude map (H, W) or (H, W, 3), in the camera's frame."""

    name: str
    environment: np.ndarray


@dataclass(frozen=True)
class Shot:
    """A subject's photograph under a light of the right strength; linear (H, W, 3)."""

    light: NamedLight
    image: np.ndarray

    @property
    def photo(self) -> np.ndarray:
        """(H, W, 3) uint8 sRGB, as a camera would store it."""
        return encoded(self.image)


@dataclass(frozen=True)
class RelitShot:
    """One cell of Table 2: what was seen, what should have been, and the metrics."""

    light: str
    image: np.ndarray
    truth: np.ndarray
    metrics: dict[str, Any]


@dataclass(frozen=True)
class ShotResult:
    """One input: the photo, its reconstruction, the face under every light, the maps' errors."""

    light: str
    variant: str
    photo: np.ndarray
    face: Reconstruction
    mask: np.ndarray
    relit: tuple[RelitShot, ...]
    maps: dict[str, Any]


def exposure(image: np.ndarray, seen: np.ndarray) -> np.float32:
    """Factor on `image` (H, W, 3), linear, of a subject that covers the pixels `seen` (H, W)."""
    return np.float32(_EXPOSURE / max(float(np.percentile(image[seen].max(axis=-1), 99)), 1e-9))


@dataclass(frozen=True)
class Study:
    """What stays the same over an evaluation.

    content: key of the subject. samples: of the path tracer, per pixel. true_mesh: give the
    reconstruction the subject's own mesh, to tell errors of shape from errors of appearance.
    """

    subject: KnownSubject
    content: str
    lights: tuple[NamedLight, ...]
    settings: Settings
    store: StepCache
    samples: int = 256
    seed: int = 0
    true_mesh: bool = False
    running: ReconstructionWatch = lambda name: nullcontext(silent)

    @cached_property
    def _head(self) -> HeadModel:
        return head_model(self.settings.head_model)

    def shots(self) -> tuple[Shot, ...]:
        """The subject under every light, at the study's resolution."""
        return tuple(self._shot(light) for light in self.lights)

    def _shot(self, light: NamedLight) -> Shot:
        if not self.subject.truth.seen.any():
            raise SubjectError(
                f"{self.subject.name}: the camera sees nothing of it; "
                "check camera_to_world (it looks along its -z) and units"
            )
        image = self.store.picture(
            f"photo-{light.name}",
            key(self.content, light.environment, self.samples, self.seed, code(RENDERING)),
            lambda: self.subject.photograph(light.environment, self.samples, 2 * self.seed),
        )
        gain = exposure(image, self.subject.truth.seen)
        return Shot(NamedLight(light.name, light.environment * gain), image * gain)

    def rows(
        self,
        shots: tuple[Shot, ...],
        inputs: tuple[str, ...] | None = None,
        without: int | None = None,
    ) -> Iterator[ShotResult]:
        """Reconstruct from each shot named in `inputs` (default all), and relight by all.

        without: number of a stage that is switched off (paper, Table 3).
        """
        settings = self.settings
        variant = "full"
        if without is not None:
            stage = f"stage{without}"
            settings = replace(settings, **{stage: replace(getattr(settings, stage), iterations=0)})
            variant = f"without stage {without}"
        for shot in shots:
            if inputs is None or shot.light.name in inputs:
                yield self._row(shot, shots, settings, variant)

    def _row(
        self,
        shot: Shot,
        shots: tuple[Shot, ...],
        settings: Settings,
        variant: str,
    ) -> ShotResult:
        step = self._step(shot, settings, variant)
        face = self.face(shot, settings, variant)
        mask = (face.face.mask > 0.5) & self.subject.truth.seen
        relit = tuple(self._relit(step, face, mask, other) for other in shots)
        maps = self.store.values(
            f"{step[0]}-maps",
            key(step, self.content, mask, code(_MAPS)),
            lambda: map_errors(face, self.subject, mask),
        )
        return ShotResult(shot.light.name, variant, shot.image, face, mask, relit, maps)

    def face(
        self, shot: Shot, settings: Settings | None = None, variant: str = "full"
    ) -> Reconstruction:
        """The reconstruction from one shot, with the study's settings unless others are given."""
        settings = settings or self.settings
        name, content = self._step(shot, settings, variant)
        return self.store.reconstruction(
            name, content, lambda: self._reconstruct(name, shot.photo, settings)
        )

    def _step(self, shot: Shot, settings: Settings, variant: str) -> tuple[str, str]:
        """Name and key of a reconstruction."""
        name = f"{variant.replace(' ', '-')}-from-{shot.light.name}"
        camera = self.subject.camera
        seen = [camera.width, camera.height, camera.focal, camera.cx, camera.cy]
        head = key("mesh", self.content) if self.true_mesh else model_key(self._head)
        name = f"true-mesh-{name}" if self.true_mesh else name
        return name, identity_of(name, key(shot.photo, seen), settings, head, _FACE).key

    def _relit(
        self, step: tuple[str, str], face: Reconstruction, mask: np.ndarray, shot: Shot
    ) -> RelitShot:
        light = shot.light
        picture = key(step, light.environment, self.samples, self.seed, code(RENDERING))
        image = self.store.picture(
            f"{step[0]}-relit-{light.name}",
            picture,
            lambda: path_traced(face.face, light.environment, self.samples, 2 * self.seed + _RELIT),
        )
        metrics = self.store.values(
            f"{step[0]}-metrics-{light.name}",
            key(picture, shot.image, mask, code(_METRICS)),
            lambda: compare(image, shot.image, mask),
        )
        return RelitShot(light.name, image, shot.image, metrics)

    def _reconstruct(self, name: str, photo: np.ndarray, settings: Settings) -> Reconstruction:
        source, camera = Photo.of(photo, name), self.subject.camera
        fit = known_mesh(*self.subject.mesh()) if self.true_mesh else fitting(self._head)
        steps = steps_of(source, fit, _FACE, camera=camera)
        with self.running(name) as progress:
            return run_chain(steps, settings, RunRecord(progress))


def map_errors(face: Reconstruction, subject: KnownSubject, mask: np.ndarray) -> dict[str, Any]:
    """Errors of the maps and the mesh inside `mask`.

    Diffuse albedo: PSNR, sRGB, raw and after one gain. Specular albedo: our median over the true
    one, and the correlation of the two maps. Normals: mean degrees of the specular normals and of
    the plain mesh. Mesh: mm to the true surface after a rigid alignment.
    """
    truth = subject.truth
    gain = best_gain(face.face.maps.diffuse_albedo, truth.diffuse_albedo, mask)
    points, normals = visible_surface(
        face.face.mesh.vertices, face.face.mesh.triangles, face.face.camera
    )
    ours, true = face.face.maps.specular_albedo[mask], truth.specular_albedo[mask]
    constant = min(ours.std(), true.std()) < 1e-6
    step = max(1, mask.sum() // _POINTS)
    distance = surface_distance(
        points[mask][::step], truth.position[truth.seen], truth.normal[truth.seen]
    )
    return {
        "share_of_crop": float(mask.mean()),
        "albedo_gain": gain,
        "albedo_psnr_raw": psnr(face.face.maps.diffuse_albedo, truth.diffuse_albedo, mask),
        "albedo_psnr": psnr(face.face.maps.diffuse_albedo * gain, truth.diffuse_albedo, mask),
        "specular_level": float(np.median(ours) / max(float(np.median(true)), 1e-6)),
        "specular_correlation": None if constant else float(np.corrcoef(ours, true)[0, 1]),
        "normal_degrees": angle(face.face.normals.specular, truth.normal, mask),
        "mesh_normal_degrees": angle(normals, truth.normal, mask),
        "mesh_mm": {name: 10 * value for name, value in distance.items()},
    }
