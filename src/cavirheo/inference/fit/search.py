"""Least squares over the shots of one material: residuals, finite differences, starts, the minimum."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cavirheo.errors import SolverError
from cavirheo.inference.fit.parameters import STRETCH_START, Family, spread_starts
from cavirheo.inference.fit.shots import COARSE, FINE, QUICK, Prediction, Shot
from cavirheo.physics.collapse import analytic_modulus

Floats = NDArray[np.float64]

FORWARD, CENTRAL = 1e-3, 3e-3  # steps of the differences, decades or the like: the solver's noise is far below
STARTS = 48
SAME = 0.01  # of its range: a search that comes so near to a known minimum in every parameter is given up
_LN10 = float(np.log(10.0))
SEARCH = {"ftol": 1e-3, "xtol": 1e-3, "gtol": 1e-8, "max_nfev": 15}
_POLISH = {"ftol": 3e-5, "xtol": 1e-4, "gtol": 1e-8, "max_nfev": 12}
TIMED = 2  # every so many starts get their shear modulus from the collapse time


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where a search ended: x (parameters,), cost (half the sum of squared weighted residuals)."""

    x: Floats
    cost: float
    converged: bool


class Fit:
    """The law's parameters, common to all shots, followed by those of each shot.

    runs and failures count the simulations.
    """

    def __init__(self, family: Family, shots: Sequence[Shot], workers: int = 1) -> None:
        self.family, self.shots, self.workers = family, list(shots), workers
        self.common = len(family.parameters)
        self.runs = self.failures = 0
        owns = [shot.own.bounds for shot in self.shots]
        self.bounds = np.concatenate([family.bounds(), *owns])
        ends = self.common + np.cumsum([0, *map(len, owns)])
        self._own = [slice(int(a), int(b)) for a, b in pairwise(ends)]

    def of_shot(self, x: Floats, k: int) -> Floats:
        """The law's parameters and those of shot k."""
        return np.concatenate([x[..., : self.common], x[..., self._own[k]]], axis=-1)

    def columns(self, k: int) -> list[int]:
        """Indices of x that shot k depends on."""
        return [*range(self.common), *range(self._own[k].start, self._own[k].stop)]

    def predictions(self, jobs: list[tuple[Shot, Floats]], accuracy: dict[str, Any]) -> list[Prediction | None]:
        """One simulation a job, on so many threads (the solver lets go of the interpreter)."""

        def one(job: tuple[Shot, Floats]) -> Prediction | None:
            return job[0].predict(job[1], accuracy)

        if self.workers == 1 or len(jobs) == 1:
            found = [one(job) for job in jobs]
        else:
            with ThreadPoolExecutor(self.workers) as pool:
                found = list(pool.map(one, jobs))
        self.runs += len(found)
        self.failures += sum(prediction is None for prediction in found)
        return found

    def residuals(self, x: Floats, accuracy: dict[str, Any]) -> Floats:
        """(all frames + priors,) weighted residuals."""
        found = self.predictions([(shot, self.of_shot(x, k)) for k, shot in enumerate(self.shots)], accuracy)
        parts = [shot.residual(prediction) for shot, prediction in zip(self.shots, found, strict=True)]
        return np.concatenate([*parts, [(x[column] - mean) / width for column, mean, width in self.priors]])

    @property
    def priors(self) -> list[tuple[int, float, float]]:
        """(column, mean, standard deviation) of log10 stretch for each shot whose late plateau gives it."""
        return [
            (own.start, float(np.log10(shot.stretch_prior[0])), shot.stretch_prior[1] / (shot.stretch_prior[0] * _LN10))
            for own, shot in zip(self._own, self.shots, strict=True)
            if shot.stretch_prior
        ]

    def jacobian(self, x: Floats, accuracy: dict[str, Any], *, central: bool, at: Floats | None = None) -> Floats:
        """(residuals, parameters) by finite differences; a side whose simulation fails is left out.

        `at` are the residuals at x, for forward differences.
        """
        step = CENTRAL if central else FORWARD
        jobs: list[tuple[Shot, Floats]] = []
        moves: list[tuple[int, int, float]] = []
        for k, shot in enumerate(self.shots):
            steps = step * np.concatenate([np.ones(self.common), shot.own.steps(shot.time_scale)])
            here = self.of_shot(x, k)
            for i, column in enumerate(self.columns(k)):
                for sign in (1.0, -1.0) if central else (1.0 if x[column] < np.mean(self.bounds[column]) else -1.0,):
                    there = here.copy()
                    there[i] += sign * steps[i]
                    jobs.append((shot, there))
                    moves.append((k, column, sign * float(steps[i])))
        found = self.predictions(jobs, accuracy)
        if at is None:
            at = self.residuals(x, accuracy)
        result = np.zeros((len(at), len(x)))
        starts = np.cumsum([0, *(len(shot.measured) for shot in self.shots)])
        sides: dict[tuple[int, int], list[tuple[float, Floats]]] = {}
        for (k, column, move), prediction in zip(moves, found, strict=True):
            if prediction is not None:
                sides.setdefault((k, column), []).append((move, self.shots[k].residual(prediction)))
        for (k, column), sampled in sides.items():
            rows = slice(starts[k], starts[k + 1])
            if len(sampled) == 1:
                sampled = [*sampled, (0.0, at[rows])]
            (a, first), (b, second) = sampled
            result[rows, column] = (first - second) / (a - b)
        for row, (column, _, width) in enumerate(self.priors):
            result[starts[-1] + row, column] = 1.0 / width
        return result

    def minimise(
        self, start: Floats, accuracy: dict[str, Any], limits: dict[str, Any], known: Sequence[Floats] = ()
    ) -> Minimum:
        """Trust-region least squares within the bounds (scipy), weights as they are.

        Every second Jacobian is the one before with Broyden's update, which costs no simulation; the last one is not,
        unless `known` minima are given: a search that comes to one of those ends there, with infinite cost.
        """
        from scipy.optimize import least_squares

        low, high = self.bounds.T
        inside = 1e-6 * (high - low)
        last: dict[bytes, Floats] = {}  # residuals at the current point
        before: list[Floats] = []  # x, residuals and Jacobian there, if that was by differences

        def fun(x: Floats) -> Floats:
            last.clear()
            last[x.tobytes()] = self.residuals(x, accuracy)
            return last[x.tobytes()]

        def jac(x: Floats) -> Floats:
            if any(np.all(np.abs(x - other) < SAME * (high - low)) for other in known):
                raise KnownMinimumError
            at = last[x.tobytes()]
            if len(before) == 3:
                x0, at0, slope = before[-3:]
                move = x - x0
                slope = slope + np.outer(at - at0 - slope @ move, move) / (move @ move)
            else:
                before.clear()
                slope = self.jacobian(x, accuracy, central=False, at=at)
            before.extend([x.copy(), at, slope])
            return slope.copy()

        x = start
        try:
            for _ in range(1 if known else 2):
                x = np.clip(x, low + inside, high - inside)
                found = least_squares(fun, x, jac=jac, bounds=(low, high), method="trf", **limits)
                if len(before) == 3:
                    break
                before.clear()
                x = found.x
        except KnownMinimumError:
            return Minimum(x, np.inf, True)
        return Minimum(found.x, float(found.cost), bool(found.status > 0))

    def reweigh(self, x: Floats, accuracy: dict[str, Any]) -> None:
        """The frames' weights from the simulated motion; held fixed while a minimum is sought, for otherwise a faster
        simulation would pay."""
        found = self.predictions([(shot, self.of_shot(x, k)) for k, shot in enumerate(self.shots)], accuracy)
        for shot, prediction in zip(self.shots, found, strict=True):
            if prediction is not None:
                shot.weigh(prediction.speed)

    def settle(self, starts: Sequence[Floats], *, enough: float = 0.0, accuracy: dict[str, Any] = FINE) -> Minimum:
        """The best minimum of a quick search from each start, then with the simulated motion's weights.

        Further starts are left out once a minimum has less than `enough` times the variance that the weights assume.
        """
        best: Minimum | None = None
        known: list[Floats] = []
        for start in starts:
            found = self.minimise(start, QUICK, SEARCH, known)
            known.append(found.x)
            best = found if best is None or found.cost < best.cost else best
            if best.cost < 0.5 * enough * sum(len(shot.measured) for shot in self.shots):
                break
        assert best is not None
        for stage, limits in ((QUICK, SEARCH), (accuracy, _POLISH), (accuracy, _POLISH)):
            self.reweigh(best.x, stage)
            before, best = best.x, self.minimise(best.x, stage, limits)
            if stage is accuracy and np.max(np.abs(best.x - before)) < 2e-2:
                break
        return best


class KnownMinimumError(Exception):
    """A search came to a minimum that is known; does not leave `Fit.minimise`."""


class Scan:
    """Coarse simulations over the whole window of a shot, from which every window takes its starts.

    Where the law has a shear modulus and a viscosity and the curve a collapse, every other point is an estimate from
    the collapse time: it has the shear modulus that t_1 asks for at its viscosity and stretch (physics/collapse.py).

    Raises:
        SolverError: all of them failed.
    """

    def __init__(self, fit: Fit, count: int = STARTS) -> None:
        (shot,) = fit.shots
        own = shot.own
        box = [fit.family.bounds(1)]
        if own.stretch is None:
            near = shot.stretch_prior
            box.append(np.log10([[near[0] - near[1], near[0] + near[1]] if near else STRETCH_START]))
        self.points = np.zeros((count, len(fit.bounds)))  # nuisances start at nothing
        inner = np.concatenate(box)
        self.points[:, : len(inner)] = spread_starts(inner, count)
        self.timed = self._from_collapse_time(fit, shot)
        self.found = fit.predictions([(shot, x) for x in self.points], COARSE)
        if not any(self.found):
            raise SolverError(
                f"all {count} simulations of {fit.family.name} failed with which the search was to be started"
            )

    def _from_collapse_time(self, fit: Fit, shot: Shot) -> NDArray[np.bool_]:
        """(count,) which points got their shear modulus from the collapse time."""
        timed = np.zeros(len(self.points), dtype=bool)
        names, times = fit.family.parameters, shot.curve.collapse_times()
        if not len(times) or not {"shear_modulus", "viscosity"} <= set(names):
            return timed
        column = names.index("shear_modulus")
        stretch = shot.own.natural(self.points[:, fit.common :].T)["stretch"]
        viscosity = 10.0 ** self.points[:, names.index("viscosity")]
        modulus = analytic_modulus(
            shot.max_radius, stretch, viscosity, float(times[0] - shot.curve.time_of_max), shot.medium
        )
        log10 = np.log10(np.where(modulus > 0, modulus, np.nan))
        timed[::TIMED] = True
        timed &= (log10 > fit.bounds[column, 0]) & (log10 < fit.bounds[column, 1])
        self.points[timed, column] = log10[timed]
        return timed

    @property
    def provenance(self) -> dict[str, int]:
        """How many starts there were, and how many with the shear modulus of the collapse time."""
        return {"starts": len(self.points), "starts_from_collapse_time": int(np.sum(self.timed))}

    def best(self, shot: Shot, count: int) -> list[Floats]:
        """The points with the smallest cost in the present window of the shot."""
        m = len(shot.since)
        costs = [
            np.sum(shot.residual(p if p is None else Prediction(p.radius[:m], p.speed[:m])) ** 2) for p in self.found
        ]
        return [self.points[i] for i in np.argsort(costs)[:count]]
