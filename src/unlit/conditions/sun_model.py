"""Skin under one small light beside an even one, lit and shaded, and how well that explains it.

In channel k, plain skin of normal n is taken as

    I_k = s_k V max(n . l, 0) + b_k + c_k . n,        V in {0, 1}:

a light of colour s from direction l, which V lets through or not, and the rest, even (b) or growing
along a direction (c). Albedo is one factor, inside all of them, and what it varies by is noise. For
a given l the terms are fitted by least squares and V is relabelled, in turn; a label that is not
the mesh's own shadow costs something, so that hats and hair may cast shadows, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from scipy import sparse
from scipy.spatial import KDTree

from ..optimize.problem import Problem
from ..settings.sun import SunSearch

#: Cosine to the light from which a pixel is told as lit or shaded.
_FACING = 0.05
#: Keeps terms apart that the skin in view does not tell apart: of s, b and c.
_RIDGE = np.diag([1e-4, 1e-4, 3e-2, 3e-2, 3e-2])
#: Rounds of terms and trust for an even light.
_EVEN_ROUNDS = 15


@dataclass(frozen=True)
class SkinSample:
    """N pixels of plain skin. rows: which of the problem's. image: (N, 3) linear. normal: (N, 3).

    mean: (N, N) sparse, the mean over the nearest. dark: (N,) bool, the darker of two classes.
    """

    rows: np.ndarray
    image: np.ndarray
    normal: np.ndarray
    mean: Any
    dark: np.ndarray
    settings: SunSearch

    @staticmethod
    def of(problem: Problem, normal: np.ndarray, settings: SunSearch) -> SkinSample | None:
        """normal: (P, 3) of the problem's pixels. None where too little plain skin is seen."""
        seen = problem.observation
        image = problem.rows(seen.image)
        regions = problem.rows(seen.regions)
        plain = (regions[:, 0] > 0.7) & (regions[:, 1:].sum(axis=1) < 0.15)
        plain &= problem.rows(seen.fitted)
        plain &= (image.min(axis=1) > settings.darkest) & (image.max(axis=1) < settings.brightest)
        rows = np.flatnonzero(plain)
        if len(rows) < settings.samples / 10:
            return None
        count = min(settings.samples, len(rows))
        rows = rows[np.linspace(0, len(rows) - 1, count).astype(int)]
        place = np.stack(np.divmod(problem.pixel[rows], problem.camera.width), axis=1)
        near = KDTree(place).query(place, min(settings.neighbours, count))[1].reshape(count, -1)
        share = np.full(near.size, 1 / near.shape[1], np.float32)
        first = np.arange(0, near.size + 1, near.shape[1])
        mean = sparse.csr_array((share, near.ravel(), first), (count, count))
        level = mean @ np.log(image[rows]).mean(axis=1)
        grey = (255 * (level - level.min()) / max(np.ptp(level), 1e-6)).astype(np.uint8)
        bright = cv2.threshold(grey, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)[1]
        return SkinSample(rows, image[rows], normal[rows], mean, bright.ravel() == 0, settings)

    def best(
        self, directions: np.ndarray, open_: np.ndarray, rounds: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """The better of two starts for directions (K, 3): cost (K,), terms (K, 5, 3).

        One start is the mesh's own shadow, `open_` (K, N) in [0, 1]; the other also has what is
        dark shaded: from the first alone a brim is never found.
        """
        starts = (open_, open_ * ~self.dark)
        (first, terms), (second, other) = (
            self._fit(directions, open_, start, rounds) for start in starts
        )
        better = second < first
        return np.where(better, second, first), np.where(better[:, None, None], other, terms)

    def _fit(
        self, directions: np.ndarray, open_: np.ndarray, labels: np.ndarray, rounds: int
    ) -> tuple[np.ndarray, np.ndarray]:
        facing = np.maximum(directions @ self.normal.T, 0)
        prior = self.settings.own_shadow
        rest = np.broadcast_to(self._even, (*facing.shape, 4))
        trust = np.ones_like(facing)
        terms, cost = np.zeros((len(facing), 5, 3)), facing
        for _ in range(rounds):
            basis = np.concatenate([(labels * facing)[..., None], rest], axis=2)
            ridge = _RIDGE * len(self.rows)
            terms = _least_squares(basis, self.image, trust * self._weight, ridge)
            lit, shaded = self._costs(facing, terms)
            odds = self._smooth(lit - shaded + prior * (1 - 2 * open_))
            labels = 1 / (1 + np.exp(np.clip(3 * odds, -30, 30)))
            labels = np.where(facing > _FACING, labels, 1).astype(np.float32)
            trust = 1 / np.sqrt(1 + np.where(labels > 0.5, lit, shaded))
            cost = labels * lit + (1 - labels) * shaded + prior * np.abs(labels - open_)
        return cost.mean(axis=1), terms

    def _costs(self, facing: np.ndarray, terms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of being lit and of being shaded, (K, N) each, for facing (K, N), terms (K, 5, 3)."""
        rest = light_of_rest(self._even, terms[:, 1:])
        sun = facing[..., None] * np.maximum(terms[:, :1], 0)
        return self._cost(sun + rest), self._cost(rest)

    def _cost(self, model: np.ndarray) -> np.ndarray:
        return huber(np.log(model / self.image).mean(axis=-1) / self.settings.error)

    def _smooth(self, values: np.ndarray) -> np.ndarray:
        """Mean over the neighbours, of (N,) or (K, N)."""
        return (self.mean @ values.T).T

    @cached_property
    def _even(self) -> np.ndarray:
        return first_order(self.normal)

    @cached_property
    def _weight(self) -> np.ndarray:
        # Relative errors would give the shade all the weight.
        level = self.image.mean(axis=1)
        return 1 / (level + np.percentile(level, 75))

    def cost_with_sun(self, direction: np.ndarray, open_: np.ndarray, terms: np.ndarray) -> float:
        """Mean cost with `terms` (5, 3) and their best labels, outliers included."""
        facing = np.maximum(self.normal @ direction, 0)[None]
        lit, shaded = (self._smooth(x[0]) for x in self._costs(facing, terms[None]))
        prior = self.settings.own_shadow
        cost = np.minimum(lit + prior * (1 - open_), shaded + prior * open_)
        return float(np.minimum(cost, self.settings.outlier).mean())

    def cost_without_sun(self) -> float:
        """That of an even light with terms of second order, the better of two starts."""
        x, y, z = self.normal.T
        second = np.stack([x * y, x * z, y * z, x * x - y * y, 3 * z * z - 1], axis=1)
        basis = np.hstack([self._even, second])
        ridge = 1e-3 * (self._weight**2).sum() * np.eye(basis.shape[1])
        most = self.settings.outlier
        found = []
        for trust in (np.ones(len(basis)), np.where(self.dark, 0.02, 1.0)):
            cost = np.zeros(len(basis))
            for _ in range(_EVEN_ROUNDS):
                weight = trust * self._weight
                terms = _least_squares(basis[None], self.image, weight[None], ridge)[0]
                model = np.maximum(basis @ terms, 0.02 * self.image.mean())
                cost = self._smooth(self._cost(model))
                trust = np.where(cost < most, 1 / np.sqrt(1 + cost), 0.05)
            found.append(float(np.minimum(cost, most).mean()))
        return min(found)


def first_order(normal: np.ndarray) -> np.ndarray:
    """What b and c are multiplied with, (P, 4), at normals (P, 3)."""
    return np.hstack([np.ones((len(normal), 1), normal.dtype), normal])


def light_of_rest(basis: np.ndarray, even: np.ndarray) -> np.ndarray:
    """Light of the rest (..., P, 3) for its terms (..., 4, 3), never below a little of b."""
    return np.maximum(basis @ even, 0.05 * np.abs(even[..., :1, :]) + 1e-5)


def huber(values: np.ndarray) -> np.ndarray:
    """Half the square up to 1.5, straight beyond."""
    size = np.abs(values)
    return np.where(size < 1.5, 0.5 * size**2, 1.5 * size - 1.125).astype(np.float32)


def _least_squares(
    basis: np.ndarray, image: np.ndarray, weight: np.ndarray, ridge: np.ndarray
) -> np.ndarray:
    """Terms (K, T, 3) of bases (K, N, T) that give image (N, 3), weights (K, N) on its errors."""
    weighted = (basis * weight[..., None]).astype(np.float32)
    turned = weighted.transpose(0, 2, 1)
    right = turned @ (image * weight[..., None]).astype(np.float32)
    return np.linalg.solve((turned @ weighted).astype(np.float64) + ridge, right.astype(np.float64))
