"""What decides the fit of the head model. Distances are pixels of a 512 x 512 crop."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LandmarkFit:
    """Of the fit to landmarks: how far they are trusted (fit/landmarks.py).

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
    """

    contour_weight: float = 1.0
    oval_weight: float = 0.5
    oval_tangential: float = 0.05
    other_weight: float = 0.1
    deviation: float = 15.0
    huber: float = 4.0
    gap_deviation: float = 3.0
    expression_deviation: float = 0.3
    last_deviation: float = 12.0
    iterations: int = 8
    closed: float = 0.04
    dark_weight: float = 0.03
    dim: tuple[float, float] = (0.1, 0.4)
    light_blur: float = 6.0


@dataclass(frozen=True)
class ShadingFit:
    """Of the fit to shading: how far it is trusted (fit/shading.py).

    samples: pixels used. independent: measurements that they are worth together.
    deviation: standard deviation of an encoded value (gamma 2.2); huber: residuals beyond this
        count linearly.
    blur: standard deviation of the Gaussian that the photo is blurred with.
    margin: distance kept from brows, eyes, mouth and the mask's edge.
    facing: least cosine between normal and viewer.
    spacing: of the albedo grid; albedo_deviation: of the log albedo at each of its points.
    colour_deviation: of log albedo's slope over log chromaticity.
    cells: rows of the light's starting grid, with twice as many columns; a cell is cut in four
        while it holds more than split of the flux and is higher than finest degrees.
    evenness: weight of the pull towards an even light.
    identity_weight: factor on the identity's prior precision.
    turns: shares of the landmarks' yaw to start from, too, where less than `least_lit` of the
        landmarks' weight is in the light: with half of the face in shadow the landmarker sees too
        much yaw.
    light_steps: with the mesh of a start; joint_steps: of everything.
    damping: Levenberg's, relative to the diagonal.
    directed: so large has to be the mean direction of the light (0: even, 1: one lamp), or the
        landmarks' mesh is kept: under even light nearly all shading is the albedo's.
    """

    samples: int = 800
    independent: float = 150.0
    deviation: float = 0.03
    huber: float = 0.06
    blur: float = 1.5
    margin: float = 6.0
    facing: float = 0.25
    spacing: float = 64.0
    albedo_deviation: float = 0.1
    colour_deviation: float = 0.1
    cells: int = 12
    split: float = 0.02
    finest: float = 4.0
    evenness: float = 0.002
    identity_weight: float = 6.0
    turns: tuple[float, ...] = (0.6, 0.3)
    least_lit: float = 0.8
    light_steps: int = 6
    joint_steps: int = 4
    damping: float = 0.05
    directed: float = 0.2
