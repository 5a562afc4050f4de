"""Quadrature of the sphere of light directions: latitude-longitude cells.

The transport renderer sees the light as one mean radiance per cell. Point-sampling a small light
at the cells' centres can miss it altogether; averaging over the cell cannot. Where a light is
small or steep, `refine` splits its cells, so that hard shadows come out at the right place.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .light import latlong_solid_angles


@dataclass(frozen=True)
class Cells:
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
        """Mean radiance (D, ...) over each cell of a latitude-longitude map (H, W, ...).

        The map is taken as constant per pixel; cell edges may fall inside pixels.
        """
        height, width = environment.shape[:2]
        omega = latlong_solid_angles(height, width)
        flux = environment * omega.reshape(height, width, *([1] * (environment.ndim - 2)))
        # Summed-area table over (cos theta, phi), linear inside a pixel, hence exact.
        table = np.zeros((height + 1, width + 1, *environment.shape[2:]))
        table[1:, 1:] = flux.cumsum(axis=0, dtype=np.float64).cumsum(axis=1)
        heights = np.cos(np.arange(height + 1) * (np.pi / height))

        def at(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
            row = np.clip((theta * (height / np.pi)).astype(int), 0, height - 1)
            fr = (heights[row] - np.cos(theta)) / (heights[row] - heights[row + 1])
            column = np.clip((phi * (width / (2 * np.pi))).astype(int), 0, width - 1)
            fc = phi * (width / (2 * np.pi)) - column
            shape = (-1, *([1] * (environment.ndim - 2)))
            fr, fc = fr.reshape(shape), fc.reshape(shape)
            top = table[row, column] * (1 - fc) + table[row, column + 1] * fc
            bottom = table[row + 1, column] * (1 - fc) + table[row + 1, column + 1] * fc
            return top * (1 - fr) + bottom * fr

        (t0, t1), (p0, p1) = self.theta.T, self.phi.T
        total = at(t1, p1) - at(t0, p1) - at(t1, p0) + at(t0, p0)
        shape = (-1, *([1] * (environment.ndim - 2)))
        # Differences of sums: rounding may leave less than nothing where there is no light.
        return np.maximum(total / self.solid_angle.reshape(shape), 0).astype(np.float32)

    def split(self, which: np.ndarray) -> Cells:
        """Cells with those marked in `which` (D,) bool cut in four, appended at the end."""
        middle_t = self.theta[which].mean(axis=1)
        middle_p = self.phi[which].mean(axis=1)
        theta, phi = [self.theta[~which]], [self.phi[~which]]
        for t in ((self.theta[which, 0], middle_t), (middle_t, self.theta[which, 1])):
            for p in ((self.phi[which, 0], middle_p), (middle_p, self.phi[which, 1])):
                theta.append(np.stack(t, axis=1))
                phi.append(np.stack(p, axis=1))
        return Cells(np.concatenate(theta), np.concatenate(phi))


def grid_cells(rows: int = 18, columns: int = 36) -> Cells:
    """Regular latitude-longitude cells, row by row from the pole +y; 648 by default."""
    theta = np.linspace(0, np.pi, rows + 1)
    phi = np.linspace(0, 2 * np.pi, columns + 1)
    i, j = (x.ravel() for x in np.mgrid[0:rows, 0:columns])
    return Cells(np.stack([theta[i], theta[i + 1]], axis=1), np.stack([phi[j], phi[j + 1]], axis=1))


def refine(cells: Cells, environment: np.ndarray, share: float = 0.001, limit: int = 2500) -> Cells:
    """Split the cells across which the light varies most, for the light `environment` (H, W[, 3]).

    A cell is split while the flux of its quarters differs by over `share` of the light's whole
    flux, or it holds over 10 `share` by itself; no finer than the map's pixels, and not beyond
    `limit` cells (the most uneven go first).
    """
    if environment.ndim == 3:
        environment = environment.mean(axis=2)
    total = float((environment * latlong_solid_angles(*environment.shape)).sum())
    pixel = np.pi / environment.shape[0]
    while True:
        quarters = cells.split(np.ones(len(cells), dtype=bool))
        flux = (quarters.average(environment) * quarters.solid_angle).reshape(4, -1)
        uneven = np.abs(flux - flux.mean(axis=0)).sum(axis=0)
        score = np.maximum(uneven, 0.1 * flux.sum(axis=0))
        score[np.diff(cells.theta, axis=1)[:, 0] < 0.75 * pixel] = 0
        room = (limit - len(cells)) // 3
        which = np.zeros(len(cells), dtype=bool)
        which[np.argsort(-score, kind="stable")[: max(room, 0)]] = True
        which &= score > share * total
        if not which.any():
            return cells
        cells = cells.split(which)
