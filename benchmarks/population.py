"""Is the material of many shots right? Coverage, outliers, pairs, time and memory of `cavirheo.population`.

    python benchmarks/population.py coverage [--groups 200] [--seed 1]
    python benchmarks/population.py outliers | pairs | width | none | bounds | timing | network | real

Shots of known truth are made without simulating bubbles: a likelihood that is Gaussian in log10 G and log10 mu, or in G
and mu themselves (skewed in the logarithm), sampled with importance weights against the shot's prior. `network` uses
simulated bubbles and the network's answers, `real` the open sets in the folder
CAVIRHEO_REAL_DATA.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cavirheo.inference.population import Population, population
from cavirheo.posterior import Checks, Posterior
from cavirheo.prior import Prior

NAMES = ("log10_shear_modulus", "log10_viscosity")
G, MU = "shear_modulus", "viscosity"
RANGES = {NAMES[0]: (1.0, 7.0), NAMES[1]: (-4.0, 1.0)}
NORMAL = {NAMES[0]: (1.0, 7.0, 3.0, 0.8), NAMES[1]: (-4.0, 1.0, -2.0, 0.8)}  # a prior that is not flat
LEVELS = (0.5, 0.9)


def shot(
    rng: np.random.Generator, truth: np.ndarray, width: np.ndarray, *, natural: bool = False, flat: bool = True,
    effective: float = 300.0,
) -> Posterior:  # fmt: skip
    """The posterior of one shot whose parameters are `truth` (log10), seen with this standard deviation (decades)."""
    rho = rng.uniform(-0.8, 0.8)
    root = np.diag(width) @ np.linalg.cholesky(np.array([[1.0, rho], [rho, 1.0]]))
    noise = root @ rng.standard_normal(2)
    origin = np.array([3.8, -1.4])  # of the natural units

    def seen(theta: np.ndarray) -> np.ndarray:
        return (10.0 ** (theta - origin) if natural else theta) * (1.0 / np.log(10.0) if natural else 1.0)

    scale = 10.0 ** (truth - origin) if natural else np.ones(2)
    root = scale[:, None] * root
    measured = seen(truth) + scale * noise
    prior = {} if flat else NORMAL
    rows = [(*(prior or RANGES)[name], 0.0, np.inf)[:4] for name in NAMES]
    density = Prior(NAMES, *np.array(rows).T).log_density
    middle = np.log10(np.maximum(measured * np.log(10.0), 0.2 * scale)) + origin if natural else measured
    wide = 1.3 * root / scale[:, None]
    count = int(1.8 * effective)
    t = rng.standard_normal((count, 2)) * np.sqrt(6.0 / rng.chisquare(6.0, count))[:, None]
    theta = middle + t @ wide.T
    log_q = -4.0 * np.log1p(np.sum(t**2, axis=1) / 6.0)
    off = np.linalg.solve(root, (measured - seen(theta)).T)
    log_weight = -0.5 * np.sum(off**2, axis=0) + density(theta) - log_q
    return Posterior(NAMES, ("Pa", "Pa s"), theta, Checks("ok"), "nhkv", "verified", log_weight=log_weight, prior=prior)


class Group:
    """Shots of one simulated material."""

    def __init__(
        self, rng: np.random.Generator, n: int, spread: np.ndarray, *, centre: np.ndarray | None = None,
        outlier: float = 0.0, widths: tuple[float, float] = (0.02, 0.15), outlier_in: tuple[float, float] = (1.0, 1.0),
    ) -> None:  # fmt: skip
        self.centre = rng.uniform([3.2, -2.0], [4.6, -1.0]) if centre is None else centre
        self.spread, rho = spread, rng.uniform(-0.9, 0.9)
        root = np.diag(spread) @ np.linalg.cholesky(np.array([[1.0, rho], [rho, 1.0]]))
        truths = self.centre + rng.standard_normal((n, 2)) @ root.T
        self.away = int(rng.integers(n)) if outlier else None
        if self.away is not None:
            truths[self.away] = self.centre + outlier * np.array(outlier_in) * rng.choice([-1.0, 1.0], 2)
        self.widths = 10.0 ** rng.uniform(*np.log10(widths), (n, 2))
        self.answers = [
            shot(
                rng, truth, width, natural=bool(np.max(width) < 0.1 and rng.uniform() < 0.5),
                flat=bool(rng.uniform() < 0.8), effective=10.0 ** rng.uniform(2.0, 3.0),
            )
            for truth, width in zip(truths, self.widths, strict=True)
        ]  # fmt: skip


def inside(found: Population, group: Group) -> dict[str, list[bool]]:
    """Whether truth is within the intervals."""
    said: dict[str, list[bool]] = {}
    for k, name in enumerate((G, MU)):
        for level in LEVELS:
            low, high = found.interval(name, level)
            said.setdefault(f"centre {level:.0%}", []).append(low <= 10.0 ** group.centre[k] <= high)
            low, _, high = found.scatter(name, level)
            said.setdefault(f"spread {level:.0%}", []).append(low <= group.spread[k] <= high)
    return said


def covered(number: int, seed: int) -> dict[str, list[bool]]:
    """Whether intervals of this group hold the truth: 3 to 20 shots, spread 0 to 0.2 decades, an outlier in a fifth."""
    rng = np.random.default_rng([seed, number])
    n = int(rng.integers(3, 21))
    group = Group(rng, n, rng.uniform(0.0, 0.2, 2), outlier=0.5 if number % 5 == 0 else 0.0)
    hits = inside(population(group.answers, seed=number), group)
    size = "3-7 shots" if n < 8 else "8-20 shots"
    kinds = (size, "outlier" if group.away is not None else "no outlier")
    return hits | {f"{name}, {kind}": values for name, values in hits.items() for kind in kinds}


def coverage(groups: int, seed: int) -> None:
    """Of the intervals of centre and spread."""
    hits: dict[str, list[bool]] = {}
    for number in range(groups):
        for name, values in covered(number, seed).items():
            hits.setdefault(name, []).extend(values)
    for name, values in sorted(hits.items()):
        print(f"{name:<28}{100 * np.mean(values):6.1f} %  ({len(values)})")


class Outliers(NamedTuple):
    """Of a group. found: whether its outlier was, None where it has none; wrong: others that were named."""

    found: bool | None
    wrong: int
    shots: int


def found_outlier(number: int, seed: int, spread: float, way: tuple[float, float], sizes: tuple[int, int]) -> Outliers:
    """Every second group has an outlier, 0.5 decades off in both parameters or, by `way`, in one."""
    rng = np.random.default_rng([seed, number])
    n = int(rng.integers(sizes[0], sizes[1] + 1))
    group = Group(rng, n, np.full(2, spread), outlier=0.5 * (number % 2), outlier_in=way)
    said = set(population(group.answers, seed=number, names=range(n)).outliers)
    there = group.away is not None
    return Outliers(group.away in said if there else None, len(said - {group.away}), n - there)


def outliers(groups: int, seed: int) -> None:
    """Found where there is one; and false alarms where there is none."""
    for spread in (0.03, 0.1, 0.2):
        for way, label in (((1.0, 1.0), "both"), ((1.0, 0.0), "G alone")):
            for sizes in ((4, 7), (8, 20)):
                all_of = [found_outlier(i, seed, spread, way, sizes) for i in range(groups)]
                known = [one.found for one in all_of if one.found is not None]
                wrong, shots = sum(one.wrong for one in all_of), sum(one.shots for one in all_of)
                print(
                    f"spread {spread:4.2f}, off in {label:<8}{sizes[0]}-{sizes[1]} shots: found {sum(known)}/"
                    f"{len(known)}, false alarms {wrong}/{shots} = {100 * wrong / shots:.1f} %",
                    flush=True,
                )


def pairs(groups: int, seed: int) -> None:
    """Two materials three standard errors apart in G (of the difference), and the same material twice."""
    right, beyond, sure, alarms, unsure = 0, 0, 0, 0, 0
    for i in range(groups):
        rng = np.random.default_rng([seed, i])
        n, spread = int(rng.integers(5, 21)), rng.uniform(0.03, 0.15, 2)
        one = Group(rng, n, spread)
        error = np.sqrt(2.0 / np.sum(1.0 / (spread[0] ** 2 + one.widths[:, 0] ** 2)))
        for step in (3.0, 0.0):
            other = Group(rng, n, spread, centre=one.centre + step * error * np.array([1.0, 0.0]))
            apart = population(other.answers, seed=i).against(population(one.answers, seed=i + 1))[G]
            if step:
                right += apart.probability_higher > 0.5
                beyond += apart.ratio[0] > 1.0
                sure += apart.probability_differs > 0.5
            else:
                alarms += apart.ratio[0] > 1.0 or apart.ratio[2] < 1.0
                unsure += apart.probability_differs > 0.5
    print(f"three standard errors apart: larger one right {right}/{groups}, 90 % interval of the ratio above 1 "
          f"{beyond}/{groups}, probably two materials {sure}/{groups}")  # fmt: skip
    print(f"one material: 90 % interval without 1 {alarms}/{groups}, probably two materials {unsure}/{groups}")


def width(groups: int, seed: int) -> None:
    """Half-width of the 68 % interval of G at 20 shots over scatter of the medians/sqrt(n), and error over it."""
    for label, widths in (("alike", (0.05, 0.05)), ("0.02 to 0.3 decades", (0.02, 0.3))):
        for spread in (0.02, 0.05, 0.1):
            ratio, missed, simple = [], [], []
            for i in range(groups):
                rng = np.random.default_rng([seed, i])
                group = Group(rng, 20, np.full(2, spread), widths=widths)
                found = population(group.answers, seed=i)
                low, high = np.log10(found.interval(G, 0.6827))
                middle = np.log10(found.median(G))
                medians = np.log10([answer.median(G) for answer in group.answers])
                ratio.append(0.5 * (high - low) / (np.std(medians, ddof=1) / np.sqrt(20)))
                missed.append((middle - group.centre[0]) / (0.5 * (high - low)))
                simple.append((np.mean(medians) - group.centre[0]) ** 2 / max((middle - group.centre[0]) ** 2, 1e-12))
            print(f"shots' widths {label}, spread {spread}: interval over scatter/sqrt(n) {np.median(ratio):.2f} "
                  f"({np.quantile(ratio, 0.05):.2f} to {np.quantile(ratio, 0.95):.2f}), error over interval "
                  f"{np.sqrt(np.mean(np.square(missed))):.2f}")  # fmt: skip


def none(groups: int, seed: int) -> None:
    """Shots of exactly one material: does the evidence say so, and does the centre hold truth?"""
    for spread in (0.0, 0.05, 0.1, 0.2):
        said, hits = [], []
        for i in range(groups):
            rng = np.random.default_rng([seed, i])
            group = Group(rng, 10, np.full(2, spread))
            found = population(group.answers, seed=i)
            said.append(found.scattered.log)
            hits += inside(found, group)["centre 90%"]
        print(f"spread {spread:4.2f}, 10 shots: log evidence of scatter {np.median(said):6.1f} (median), above 0 in "
              f"{np.mean(np.array(said) > 0):.0%}; centre within 90 %: {np.mean(hits):.0%}")  # fmt: skip


def bounds(groups: int, seed: int) -> None:
    """12 gels of 6.3 kPa with a scatter of 0.05 decades, whose mu is measured with a normal error in Pa s, so that many
    shots only bound it; log10 of G is traded for mu by 3 decades per Pa s."""
    logs = np.linspace(-4.0, 1.0, 5001)
    for mu, errors in ((0.03, [0.002]), (1e-5, [0.01]), (1e-3, [0.005]), (0.01, [0.002, 0.02])):
        bounded, within, held, known, widths = 0, 0, 0, 0, []
        for i in range(groups):
            rng, answers = np.random.default_rng([seed, i]), []
            for error in errors * (12 // len(errors)):
                stiffness, truth = np.array([3.8, np.log10(mu)]) + 0.05 * rng.standard_normal(2)
                measured = 10.0**truth + error * rng.standard_normal()
                share = np.cumsum(np.exp(-0.5 * ((10.0**logs - measured) / error) ** 2))
                drawn = np.interp(rng.uniform(size=1000), share / share[-1], logs)
                stiffness += 0.05 * rng.standard_normal() + 3.0 * (10.0**truth - 10.0**drawn)
                theta = np.column_stack([stiffness + 0.05 * rng.standard_normal(1000), drawn])
                answers.append(Posterior(NAMES, ("Pa", "Pa s"), theta, Checks("ok"), "nhkv", "verified", prior=RANGES))
            found = population(answers, seed=i)
            low, high = np.log10(found.interval(G))
            bounded += sum(answer.bound(MU) == "upper" for answer in answers)
            within, widths = within + (low < 3.8 < high), [*widths, high - low]
            known += found.bound(MU) is None
            ends = found.interval(MU)
            held += ends[0] < mu < ends[1] if found.bound(MU) is None else mu < ends[1]
        print(f"mu {mu:g}, errors {errors}: {bounded / groups:.1f} of 12 shots bound it; G within 90 % "
              f"{within}/{groups}, width {np.median(widths):.3f} decades; mu is a value in {known}, "
              f"interval or bound holds it in {held}/{groups}")  # fmt: skip


def timing(groups: int, seed: int) -> None:
    """Seconds and memory of 50 and of 1,000 shots, their answers being there."""
    for n in (8, 50, 1000):
        rng = np.random.default_rng(seed)
        group = Group(rng, n, np.full(2, 0.08))
        draws = sum(len(answer.theta) for answer in group.answers)
        for _ in range(2):
            began = time.perf_counter()
            population(group.answers)
            took = time.perf_counter() - began
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        print(f"{n} shots ({draws} draws): {took:.2f} s, the process at most {memory:.2f} GB")


def network(groups: int, seed: int) -> None:
    """Simulated field's bubbles of one material each, answered so by the posterior network without verification."""
    from cavirheo import NeoHookeanKelvinVoigt, infer_many

    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from validation.claims.calibration import film

    hits: dict[str, list[bool]] = {}
    for i in range(groups):
        rng = np.random.default_rng([seed, 7, i])
        n, spread = int(rng.integers(5, 9)), rng.uniform(0.0, 0.2, 2)
        centre = rng.uniform([3.5, -1.7], [4.5, -1.0])
        truths = centre + spread * rng.standard_normal((n, 2))
        curves = []
        for k, (log_G, log_mu) in enumerate(truths):
            law = NeoHookeanKelvinVoigt(10.0**log_G, 10.0**log_mu)
            top, stretch = rng.uniform(150e-6, 350e-6), rng.uniform(5.0, 9.0)
            curves.append(film(law, top, stretch, 0.005, rng, f"shot {k + 1}")[1])
        answers = infer_many(curves, bubble="field", workers=1)
        found = population(answers, only_trusted=False)
        print(i, n, centre.round(3), spread.round(3), found, flush=True)
        for k, name in enumerate((G, MU)):
            for level in LEVELS:
                ends, wide = found.interval(name, level), found.scatter(name, level)
                hits.setdefault(f"centre {level:.0%}", []).append(ends[0] <= 10.0 ** centre[k] <= ends[1])
                hits.setdefault(f"spread {level:.0%}", []).append(wide[0] <= spread[k] <= wide[2])
    for name, values in sorted(hits.items()):
        print(f"{name:<28}{100 * np.mean(values):6.1f} %  ({len(values)})")


SETS = (  # file, law, medium
    ("paam_alginate_0p3/Rt_nondim_exp_PAAm_Alginite_0p3perc_v2.mat", "nhkv", {"density": 998.0}),
    ("peg8000_40wv/Rt_nondim_exp_PEG8K_80.mat", "newtonian", {"density": 998.0}),
    ("peg8000_40wv/Rt_nondim_exp_PEG8K_80.mat", "power-law", {"density": 998.0}),
    ("peg8000_10wv/Rt_nondim_exp_PEG8K_20.mat", "newtonian", {"density": 998.0}),
    ("agarose_0p5/Rt_nondim_exp.mat", "nhkv", {"density": 1003.0}),
    ("agarose_2p5/Rt_nondim_exp.mat", "fung + newtonian", {"density": 1025.0}),
    ("pa_stiff/RofT_shifted_20_shots.mat", "nhkv", {"name": "estrada2018"}),
)


def real(groups: int, seed: int) -> None:
    """Shots of the open sets in CAVIRHEO_REAL_DATA as `infer` answers them; --groups: of each."""
    from dataclasses import replace

    from cavirheo import infer_many, read_curves
    from cavirheo.physics.media import medium

    for file, law, about in SETS:
        liquid = medium(about["name"]) if "name" in about else replace(medium("water"), **about)
        path = Path(os.environ["CAVIRHEO_REAL_DATA"]) / file
        curves = read_curves(path, density=liquid.density, pressure=liquid.pressure)[:groups]
        began = time.perf_counter()
        answers = infer_many(curves, material=law, medium=liquid, seed=seed, workers=1)
        took = time.perf_counter() - began
        for curve, answer in zip(curves, answers, strict=True):
            worth = answer.diagnostics.effective_sample_size
            print(
                curve.name, answer.checks.verdict, worth, {n: answer.interval(n) for n in answer.parameters}, flush=True
            )
        for only in (True, False):
            found = population(answers, names=[curve.name for curve in curves], only_trusted=only)
            print(file, "trusted" if only else "all", found, f"{took:.0f} s", flush=True)


def main() -> None:
    verbs = {verb.__name__: verb for verb in (coverage, outliers, pairs, width, none, bounds, timing, network, real)}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=verbs)
    parser.add_argument("--groups", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    verbs[given.what](given.groups, given.seed)


if __name__ == "__main__":
    main()
