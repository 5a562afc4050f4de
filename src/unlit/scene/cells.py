"""Quadrature of the sphere of light directions: latitude-longitude cells.

The transport renderer sees the light as one mean radiance per cell. Point-sampling a small light
at the cells' centres can miss it altogether; averaging over the cell cannot. Where a light is
small or steep, `refine` splits its cells, so that hard shadows come out at the right place.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .light import latlong_solid_angles


@dataclass(frozen=True)
class SphereCells:
    """D cells given by their edges: theta (D, 2) and phi (D, 2), radians, low then high."""

    theta: np.ndarray
    phi: np.ndarray

    def __len__(self) -> int:
        return len(self.theta)

    @cached_property
    def solid_angle(self) -> np.ndarray:
        """Exact solid angles (D,), steradian; they sum to 4 pi."""
        return (np.cos(self.theta[:, 0]) - np.cos(self.theta[:, 1])) * np.diff(self.phi, axis=1)[
            :, 0
        ]

    @cached_property
    def moment(self) -> np.ndarray:
        """Exact first moments (D, 3): the integral of the direction over each cell.

        n . moment is the exact cosine integral of an unoccluded cell above the horizon, a little
        less than the solid angle times the cosine at the centre.
        """
        t0, t1 = self.theta.T
        p0, p1 = self.phi.T
        sin2 = 0.5 * ((t1 - t0) - 0.5 * (np.sin(2 * t1) - np.sin(2 * t0)))
        return np.stack(
            [
                sin2 * (np.cos(p0) - np.cos(p1)),
                0.5 * (np.sin(t1) ** 2 - np.sin(t0) ** 2) * (p1 - p0),
                -sin2 * (np.sin(p1) - np.sin(p0)),
            ],
            axis=1,
        )

    @cached_property
    def direction(self) -> np.ndarray:
        """Unit mean direction (D, 3) of each cell: where visibility and the lobe are sampled."""
        return self.moment / np.linalg.norm(self.moment, axis=1, keepdims=True)

    def average(self, environment: np.ndarray) -> np.ndarray:
        """Mean radiance (D, ...) over each cell of a latitude-longitude map (H, W, ...)."""
        return EnvironmentFlux(environment).mean(self)

    def rotated(self, azimuth: float) -> SphereCells:
        """The cells moved by `azimuth`, radians, towards larger phi; edges may pass 2 pi."""
        return SphereCells(self.theta, self.phi + azimuth)

    def select(self, which: np.ndarray) -> SphereCells:
        """The cells at `which`, indices or (D,) bool."""
        return SphereCells(self.theta[which], self.phi[which])

    def split(self, which: np.ndarray) -> SphereCells:
        """Cells with those marked in `which` (D,) bool cut in four, appended at the end."""
        middle_t = self.theta[which].mean(axis=1)
        middle_p = self.phi[which].mean(axis=1)
        theta, phi = [self.theta[~which]], [self.phi[~which]]
        for t in ((self.theta[which, 0], middle_t), (middle_t, self.theta[which, 1])):
            for p in ((self.phi[which, 0], middle_p), (middle_p, self.phi[which, 1])):
                theta.append(np.stack(t, axis=1))
                phi.append(np.stack(p, axis=1))
        return SphereCells(np.concatenate(theta), np.concatenate(phi))


class EnvironmentFlux:
    """Integrals of a latitude-longitude map (H, W, ...) over cells, however they are turned.

    The map is taken as constant per pixel; cell edges may fall inside pixels.
    """

    def __init__(self, environment: np.ndarray) -> None:
        height, width = environment.shape[:2]
        omega = latlong_solid_angles(height, width)
        flux = environment * omega.reshape(height, width, *([1] * (environment.ndim - 2)))
        # Summed-area table over (cos theta, phi), linear inside a pixel, hence exact.
        self._table = np.zeros((height + 1, width + 1, *environment.shape[2:]))
        self._table[1:, 1:] = flux.cumsum(axis=0, dtype=np.float64).cumsum(axis=1)
        self._heights = np.cos(np.arange(height + 1) * (np.pi / height))

    @property
    def total(self) -> np.ndarray:
        """Integral over the sphere (...)."""
        return self._table[-1, -1]

    def mean(self, cells: SphereCells) -> np.ndarray:
        """Mean radiance (D, ...) over each of `cells`, float32."""
        (t0, t1), (p0, p1) = cells.theta.T, cells.phi.T
        total = self._at(t1, p1) - self._at(t0, p1) - self._at(t1, p0) + self._at(t0, p0)
        shape = (-1, *([1] * (total.ndim - 1)))
        # Differences of sums: rounding may leave less than nothing where there is no light.
        return np.maximum(total / cells.solid_angle.reshape(shape), 0).astype(np.float32)

    def _at(self, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        """Integral (D, ...) over [0, theta] x [0, phi]; phi beyond 2 pi counts whole turns."""
        table = self._table
        height, width = table.shape[0] - 1, table.shape[1] - 1
        row = np.clip((theta * (height / np.pi)).astype(int), 0, height - 1)
        place = phi * (width / (2 * np.pi))
        column = np.floor(place).astype(int)
        turns, inside = np.divmod(column, width)
        shape = (-1, *([1] * (table.ndim - 2)))
        fr = (self._heights[row] - np.cos(theta)) / (self._heights[row] - self._heights[row + 1])
        fr, fc, whole = (x.reshape(shape) for x in (fr, place - column, turns))

        def along(row: np.ndarray) -> np.ndarray:
            part = table[row, inside] * (1 - fc) + table[row, inside + 1] * fc
            return part + whole * table[row, width]

        return along(row) * (1 - fr) + along(row + 1) * fr


def grid_cells(rows: int = 18, columns: int = 36) -> SphereCells:
    """Regular latitude-longitude cells, row by row from the pole +y; 648 by default."""
    theta = np.linspace(0, np.pi, rows + 1)
    phi = np.linspace(0, 2 * np.pi, columns + 1)
    i, j = (x.ravel() for x in np.mgrid[0:rows, 0:columns])
    return SphereCells(
        np.stack([theta[i], theta[i + 1]], axis=1), np.stack([phi[j], phi[j + 1]], axis=1)
    )


def even_cells(rows: int = 18) -> SphereCells:
    """Cells as wide as high: rows get shorter towards the poles; 414 by default.

    They serve as well as the regular ones, which crowd at the poles, with a third fewer rays.
    """
    edges = np.linspace(0, np.pi, rows + 1)
    theta, phi = [], []
    for t0, t1 in itertools.pairwise(edges):
        columns = max(round(2 * rows * np.sin(0.5 * (t0 + t1))), 4)
        steps = np.linspace(0, 2 * np.pi, columns + 1)
        theta += [(t0, t1)] * columns
        phi += itertools.pairwise(steps)
    return SphereCells(np.array(theta), np.array(phi))


def refine(
    cells: SphereCells,
    environment: np.ndarray,
    share: float = 0.001,
    limit: int = 2500,
    azimuths: Sequence[float] = (0.0,),
) -> SphereCells:
    """Split the cells across which the light varies most, for the light `environment` (H, W[, 3]).

    A cell is split while the flux of its quarters differs by over `share` of the light's whole
    flux, or it holds over 10 `share` by itself; no finer than the map's pixels, and not beyond
    `limit` cells (the most uneven go first). azimuths: radians; cells that serve the light seen
    through the cells turned by any of them.
    """
    if environment.ndim == 3:
        environment = environment.mean(axis=2)
    light = EnvironmentFlux(environment)
    pixel = np.pi / environment.shape[0]
    while True:
        quarters = cells.split(np.ones(len(cells), dtype=bool))
        score = np.zeros(len(cells))
        for azimuth in azimuths:
            flux = light.mean(quarters.rotated(azimuth)) * quarters.solid_angle
            flux = flux.reshape(4, -1)
            uneven = np.abs(flux - flux.mean(axis=0)).sum(axis=0)
            score = np.maximum(score, np.maximum(uneven, 0.1 * flux.sum(axis=0)))
        score[np.diff(cells.theta, axis=1)[:, 0] < 0.75 * pixel] = 0
        room = (limit - len(cells)) // 3
        which = np.zeros(len(cells), dtype=bool)
        which[np.argsort(-score, kind="stable")[: max(room, 0)]] = True
        which &= score > share * float(light.total)
        if not which.any():
            return cells
        cells = cells.split(which)
