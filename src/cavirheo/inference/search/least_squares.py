"""Least squares of one experiment: weighted residuals, finite differences, the minimum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.inference.camera import NAMES
from cavirheo.inference.experiment import FORWARD, Experiment, Prediction
from cavirheo.parallel import each
from cavirheo.physics.accuracy import ROUGH, Accuracy

SAME = 0.01  # of each range: a search so near to a known minimum is given up
LIMITS: dict[str, Any] = {"ftol": 1e-3, "xtol": 1e-3, "gtol": 1e-8, "max_nfev": 15}

POLISH: dict[str, Any] = {"ftol": 3e-5, "xtol": 1e-4, "gtol": 1e-8, "max_nfev": 12}


class Minimum(NamedTuple):
    """Where a search ended: x (parameters,), cost (half the sum of squared weighted residuals), these residuals."""

    x: Floats
    cost: float
    residual: Floats


class LeastSquares:
    """The residuals of an experiment with its weights, which those of the normal priors follow."""

    def __init__(self, shot: Experiment, workers: int = 1) -> None:
        self.shot: Experiment = shot
        self.workers: int = workers
        self.bounds: Floats = shot.bounds
        prior = shot.prior()
        self.columns = np.flatnonzero(np.isfinite(prior.std))  # of x, that have a normal prior
        self.mean, self.std = prior.mean[self.columns], prior.std[self.columns]

    def predictions(self, points: Sequence[Floats], accuracy: Accuracy) -> list[Prediction | None]:
        """One simulation for each x (parameters,), on so many threads."""
        return each(lambda x: self.shot.predict(x, accuracy), points, self.workers)

    def residuals(self, x: Floats, accuracy: Accuracy) -> Floats:
        """(frames + priors,) weighted residuals."""
        return self.weighted(x, self.shot.predict(x, accuracy))

    def weighted(self, x: Floats, seen: Prediction | None) -> Floats:
        """(frames + priors,) weighted residuals, of what the camera has seen at x."""
        return np.concatenate([self.shot.residual(seen), (x[self.columns] - self.mean) / self.std])

    def jacobian(self, x: Floats, accuracy: Accuracy, at: Prediction | None) -> Floats:
        """(frames + priors, parameters) by forward differences from what the camera has seen at x, without a column
        whose simulation fails. Those by clock and scales cost no simulation in a search."""
        shot, here = self.shot, self.weighted(x, at)
        steps = FORWARD * shot.steps * np.where(x < np.mean(self.bounds, axis=1), 1.0, -1.0)
        alike = accuracy is ROUGH and at is not None
        moved = [i for i, name in enumerate(shot.names) if not (alike and name in NAMES)]
        points = [x + np.where(np.arange(len(x)) == i, steps, 0.0) for i in moved]
        frames, result = len(shot.measured), np.zeros((len(here), len(x)))
        for i, seen in zip(moved, self.predictions(points, accuracy), strict=True):
            if seen is not None:
                result[:frames, i] = (shot.residual(seen) - here[:frames]) / steps[i]
        if alike and at is not None:
            by_camera = [i for i, name in enumerate(shot.names) if name in NAMES]
            result[:frames, by_camera] = shot.camera_slopes(x, at, result[:frames, : shot.law])
        result[range(frames, len(here)), self.columns] = 1.0 / self.std
        return result

    def minimise(
        self,
        start: Floats,
        accuracy: Accuracy,
        limits: Mapping[str, Any] = LIMITS,
        known: Sequence[Minimum] = (),
        unlike: float = 0.0,
    ) -> Minimum:
        """Trust-region least squares within the bounds (scipy), weights as they are.

        Every second Jacobian is the one before with Broyden's update, which costs no simulation; the last one is not,
        unless minima are `known`: a search that comes to one, or to frames that differ from its frames by less than
        `unlike` (sum of weighted squares), ends there, with infinite cost.
        """
        from scipy.optimize import least_squares

        low, high = self.bounds.T
        inside = 1e-6 * (high - low)
        last: list[Prediction | None] = [None]  # what the camera has seen at the current point
        slopes: list[tuple[Floats, Floats, Floats]] = []  # x, residuals, Jacobian: by differences, then updated

        def fun(x: Floats) -> Floats:
            last[0] = self.shot.predict(x, accuracy)
            return self.weighted(x, last[0])

        def jac(x: Floats) -> Floats:
            at = self.weighted(x, last[0])
            for other in known:
                near = np.all(np.abs(x - other.x) < SAME * (high - low))
                if near or np.sum((at - other.residual) ** 2) < unlike:
                    raise KnownMinimumError
            if len(slopes) == 1:
                ((x0, at0, slope),) = slopes
                move = x - x0
                slope = slope + np.outer(at - at0 - slope @ move, move) / (move @ move)
            else:
                slopes.clear()
                slope = self.jacobian(x, accuracy, last[0])
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
            return Minimum(x, np.inf, np.empty(0))
        return Minimum(found.x, float(found.cost), found.fun)


class KnownMinimumError(Exception):
    """A search came to a minimum that is known; does not leave `LeastSquares.minimise`."""
