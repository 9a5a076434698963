"""Where a search starts: coarse simulations all over the ranges."""

from __future__ import annotations

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import SolverError
from cavirheo.inference.experiment import COARSE, Experiment, Prediction
from cavirheo.inference.fit.least_squares import LeastSquares
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.collapse import analytic_modulus

STARTS = 48
APART, VALLEYS = 0.07, 2  # decades of stretch between starts of a model with more parameters; how many more of them
TIMED = 2  # every so many starts get their shear modulus from the collapse time


class Scan:
    """Coarse simulations over the whole window of a shot, from which every window takes its starts.

    Where law and curve allow, every other point has the shear modulus that the collapse time t_1 asks for at its
    viscosity and stretch (physics/collapse.py). Raises SolverError: all of them failed.
    """

    def __init__(self, fit: LeastSquares, count: int = STARTS) -> None:
        (shot,) = fit.shots
        box = fit.family.bounds(started=True)
        for name in shot.logs:
            near = shot.stretch_prior if name == "stretch" else None
            around = np.log10([near[0] - near[1], near[0] + near[1]]) if near else PARAMETERS[name].started
            box = np.concatenate([box, [around]])
        self.points = shot.starts(np.zeros((count, len(fit.bounds))))
        self.points[:, : len(box)] = spread_starts(box, count)
        self.timed = np.zeros(count, dtype=bool)  # which get their shear modulus from the collapse time
        names, times = fit.family.parameters, shot.curve.collapse_times()
        if len(times) and {"shear_modulus", "viscosity"} <= set(names):
            column = names.index("shear_modulus")
            viscosity = 10.0 ** self.points[:, names.index("viscosity")]
            stretch, first = shot.natural(self.points.T)["stretch"], float(times[0] - shot.curve.time_of_max)
            modulus = analytic_modulus(shot.max_radius, stretch, viscosity, first, shot.medium)
            log10 = np.log10(np.where(modulus > 0, modulus, np.nan))
            low, high = fit.bounds[column]
            self.timed[::TIMED] = ((log10 > low) & (log10 < high))[::TIMED]
            self.points[self.timed, column] = log10[self.timed]
        self.found = fit.predictions([(shot, x) for x in self.points], COARSE)
        if not any(self.found):
            raise SolverError(f"all {count} simulations of {fit.family.name} failed that were to start the search")

    @property
    def counts(self) -> dict[str, int]:
        """How many starts there were, and how many with the shear modulus of the collapse time."""
        return {"starts": len(self.points), "starts_from_collapse_time": int(np.sum(self.timed))}

    def best(self, shot: Experiment, count: int) -> list[Floats]:
        """The points with the smallest cost in the present window of the shot.

        Where the model of the bubble has parameters, too, those of different stretch: its valleys have their own.
        """
        m = len(shot.since)
        cut = [p and Prediction(p.radius[:m], p.speed[:m]) for p in self.found]
        costs = [np.sum(shot.residual(p) ** 2) for p in cut]
        order = np.argsort(costs)
        if len(shot.logs) < 2:
            return [self.points[i] for i in order[:count]]
        chosen: list[int] = []
        column = shot.names.index(shot.logs[0])
        for i in order:
            if all(abs(self.points[i, column] - self.points[j, column]) > APART for j in chosen):
                chosen.append(i)
        return [self.points[i] for i in chosen[: count + VALLEYS]]


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
