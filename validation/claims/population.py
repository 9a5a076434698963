"""One material from many shots: do the intervals of centre and spread hold the truth, and are outliers found?

Groups have 3 to 20 shots, spread 0 to 0.2 decades, an outlier in a fifth of them. The two parameters of a group are not
independent, so n counts groups. Shots are made without simulating bubbles: a likelihood that is Gaussian in log10 G and
log10 mu, or in G and mu themselves (skewed in the logarithm), sampled with importance weights against the shot's prior.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cavirheo.inference.population import Population, population
from cavirheo.posterior import Checks, Posterior
from cavirheo.prior import Prior
from validation.numbers import SEED, Number, Run, coverage, share

NAMES = ("log10_shear_modulus", "log10_viscosity")
RANGES = {NAMES[0]: (1.0, 7.0), NAMES[1]: (-4.0, 1.0)}
NORMAL = {NAMES[0]: (1.0, 7.0, 3.0, 0.8), NAMES[1]: (-4.0, 1.0, -2.0, 0.8)}  # a prior that is not flat
ORIGIN = np.array([3.8, -1.4])  # log10 of the units of a likelihood in G and mu themselves
WIDTHS = (0.02, 0.15)  # decades; standard deviations with which a shot shows its parameters
AWAY = 0.5  # decades from the centre to an outlier, in both parameters
LEVELS = (0.5, 0.9)
SPREADS = (0.03, 0.1, 0.2)  # decades; of groups of 8 to 20 shots with an outlier


def shot(
    rng: np.random.Generator, truth: np.ndarray, width: np.ndarray, *, natural: bool, flat: bool, effective: float
) -> Posterior:
    """The posterior of one shot whose parameters are `truth` (log10), seen with this standard deviation (decades)."""
    rho = rng.uniform(-0.8, 0.8)
    root = np.diag(width) @ np.linalg.cholesky(np.array([[1.0, rho], [rho, 1.0]]))
    noise = root @ rng.standard_normal(2)

    def seen(theta: np.ndarray) -> np.ndarray:
        return 10.0 ** (theta - ORIGIN) / np.log(10.0) if natural else theta

    scale = 10.0 ** (truth - ORIGIN) if natural else np.ones(2)
    measured = seen(truth) + scale * noise
    middle = np.log10(np.maximum(measured * np.log(10.0), 0.2 * scale)) + ORIGIN if natural else measured
    prior = {} if flat else NORMAL
    rows = [(*(prior or RANGES)[name], 0.0, np.inf)[:4] for name in NAMES]
    count = int(1.8 * effective)
    t = rng.standard_normal((count, 2)) * np.sqrt(6.0 / rng.chisquare(6.0, count))[:, None]
    theta = middle + t @ (1.3 * root).T
    off = np.linalg.solve(scale[:, None] * root, (measured - seen(theta)).T)
    log_drawn = -4.0 * np.log1p(np.sum(t**2, axis=1) / 6.0)
    log_weight = -0.5 * np.sum(off**2, axis=0) + Prior(NAMES, *np.array(rows).T).log_density(theta) - log_drawn
    return Posterior(NAMES, ("Pa", "Pa s"), theta, Checks("ok"), "nhkv", "verified", log_weight=log_weight, prior=prior)


class Group:
    """Shots of one simulated material; `away` is the number of its outlier."""

    def __init__(self, rng: np.random.Generator, n: int, spread: np.ndarray, outlier: bool) -> None:
        self.centre, self.spread = rng.uniform([3.2, -2.0], [4.6, -1.0]), spread
        rho = rng.uniform(-0.9, 0.9)
        root = np.diag(spread) @ np.linalg.cholesky(np.array([[1.0, rho], [rho, 1.0]]))
        truths = self.centre + rng.standard_normal((n, 2)) @ root.T
        self.away = int(rng.integers(n)) if outlier else None
        if self.away is not None:
            truths[self.away] = self.centre + AWAY * rng.choice([-1.0, 1.0], 2)
        widths = 10.0 ** rng.uniform(*np.log10(WIDTHS), (n, 2))
        self.answers = []
        for truth, width in zip(truths, widths, strict=True):
            natural = bool(np.max(width) < 0.1 and rng.uniform() < 0.5)
            flat, effective = bool(rng.uniform() < 0.8), 10.0 ** rng.uniform(2.0, 3.0)
            self.answers.append(shot(rng, truth, width, natural=natural, flat=flat, effective=effective))


def hits(found: Population, group: Group) -> dict[str, list[bool]]:
    """Whether truth is within the intervals of G and of mu."""
    held: dict[str, list[bool]] = {}
    for k, name in enumerate(("shear_modulus", "viscosity")):
        for level in LEVELS:
            low, high = found.interval(name, level)
            held.setdefault(f"centre.{100 * level:.0f}", []).append(bool(low <= 10.0 ** group.centre[k] <= high))
            low, _, high = found.scatter(name, level)
            held.setdefault(f"spread.{100 * level:.0f}", []).append(bool(low <= group.spread[k] <= high))
    return held


def one(job: tuple[str, float, int]) -> dict:
    """Whether intervals hold; or whether the outlier is found, and how many others are named, of how many shots."""
    what, spread, number = job
    rng = np.random.default_rng([SEED, number])
    if what == "intervals":
        group = Group(rng, int(rng.integers(3, 21)), rng.uniform(0.0, 0.2, 2), outlier=number % 5 == 0)
        return hits(population(group.answers, seed=number), group)
    n = int(rng.integers(8, 21))
    group = Group(rng, n, np.full(2, spread), outlier=True)
    away = f"shot {group.away + 1}"
    named = set(population(group.answers, seed=number).outliers)
    return {"found": away in named, "wrong": len(named - {away}), "shots": n - 1}


def measure(run: Run) -> Iterator[Number]:
    n = run.count(60, 200)
    rows = run.rows("population", one, [("intervals", 0.0, number) for number in range(n)])
    for part in ("centre", "spread"):
        for level in LEVELS:
            name = f"{part}.{100 * level:.0f}"
            yield coverage(name, [hit for row in rows for hit in row[name]], level, n)
    named, others = 0, 0
    for spread in SPREADS:
        jobs = [("outlier", spread, number) for number in range(1, run.count(40, 200), 2)]
        rows = run.rows("population", one, jobs)
        yield share(f"outlier.{spread:g}", [row["found"] for row in rows])
        named, others = named + sum(row["wrong"] for row in rows), others + sum(row["shots"] for row in rows)
    yield share("false_alarms", [True] * named + [False] * (others - named))
