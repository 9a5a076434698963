"""`cavirheo design` against experiments: intervals that were predicted, and those that `infer` then gives.

python benchmarks/design.py [folder] [experiments]    goes on where it was stopped
python benchmarks/design.py checks [recordings]       settings that `design` checks: 6 of each take
                                                      ten minutes
python benchmarks/design.py groups                    shots that scatter: a minute
"""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from functools import cache
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cavirheo import InputError, SolverError, infer_many, population
from cavirheo.inference.assumptions import Family
from cavirheo.inference.design import NORMAL_90, Draws, Setting, compute_expectation, material_information, shots_wanted
from cavirheo.posterior import Checks, Posterior
from cavirheo.prior import Prior
from cavirheo.reporting.material import population_record

KNOWN = {"log10_shear_modulus": np.log10([3e3, 1.2e4]), "log10_viscosity": np.log10([0.03, 0.1]), "stretch": [5.0, 8.0]}
RADII, RATES, FRAMES = (100e-6, 150e-6, 250e-6, 400e-6), (250e3, 500e3, 1e6), 128
DEFAULT = (150e-6, 250e3)
SET, APART = 1000, 2000  # seeds of the experiments
TITLES = {SET: "All settings", APART: "Four settings again, other noise"}
AGAIN = ((400e-6, 500e3), (250e-6, 1e6), (250e-6, 500e3), (150e-6, 1e6))
WANTED = np.log10(1.1)  # decades
DRAWS = 12  # of the prediction
FAMILY = Family("nhkv")
NAMES = ("shear_modulus", "viscosity")


def drawn(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(count, 2) log10 of the law's parameters and (count,) stretches of what is known."""
    x = Prior.uniform(KNOWN).sample(count, seed)
    return x[:, :2], x[:, 2]


def recordings(setting: Setting, count: int, seed: int) -> dict[int, tuple]:
    """Of simulated experiments, with the truth about each; none where no R_max can be read off."""
    law, stretch = drawn(DRAWS, 0)
    made = {}
    for k in range(count):
        with suppress(InputError):
            made[k] = setting.film(FAMILY, law[k], float(stretch[k]), seed=seed + k)
    return made


def predicted(setting: Setting, count: int, seed: int) -> np.ndarray:
    """(count, 2) half-widths in decades of these recordings; NaN where one cannot be read."""
    widths = np.full((count, 2), np.nan)
    for k, pair in recordings(setting, count, seed).items():
        with suppress(InputError, SolverError):
            widths[k] = compute_expectation(*pair, FAMILY).half_width
    return widths


def reached(setting: Setting, count: int, seed: int) -> tuple[np.ndarray, list[str]]:
    """(count, 2) half-widths of the default `infer`, NaN where it gives no interval; and its verdicts."""
    widths, verdicts, made = np.full((count, 2), np.nan), ["failed"] * count, recordings(setting, count, seed)
    for k, answer in zip(made, infer_many([curve for curve, _ in made.values()]), strict=True):
        verdicts[k] = answer.checks.verdict
        for i, name in enumerate(NAMES):
            if ends := answer.interval(name) if answer.theta.size else None:
                widths[k, i] = 0.5 * np.log10(ends[1] / ends[0])
    return widths, verdicts


@cache
def expected_shots(setting: Setting) -> float:
    """That `design` names, from recordings of its own."""
    (found,) = Draws(FAMILY, *drawn(DRAWS, 0)).compute_expectations([setting])
    read, known = [one.information for one in found if one], 1e6 * np.eye(2)
    counts = [shots_wanted(len(read) / DRAWS * one, known, WANTED) or np.inf for one in read]
    return float(np.sort(counts or [np.inf])[len(counts) // 2])


def reached_shots(widths: np.ndarray) -> float:
    """How many of these bring both to WANTED, if information adds: no interval is none."""
    information = np.mean(np.nan_to_num((NORMAL_90 / widths) ** 2), axis=0)
    return float(np.max((NORMAL_90 / WANTED) ** 2 / np.maximum(information, 1e-9)))


def middle(widths: np.ndarray) -> np.ndarray:
    """(2,) geometric mean."""
    return np.exp(np.mean(np.log(widths), axis=0)) if len(widths) else np.full(2, np.nan)


def percent(decades: float) -> str:
    return f"{100 * (10**decades - 1):.3g}"


HEAD = f"""# Predicted intervals and reached ones
`python benchmarks/design.py`: nhkv, G 3 to 12 kPa, µ 0.03 to 0.1 Pa s, stretch 5 to 8 (free), 128 frames, noise 1 % of
R_max, clock and scale off as those of a camera; recordings are simulated.
Told: half of the 90 % interval over the median that `inference/design.py` expects (± %). Reached: that of the default
`infer` on the same recordings. Both are geometric means over the recordings that have both; a half-width above 300 %
is hardly more than the prior. Shots: that bring G and µ both to ± 10 %; told: by `design`, from {DRAWS} recordings of
its own; reached: if the information of the intervals that `infer` gave adds up.
"""

COLUMNS = """| R_max, µm | kfps | G told | reached | ratio | µ told | reached | ratio | shots told | reached | n | ok |
|---|---|---|---|---|---|---|---|---|---|---|---|
"""


def report(found: dict[str, dict]) -> str:
    text = HEAD
    for seed, title in TITLES.items():
        mine = {key: one for key, one in found.items() if key.startswith(f"{seed} ")}
        text += f"\n## {title}\n{COLUMNS}{table(mine)}" if mine else ""
    return text


def table(found: dict[str, dict]) -> str:
    text, ratios, single, needed = "", [], [], {}
    for key, one in found.items():
        seed, radius, rate = map(float, key.split())
        setting, got = Setting(radius, rate, frames=FRAMES), np.array(one["reached"], float)
        told = predicted(setting, len(got), int(seed))
        both = np.isfinite(told).all(axis=1) & np.isfinite(got).all(axis=1)
        a, b = middle(told[both]), middle(got[both])
        ratios.append(a / b)
        single.append(told[both] / got[both])
        needed[radius, rate] = expected_shots(setting), reached_shots(got)
        cells = [
            f"{percent(a[i])} | {percent(b[i])} | {a[i] / b[i]:.2f}" if both.any() else "– | – | –" for i in (0, 1)
        ]
        counts = [f"{count:.0f}" if count < 1e4 else "> 10,000" for count in needed[radius, rate]]
        about = [f"{1e6 * radius:.0f}", f"{1e-3 * rate:.0f}", *cells, *counts, f"{len(got)}"]
        text += f"| {' | '.join(about)} | {one['verdicts'].count('ok')} |\n"
    off = np.array([ratio for ratio in ratios if np.all(np.isfinite(ratio))])
    apart = np.concatenate(single)
    within, spread = np.sum(np.abs(np.log(off)) < np.log(1.2), axis=0), np.exp(np.std(np.log(apart), axis=0))
    text += f"\nTold over reached: median {np.median(off[:, 0]):.2f} (G) and {np.median(off[:, 1]):.2f} (µ); "
    text += f"within 20 % (0.83 to 1.2) at {within[0]} (G) and {within[1]} (µ) of {len(off)} settings. "
    text += f"Of {len(apart)} single recordings: median {np.median(apart[:, 0]):.2f} and {np.median(apart[:, 1]):.2f}, "
    text += f"scatter by a factor of {spread[0]:.2f} and {spread[1]:.2f}.\n"
    chosen = min(needed, key=lambda setting: needed[setting][0])
    if DEFAULT in needed:
        share = needed[chosen][1] / needed[DEFAULT][1]
        where = f"R_max {1e6 * chosen[0]:.0f} µm at {1e-3 * chosen[1]:.0f} kfps"
        text += f"\nFollowing it: the fewest shots are told for {where}; ± 10 % is reached there with "
        text += f"{needed[chosen][1]:.0f} shots, and with {needed[DEFAULT][1]:.0f} at the default setting (150 µm at "
        text += f"250 kfps): {100 * share:.2g} % of them.\n"
    return text


class Halves(NamedTuple):
    """(2,) half-widths in decades, geometric means; expected and answered of other recordings than were checked."""

    expected: np.ndarray
    scaled: np.ndarray
    answered: np.ndarray


def halves(setting: Setting, count: int) -> Halves | None:
    """What answers of `count` recordings say of the answers of 2 `count` others; None where too few can be read."""
    law, stretch = drawn(3 * count, 1)
    both = []
    for k, part in enumerate((slice(count), slice(count, None))):
        told, got = Draws(FAMILY, law[part], stretch[part], seed=10_000 + 1000 * k).check_widths(setting)
        both.append((middle(told), middle(got), len(got)))
    (told, checked, n), (expects, got, others) = both
    if n < 0.8 * count or others < 1.6 * count:
        return None
    return Halves(expects, expects * checked / told, got)


CHECKS = "## Checked settings"


def checks(count: int = 6) -> None:
    """What answers of `count` recordings say of the answers of others at the same setting."""
    text = f"""{CHECKS}
`python benchmarks/design.py checks {count}`: `design` lets `infer` answer recordings of the settings that it recommends
(`--check {count}`), and scales what it expects by answered/expected. For each parameter: half-width expected of
{2 * count} other recordings, of other materials from the same ranges; that scaled by the {count} checked ones; that of
the answers to the others. Geometric means, in percent.

| R_max, µm | kfps | G expected | scaled | answered | µ expected | scaled | answered |
|---|---|---|---|---|---|---|---|
"""
    off = []
    for radius, rate in product(RADII, RATES):
        found = halves(Setting(radius, rate, frames=FRAMES), count)
        if found is None:
            continue
        off.append([found.expected / found.answered, found.scaled / found.answered])
        cells = [" | ".join(percent(one[i]) for one in found) for i in (0, 1)]
        text += f"| {1e6 * radius:.0f} | {1e-3 * rate:.0f} | {' | '.join(cells)} |\n"
        print(text.splitlines()[-1], flush=True)
    logs = np.log(np.array(off))
    for i, name in enumerate(("Expected", "Scaled")):
        within, spread = np.sum(np.abs(logs[:, i]) < np.log(1.2), axis=0), np.exp(np.std(logs[:, i], axis=0))
        middles = np.exp(np.median(logs[:, i], axis=0))
        text += f"\n{name} over answered: within 20 % (0.83 to 1.2) at {within[0]} (G) and {within[1]} (µ) of "
        text += f"{len(off)} settings; middle {middles[0]:.2f} and {middles[1]:.2f}, "
        text += f"scatter by a factor of {spread[0]:.2f} and {spread[1]:.2f}.\n"
    print(text)


GROUPS = "## Shots that scatter"
CENTRE, WIDTH, TOLD_FOR = np.array([3.8, -1.4]), 0.05, np.log10(1.15)


def shots(count: int, spread: float, rng: np.random.Generator) -> list[Posterior]:
    """Of one material, each seen to WIDTH decades in G and mu; Gaussian, so that nothing else can be wrong."""
    truths = CENTRE + np.hypot(spread, WIDTH) * rng.standard_normal((count, 2))
    draws = [truth + WIDTH * rng.standard_normal((300, 2)) for truth in truths]
    names = tuple(f"log10_{name}" for name in NAMES)
    return [Posterior(names, ("Pa", "Pa s"), theta, Checks("ok"), "nhkv", "verified") for theta in draws]


def groups(repeats: int = 20) -> None:
    """How many shots are told from the first ones, and how wide the material's interval is after as many."""
    text = f"""{GROUPS}
`python benchmarks/design.py groups`: simulated groups, each shot known to {WIDTH} decades in G and µ; ± 15 % is wanted.
Needed: by the true scatter. Told: first and further shots in all, from the population of the first ones; without: if
the scatter is taken for 0. Reached: half of the 90 % interval after as many over the wanted one, median [10 %, 90 %] of
{repeats} groups (of those with 1 to 70 further shots).

| scatter, decades | first shots | needed | told | without | reached/wanted | groups |
|---|---|---|---|---|---|---|
"""
    for spread, count in product((0.0, 0.05, 0.1, 0.2), (4, 8)):
        told, without, reached_ = [], [], []
        for k in range(repeats):
            rng = np.random.default_rng([k, count, int(100 * spread)])
            first = shots(count, spread, rng)
            _, known, scatter = population_record(population(first)).log_moments(NAMES)
            one = np.eye(2) / WIDTH**2
            more = shots_wanted(material_information(one, scatter), known, TOLD_FOR)
            told.append(count + more)
            without.append(count + shots_wanted(one, known, TOLD_FOR))
            if 1 <= more <= 70:
                found = population([*first, *shots(more, spread, rng)])
                ends = np.log10([found.interval(name) for name in NAMES])
                reached_.append(0.5 * np.max(np.ptp(ends, axis=1)) / TOLD_FOR)
        needed = max(np.ceil((NORMAL_90 / TOLD_FOR) ** 2 * (spread**2 + WIDTH**2)), 3)
        low, middle, high = np.quantile(reached_ or [np.nan], [0.1, 0.5, 0.9])
        cells = [f"{spread:g}", count, f"{needed:.0f}", f"{np.median(told):.0f}", f"{np.median(without):.0f}"]
        cells += [f"{middle:.2f} [{low:.2f}, {high:.2f}]" if reached_ else "–", len(reached_)]
        text += "| " + " | ".join(map(str, cells)) + " |\n"
        print(cells, flush=True)
    print(text)


def main(folder: str = "build/design", count: str = "4") -> None:
    if folder in ("groups", "checks"):
        return groups() if folder == "groups" else checks(*map(int, sys.argv[2:]))
    place = Path(folder) / "design.json"
    place.parent.mkdir(parents=True, exist_ok=True)
    found = json.loads(place.read_text()) if place.exists() else {}
    for seed, (radius, rate) in [*product([SET], product(RADII, RATES)), *product([APART], AGAIN)]:
        key = f"{seed} {radius} {rate}"
        if key not in found:
            widths, verdicts = reached(Setting(radius, rate, frames=FRAMES), int(count), seed)
            found[key] = {"reached": widths.tolist(), "verdicts": verdicts}
            place.write_text(json.dumps(found))
            print(key, middle(widths), flush=True)
    print(report(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
