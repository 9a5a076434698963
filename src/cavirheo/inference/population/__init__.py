"""Posteriors of many shots -> the material: its centre, the scatter from shot to shot, and the outliers
(docs/method/population.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats, unscaled
from cavirheo.errors import InputError, expect, expect_whole, require
from cavirheo.inference.alternatives import model_of, of_one_law
from cavirheo.inference.population.likelihood import FEW, Likelihood, Likelihoods, likelihood
from cavirheo.inference.population.material import Population
from cavirheo.inference.population.scatter import Scatter
from cavirheo.inference.verify.sampler import Sample
from cavirheo.parameters import Bound, natural_name, of_the_law, parameter_of
from cavirheo.posterior import TRUSTED, Evidence, Posterior
from cavirheo.prior import Prior
from cavirheo.writing import digits

__all__ = ["Population", "population"]

FEWEST = 3  # shots of a population
_DRAWS = 4000  # of a population
_LEAST_EFFECTIVE = 200.0  # effective draws of a population, below which that is said


def population(
    answers: Sequence[Posterior],
    *,
    names: Sequence[str] | None = None,
    along: ArrayLike | None = None,
    only_trusted: bool = True,
    seed: int = 0,
) -> Population:
    """The material of many shots, from the draws of their posteriors and no further simulation.

    Args:
        answers: of shots of one material, as `infer_many`, `fit_many` or `verify_many` give them. Their weighted draws
            are divided by the prior that they were made with (`Posterior.prior`; flat in the logarithm where that is
            not known). Those without an interval, of another model than most, or whose verdict says that they are no
            property of the material, are left out and counted; so is a copy of another's draws. Averages over laws
            count by the law that has the largest evidence of all shots together.
        names: of the shots; default "shot 1", ...
        along: (n,) a column by which the centre may change, such as log10 of R_max or a concentration: the population
            then has a slope, in decades of each parameter per unit of the column.
        only_trusted: False: take answers of any verdict, as the evidence of a law needs it.
        seed: of the draws.

    Returns:
        The material, log10 of SI. Fewer than 3 shots that count give one without draws, whose `warnings` say why.

    Raises:
        InputError: no answers, or names or a column of another length.

    Source: docs/method/population.md.
    """
    answers = list(answers)
    for answer in answers:
        expect(answer, Posterior, "a Posterior of infer or fit for each shot")
    answers = of_one_law(answers)
    expect_whole(seed, "seed", 0, "option.seed")
    require(bool(answers), "a population needs answers of shots, got none", "population.none")
    shots = [f"shot {i + 1}" for i in range(len(answers))] if names is None else list(names)
    column = np.zeros(len(answers)) if along is None else np.asarray(along, dtype=float)
    for what, values in (("names", shots), ("along", column)):
        message = f"{what} must have one entry for each of the {len(answers)} answers"
        require(np.shape(values) == (len(answers),), message, f"population.{what}")
    likelihoods, excluded = _counted(answers, column, only_trusted)
    first = answers[next(iter(likelihoods), 0)]
    law = tuple(name for name in first.names if of_the_law(name))
    names = tuple(map(natural_name, law))
    fields: dict[str, Any] = {"names": names, "material": first.material, "bubble": first.bubble}
    fields |= {"shots": tuple(shots[i] for i in likelihoods), "left_out": excluded}
    if len(likelihoods) < FEWEST:
        warning = f"{digits.counting(len(likelihoods), len(answers))}, and a material with its scatter needs {FEWEST}"
        return Population(**fields, warnings=(warning,))
    rough = [f"{shots[i]} ({shot.effective:.0f})" for i, shot in likelihoods.items() if shot.effective < FEW]
    notes = [f"rough intervals of shots with fewer than {FEW:.0f} effective draws: {', '.join(rough)}"] * bool(rough)
    counted = [answers[i] for i in likelihoods]
    ends = np.array([_ends(answer, law) for answer in counted])
    low, high = np.min(ends[:, 0], axis=0), np.max(ends[:, 1], axis=0)
    like, x = Likelihoods.of(list(likelihoods.values())), None
    if along is not None:
        column = column[list(likelihoods)]
        middle, unit = float(np.mean(column)), float(np.std(column))
        require(unit > 0, "along must not be one value for all shots", "population.along")
        x = (column - middle) / unit
    several = Scatter(like, low, high, column=x)
    common = Scatter(like, low, high, column=x, spread=False)
    sample, sample_of_one = several.sample(seed), common.sample(seed)
    if sample.ess < _LEAST_EFFECTIVE or not sample.reliable:
        notes.append(f"the intervals of the material are rough: its draws are worth {sample.ess:.0f} independent ones")
    u = _resampled(sample, seed)
    fields["centre"], fields["spread"], fields["correlation"], slope = several.parts(u)
    if along is not None:
        fields |= {"slope": slope / unit, "along_at": middle}
    return Population(
        **fields,
        warnings=tuple(notes),
        common=common.parts(_resampled(sample_of_one, seed))[0],
        outlier_probability=several.outliers(u[:: max(_DRAWS // 1000, 1)]),
        gain=_evidence(sample, like.log_size),
        gain_of_one=_evidence(sample_of_one, like.log_size),
        shot_evidence=tuple(answer.evidence for answer in counted),
        prior={name: (float(a), float(b)) for name, a, b in zip(names, low, high, strict=True)},
        shots_bound=_shots_bound(counted, names),
    )


def with_slope_if_any(
    answers: Sequence[Posterior],
    names: Sequence[str],
    along: Sequence[float] | None,
    *,
    only_trusted: bool = True,
) -> Population:
    """As `population`, with a slope along the column unless that has one value in all shots that count, or too few."""
    if along is not None:
        with suppress(InputError):
            sloped = population(answers, names=names, along=along, only_trusted=only_trusted)
            if len(sloped.centre):
                return sloped
    return population(answers, names=names, only_trusted=only_trusted)


def _counted(
    answers: Sequence[Posterior], column: Floats, only_trusted: bool
) -> tuple[dict[int, Likelihood], dict[str, int]]:
    """(the likelihoods of those that count, by their place; how many are left out by reason)."""
    why: dict[int, str] = {}
    for i, answer in enumerate(answers):
        if len(answer.theta) < 2:
            why[i] = "failed" if answer.checks.verdict == "failed" else "no_interval"
        elif only_trusted and answer.checks.verdict not in TRUSTED:
            why[i] = answer.checks.verdict
        elif not np.isfinite(column[i]):
            why[i] = "no_column_value"
    usable = [i for i in range(len(answers)) if i not in why]
    counts = Counter(map(model_of, (answers[i] for i in usable)))
    most = max(counts, key=lambda model: counts[model], default=None)
    unique: set[bytes] = set()
    likelihoods: dict[int, Likelihood] = {}
    for i in usable:
        draws = answers[i].theta[:, [of_the_law(name) for name in answers[i].names]].tobytes()
        if model_of(answers[i]) != most:
            why[i] = "other_model"
        elif draws in unique:
            why[i] = "copy"
        elif shot := _likelihood(answers[i]):
            likelihoods[i] = shot
            unique.add(draws)
        else:
            why[i] = "no_interval"
    return likelihoods, dict(Counter(why.values()))


def _likelihood(answer: Posterior) -> Likelihood | None:
    """Over the shot's prior of the law's parameters; over the range that is searched where it is not said."""
    law = [k for k, name in enumerate(answer.names) if of_the_law(name)]
    names, theta = tuple(answer.names[k] for k in law), answer.theta[:, law]
    ends, log_weight = _ends(answer, names), np.zeros(len(theta)) if answer.log_weight is None else answer.log_weight
    rows = [(*answer.prior[name], 0.0, np.inf)[:4] for name in names if name in answer.prior]
    if len(rows) < len(names):
        log_prior = np.full(len(theta), -float(np.sum(np.log(np.diff(ends, axis=0)))))
    else:
        log_prior = Prior(names, *np.array(rows, dtype=float).T).log_density(theta)
    return likelihood(theta, log_weight, log_prior, [answer.bound(natural_name(name)) for name in names], ends)


def _shots_bound(answers: Sequence[Posterior], names: Sequence[str]) -> dict[str, Bound]:
    """Of each parameter that most shots only bound, and fewer than FEWEST determine: what most of the former say."""
    most = {}
    for name in names:
        bounds = [bound for answer in answers if (bound := answer.bound(name))]
        if len(answers) - len(bounds) < min(FEWEST, len(bounds)):
            most[name] = Counter(bounds).most_common(1)[0][0]
    return most


def _ends(answer: Posterior, law: Sequence[str]) -> Floats:
    """(2, d) low and high of the prior, in the scale of theta."""
    ends = []
    for name in law:
        values = answer.theta[:, answer.names.index(name)]
        searched = parameter_of(name).searched or (float(np.min(values)) - 1.0, float(np.max(values)) + 1.0)
        ends.append(tuple(answer.prior.get(name, searched))[:2])
    return np.array(ends, dtype=float).T


def _resampled(sample: Sample, seed: int) -> Floats:
    """(_DRAWS, m) equally likely draws, in random order."""
    rng = np.random.Generator(np.random.Philox(seed).jumped())
    weight = unscaled(sample.log_weight)
    places = (np.arange(_DRAWS) + rng.uniform()) / _DRAWS
    chosen = np.searchsorted(np.cumsum(weight) / np.sum(weight), places)
    return sample.u[rng.permutation(np.minimum(chosen, len(weight) - 1))]


def _evidence(sample: Sample, log_size: float) -> Evidence:
    log, error = sample.log_evidence
    return Evidence(log + log_size, error)
