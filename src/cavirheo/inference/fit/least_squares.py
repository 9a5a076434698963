"""Least squares over experiments with one material: residuals, finite differences, the minimum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Floats
from cavirheo.inference.camera import NAMES
from cavirheo.inference.experiment import FINE, FORWARD, QUICK, Experiment, Prediction
from cavirheo.inference.law import Family
from cavirheo.parallel import each
from cavirheo.physics.accuracy import Accuracy

CENTRAL = 3e-3  # step of the differences from both sides, decades or the like
SAME = 0.01  # of each range: a search so near to a known minimum is given up
SEARCH: dict[str, Any] = {"ftol": 1e-3, "xtol": 1e-3, "gtol": 1e-8, "max_nfev": 15}
_POLISH = {"ftol": 3e-5, "xtol": 1e-4, "gtol": 1e-8, "max_nfev": 12}


class Minimum(NamedTuple):
    """Where a search ended: x (parameters,), cost (half the sum of squared weighted residuals)."""

    x: Floats
    cost: float
    converged: bool


class LeastSquares:
    """Experiments with one material: x holds its parameters, then those of each shot."""

    def __init__(self, experiments: Sequence[Experiment], workers: int = 1) -> None:
        self.shots: list[Experiment] = list(experiments)
        self.workers: int = workers
        self.family: Family = self.shots[0].family
        self.common: int = self.shots[0].law
        owns = [shot.bounds[self.common :] for shot in self.shots]
        self.bounds: Floats = np.concatenate([self.family.bounds(), *owns])
        ends = np.cumsum([self.common, *map(len, owns)])
        law = range(self.common)
        # of x that shot k depends on
        self.columns: list[NDArray[np.intp]] = [np.array([*law, *range(a, b)]) for a, b in pairwise(ends)]
        self.priors: list[tuple[int, float, float]] = []  # column, mean, standard deviation of what has a normal prior
        for shot, own in zip(self.shots, self.columns, strict=True):
            prior = shot.prior()
            known = [(int(i), *pair) for i, *pair in zip(own, prior.mean.tolist(), prior.std.tolist(), strict=True)]
            self.priors += [one for one in known if np.isfinite(one[2])]

    @property
    def rows(self) -> list[slice]:
        """Of the residuals: those of each shot, which the priors follow."""
        ends = np.cumsum([0, *(len(shot.measured) for shot in self.shots)]).tolist()
        return [slice(a, b) for a, b in pairwise(ends)]

    def predictions(self, jobs: list[tuple[Experiment, Floats]], accuracy: Accuracy) -> list[Prediction | None]:
        """One simulation a job, on so many threads."""
        return each(lambda job: job[0].predict(job[1], accuracy), jobs, self.workers)

    def at(self, x: Floats, accuracy: Accuracy) -> list[Prediction | None]:
        """The simulation of every shot."""
        return self.predictions([(shot, x[own]) for shot, own in zip(self.shots, self.columns, strict=True)], accuracy)

    def residuals(self, x: Floats, accuracy: Accuracy) -> Floats:
        """(all frames + priors,) weighted residuals."""
        return self.weighted(x, self.at(x, accuracy))

    def weighted(self, x: Floats, seen: Sequence[Prediction | None]) -> Floats:
        """(all frames + priors,) weighted residuals, of what each shot's camera has seen at x."""
        parts = [shot.residual(one) for shot, one in zip(self.shots, seen, strict=True)]
        return np.concatenate([*parts, [(x[column] - mean) / width for column, mean, width in self.priors]])

    def jacobian(
        self, x: Floats, accuracy: Accuracy, *, central: bool, at: Sequence[Prediction | None] | None = None
    ) -> Floats:
        """(residuals, parameters) by finite differences, without a side whose simulation fails; `at`: what each camera
        has seen at x. Those by clock and scales cost no simulation in a search."""
        middle = np.mean(self.bounds, axis=1)
        at = self.at(x, accuracy) if at is None else at
        here, rows = self.weighted(x, at), self.rows
        moves: list[tuple[int, int, float, Floats]] = []  # shot, column, step, x of the shot
        alike = [accuracy is QUICK and not central and one is not None for one in at]
        for k, (shot, own) in enumerate(zip(self.shots, self.columns, strict=True)):
            steps = ((CENTRAL if central else FORWARD) * shot.steps).tolist()
            for i, (name, column, step) in enumerate(zip(shot.names, own, steps, strict=True)):
                if alike[k] and name in NAMES:
                    continue
                for sign in (1.0, -1.0) if central else (1.0 if x[column] < middle[column] else -1.0,):
                    there = x[own]
                    there[i] += sign * step
                    moves.append((k, column, sign * step, there))
        found = self.predictions([(self.shots[k], there) for k, _, _, there in moves], accuracy)
        sides: dict[tuple[int, int], list[tuple[float, Floats]]] = {}
        for (k, column, step, _), prediction in zip(moves, found, strict=True):
            if prediction is not None:
                sides.setdefault((k, column), []).append((step, self.shots[k].residual(prediction)))
        result = np.zeros((len(here), len(x)))
        for (k, column), sampled in sides.items():
            (a, first), (b, second) = sampled if len(sampled) == 2 else (*sampled, (0.0, here[rows[k]]))
            result[rows[k], column] = (first - second) / (a - b)
        for k, (shot, own, seen) in enumerate(zip(self.shots, self.columns, at, strict=True)):
            if alike[k] and seen is not None:
                columns = [column for name, column in zip(shot.names, own, strict=True) if name in NAMES]
                result[rows[k], columns] = shot.camera_slopes(x[own], seen, result[rows[k], : self.common])
        for row, (column, _, width) in enumerate(self.priors, rows[-1].stop):
            result[row, column] = 1.0 / width
        return result

    def minimise(
        self, start: Floats, accuracy: Accuracy, limits: Mapping[str, Any], known: Sequence[Floats] = ()
    ) -> Minimum:
        """Trust-region least squares within the bounds (scipy), weights as they are.

        Every second Jacobian is the one before with Broyden's update, which costs no simulation; the last one is not,
        unless minima are `known`: a search that comes to one ends there, with infinite cost.
        """
        from scipy.optimize import least_squares

        low, high = self.bounds.T
        inside = 1e-6 * (high - low)
        last: list[Prediction | None] = []  # what each camera has seen at the current point
        slopes: list[tuple[Floats, Floats, Floats]] = []  # x, residuals, Jacobian: by differences, then updated

        def fun(x: Floats) -> Floats:
            last[:] = self.at(x, accuracy)
            return self.weighted(x, last)

        def jac(x: Floats) -> Floats:
            if any(np.all(np.abs(x - other) < SAME * (high - low)) for other in known):
                raise KnownMinimumError
            at = self.weighted(x, last)
            if len(slopes) == 1:
                ((x0, at0, slope),) = slopes
                move = x - x0
                slope = slope + np.outer(at - at0 - slope @ move, move) / (move @ move)
            else:
                slopes.clear()
                slope = self.jacobian(x, accuracy, central=False, at=last)
            slopes.append((x.copy(), at, slope))
            return slope.copy()

        x = start
        try:
            for _ in range(1 if known else 2):
                x = np.clip(x, low + inside, high - inside)
                found = least_squares(fun, x, jac=jac, bounds=(low, high), method="trf", **limits)
                if len(slopes) == 1:
                    break
                slopes.clear()
                x = found.x
        except KnownMinimumError:
            return Minimum(x, np.inf, True)
        return Minimum(found.x, float(found.cost), bool(found.status > 0))

    def reweigh(self, x: Floats, accuracy: Accuracy) -> None:
        """The frames' weights from a simulation; fixed in a search, where otherwise fast motion would pay."""
        for shot, seen in zip(self.shots, self.at(x, accuracy), strict=True):
            if seen is not None:
                shot.weigh(seen.speed, shot.measured - seen.radius)

    def polish(self, start: Floats, limits: Mapping[str, Any] = SEARCH) -> Minimum:
        """The minimum beside `start` of the default solver, with the weights of the simulation there."""
        found = Minimum(start, np.inf, False)
        for accuracy, how in ((QUICK, limits), (FINE, _POLISH), (FINE, _POLISH)):
            self.reweigh(found.x, accuracy)
            before, found = found.x, self.minimise(found.x, accuracy, how)
            if accuracy is FINE and np.max(np.abs(found.x - before)) < 2e-2:
                break
        return found


class KnownMinimumError(Exception):
    """A search came to a minimum that is known; does not leave `LeastSquares.minimise`."""
