"""Accuracy of a simulation: the settings in use (docs/validation.md), the shells in space, the steps in time.

The finite-volume grid on y = r/R in [0, 1] is clustered at the wall, where the thermal and vapour layers are thin.
Steps are those of Rodas5P, a stiffly accurate, L-stable Rosenbrock method of order 5 with an embedded 4th-order
solution (G. Steinebach, BIT Numer. Math. 63, 27 (2023), doi:10.1007/s10543-023-00967-x). Its order is not
reduced for parabolic problems with time-dependent boundary values, as for the vapour at the wall. In transformed form

    (1/(h gamma) - J) u_i = f(y + sum_j A_ij u_j) + sum_j (C_ij/h) u_j + h w_i df/dt,  f at t + c_i h;

the last stage is the error estimate.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import expect_whole
from cavirheo.parameters import check, domain


@dataclass(frozen=True)
class Accuracy:
    """Accuracy of the radius in space and in time.

    Attributes:
        shells: their number from the centre to the wall, 8 or more.
        relative_error: of a step, between 1e-12 and 0.1; a tenth of it is used for kinetic contents, and at most 1e-7
            for a polytropic gas, which has no shells.

    Raises:
        InputError: shells or relative_error is out of range.
    """

    shells: int = 128
    relative_error: float = field(default=2e-4, metadata=domain("between 1e-12 and 0.1", lambda x: 1e-12 < x < 0.1))

    def __post_init__(self) -> None:
        expect_whole(self.shells, "shells", 8, "physics.shells")
        check(self)


DEFAULT = Accuracy()  # median error 4e-5 of R_max, up to 1e-3 in the most violent collapses
PRECISE = Accuracy(384, 1e-5)  # six times as accurate as the default, and five times as slow
ROUGH = Accuracy(64, 3e-4)  # inside a search: 2 ms, error up to 1 % of R_max, mostly 0.04 %
BRISK = Accuracy(64, 1e-3)  # stands in for an emulator that does not know the bubble; its error is corrected (weigh.py)
COARSE = Accuracy(24, 3e-3)  # for the starting points of a search: 1 ms


class Grid(NamedTuple):
    """Spherical shells 0..M-1 from centre to wall; face i lies between shell i and shell i+1."""

    inverse_volume: Floats  # (M,) 3/(y_out^3 - y_in^3)
    centre: Floats  # (M,) centroid of each shell
    face: Floats  # (M-1,) y of the interior faces
    area: Floats  # (M-1,) y^2
    inverse_distance: Floats  # (M-1,) inverse distance of the two centroids
    left: Floats  # (M-1,) weight of the inner shell in the value on the face
    right: Floats  # (M-1,) weight of the outer shell in that value
    wall: Floats  # (3,) d/dy at y = 1 from the values at the wall, in shell M-1 and in shell M-2


NO_SHELLS = Grid(*(np.zeros(0) for _ in Grid._fields))  # for polytropic contents


@lru_cache(maxsize=16)
def wall_clustered(shells: int) -> Grid:
    """`shells` shells (8 or more), tanh-spaced so that the one at the wall is 1e-4 thick."""
    first = min(1e-4, 0.5 / shells)
    s = np.linspace(0.0, 1.0, shells + 1)
    low, high = 1e-3, 18.0
    for _ in range(60):  # bisection: importing scipy's solver would take longer than a simulation
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


class Method(NamedTuple):
    """Coefficients of a Rosenbrock method, as the compiled solver takes them."""

    A: np.ndarray
    C: np.ndarray
    stage_times: np.ndarray  # c
    time_weights: np.ndarray  # w
    gamma: float
    order: int


_GAMMA = 0.21193756319429014
_LAST = [-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946]
_A = [
    [],
    [3.0],
    [2.849394379747939, 0.45842242204463923],
    [-6.954028509809101, 2.489845061869568, -10.358996098473584],
    [2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641],
    _LAST,
    [*_LAST, 1.0],
    [*_LAST, 1.0, 1.0],
]
_C = [
    [],
    [-14.155112264123755],
    [-17.97296035885952, -2.859693295451294],
    [147.12150275711716, -1.41221402718213, 71.68940251302358],
    [165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306],
    [24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471],
    [30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783, -19.097331116725623,
     -28.087943162872662],
    [37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047, -40.06618937091002,
     -54.66780262877968, -9.48861652309627],
]  # fmt: skip


def _square(rows: list[list[float]]) -> np.ndarray:
    return np.array([row + [0.0] * (len(rows) - len(row)) for row in rows])


RODAS5P = Method(
    A=_square(_A),
    C=_square(_C),
    stage_times=np.array([0.0, 3 * _GAMMA, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1.0, 1.0, 1.0]),
    time_weights=np.array(
        [_GAMMA, -2 * _GAMMA, -0.3384627126235924, 1.8046452872882734, 2.325825639765069, 0.0, 0.0, 0.0]
    ),
    gamma=_GAMMA,
    order=5,
)
