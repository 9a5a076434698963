"""The posterior of one shot as a function of u, its modes, and the Gaussian about each (Laplace)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.inference.experiment import FINE, FORWARD, QUICK, Accuracy, Experiment
from cavirheo.inference.noise import Noise
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.parallel import each
from cavirheo.posterior import Evidence, OtherAnswer, intervals
from cavirheo.prior import Prior, log_normal

INSIDE = 1e-3  # of the probability, that a start keeps away from the bounds: it must have somewhere to go
_RESISTING = 0.3  # accommodation below which condensation resists more than what else does


class Target:
    """log p(frames | x(u)) + log p(u) of one experiment; -inf where the simulation failed."""

    def __init__(self, experiment: Experiment, prior: Prior, noise: Noise, workers: int = 1) -> None:
        self.experiment: Experiment = experiment
        self.prior: Prior = prior
        self.noise: Noise = noise
        self.workers: int = workers

    def start(self, x: Floats) -> Floats:
        """(..., d) u of x (..., d), where a climb can begin."""
        return self.prior.to_u(x, INSIDE)

    def residuals(self, u: Floats, accuracy: Accuracy) -> Floats:
        """(k, n) measured minus simulated, over R_max, at u (k, d); NaN where the simulation failed."""
        return np.array(each(lambda x: self.experiment.difference(x, accuracy), self.prior.to_x(u), self.workers))

    def log_posterior(self, u: Floats, residual: Floats) -> Floats:
        """(k,) of u (k, d), where the residuals are (k, n); -inf where one is not finite."""
        return self.noise.log_density(residual) + log_normal(u)

    def linear(self, u: Floats) -> Floats:
        """(k, d) coordinates that frames are nearly linear in, of u (k, d): parameters, not their logarithms. Of the
        accommodation its inverse, a resistance, where that is small beside the others, and else the logarithm."""
        x, law = self.prior.to_x(u), self.experiment.law
        v = np.concatenate([10.0 ** x[:, :law], x[:, law:]], axis=1)
        if "accommodation" in self.prior.names:
            column = self.prior.names.index("accommodation")
            v[:, column] = np.log1p(_RESISTING * 10.0 ** -x[:, column])
        return v

    def jacobian(self, u: Floats, residual: Floats, accuracy: Accuracy) -> Floats:
        """(n, d) of the simulated frames by u: differences towards u = 0, steps as those of a fit."""
        moves = np.minimum(FORWARD * self.experiment.steps / self.prior.slope(u), 0.3) * np.where(u > 0, -1.0, 1.0)
        moved = self.residuals(u + np.diag(moves), accuracy)
        return np.nan_to_num((residual - moved) / moves[:, None]).T


@dataclass(frozen=True, eq=False)
class Mode:
    """A maximum of the posterior in u, with what the Gaussian about it needs."""

    u: Floats  # (d,)
    log_posterior: float
    covariance: Floats  # (d, d), of u
    residual: Floats  # (n,)
    jacobian: Floats  # (n, d)

    @property
    def log_evidence(self) -> float:
        """Laplace's integral of likelihood times prior."""
        return self.log_posterior + 0.5 * float(np.linalg.slogdet(2.0 * np.pi * self.covariance)[1])

    def squares(self, u: Floats) -> Floats:
        """(k,) squared Mahalanobis distances of u (k, d)."""
        off = u - self.u
        return np.asarray(np.einsum("ki,ij,kj->k", off, np.linalg.inv(self.covariance), off))

    def draws(self, count: int, seed: int) -> Floats:
        """(count, d) of the Gaussian, in pairs opposite to each other."""
        rng = np.random.Generator(np.random.Philox(seed))
        half = rng.standard_normal((count // 2, len(self.u))) @ np.linalg.cholesky(self.covariance).T
        return np.asarray(self.u + np.concatenate([half, -half]))


def valley(target: Target, mode: Mode) -> OtherAnswer:
    """What the Gaussian about a mode answers, beside another one's."""
    shot, to_x = target.experiment, target.prior.to_x
    told = intervals(*shot.answer(to_x(mode.draws(TUNING.draws, 0))))
    best, rmse = shot.best(to_x(mode.u)), float(np.sqrt(np.mean(mode.residual**2)))
    return OtherAnswer(shot.family.name, shot.options.bubble, best, told, Evidence(mode.log_evidence), rmse)


def climb(
    target: Target,
    start: Floats,
    accuracy: Accuracy,
    held: Floats | None = None,
    most: int = 12,
    known: Sequence[Mode] = (),
) -> Mode | None:
    """The maximum reached from u (d,) by damped Gauss-Newton; None if the start cannot be simulated, or if the way
    comes to a `known` mode or promises to end far below the best of them. `held` (d,) is a direction along which u
    stays near its start."""
    u, noise = start, target.noise
    rope = np.zeros(len(u)) if held is None else held

    def value_of(residual: Floats, u: Floats) -> float:
        return float(target.log_posterior(u[None], residual[None])[0]) - 0.5 * float(rope @ (u - start)) ** 2

    residual = target.residuals(u[None], accuracy)[0]
    value = value_of(residual, u)
    if not np.isfinite(value):
        return None
    damping = 1e-3
    lowest = max((mode.log_posterior for mode in known), default=-np.inf)
    lowest -= TUNING.climb_hopeless * TUNING.lowest_mode
    for turn in range(most + 1):
        if any((u - mode.u) @ np.linalg.solve(mode.covariance, u - mode.u) < TUNING.same_mode**2 for mode in known):
            return None
        jacobian = target.jacobian(u, residual, accuracy)
        gradient, curvature = noise.newton(residual, jacobian)
        free = curvature + np.eye(len(u))
        gradient, curvature = gradient + u + rope * (rope @ (u - start)), free + np.outer(rope, rope)
        hoped = 0.5 * float(gradient @ np.linalg.solve(curvature, gradient))
        if turn > 2 and value + hoped < lowest:
            return None
        if turn == most or hoped < TUNING.climb_gain:
            break
        for _ in range(5):
            step = -np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), gradient)
            there = np.clip(u + step, -5.0, 5.0)
            tried = target.residuals(there[None], accuracy)[0]
            reached = value_of(tried, there)
            if reached > value:
                break
            damping *= 8.0
        else:
            break
        gain, u, residual, value = reached - value, there, tried, reached
        damping = max(damping / 8.0, 1e-6)
        if gain < TUNING.climb_gain:
            break
    value += 0.5 * float(rope @ (u - start)) ** 2
    return Mode(u, value, np.asarray(np.linalg.inv(free), dtype=float), residual, jacobian)


class Simulated(NamedTuple):
    """Simulations: u (k, d), residuals (k, n), log posterior (k,)."""

    u: Floats
    residual: Floats
    value: Floats

    @classmethod
    def at(cls, target: Target, u: Floats, accuracy: Accuracy = FINE) -> Simulated:
        """Those at u (k, d)."""
        residual = target.residuals(u, accuracy)
        return cls(u, residual, target.log_posterior(u, residual))


def secant(target: Target, known: Simulated) -> tuple[Mode, Simulated]:
    """The maximum among `known` simulations, more of them than parameters, and near them; with those of the steps.

    Gauss-Newton steps whose jacobian is the slope of a plane through the residuals of the likeliest: a step costs two
    simulations, where one with finite differences costs one a parameter. (Ralston and Jennrich 1978,
    doi:10.1080/00401706.1978.10489610)
    """
    for left in reversed(range(TUNING.secant_steps + 1)):
        top = int(np.argmax(known.value))
        u, residual, value = (values[np.isfinite(known.value)] for values in known)
        trust = 1.0 / (1.0 + (known.value[top] - value) / TUNING.nugget_height)
        off = trust[:, None] * np.column_stack([np.ones(len(u)), u - known.u[top]])
        size = np.append(0.0, np.sqrt(np.sum(off[:, 1:] ** 2, axis=0)))
        missed = trust[:, None] * (residual - known.residual[top])
        plane = np.linalg.solve(off.T @ off + np.diag((TUNING.secant_firm * size) ** 2), off.T @ missed)
        jacobian = -plane[1:].T
        gradient, curvature = target.noise.newton(known.residual[top], jacobian)
        gradient, curvature = gradient + known.u[top], curvature + np.eye(len(gradient))
        step = -np.linalg.solve(curvature, gradient)
        if not left or -0.5 * float(gradient @ step) < TUNING.climb_gain:
            break
        tried = Simulated.at(target, np.clip(known.u[top] + np.outer((1.0, 0.4), step), -5.0, 5.0))
        known = Simulated(*(np.concatenate(pair) for pair in zip(known, tried, strict=True)))
        if np.max(known.value) - known.value[top] < TUNING.climb_gain:
            break
    top = int(np.argmax(known.value))
    covariance = np.asarray(np.linalg.inv(curvature), dtype=float)
    return Mode(known.u[top], float(known.value[top]), covariance, known.residual[top], jacobian), known


def ridge(target: Target, mode: Mode) -> list[Mode]:
    """Places on either side of a mode along its longest axis, each the maximum across it: posteriors are curved."""
    values, vectors = np.linalg.eigh(mode.covariance)

    def along(side: float) -> list[Mode]:
        found: list[Mode] = []
        here, axis, length = mode.u, side * vectors[:, -1], np.sqrt(values[-1])
        for _ in range(4):
            start = np.clip(here + TUNING.ridge_stride * length * axis, -3.0, 3.0)
            place = climb(target, start, QUICK, held=axis * TUNING.ridge_held / length, most=2)
            if place is None or place.log_posterior < mode.log_posterior - TUNING.ridge_depth:
                break
            found.append(place)
            local, turned = np.linalg.eigh(place.covariance)
            axis = turned[:, -1] * np.sign(turned[:, -1] @ axis)
            here, length = place.u, min(np.sqrt(local[-1]), 2.0 * length)
        return found

    return [place for places in each(along, (1.0, -1.0), target.workers) for place in places]


def same(mode: Mode, other: Mode) -> bool:
    """Nearer to each other than their Gaussians are wide."""
    off = mode.u - other.u
    return bool(off @ np.linalg.solve(other.covariance + mode.covariance, off) < TUNING.same_mode**2)


def modes(target: Target, starts: Sequence[Floats], further: Sequence[Floats] = ()) -> list[Mode]:
    """Distinct maxima from the starts (d,) in u, and from `further` ones where they lead elsewhere; best first, without
    those far below."""
    found: list[Mode] = []
    for start in (*starts, *further):
        mode = climb(target, start, QUICK, known=found)
        if mode is None:
            continue
        twin = next((i for i, other in enumerate(found) if same(mode, other)), None)
        if twin is None:
            found.append(mode)
        elif mode.log_posterior > found[twin].log_posterior:
            found[twin] = mode
    found.sort(key=lambda mode: -mode.log_posterior)
    return [mode for mode in found if mode.log_posterior > found[0].log_posterior - TUNING.lowest_mode]
