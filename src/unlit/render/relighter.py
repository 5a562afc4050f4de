"""A finished face under another light: with the transport renderer, or path-traced.

The transport renderer traces which cells of the light every point sees, once for all lights it is
prepared for (`Relighter.under`): a light that turns about the vertical axis costs one sum a frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ..face.face import Face
from ..machine.runtime import mitsuba
from ..progress.callbacks import PassProgress, silent
from ..scene.arrays import device
from ..scene.cells import EnvironmentFlux, SphereCells, even_cells, refine
from ..scene.light import SphericalGaussians
from ..scene.maps import Maps
from ..scene.mesh import CameraHits, Mesh, surface
from .interreflection import IndirectLight, Interreflection
from .reference import path_trace
from .transport import Quadrature, ShadingPoints, shade, visibility
from .visibility import words as words_of

mi = mitsuba()

#: Inter-reflections between parts of the face.
BOUNCES = 3
#: Cells at most for a light that turns: the sum over them is to take about a second at 512 pixels.
_TURNING_LIMIT = 6000
#: And no more than so many bits of visibility: 512 MB.
_BITS = 1 << 32


def path_traced(
    face: Face,
    environment: np.ndarray,
    samples: int,
    seed: int = 0,
    progress: PassProgress = silent,
) -> np.ndarray:
    """Path-traced (S, S, 3) linear sRGB under `environment` (H, W[, 3]), beyond the mask, too."""
    mesh = Mesh(face.mesh.vertices, face.mesh.triangles)
    return path_trace(
        mesh, face.camera, face.maps, environment, samples, BOUNCES, seed, progress=progress
    )


class Relighter:
    """What stays when only the light changes: geometry, shading points, form factors."""

    def __init__(self, face: Face, bounces: int = BOUNCES) -> None:
        self.maps = face.maps
        self.mesh = Mesh(face.mesh.vertices, face.mesh.triangles)
        hits = self.mesh.camera_hits(face.camera)
        inside = np.flatnonzero(face.mask.ravel()[hits.pixel.numpy()] > 0).astype(np.uint32)
        chosen = device(mi.UInt32, inside)
        hits = CameraHits(
            dr.gather(mi.UInt32, hits.pixel, chosen), dr.gather(mi.UInt32, hits.triangle, chosen)
        )
        self.pixel = hits.pixel.numpy().astype(np.int64)
        mesh = self.mesh
        position, _, geometric = surface(
            face.camera, hits, mesh.vertices, mesh.normals, mesh.triangles
        )
        self.points = ShadingPoints(
            position,
            device(mi.Vector3f, face.normals.diffuse.reshape(-1, 3)[self.pixel]),
            device(mi.Vector3f, face.normals.specular.reshape(-1, 3)[self.pixel]),
            geometric,
            device(mi.Float, face.maps.roughness.ravel()[self.pixel]),
        )
        self.interreflection = Interreflection(
            mesh, face.camera, hits, face.maps.roughness, bounces
        )

    def __call__(self, light: np.ndarray | SphericalGaussians) -> np.ndarray:
        """(S, S, 3) linear sRGB under `light`; 0 outside the mask.

        light: radiance as a latitude-longitude map (H, W) or (H, W, 3) in the world frame of
        scene/camera.py, or spherical Gaussians. Deterministic, with self-shadowing and
        inter-reflection.
        """
        lobes = isinstance(light, SphericalGaussians)
        return self.under(light.environment if lobes else np.asarray(light)).image(0)

    def under(self, environment: np.ndarray, azimuths: Sequence[float] = (0.0,)) -> FaceUnderLight:
        """Trace what the face sees of `environment` (H, W[, 3]), turned by each of `azimuths`.

        azimuths: degrees about the vertical axis; a light in front moves to the picture's right.
        The quadrature is refined where the light is small or steep, so shadows of small lights
        are sharp; cells without light are left out.
        """
        turns = [float(turn) for turn in np.radians(azimuths)]
        limit = 2500
        if len(turns) > 1:
            limit = int(np.clip(_BITS // len(self.pixel), limit, _TURNING_LIMIT))
        cells = refine(even_cells(), environment, limit=limit, azimuths=turns)
        flux = EnvironmentFlux(environment)
        radiance = np.stack([flux.mean(cells.rotated(turn)) for turn in turns])
        lit = np.flatnonzero(radiance.any(axis=(0, *range(2, radiance.ndim))))
        # Cells that one frame needs lie next to each other.
        lit = lit[np.argsort(cells.phi[lit].mean(axis=1), kind="stable")]
        return FaceUnderLight(self, cells.select(lit), radiance[:, lit])


class FaceUnderLight:
    """A face in a light that may turn: visibility of all its cells, traced once.

    cells: D of them. radiance: (F, D) or (F, D, 3), of each of F frames.
    """

    def __init__(self, face: Relighter, cells: SphereCells, radiance: np.ndarray) -> None:
        self.face, self.cells, self.radiance = face, cells, radiance
        if not len(cells):
            return
        quadrature = Quadrature(cells)
        self._direct = visibility(face.mesh.scene, face.points, quadrature, face.points.horizon)
        self._indirect = face.interreflection.under(quadrature).bits

    def image(self, frame: int) -> np.ndarray:
        """(S, S, 3) linear sRGB; 0 outside the mask."""
        shading = self.shading(frame)
        e, s = (sum(parts) for parts in (shading.diffuse, shading.specular))
        return image_from_shading(self.face.maps, self.face.pixel, np.asarray(e), np.asarray(s))

    def shading(self, frame: int) -> FaceShading:
        """What the image is made of, of the P pixels of the mask."""
        face, radiance = self.face, self.radiance[frame]
        count = len(face.pixel)
        # Words of 32 visibility bits in which this frame has light.
        lit = radiance.any(axis=tuple(range(1, radiance.ndim)))
        words = np.unique(np.flatnonzero(lit) >> 5)
        if not words.size:
            nothing = np.zeros((count, 1), dtype=np.float32)
            return FaceShading((nothing, nothing), (nothing, nothing))
        index = (words[:, None] * 32 + np.arange(32)).ravel()
        index = index[index < len(radiance)]
        quadrature, radiance = Quadrature(self.cells.select(index)), radiance[index]
        e, s = shade(face.points, quadrature, _words(self._direct, words, count), radiance)
        bits = self._indirect
        if bits is not None:
            bits = _words(bits, words, len(face.interreflection.emitting))
        under = IndirectLight(face.interreflection, quadrature, bits)
        indirect_e, indirect_s = under.shade(radiance, face.maps)
        e, s = (x.numpy().T.reshape(count, -1) for x in (e, s))
        return FaceShading((e, indirect_e), (s, indirect_s))

    def unshadowed(self, frame: int) -> np.ndarray:
        """(P, 1) or (P, 3): direct diffuse shading if nothing were in the light's way."""
        points, cells = self.face.points, self.cells
        if not len(cells):
            return np.zeros((len(points), 1), dtype=np.float32)
        every = dr.full(mi.UInt32, 0xFFFFFFFF, len(points) * words_of(len(cells)))
        e, _ = shade(points, Quadrature(cells), every, self.radiance[frame])
        return e.numpy().T.reshape(len(points), -1)


@dataclass(frozen=True)
class FaceShading:
    """Shading of P pixels, (P, 1) or (P, 3) each: E and S (render/transport.py).

    diffuse, specular: the direct part, and what arrives by way of the face itself.
    """

    diffuse: tuple[np.ndarray, np.ndarray]
    specular: tuple[np.ndarray, np.ndarray]


def _words(bits: Any, words: np.ndarray, points: int) -> Any:
    """The visibility bits (visibility.trace) of the cells in `words` only."""
    if len(words) * points == dr.width(bits):
        return bits
    width = dr.opaque(mi.UInt32, points)
    index = dr.arange(mi.UInt32, len(words) * points)
    word = dr.gather(mi.UInt32, device(mi.UInt32, words), index // width)
    return dr.gather(mi.UInt32, bits, word * width + index % width)


def image_from_shading(maps: Maps, pixel: np.ndarray, e: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Image (H, W, 3) of I = rho_d E + rho_s S at the row-major `pixel` (P,), 0 elsewhere.

    e, s: (P, 1) or (P, 3) total shading.
    """
    shape = maps.diffuse_albedo.shape
    image = np.zeros((shape[0] * shape[1], 3), dtype=np.float32)
    image[pixel] = maps.diffuse_albedo.reshape(-1, 3)[pixel] * e
    image[pixel] += maps.specular_albedo.reshape(-1, 1)[pixel] * s
    return image.reshape(shape)
