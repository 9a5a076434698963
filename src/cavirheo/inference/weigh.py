"""From draws of the emulator to draws of the solver: each is simulated and weighted by the likelihood of its frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Floats, log_sum
from cavirheo.inference.noise import Noise
from cavirheo.inference.sample import (
    EMULATED,
    Budget,
    Density,
    Draws,
    Frames,
    about,
    climb,
    effective_size,
    sample,
    scan,
    settle,
)
from cavirheo.prior import log_normal

CORRECTING = 12  # simulations that tell the emulator's mean error of each frame
WEIGHED = 128  # draws that are simulated at a time
ENOUGH = 100.0  # effective draws of an answer
MOST = 1800  # simulations of an answer


Correction = Callable[[Floats], Floats]  # of residuals (k, n), or of one (n,), at u (k, d)
Part = tuple[Floats, Floats, Floats, Floats, float, float]  # the first four fields of `Weighed`, evidence and error


@dataclass(frozen=True, eq=False)
class Weighed:
    """Draws u (k, d) that were simulated, their residuals (k, n), and log weights (k,) and evidence.

    share: effective part of the draws. emulator_error: (before, after) the correction, RMS over R_max."""

    u: Floats
    residuals: Floats
    log_posterior: Floats
    log_weight: Floats
    log_evidence: float
    error: float
    share: float
    emulator_error: tuple[float, float]
    evaluations: int


def posterior(
    emulated: Frames, simulated: Frames, noise: Noise, dimension: int, seed: int, budget: Budget = EMULATED
) -> Weighed:
    """The posterior of u (d,): scan, climb and sample by the emulator, then weigh by simulations. emulated, simulated:
    residuals (k, n) at u (k, d), NaN where there is no bubble."""
    streams = iter(np.random.SeedSequence(seed).spawn(8))
    rng = np.random.default_rng(next(streams))
    count = [0]

    def counted(u: Floats) -> Floats:
        count[0] += len(u)
        return emulated(u)

    maxima = climb(counted, noise, scan(counted, noise, dimension, budget, rng), budget)

    def density(correct: Correction) -> Density:
        return lambda u: noise.log_density(counted(u) + correct(u)) + log_normal(u)

    target = density(lambda u: np.zeros(1))
    u, value = settle(target, about(*maxima), budget, rng)
    draws, u, _ = sample(target, u, value, replace(budget, rounds=1), rng)
    first = spread(draws, CORRECTING, rng)
    exact = simulated(draws.u[first])
    difference = exact - counted(draws.u[first])
    good = np.isfinite(difference).all(axis=1)
    shift = difference[good].mean(axis=0)
    errors = float(np.sqrt(np.mean(difference[good] ** 2))), float(np.sqrt(np.mean((difference[good] - shift) ** 2)))
    known = [(draws.u[first][good], difference[good])]

    def mean_shift(u: Floats) -> Floats:
        return np.asarray(shift)

    correction: Correction = mean_shift
    parts: list[Part] = []
    total = CORRECTING
    while True:
        target = density(correction)
        draws, u, _ = sample(target, u, np.maximum(target(u), -1e9), budget, rng, settling=2)
        chosen = spread(draws, WEIGHED, rng)
        at = draws.u[chosen]
        residuals = simulated(at)
        total += len(at)
        log_posterior = noise.log_density(residuals) + log_normal(at)
        log_weight = log_posterior - draws.log_density[chosen]
        parts.append((at, residuals, log_posterior, log_weight, draws.log_evidence, draws.error))
        effective = sum(effective_size(part[3]) for part in parts)
        if effective >= ENOUGH or total + WEIGHED > MOST:
            break
        good = np.isfinite(residuals).all(axis=1)
        known.append((at[good], (residuals - counted(at))[good]))
        correction = linear(*(np.concatenate(each) for each in zip(*known, strict=True)))
    return joined(parts, errors, count[0])


def linear(u: Floats, difference: Floats) -> Correction:
    """The difference (k, n) of simulated and emulated frames at u (k, d), as a linear function of u, by ridge
    regression over the scatter of u."""
    middle, mean = u.mean(axis=0), difference.mean(axis=0)
    whiten = np.linalg.inv(np.linalg.cholesky(np.cov(u.T) + 1e-8 * np.eye(u.shape[1]))).T
    z = (u - middle) @ whiten
    slope = np.linalg.solve(z.T @ z + 3.0 * np.eye(z.shape[1]), z.T @ (difference - mean))
    return lambda u: mean + np.clip((u - middle) @ whiten, -4.0, 4.0) @ slope


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


def joined(
    parts: list[tuple[Floats, Floats, Floats, Floats, float, float]], errors: tuple[float, float], evaluations: int
) -> Weighed:
    """The draws of all parts, each part with the share of its effective draws."""
    sizes = np.array([effective_size(part[3]) for part in parts])
    weights, evidences, spreads = [], [], []
    for (_, _, _, log_weight, log_evidence, error), size in zip(parts, sizes, strict=True):
        mean = log_sum(log_weight) - np.log(len(log_weight))
        relative = np.exp(log_weight - mean)
        weights.append(log_weight - log_sum(log_weight) + np.log(max(size, 1e-12)))
        evidences.append(log_evidence + mean)
        spreads.append(np.hypot(error, np.std(relative) / np.sqrt(len(relative))))
    share = sizes / np.sum(sizes)
    u, residuals, log_posterior = (np.concatenate([part[i] for part in parts]) for i in range(3))
    log_weight = np.concatenate(weights)
    log_evidence = float(np.log(np.sum(share * np.exp(np.array(evidences) - max(evidences)))) + max(evidences))
    error = float(np.sqrt(np.sum((share * np.array(spreads)) ** 2)))
    return Weighed(
        u, residuals, log_posterior, log_weight, log_evidence, error, float(np.sum(sizes) / len(u)), errors, evaluations
    )
