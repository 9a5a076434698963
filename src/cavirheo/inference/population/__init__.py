"""The material from the posteriors of many shots: its centre, the scatter between shots, and the outliers
(docs/method/population.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from cavirheo.arrays import Floats, at_levels
from cavirheo.errors import expect, expect_whole, require
from cavirheo.inference.answer import sensitivity_to_scale
from cavirheo.inference.population.hierarchy import Likelihood, MaterialPosterior, likelihood
from cavirheo.inference.population.material import CommonErrors, Population, quantiles, shifts, two_heaps, widened_limit
from cavirheo.inference.population.switches import share_switches
from cavirheo.inference.sample import effective_size
from cavirheo.parameters import (
    DECIDING,
    USUAL_STRETCH,
    Bound,
    bound_of,
    is_law_parameter,
    natural_name,
    parameter_of,
    wide_bound,
)
from cavirheo.physics.media import WATER
from cavirheo.posterior import TRUSTED, Heap, Posterior
from cavirheo.prior import Prior
from cavirheo.writing import digits

__all__ = ["CommonErrors", "Population", "population"]

MIN_SHOTS = 3  # least number of shots of a population
FEW = 30.0  # effective draws of a shot, below which its interval is rough
_DRAWS = 4000  # draws of a population
_LEAST_EFFECTIVE = 200.0  # fewest effective draws of a population without a warning


def population(
    answers: Sequence[Posterior],
    *,
    names: Sequence[str] | None = None,
    only_trusted: bool = True,
    errors: CommonErrors | None = None,
    seed: int = 0,
) -> Population:
    """The material of many shots from the draws of their posteriors, without simulations (docs/method/population.md).

    Args:
        answers: of shots of one material, by `infer_many` or `fit_many`. Their weighted draws are divided by the prior
            that they were made with (`Posterior.prior`; flat in the logarithm if it is not known). Left out and counted
            are those without an interval, with an untrusted verdict, of another model than most, or of equal draws.
            Answers by the default family share its switches (switches.py).
        names: of the shots; default: those of their curves if they differ, else "shot 1", ...
        only_trusted: False: answers count with any verdict, as a comparison of laws needs it.
        errors: that all shots share; default: 1 % of scale, density and pressure, 0.1 % of the frame rate.
        seed: random seed of the draws.

    Returns:
        The material, log10 of SI. If fewer than 3 shots count, it has no draws, and its `warnings` say why.

    Raises:
        InputError: no answers, or names of another length.
    """
    expect(answers, Iterable, "a list of answers of infer_many or fit_many")
    own = list(answers)
    for answer in own:
        expect(answer, Posterior, "a Posterior of infer or fit for each shot")
    require(bool(own), "a population needs answers of shots, got none", "population.none")
    expect_whole(seed, "seed", 0, "option.seed")
    expect(only_trusted, bool | np.bool_, "True or False as only_trusted")
    errors = CommonErrors() if errors is None else errors
    expect(errors, CommonErrors, "CommonErrors(scale=0.02), or none")
    shots = _shot_names(own) if names is None else list(names)
    require(len(shots) == len(own), f"names must have one entry for each of the {len(own)} answers", "population.names")
    shared = share_switches(own, only_trusted=only_trusted)
    likelihoods, left_out = _select_likelihoods(own, shared.answers, only_trusted)
    counted = [shared.answers[i] for i in likelihoods]
    first = counted[0] if counted else shared.answers[0]
    empty = Population(
        names=tuple(natural_name(name) for name in first.names if is_law_parameter(name)),
        material=first.material,
        bubble=first.bubble,
        shots=tuple(shots[i] for i in likelihoods),
        left_out=left_out,
        switches=shared.switches,
        errors=errors,
    )
    if counted and shared.modulus_limit is not None:
        pressure = float(np.median([(answer.medium or WATER).pressure for answer in counted]))
        stretch = float(np.median([answer.stretch or USUAL_STRETCH[0] for answer in counted]))
        limit = widened_limit(shared.modulus_limit, errors, pressure, stretch)
        empty = replace(empty, modulus_limit=limit or None)
    if len(counted) < MIN_SHOTS:
        count = digits.counted_shots(len(counted), len(own))
        return replace(empty, warnings=(f"{count}, and a common G and µ need {MIN_SHOTS}",))
    return _with_material(empty, [own[i] for i in likelihoods], counted, [*likelihoods.values()], seed)


def _shot_names(answers: Sequence[Posterior]) -> list[str]:
    """Names of the curves, or numbers if two of them have the same name."""
    names = [answer.name for answer in answers]
    return names if all(names) and len({*names}) == len(names) else [f"shot {i + 1}" for i in range(len(names))]


def _select_likelihoods(
    own: Sequence[Posterior], answers: Sequence[Posterior], only_trusted: bool
) -> tuple[dict[int, Likelihood], dict[str, int]]:
    """(likelihoods of the answers that count, by index; number of those that do not, by reason). own: the answers
    before their switches were those of the group."""
    why: dict[int, str] = {}
    for i, answer in enumerate(answers):
        verdict = answer.checks.verdict
        if verdict == "failed" or (only_trusted and verdict not in TRUSTED):
            why[i] = verdict
        elif len(own[i].theta) < 2:
            why[i] = "no_interval"
        elif len(answer.theta) < 2:
            why[i] = "other_switches"
    usable = [i for i in range(len(answers)) if i not in why]
    models = {i: (answers[i].material, answers[i].bubble.name) for i in usable}
    counts = Counter(models.values())
    most = max(counts, key=lambda model: counts[model], default=None)
    likelihoods: dict[int, Likelihood] = {}
    for i in usable:
        if models[i] != most:
            why[i] = "other_model"
        elif (shot := _likelihood(answers[i])) is None:
            why[i] = "no_interval" if answers[i] is own[i] else "other_switches"
        elif any(np.array_equal(shot.points, other.points) for other in likelihoods.values()):
            why[i] = "copy"
        else:
            likelihoods[i] = shot
    return likelihoods, dict(Counter(why.values()))


def _likelihood(answer: Posterior) -> Likelihood | None:
    """The likelihood of a shot, with a flat prior over the searched range where its prior is not known; None if there
    are too few draws."""
    names = [name for name in answer.names if is_law_parameter(name)]
    theta = answer.theta[:, [answer.names.index(name) for name in names]]
    rows = []
    for name, values in zip(names, theta.T, strict=True):
        searched = parameter_of(name).search_range or (float(np.min(values)) - 1.0, float(np.max(values)) + 1.0)
        rows.append((*answer.prior.get(name, searched), 0.0, np.inf)[:4])
    return likelihood(theta, answer.log_weight, Prior(tuple(names), *np.array(rows, dtype=float).T))


def _with_material(
    empty: Population,
    alone: Sequence[Posterior],
    answers: Sequence[Posterior],
    likelihoods: Sequence[Likelihood],
    seed: int,
) -> Population:
    """The population with its draws, from the shots that count: each by itself, and in the state of the switches that
    all share."""
    posterior = MaterialPosterior(likelihoods)
    draws = posterior.sample(seed)
    rng = np.random.Generator(np.random.Philox(seed).jumped())
    levels = (np.arange(_DRAWS) + rng.uniform()) / _DRAWS
    u = rng.permutation(draws.u[at_levels(np.exp(draws.log_weight), levels)])  # equally likely, in random order
    centre, spread = posterior.parts(u)
    over = {name: change for name in empty.names if (change := sensitivity_to_scale(answers, name)) is not None}
    with_errors = centre + shifts(empty.names, over, empty.errors, _DRAWS, seed)
    heaps, bounds = dict[str, tuple[Heap, Heap]](), dict[str, Bound | None]()
    of_shots = alone if "shear_modulus" in empty.names else answers  # of a liquid, in which its thinning is shared
    for name, values, low, high in zip(empty.names, with_errors.T, posterior.low, posterior.high, strict=True):
        bounds[name] = _bound(answers, name, values, low, high)
        if name in DECIDING and (both := two_heaps(of_shots, empty.shots, name)):
            heaps[name], bounds[name] = both, "wide"
    return replace(
        empty,
        warnings=tuple(_warnings(empty.shots, likelihoods, effective_size(draws.log_weight))),
        centre=with_errors,
        statistical=centre,
        spread=spread,
        outlier_probability=posterior.outliers(u[:: _DRAWS // 1000]),
        heaps=heaps,
        bounds=bounds,
        over_scale=over,
    )


def _warnings(shots: Sequence[str], likelihoods: Sequence[Likelihood], effective: float) -> Iterator[str]:
    """What is rough in the intervals of shots, and in those of their material, which has so many effective draws."""
    sizes = zip(digits.distinct_names(shots), likelihoods, strict=True)
    rough = [name for name, shot in sizes if shot.effective < FEW]
    if 2 * len(rough) > len(shots):
        yield f"rough: fewer than {FEW:.0f} independent draws of {', '.join(rough)} are of this model"
    if effective < _LEAST_EFFECTIVE:
        yield f"the intervals of the material are rough: they rest on {effective:.0f} independent draws"


def _bound(answers: Sequence[Posterior], name: str, centre: Floats, low: float, high: float) -> Bound | None:
    """What is known of a parameter by the draws (k,) of its centre, log10, which ranges from low to high, and by the
    shots: of one that fewer of them than MIN_SHOTS determine, and than bound it, their most frequent bound."""
    least, _, most = quantiles(centre, 0.9)
    bounds = [bound for answer in answers if (bound := answer.bound(name)) not in (None, "wide")]
    reached = bound_of(name, least, most, (low, high))
    if reached is None and len(answers) - len(bounds) < min(MIN_SHOTS, len(bounds)):
        return Counter(bounds).most_common(1)[0][0]
    return reached or wide_bound(name, 10.0**least, 10.0**most)
