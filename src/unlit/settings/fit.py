"""How the head model is fitted: to landmarks, then to the photo's shading."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from msgspec import Meta

from ..errors import SettingsError
from .ranges import Count, Positive, Share, Weight


@dataclass(frozen=True)
class Registration:
    """How lips and lids are drawn to their landmarks after the fit (fit/registration.py).

    deviation: standard deviation of the field that moves the surface, cm; 0: lips and lids stay.
    length: distance along the surface over which it hardly correlates any more, cm.
    across, along: standard deviation of a landmark across and along its contour, pixels at 512;
    shared: how many neighbours err together.
    """

    deviation: Weight = 0.3
    length: Positive = 2.0
    across: Positive = 2.5
    along: Positive = 6.0
    shared: Positive = 4.0


@dataclass(frozen=True)
class LandmarkFit:
    """How far the landmarks are trusted. Distances are pixels of a 512 x 512 crop.

    contour_weight: weight of lips, eyelids, nose and midline points.
    oval_weight: weight of the face oval across itself; oval_tangential: factor on the residual
        along it, since the outline slides over the head as it turns.
    other_weight: weight of all other points.
    deviation: standard deviation of one landmark coordinate of weight 1.
    huber: residuals beyond this count linearly.
    gap_deviation: standard deviation of the distance across the lips and across the eyelids,
        for each of several pairs of points: what two close points share of their error cancels
        in it, so that it says how far mouth and eyes are open better than the points do.
    expression_deviation: scale of the prior that pulls the expression's units to 0.
    last_deviation: as deviation, for the expression alone, once pose and identity are found: a
        smile moves the lips by far more than the landmarks are wrong.
    iterations: of Gauss-Newton, after the pose alone has settled.
    closed: the mouth counts as closed, and is closed, below this opening in mouth widths.
    dark_weight: factor on the weight of a landmark in the dark, where the landmarker guesses.
    dim: light on a landmark, as a share of that on the face's lit part, below which it counts as
        dark, and above which it has its full weight.
    light_blur: standard deviation of the Gaussian that the light is averaged with.
    registration: of lips and lids, after the fit.
    """

    contour_weight: Weight = 1.0
    oval_weight: Weight = 0.5
    oval_tangential: Share = 0.05
    other_weight: Weight = 0.1
    deviation: Positive = 15.0
    huber: Positive = 4.0
    gap_deviation: Positive = 3.0
    expression_deviation: Positive = 0.3
    last_deviation: Positive = 12.0
    iterations: Count = 8
    closed: Share = 0.04
    dark_weight: Share = 0.03
    dim: tuple[Positive, Positive] = (0.1, 0.4)
    light_blur: Annotated[float, Meta(ge=0, le=512)] = 6.0
    registration: Registration = field(default_factory=Registration)

    def __post_init__(self) -> None:
        if not self.dim[0] < self.dim[1]:
            raise SettingsError(
                "landmark_fit.dim: the second must be larger than the first", "landmark_fit.dim"
            )


@dataclass(frozen=True)
class ShadingFit:
    """How far shading is trusted. Distances are pixels of a 512 x 512 crop.

    samples: pixels used. independent: measurements that they are worth together.
    deviation: standard deviation of an encoded value (gamma 2.2); huber: residuals beyond this
        count linearly.
    blur: standard deviation of the Gaussian that the photo is blurred with.
    margin: distance kept from brows, eyes, mouth and the mask's edge.
    facing: least cosine between normal and viewer.
    spacing: of the albedo grid; albedo_deviation: of the log albedo at each of its points.
    colour_deviation: of log albedo's slope over log chromaticity.
    cells: rows of the light's starting grid, with twice as many columns. split: share of the flux
        above which a cell is cut in four; finest: while it is higher than this, degrees.
    evenness: weight of the pull towards an even light.
    identity_weight: factor on the identity's prior precision.
    turns: shares of the landmarks' yaw to start from, too, where half of the face is in shadow and
        the landmarker sees too much yaw. least_lit: share of the landmarks' weight in the light,
        below which that is so.
    light_steps: with the mesh of a start; joint_steps: of everything.
    damping: Levenberg's, relative to the diagonal.
    directed: so large has to be the mean direction of the light (0: even, 1: one lamp), or the
        landmarks' mesh is kept: under even light nearly all shading is the albedo's.
    """

    samples: Count = 800
    independent: Positive = 150.0
    deviation: Positive = 0.03
    huber: Positive = 0.06
    blur: Annotated[float, Meta(ge=0, le=512)] = 1.5
    margin: Annotated[float, Meta(ge=0, le=512)] = 6.0
    facing: Share = 0.25
    spacing: Annotated[float, Meta(ge=8, le=256)] = 64.0
    albedo_deviation: Positive = 0.1
    colour_deviation: Positive = 0.1
    cells: Annotated[int, Meta(ge=2, le=100)] = 12
    split: Annotated[float, Meta(gt=0, le=1)] = 0.02
    finest: Annotated[float, Meta(gt=0, le=180)] = 4.0
    evenness: Weight = 0.002
    identity_weight: Positive = 6.0
    turns: tuple[Share, ...] = (0.6, 0.3)
    least_lit: Share = 0.8
    light_steps: Annotated[int, Meta(ge=1, le=1000)] = 6
    joint_steps: Annotated[int, Meta(ge=0, le=1000)] = 4
    damping: Weight = 0.05
    directed: Share = 0.2


@dataclass(frozen=True)
class OutlineFit:
    """How far the head's outline in the photo is trusted. Distances are pixels of a 512 x 512 crop.

    reach: how far from the mesh's outline the photo's is looked for.
    deviation: standard deviation of its place; huber: residuals beyond this count linearly.
    independent: length along it that is worth one independent measurement.
    """

    reach: Annotated[float, Meta(gt=0, le=256)] = 40.0
    deviation: Positive = 4.0
    huber: Positive = 8.0
    independent: Positive = 32.0
