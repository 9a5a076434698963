"""Where a search starts: coarse simulations all over the ranges."""

from __future__ import annotations

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import SolverError
from cavirheo.inference.experiment import Experiment, Prediction
from cavirheo.inference.fit.least_squares import LeastSquares
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.accuracy import COARSE
from cavirheo.physics.collapse import analytic_modulus

STARTS = 64
APART = 0.08  # of a range: starts that are nearer to each other in all parameters lead to one minimum


class Scan:
    """Coarse simulations over the whole window of a shot, from which every window takes its starts.

    Every second point lies where materials usually are, the others all over the ranges. Where law and curve allow, two
    of four have the shear modulus that the collapse time t_1 asks for at their viscosity and stretch
    (physics/collapse.py). Points from `first` on are those of the same sequence. Raises SolverError: all of them
    failed.
    """

    def __init__(self, fit: LeastSquares, count: int = STARTS, first: int = 0) -> None:
        (shot,) = fit.shots
        self.bounds = fit.bounds
        near = shot.stretch_prior
        logs = [PARAMETERS[name] for name in shot.logs]
        usual = np.concatenate([fit.family.bounds(started=True), np.array([p.started for p in logs]).reshape(-1, 2)])
        wide = np.concatenate([fit.family.bounds(), np.array([p.searched for p in logs]).reshape(-1, 2)])
        if near and "stretch" in shot.logs:
            row = shot.law + shot.logs.index("stretch")
            usual[row] = np.clip(np.log10([max(near[0] - near[1], 1e-3), near[0] + near[1]]), *wide[row])
        numbers = np.arange(first, first + count)
        self.points = shot.starts(np.zeros((count, len(fit.bounds))))
        self.searched = slice(0, len(wide))  # columns that are not at nothing
        cube = spread_starts(np.tile([0.0, 1.0], (len(wide), 1)), first + count)[first:]
        for box, taken in ((usual, numbers % 2 == 0), (wide, numbers % 2 == 1)):
            self.points[taken, self.searched] = box[:, 0] + cube[taken] * (box[:, 1] - box[:, 0])
        self.timed = np.zeros(count, dtype=bool)  # which get their shear modulus from the collapse time
        names, times = fit.family.parameters, shot.curve.collapse_times()
        if len(times) and {"shear_modulus", "viscosity"} <= set(names):
            column = names.index("shear_modulus")
            viscosity = 10.0 ** self.points[:, names.index("viscosity")]
            stretch, until = shot.natural(self.points.T)["stretch"], float(times[0] - shot.curve.time_of_max)
            modulus = analytic_modulus(shot.max_radius, stretch, viscosity, until, shot.medium)
            log10 = np.log10(np.where(modulus > 0, modulus, np.nan))
            low, high = fit.bounds[column]
            self.timed = (log10 > low) & (log10 < high) & (numbers // 2 % 2 == 0)
            self.points[self.timed, column] = log10[self.timed]
        self.found = fit.predictions([(shot, x) for x in self.points], COARSE)
        if not any(self.found):
            raise SolverError(f"all {count} simulations of {fit.family.name} failed that were to start the search")

    @property
    def counts(self) -> dict[str, int]:
        """How many starts there were, and how many with the shear modulus of the collapse time."""
        return {"starts": len(self.points), "starts_from_collapse_time": int(np.sum(self.timed))}

    def best(self, shot: Experiment, count: int, known: list[Floats]) -> list[Floats]:
        """Points with the smallest cost in the present window of the shot, apart from each other and from the known."""
        m = len(shot.since)
        costs = [np.sum(shot.residual(p and Prediction(*(values[:m] for values in p))) ** 2) for p in self.found]
        width = (self.bounds[:, 1] - self.bounds[:, 0])[self.searched]
        chosen: list[Floats] = []
        for i in np.argsort(costs):
            point = self.points[i]
            off = [np.abs(point - other)[self.searched] / width for other in (*known, *chosen)]
            if all(np.max(one) > APART for one in off):
                chosen.append(point)
            if len(chosen) == count:
                break
        return chosen


def spread_starts(bounds: Floats, count: int) -> Floats:
    """(count, d) points that fill a box (d, 2) evenly: the additive recurrence of the generalised golden ratio.

    Roberts 2018, "The unreasonable effectiveness of quasirandom sequences"; the same points every time.
    """
    d = len(bounds)
    phi = 2.0
    for _ in range(40):
        phi = (1.0 + phi) ** (1.0 / (d + 1))
    cube = (0.5 + np.outer(np.arange(1, count + 1), phi ** -np.arange(1.0, d + 1))) % 1.0
    return np.asarray(bounds[:, 0] + cube * (bounds[:, 1] - bounds[:, 0]))
