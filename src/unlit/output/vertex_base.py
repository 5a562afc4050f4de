"""The smooth part of the atlas: what the mesh's vertices know of photo and mirror image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from ..color import luminance
from ..scene.components import components
from .base_tone import BaseTone, Surface, base_tone
from .beard import beard_base
from .evidence import ramp
from .geometry import Welded
from .parts import EYES, INSIDE, SKIN, TEETH, parts_of_corners
from .photo_samples import LOGS, PhotoSamples, Points
from .scalp import Hair
from .texels import Texels

#: Distance in the layout between a vertex and the mirror image of its twin, at most.
_TWIN = 3e-3
#: Difference in log luminance from the skin's typical value, and of a spot from the tone around
#: it, at which skin counts for half as tone, and at which it is no longer mirrored.
_UNLIKE, _SPOT = 0.5, (0.15, 0.4)
#: Difference of the tones of both halves (log, root mean square) at which their lights disagree.
_DISAGREE = (0.1, 0.3)
#: Mirrored details are kept within so many standard deviations of the skin's fine structure, and
#: _MOTTLE (log) in any case: a mole is not to be there twice.
_MOLE, _MOTTLE = 2.0, 0.15
#: Edges over which hair fades into skin, to either side.
_HAIRLINE = 3
_WHOLE = 0.999  # of three corners' mean: all of them
# Where nothing is known of a part: skin mid-grey, eyes the white of an eye, mouth dark red,
# teeth of a usual shade.
# Linear albedo, specular albedo, roughness; ours.
_PLAIN = np.log(
    np.array(
        [
            [0.30, 0.30, 0.30, 0.7, 0.30],
            [0.55, 0.50, 0.47, 0.7, 0.15],
            [0.16, 0.04, 0.035, 0.7, 0.25],
            [0.52, 0.45, 0.36, 0.7, 0.15],
        ],
        dtype=np.float32,
    )
)


@dataclass(frozen=True)
class VertexBase:
    """The smooth part of all channels on the mesh's V vertices.

    vertex: (F, 3) into them. tone: (V, CHANNELS) fields; known: (V,) 1 where they mean anything.
    twins: (V,) in [0, 1], whether a vertex has a mirror image, and like: how far what is there
    has the look of skin. spread: (CHANNELS,) bound on mirrored details.
    """

    vertex: np.ndarray
    tone: BaseTone
    known: np.ndarray
    twins: np.ndarray
    like: np.ndarray
    spread: np.ndarray

    @staticmethod
    def of(
        photo: PhotoSamples,
        mesh: Welded,
        part: np.ndarray,
        axis: float | None,
        hair: Hair | None = None,
    ) -> VertexBase:
        """From the photo; part: of each triangle (F,). axis: the layout's mirror axis, u.

        hair: what has the hair's colour instead of the skin's where it was not measured.
        """
        vertex = mesh.vertex[mesh.triangles]
        count = int(mesh.vertex.max()) + 1
        first = np.unique(mesh.vertex, return_index=True)[1]  # a corner of each vertex
        kind = parts_of_corners(mesh.triangles, part, len(mesh.vertex))
        of_vertex = np.full(count, 255, dtype=np.uint8)
        np.minimum.at(of_vertex, mesh.vertex, kind)
        normal = mesh.normal[first]
        points = Points(mesh.position[first], normal, mesh.tangent[first], of_vertex)
        found = photo.at(points, photo.toned)
        surface = Surface.of(mesh.position[first], vertex[part != INSIDE])

        # Tone is that of skin alone: features, and what is far from typical, do not spread.
        weight = found.weight * np.where(of_vertex == SKIN, 1 - found.feature, 1)
        weight[of_vertex == INSIDE] = 0
        values = found.values.astype(np.float64)
        values[:, LOGS.stop :] = 0
        typical = np.zeros_like(values)
        for one in (SKIN, EYES, TEETH):
            here = of_vertex == one
            good = here & (weight > 0.5)
            typical[here, LOGS] = (
                np.median(values[good, LOGS], axis=0) if good.any() else _PLAIN[one]
            )
        skin = of_vertex == SKIN
        evidence = weight.copy()
        unlike = luminance(values[:, :3] - typical[:, :3])
        weight[skin] /= 1 + (unlike[skin] / _UNLIKE) ** 2

        twin, has = _twins(mesh, first, skin, axis)
        change = np.where(has, evidence[twin], 0) * (1 - evidence)
        both = has & (weight > 0.5) & (weight[twin] > 0.5)
        if both.any():
            difference = (values - values[twin])[both, :3]
            rms = np.sqrt((difference**2).mean())
            change *= 1 - ramp(rms, *_DISAGREE)
        tone = base_tone(surface, values, weight, typical, twin, change)
        field, mirrored = tone.field, tone.mirrored
        if hair is not None:
            covered = hair.cover & skin & (evidence < 0.5)
            share = surface.spread(covered * 1.0, _HAIRLINE)[:, None]
            field = field.copy()
            field[:, :3] += share * (np.log(hair.albedo) - field[:, :3])
            has &= ~covered
        worn = photo.bearded
        if worn is not None:
            there = photo.at(points, worn)
            weighed = there.weight * skin
            beard = beard_base(surface, there.values[:, LOGS], there.beard, weighed, twin)
            if beard is not None:
                field, mirrored = beard.over(field), beard.over(tone.field)[twin]
        spot = np.abs(luminance(values[:, :3] - tone.field[:, :3]))
        like = np.where(found.weight > 0, 1 - ramp(spot, *_SPOT), 0)
        known = _known(vertex[part != INSIDE], weight > 0, of_vertex, count)
        return VertexBase(
            vertex,
            BaseTone(field, mirrored),
            known.astype(np.float32),
            has.astype(np.float32),
            like[twin].astype(np.float32),
            np.maximum(photo.spread() * _MOLE, _MOTTLE),
        )

    def at(self, texels: Texels, part: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The base (K, CHANNELS) of texels, and whether it is known (K,); part: theirs."""
        field = texels.at(self.tone.field, self.vertex)
        known = (texels.at(self.known[:, None], self.vertex)[:, 0] > _WHOLE) & (part != INSIDE)
        field[~known, LOGS], field[~known, LOGS.stop :] = _PLAIN[part[~known]], 0
        return field, known

    def mirrored_at(self, texels: Texels) -> np.ndarray:
        """The base (K, CHANNELS) of the texels' mirror images."""
        return texels.at(self.tone.mirrored, self.vertex)

    def mirrors(self, texels: Texels, feature: np.ndarray) -> np.ndarray:
        """(K,) in [0, 1]: how far the detail of the mirror image may be taken over.

        feature: (K,) of the mirror image. Spots that are no features are not: hair, a scar, a
        shadow.
        """
        both = texels.at(np.stack([self.twins, self.like], axis=1), self.vertex)
        return np.maximum(both[:, 1], feature) * (both[:, 0] > _WHOLE)


def _twins(
    mesh: Welded, first: np.ndarray, skin: np.ndarray, axis: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Number (V,) of each vertex's mirror image about u = axis, and whether it has one (V,).

    first: (V,) a corner of each vertex. skin: (V,) bool; others have none.
    """
    own = np.arange(len(first))
    if axis is None:
        return own, np.zeros(len(first), bool)
    distance, near = KDTree(mesh.uv).query(mesh.uv[first] * (-1, 1) + (2 * axis, 0))
    twin = mesh.vertex[near]
    has = (distance < _TWIN) & skin & skin[twin]
    return np.where(has, twin, own), has


def _known(triangles: np.ndarray, seen: np.ndarray, kind: np.ndarray, count: int) -> np.ndarray:
    """(V,) bool: skin, and teeth, if any of them were seen; eyeballs each by itself."""
    piece = components(triangles, count)
    reached = np.isin(piece, piece[seen])
    known = reached & (kind == EYES)
    for whole in (SKIN, TEETH):
        known |= (kind == whole) & (seen & (kind == whole)).any()
    return known
