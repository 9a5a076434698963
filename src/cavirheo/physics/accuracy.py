"""Accuracy of a simulation, those that are in use (what each is worth: docs/validation.md), and its shells.

The finite-volume grid on y = r/R in [0, 1] is clustered at the wall, where the thermal and vapour layers are thin.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import expect_whole, require
from cavirheo.parameters import check, domain


@dataclass(frozen=True)
class Accuracy:
    """Of the radius in space and in time.

    Attributes:
        cells: shells across the bubble, a whole number from 8 up.
        relative_error: of a step, between 1e-12 and 0.1; of kinetic contents a tenth of it counts, and of a gas with
            an exponent, which has no shells, at most 1e-7.

    Raises:
        InputError: cells or relative_error are not so.
    """

    cells: int = 152
    relative_error: float = field(default=1e-4, metadata=domain("between 1e-12 and 0.1", lambda x: 1e-12 < x < 0.1))

    def __post_init__(self) -> None:
        expect_whole(self.cells, "cells", 8, "physics.cells")
        check(self)


DEFAULT = Accuracy()  # 1e-4 of R_max in the median, up to 2e-3 in the most violent collapses
PRECISE = Accuracy(384, 1e-5)  # ten times as accurate as the default, and five times as long
ROUGH = Accuracy(64, 3e-4)  # inside a search: 2 ms, good to 1 % of R_max, most to 0.04 %
BRISK = Accuracy(64, 1e-3)  # for draws, with what it misses of the default's: that hardly changes
COARSE = Accuracy(24, 3e-3)  # for starts: 1 ms


class Grid(NamedTuple):
    """Spherical shells (cells) 0..M-1 from centre to wall; face i lies between cell i and cell i+1."""

    inverse_volume: Floats  # (M,) 3/(y_out^3 - y_in^3)
    centre: Floats  # (M,) centroid of each shell
    face: Floats  # (M-1,) y of the interior faces
    area: Floats  # (M-1,) y^2
    inverse_distance: Floats  # (M-1,) between the two centroids
    left: Floats  # (M-1,) weight of the inner cell in the value on the face
    right: Floats  # (M-1,) and of the outer one
    wall: Floats  # (3,) d/dy at y = 1 from the values at the wall, in cell M-1 and in cell M-2


NO_SHELLS = Grid(*(np.zeros(0) for _ in Grid._fields))  # for contents without fields


@lru_cache(maxsize=16)
def wall_clustered(shells: int, first: float = 1e-4) -> Grid:
    """`shells` shells, tanh-spaced so that the one at the wall is `first` thick."""
    why = f"a clustered grid needs at least 8 cells and a wall cell thinner than 1/cells, got {shells} and {first}"
    require(shells >= 8 and 0 < first < 1 / shells, why, "physics.cells")
    s = np.linspace(0.0, 1.0, shells + 1)
    low, high = 1e-3, 18.0
    for _ in range(60):  # bisection: importing a solver takes longer than a simulation
        steepness = (low + high) / 2
        thick = 1 - np.tanh(steepness * s[-2]) / np.tanh(steepness) > first
        low, high = (steepness, high) if thick else (low, steepness)
    y = np.tanh(steepness * s) / np.tanh(steepness)
    volume = np.diff(y**3) / 3
    centre = np.diff(y**4) / 4 / volume
    distance = np.diff(centre)
    right = (y[1:-1] - centre[:-1]) / distance
    h1, h2 = 1 - centre[-1], 1 - centre[-2]
    c1, c2 = -h2 / (h1 * (h2 - h1)), h1 / (h2 * (h2 - h1))
    wall = np.array([-(c1 + c2), c1, c2])
    return Grid(1 / volume, centre, y[1:-1].copy(), y[1:-1] ** 2, 1 / distance, 1 - right, right, wall)
