"""From draws of the emulator to draws of the solver: each is simulated and weighted by the likelihood of its frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Floats, log_sum
from cavirheo.inference.noise import Noise
from cavirheo.inference.sample import (
    EMULATED,
    NEVER,
    Budget,
    Density,
    Draws,
    Frames,
    Groups,
    about,
    climb,
    effective_size,
    one_group,
    sample,
    scan,
    settle,
)
from cavirheo.prior import log_normal

CORRECTING = 12  # simulations that tell the emulator's mean error of each frame
LOOKED_AT, NEAR_MAXIMUM, REACH = 4, 5, 30.0  # maxima of a group that are simulated, places about the best
REFINED = 8  # steps at most to a maximum by simulations
CROSSED = 2  # highest maxima that are tried with the switches of other groups
REJECTED = 12.0  # log of Laplace's integral by which a group is too unlikely to be looked at,
NEGLIGIBLE = 5.0  # and log evidence by which it is too unlikely to be drawn from
LEAST_WEIGHED = 24  # draws of a group at least
WEIGHED = 150  # draws that are simulated at a time
ENOUGH = 100.0  # effective draws of an answer
MOST = 1800  # simulations of an answer


Correction = Callable[[Floats], Floats]  # of residuals (k, n) or (n,), at u (k, d)


class Switch(NamedTuple):
    """A column of u that is a switch: below `zero` the parameter is exactly 0, above `infinite` it is infinite."""

    column: int
    zero: float
    infinite: float


class Part(NamedTuple):
    """Some draws, as in `Weighed`, and how many of them are effective."""

    u: Floats
    residuals: Floats
    log_posterior: Floats
    log_weight: Floats
    log_evidence: float
    error: float
    effective: float


@dataclass(frozen=True, eq=False)
class Weighed:
    """Draws that were simulated.

    Attributes:
        u: (k, d) places, in random order in each group.
        residuals: (k, n) of the simulations there.
        log_posterior: (k,) by these.
        log_weight: (k,) whose exponentials sum to 1.
        log_evidence, error: of the whole, and its standard error.
        emulator_error: RMS over R_max of the quick frames, before and after their correction.
        evaluations: number of quick frames.
    """

    u: Floats
    residuals: Floats
    log_posterior: Floats
    log_weight: Floats
    log_evidence: float
    error: float
    emulator_error: tuple[float, float]
    evaluations: int = 0

    @property
    def share(self) -> float:
        """Effective part of the draws."""
        return effective_size(self.log_weight) / len(self.u)


def posterior(
    quick: Frames,
    simulated: Frames,
    noise: Noise,
    dimension: int,
    seed: int,
    budget: Budget = EMULATED,
    groups: Groups = one_group,
    switches: Sequence[Switch] = (),
) -> Weighed:
    """The posterior of u (d,): scan, climb and sample by a quick source of frames, then weigh by simulations.

    quick, simulated: residuals (k, n) at u (k, d), NaN where there is no bubble. groups: (k,) of u (k, d): where
    the physics jumps. switches: what decides the group. Each group is sampled and corrected by itself, and
    counts by its evidence from simulations."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    evaluations = [0]

    def counted(u: Floats) -> Floats:
        evaluations[0] += len(u)
        return quick(u)

    starts = scan(counted, noise, dimension, budget, rng, groups)
    u, value, curvature = climb(counted, noise, starts, budget, groups)
    if len(switches):  # the highest maxima of all, with the switches of each group
        crossed = cross(u, value, groups(u), switches)
        more = climb(counted, noise, crossed, budget, groups)
        u, value, curvature = (np.concatenate(pair) for pair in zip((u, value, curvature), more, strict=True))
    of, runs = groups(u), list[Group]()
    for g in np.unique(of):
        if np.max(value[of == g]) > np.max(value) - REACH:
            maxima = u[of == g], value[of == g], curvature[of == g]
            runs.append(Group(counted, simulated, noise, maxima, partial(_is_in, groups, int(g)), budget, rng))
    first = max(run.expected for run in runs)
    runs = sorted((run for run in runs if run.expected > first - REJECTED), key=lambda run: -run.expected)
    estimates = [run.estimate() for run in runs]
    top = max(estimates)
    found = [
        run.weigh(float(np.exp(estimate - top)))
        for run, estimate in zip(runs, estimates, strict=True)
        if estimate > top - NEGLIGIBLE
    ]
    return joined(found, evaluations[0])


def cross(u: Floats, value: Floats, of: NDArray[np.int64], switches: Sequence[Switch]) -> Floats:
    """(k, d) the CROSSED highest of u (m, d), with those switches that differ of the highest of each group, or
    beside the place where they switch."""
    order = np.argsort(-value)
    highest = u[order[:CROSSED]]
    places = list[Floats]()
    for g in np.unique(of):
        for of_group in u[order[of[order] == g][:CROSSED]]:
            place, beside = highest.copy(), highest.copy()
            for column, zero, infinite in switches:
                here, there = place[:, column], of_group[column]
                differs = ((here < zero) != (there < zero)) | ((here > infinite) != (there > infinite))
                beside[differs, column] = np.clip(there, zero - 0.3 if there < zero else zero + 0.3, infinite + 0.3)
                if zero < there < infinite:
                    beside[differs, column] = zero + 0.3 if np.isfinite(zero) else infinite - 0.3
                place[differs, column] = there
            places += [place, beside]
    return np.unique(np.concatenate(places), axis=0)


def _shifted(quick: Frames, shift: Floats, u: Floats) -> Floats:
    return quick(u) + shift


def _is_in(groups: Groups, group: int, u: Floats) -> NDArray[np.bool_]:
    return np.asarray(groups(u) == group)


class Group:
    """The posterior in one group of places. expected: log of Laplace's integral about its highest maximum, corrected by
    simulations there."""

    def __init__(
        self,
        quick: Frames,
        simulated: Frames,
        noise: Noise,
        maxima: tuple[Floats, Floats, Floats],
        inside: Callable[[Floats], NDArray[np.bool_]],
        budget: Budget,
        rng: np.random.Generator,
    ) -> None:
        self.noise, self.maxima, self.inside, self.budget, self.rng = noise, maxima, inside, budget, rng
        self.known = Known(quick, simulated)
        u, value, curvature = maxima
        order = [i for i in np.argsort(-value) if value[i] > np.max(value) - REACH]
        apart: list[int] = []
        for i in order:
            if all(np.sum((u[i] - u[k]) ** 2) > 0.25 * u.shape[1] for k in apart) and len(apart) < LOOKED_AT:
                apart.append(int(i))
        residuals = self.known.simulate(u[apart])
        heights = noise.log_density(residuals) + log_normal(u[apart])
        if not np.isfinite(heights).any():
            heights, residuals = value[apart], quick(u[apart])
        best = int(np.argmax(heights))
        place, height = self._refined(u[apart][best], float(heights[best]), residuals[best])
        root = np.linalg.cholesky(np.linalg.inv(curvature[apart[best]]))
        self.expected = height + float(np.sum(np.log(np.diag(root))))
        near = place + 0.25 * rng.standard_normal((NEAR_MAXIMUM, u.shape[1])) @ root.T
        near = np.concatenate([place[None], near[inside(near)]])
        looked = self.known.count
        self.known = Known(quick, simulated)
        self.errors = self.known.add(near), 0.0
        self.known.count += looked
        self.maxima = (
            np.vstack([u, place]),
            np.append(value, height),
            np.concatenate([curvature, curvature[apart[best]][None]]),
        )

    def _refined(self, place: Floats, height: float, residual: Floats) -> tuple[Floats, float]:
        """A maximum by simulations from a place (d,) near it with its residual (n,): each step leads to the maximum of
        quick frames that are right at the last place."""
        quick, budget = self.known.quick, replace(self.budget, steps=6)
        for _ in range(REFINED):
            shift = residual - quick(place[None])[0]
            corrected = partial(_shifted, quick, shift)
            trial = climb(corrected, self.noise, place[None], budget, self._number)[0]
            found = self.known.simulate(trial)
            reached = float(self.noise.log_density(found)[0] + log_normal(trial)[0])
            if not reached > height + 0.1:
                break
            place, height, residual = trial[0], reached, found[0]
        return place, height

    def _number(self, u: Floats) -> NDArray[np.int64]:
        """1 inside the group, 0 outside."""
        return self.inside(u).astype(np.int64)

    def target(self) -> Density:
        """The log posterior by corrected quick frames; -inf outside the group."""
        known, noise, correction, inside = self.known, self.noise, self.known.correction(), self.inside

        def log_posterior(u: Floats) -> Floats:
            log_density = noise.log_density(known.quick(u) + correction(u)) + log_normal(u)
            return np.where(inside(u), log_density, -np.inf)

        return log_posterior

    def estimate(self) -> float:
        """The log evidence by quick frames, of walkers that have settled; their correction is that of likely places."""
        target = self.target()
        u, value = settle(target, about(*self.maxima), self.budget, self.rng)
        draws, self.u, _ = sample(target, u, value, replace(self.budget, rounds=2), self.rng)
        self.known.add(draws.u[spread(draws, CORRECTING, self.rng)])
        return draws.log_evidence

    def weigh(self, share: float) -> Weighed:
        """Draws that are simulated until they are worth ENOUGH times the share of this group in the answer."""
        parts: list[Part] = []
        wanted = int(np.clip(WEIGHED * share, LEAST_WEIGHED, WEIGHED))
        while True:
            target = self.target()
            start = np.maximum(target(self.u), NEVER)
            draws, self.u, _ = sample(target, self.u, start, self.budget, self.rng, settling=2)
            at, count = np.unique(draws.u[spread(draws, wanted, self.rng)], axis=0, return_counts=True)
            order = self.rng.permutation(len(at))
            at, count = at[order], count[order]
            log_quick, correction = target(at), self.known.correction()(at)
            residuals = self.known.simulate(at)
            self.errors = self.errors[0], self.known.rms(correction)
            log_posterior = self.noise.log_density(residuals) + log_normal(at)
            log_weight = np.log(count) + log_posterior - log_quick
            log_mean = float(log_sum(log_weight) - np.log(np.sum(count)))
            scatter = float(np.std(np.exp(log_weight - np.log(count) - log_mean)) / np.sqrt(np.sum(count)))
            evidence = draws.log_evidence + log_mean, float(np.hypot(draws.error, scatter))
            parts.append(Part(at, residuals, log_posterior, log_weight, *evidence, effective_size(log_weight)))
            if sum(part.effective for part in parts) >= ENOUGH * wanted / WEIGHED or self.known.count + wanted > MOST:
                return together(parts, self.errors)


class Known:
    """What simulations tell of the error of a quick source of frames. u (k, d), difference (k, n): simulated minus
    quick residuals of those that succeeded. count: of all simulations."""

    def __init__(self, quick: Frames, simulated: Frames) -> None:
        self.quick, self.simulated, self.count = quick, simulated, 0
        self.u: list[Floats] = []
        self.difference: list[Floats] = []

    def simulate(self, u: Floats) -> Floats:
        """Simulated residuals (k, n) at u (k, d), which are then known."""
        residuals = self.simulated(u)
        self.count += len(u)
        good = np.isfinite(residuals).all(axis=1)
        self.u.append(u[good])
        self.difference.append((residuals - self.quick(u))[good])
        return residuals

    def add(self, u: Floats) -> float:
        """Simulate u (k, d); the RMS error there."""
        self.simulate(u)
        return self.rms(np.zeros(1))

    def rms(self, correction: Floats) -> float:
        """RMS error that a correction (k, n) or (1,) leaves at the last simulations; NaN if one of them failed."""
        last = self.difference[-1]
        fits = correction.ndim == 1 or len(correction) == len(last)
        return float(np.sqrt(np.mean((last - correction) ** 2))) if last.size and fits else float("nan")

    def correction(self) -> Correction:
        """The error as a function of u."""
        u, difference = np.concatenate(self.u), np.concatenate(self.difference)
        if not len(u):
            return lambda at: np.zeros((len(at), 1))
        return linear(u, difference)


def linear(u: Floats, difference: Floats) -> Correction:
    """The difference (k, n) of simulated and quick frames at u (k, d): its mean, or, of enough, a linear function of u
    by ridge regression over the scatter of u."""
    middle, mean, d = u.mean(axis=0), difference.mean(axis=0), u.shape[1]
    if len(u) < 4 * d:
        middle_difference = np.median(difference, axis=0)  # one wild bubble does not count
        return lambda at: np.asarray(middle_difference)
    whiten = np.linalg.inv(np.linalg.cholesky(np.cov(u.T) + 1e-8 * np.eye(d))).T
    z = (u - middle) @ whiten
    slope = np.linalg.solve(z.T @ z + 3.0 * np.eye(d), z.T @ (difference - mean))
    return lambda at: mean + np.clip((at - middle) @ whiten, -4.0, 4.0) @ slope


def spread(draws: Draws, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Indices of `count` draws that are spread as all are: one of each of `count` cells of equal numbers of draws,
    which are halved along one parameter after the other."""
    cells: list[NDArray[np.int64]] = [np.arange(len(draws.u))]
    axis = 0
    while len(cells) < count:
        halves: list[NDArray[np.int64]] = []
        for cell in cells:
            order = cell[np.argsort(draws.u[cell, axis % draws.u.shape[1]], kind="stable")]
            halves += np.array_split(order, 2)
        cells, axis = halves, axis + 1
    picked = np.array([rng.choice(cell) for cell in cells])
    return rng.permutation(picked)[:count]


def together(parts: Sequence[Part], errors: tuple[float, float]) -> Weighed:
    """The draws of several parts of one group, each part with the share of its effective draws."""
    sizes = np.array([part.effective for part in parts])
    share = sizes / max(np.sum(sizes), 1e-300)
    evidences = np.array([part.log_evidence for part in parts])
    top = np.max(evidences)
    logs = [
        part.log_weight - log_sum(part.log_weight) + np.log(max(size, 1e-300))
        for part, size in zip(parts, share, strict=True)
    ]
    u, residuals, log_posterior = (np.concatenate([part[i] for part in parts]) for i in range(3))
    log_evidence = float(top + np.log(np.sum(share * np.exp(evidences - top))))
    error = float(np.sqrt(np.sum((share * np.array([part.error for part in parts])) ** 2)))
    return Weighed(u, residuals, log_posterior, np.concatenate(logs), log_evidence, error, errors)


def joined(groups: Sequence[Weighed], evaluations: int) -> Weighed:
    """The draws of all groups, each with the share of its evidence."""
    evidences = np.array([group.log_evidence for group in groups])
    whole = float(log_sum(evidences))
    share = np.exp(evidences - whole)
    u, residuals, log_posterior = (
        np.concatenate([getattr(group, name) for group in groups]) for name in ("u", "residuals", "log_posterior")
    )
    log_weight = np.concatenate([group.log_weight + log - whole for group, log in zip(groups, evidences, strict=True)])
    error = float(np.sqrt(np.sum((share * np.array([group.error for group in groups])) ** 2)))
    errors = groups[int(np.argmax(share))].emulator_error
    return Weighed(u, residuals, log_posterior, log_weight, whole, error, errors, evaluations)
