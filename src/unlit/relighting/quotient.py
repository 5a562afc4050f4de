"""What a new light makes of hair and clothes: new over old shading of a coarse surface.

Nothing is known of their reflectance, but for a matte surface it cancels:

    photo' = photo (E' + f m') / (E + f m)

E: irradiance over pi with the body's own shadows (render/transport.py), m: the light's mean
radiance, f: how much of it arrives everywhere, by way of fibres, folds and the surroundings. Where
the skin begins, whose new colour is known, the quotient is brought to the skin's, and the
difference dies away from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..machine.runtime import mitsuba
from ..render.transport import Quadrature, ShadingPoints, shade, visibility
from ..scene.arrays import device
from ..scene.cells import EnvironmentFlux, even_cells, refine
from ..scene.light import coloured
from ..scene.maps import blur, fill
from ..scene.mesh import Mesh
from .body import Body

mi = mitsuba()

#: f above.
_EVERYWHERE = 0.08
#: cm over which both shadings are blurred: creases of a coarse surface are no creases of hair.
_CREASE = 0.7
#: How far the normals of hair, and of all else that is not the head itself, lean towards the
#: camera: hair has strands that face the viewer at its outline, too.
_LEAN_OF_HAIR, _LEAN = 0.5, 0.1
#: Sharpness of the lobe by which hair's highlights blur the light.
_GLOSS = 6.0
#: Least and greatest quotient: beyond, there is nothing in the photo to multiply.
RANGE = (1 / 64, 12.0)
#: cm: rays start so far off the coarse surface; blur of the skin's quotient.
_OFFSET, _BLUR = 0.2, 0.35
#: cm: how far beyond the skin its difference from the body's quotient reaches, in brightness and in
#: colour: that is the model's error more often than the light's.
_FALLS = (1.2, 0.5)
#: Least and greatest natural logarithm of that difference in brightness, and in colour.
_DIFFERENCE, _COLOUR = (-4.0, 1.0), 0.5
_KNOWN = 10.0  # weight of the skin's quotient against the smoothness of the difference


@dataclass(frozen=True)
class Quotient:
    """By what a photo is multiplied for one frame, (N, N, 3) float32 on the body's canvas.

    value: > 0, also beyond the person. kept: (N, N), the share of the old light's directions that
    the new light has, too, 0 to 1.
    """

    value: np.ndarray
    kept: np.ndarray


class BodyUnderLight:
    """The body under the old light, and under a new one that may turn; traced once.

    old, new: environment maps (H, W[, 3]). azimuths: degrees by which the new light is turned, one
    for each frame.
    """

    def __init__(
        self, body: Body, old: np.ndarray, new: np.ndarray, azimuths: Sequence[float] = (0.0,)
    ) -> None:
        self.body = body
        turns = [float(turn) for turn in np.radians(azimuths)]
        cells = refine(refine(even_cells(), old, limit=1200), new, limit=3600, azimuths=turns)
        flux = EnvironmentFlux(coloured(new))
        before = EnvironmentFlux(coloured(old)).mean(cells)
        self._old = before
        self._new = [flux.mean(cells.rotated(turn)) for turn in turns]
        lit = before.any(axis=1) | np.any([frame.any(axis=1) for frame in self._new], axis=0)
        cells = cells.select(lit)
        self._old, self._new = before[lit], [frame[lit] for frame in self._new]
        self._quadrature = Quadrature(cells)
        mesh = Mesh(body.vertices, body.triangles)
        count = len(body.lattice.rows)
        outwards = mesh.normals.numpy().T[:count]
        position = body.vertices[:count]
        viewer = -position / np.linalg.norm(position, axis=1, keepdims=True)
        lean = (_LEAN + (_LEAN_OF_HAIR - _LEAN) * body.hair) * (1 - body.close)
        leaning = outwards + lean[:, None] * viewer
        leaning /= np.maximum(np.linalg.norm(leaning, axis=1, keepdims=True), 1e-6)
        normal = device(mi.Vector3f, leaning)
        position = device(mi.Point3f, position + _OFFSET * outwards)
        roughness = device(mi.Float, np.full(count, 0.5, np.float32))
        self._points = ShadingPoints(position, normal, normal, normal, roughness)
        self._bits: Any = visibility(
            mesh.scene, self._points, self._quadrature, self._points.horizon
        )

    def _shading(self, radiance: np.ndarray) -> np.ndarray:
        """(P, 3): irradiance over pi, without what is finer than a crease."""
        lattice = self.body.lattice
        found = shade(self._points, self._quadrature, self._bits, radiance)[0].numpy().T
        sigma = _CREASE * self.body.pixels_per_cm
        return blur_on(lattice.image(found), lattice.mask, sigma)[lattice.mask]

    def _mean(self, radiance: np.ndarray) -> np.ndarray:
        """(3,): mean radiance over the sphere."""
        return self._quadrature.flux(radiance).sum(axis=0) / (4 * np.pi)

    def _glossy(self, radiance: np.ndarray) -> np.ndarray:
        """(D,): grey radiance of mean 1, blurred over the sphere."""
        grey = self._quadrature.flux(radiance).mean(axis=1)
        blurred = (self._spread @ grey.astype(np.float32)).astype(np.float64)
        return blurred / max(float(self._mean(blurred[:, None])[0]), 1e-12)

    @cached_property
    def _spread(self) -> np.ndarray:
        """(D, D): from the cells' flux to radiance blurred by a lobe as wide as hair's."""
        towards = self._quadrature.directions.numpy().T
        return np.exp(_GLOSS * (towards @ towards.T - 1))

    @cached_property
    def before(self) -> np.ndarray:
        """(P, 3): the old light's denominator."""
        return self._shading(self._old) + _EVERYWHERE * self._mean(self._old)

    def plain(self, frame: int) -> Quotient:
        """The body's own quotient, whatever the skin's is."""
        new, lattice = self._new[frame], self.body.lattice
        after = self._shading(new) + _EVERYWHERE * self._mean(new)
        value = np.clip(after / np.maximum(self.before, 1e-9), *RANGE)
        # What both lights have in common, at one strength, as what is as glossy as hair sees them.
        old, new = (self._glossy(x) for x in (self._old, new))
        common, every = (
            self._shading(x[:, None].repeat(3, axis=1))[:, 0] for x in (np.minimum(old, new), old)
        )
        kept = np.clip(common / np.maximum(every, 1e-3), 0, 1)
        values = lattice.image(np.concatenate([np.log(value), kept[:, None]], axis=1))
        values = fill(values, lattice.mask)
        return Quotient(np.exp(values[..., :3]), values[..., 3])


class SkinMatch:
    """Brings a body's quotient to the skin's where the skin is.

    weight: (N, N) in [0, 1], how far the canvas's pixels are skin whose relit colour counts.
    photo: (N, N, 3), the photo's mean over that skin times `weight`, without a shadow on it.
    """

    def __init__(self, body: Body, weight: np.ndarray, photo: np.ndarray) -> None:
        self._lattice = body.lattice
        self._sigma = max(_BLUR * body.pixels_per_cm, 0.7)
        self._weight = blur(weight, self._sigma)
        self._photo = blur(photo, self._sigma)
        share = _KNOWN * np.clip(2 * self._weight - 0.5, 0, 1)[body.lattice.mask]
        loose = [1 / (fall * body.pixels_per_cm) ** 2 for fall in _FALLS]
        self._solves = [
            (body.lattice.smoothest(share + low), (share / (share + low))[:, None]) for low in loose
        ]

    def __call__(self, quotient: Quotient, relit: np.ndarray) -> Quotient:
        """relit: (N, N, 3), the relit skin's mean times `weight`."""
        mask = self._lattice.mask
        floor = 1e-4 * np.maximum(self._weight, 1e-3)[..., None]
        skin = (blur(relit, self._sigma) + floor) / (self._photo + floor)
        apart = (np.log(skin) - np.log(quotient.value))[mask]
        bright = apart.mean(axis=1, keepdims=True)
        colour = np.clip(apart - bright, -_COLOUR, _COLOUR)
        parts = (np.clip(bright, *_DIFFERENCE), colour)
        total = sum(
            solve(known * part) for (solve, known), part in zip(self._solves, parts, strict=True)
        )
        total = fill(self._lattice.image(np.asarray(total)), mask)
        return Quotient(np.clip(quotient.value * np.exp(total), *RANGE), quotient.kept)


def blur_on(values: np.ndarray, mask: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian means of (N, N, C) over the pixels of `mask` (N, N) only; 0 beyond."""
    inside = mask.astype(np.float32)
    amount = np.maximum(blur(inside, sigma), 1e-6)
    return blur(values * inside[..., None], sigma) / amount[..., None] * inside[..., None]
