"""The material from the posteriors of many shots: its centre, the scatter between shots, and the outliers
(docs/method/population.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf, expit

from cavirheo.arrays import Floats, relative_scatter, relative_weights
from cavirheo.errors import InputError, expect, expect_whole, require
from cavirheo.inference.alternatives import model_of
from cavirheo.inference.answer import over_scale
from cavirheo.inference.population.heaps import two_heaps
from cavirheo.inference.population.hierarchy import FEW, SPREAD_SCALE, Likelihood, MaterialPosterior, likelihood
from cavirheo.inference.population.switches import LIKELY, share_switches
from cavirheo.inference.population.systematic import CommonErrors, hidden_modulus, shifts
from cavirheo.inference.sample import Draws, effective_size
from cavirheo.messages import Message
from cavirheo.parameters import (
    DECIDING,
    LOG10,
    USUAL_STRETCH,
    Bound,
    bound_of,
    column_name,
    is_law_parameter,
    matching,
    natural_name,
    parameter_of,
    require_name,
    wide_bound,
)
from cavirheo.physics.bubble import Bubble
from cavirheo.physics.media import WATER
from cavirheo.posterior import TRUSTED, Evidence, Heap, Posterior, check_level, upper_limit
from cavirheo.prior import Prior
from cavirheo.writing import digits, export, plots
from cavirheo.writing.document import Quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["CommonErrors", "Population", "population"]

MIN_SHOTS = 3  # least number of shots of a population
_DRAWS = 4000  # draws of a population
_LEAST_EFFECTIVE = 200.0  # fewest effective draws of a population without a warning
_EMPTY = np.empty((0, 0))
HARDLY = 0.03  # decades: shots that scatter by less hardly scatter
DIFFERENCE_SCALE = 0.3  # decades: prior standard deviation of the difference between two materials that are compared


class Difference(NamedTuple):
    """The difference of two materials in a parameter.

    Attributes:
        ratio: (5 %, 50 %, 95 %) of this material's value over the other's.
        probability_higher: probability that this material's value is larger.
        probability_differs: probability of two materials against one, if both are equally likely in advance, and two
            materials are a factor of about 2 apart (DIFFERENCE_SCALE decades).
    """

    ratio: tuple[float, float, float]
    probability_higher: float
    probability_differs: float


@dataclass(frozen=True, eq=False, repr=False)
class Population:
    """The material of n shots. If it failed, it has no draws, and `warnings` say why.

    Attributes:
        names: the law's parameters, "shear_modulus", ...
        material: the law.
        bubble: the model of the bubble.
        shots: names of those that count.
        left_out: number of shots that do not count, by reason: their verdict, "no_interval", "no_column_value",
            "other_model" or "copy".
        warnings: what a user must know before using it.
        centre: (draws, d) log10 of the material's parameters, SI, with the errors that all shots share.
        statistical: (draws, d) the same without these errors.
        spread: (draws, d) standard deviation of the shots about the centre, decades.
        correlation: (draws, d, d) of this scatter.
        slope: (draws, d) decades per unit of the column, or None.
        outlier_probability: (n,) probability that a shot is an outlier.
        gain: log evidence of the population minus that of shots which have nothing in common.
        shot_evidence: of each shot by itself.
        along_at: value of the column to which the centre belongs, if there is a slope.
        prior: (low, high) of the centre, log10 of SI, by name.
        shots_bound: the bound that most shots give of a parameter that too few shots determine, by name.
        heaps: the two heaps, the lower one first, into which the shots fall in a parameter in which they disagree.
        switches: probability of each switch of the default family, by all shots together.
        modulus_limit: 95 % limit of G, Pa, where the material may be a liquid, with the errors that all shots share.
        errors: relative standard deviations of the errors that all shots share.
        over_scale: relative change of each parameter per relative change of R_max; those that are known.
    """

    names: tuple[str, ...]
    material: str
    bubble: Bubble
    shots: tuple[str, ...]
    left_out: Mapping[str, int] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    centre: Floats = field(default_factory=lambda: _EMPTY)
    statistical: Floats = field(default_factory=lambda: _EMPTY)
    spread: Floats = field(default_factory=lambda: _EMPTY)
    correlation: Floats = field(default_factory=lambda: _EMPTY)
    slope: Floats | None = None
    outlier_probability: Floats = field(default_factory=lambda: np.empty(0))
    gain: Evidence | None = None
    shot_evidence: tuple[Evidence | None, ...] = ()
    along_at: float | None = None
    prior: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    shots_bound: Mapping[str, Bound] = field(default_factory=dict)
    heaps: Mapping[str, tuple[Heap, Heap]] = field(default_factory=dict)
    switches: Mapping[str, float] = field(default_factory=dict)
    modulus_limit: float | None = None
    errors: CommonErrors = field(default_factory=CommonErrors)
    over_scale: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        """The line for a paper, then the remarks."""
        return "\n  ".join([f"Population({self.material}, {self.bubble.name}): {self.line}", *self.remarks])

    def _column(self, name: str) -> int:
        known = require_name(name, self.names, "the population", "population.parameter")
        require(len(self.centre) > 0, f"the population has no draws: {'; '.join(self.warnings)}", "population.no_draws")
        return self.names.index(known)

    def _ends(self, draws: Floats, name: str, level: float) -> tuple[float, float, float]:
        return _quantiles(draws[:, self._column(name)], level)

    def draws(self, name: str) -> Floats:
        """(draws,) equally likely values of the material's parameter, SI: of "G" or "shear_modulus" in Pa, ... Raises
        InputError: no such parameter, or no draws."""
        return np.asarray(10.0 ** self.centre[:, self._column(name)])

    @property
    def quantities(self) -> list[str]:
        """The law's parameters, and G where it has a limit alone."""
        limited = ["shear_modulus"] if self.modulus_limit is not None else []
        return [*dict.fromkeys([*limited, *self.names])]

    def _limit_of(self, name: str) -> float | None:
        """`modulus_limit`, if the parameter is G."""
        return None if matching(name, ["shear_modulus"]) is None else self.modulus_limit

    def interval(self, name: str, level: float = 0.9) -> tuple[float, float]:
        """Central interval of the material's parameter with the probability `level`, SI; of a G with a limit 0 and the
        limit, of other upper bounds as `upper_limit`. Raises InputError: as `draws`, or the level is not between 0 and
        1."""
        check_level(level)
        if (limit := self._limit_of(name)) is not None:
            return 0.0, limit
        low, _, high = self._ends(self.centre, name, level)
        if self.bound(name) == "upper":
            return 10.0**low, upper_limit(self.draws(name), 0.5 + 0.5 * level)
        return 10.0**low, 10.0**high

    def median(self, name: str) -> float:
        """Median of the material's parameter, SI. Raises InputError: as `draws`."""
        return float(10.0 ** np.median(self.centre[:, self._column(name)]))

    def bound(self, name: str) -> Bound | None:
        """The bound of a parameter that the shots do not determine: "upper", "lower", "undetermined" or "wide", as
        `Posterior.bound`. None if its interval is inside the range and no wider than a factor of 10, and at least three
        shots, or as many as bound it, determine it by themselves; "wide", if the shots disagree (`heaps`). Raises
        InputError: as `draws`."""
        if self._limit_of(name) is not None:
            return "upper"
        name = self.names[self._column(name)]
        if name in self.heaps:
            return "wide"
        low, _, high = self._ends(self.centre, name, 0.9)
        reached = bound_of(low, high, self.prior[name]) if name in self.prior else None
        return reached or self.shots_bound.get(name) or wide_bound(name, 10.0**low, 10.0**high)

    def quantity(self, name: str) -> Quantity:
        """Median, 90 % interval and bound of a parameter, SI; where the shots disagree, the ends of all of them. Raises
        InputError: as `draws`."""
        if (limit := self._limit_of(name)) is not None:
            return Quantity(q05=0.0, q95=limit, bound="upper")
        name = self.names[self._column(name)]
        if name in self.heaps:
            first, second = self.heaps[name]
            return Quantity(q05=first.low or 0.0, q95=second.high or 10.0 ** self.prior[name][1], bound="wide")
        low, high = self.interval(name)
        return Quantity(median=self.median(name), q05=low, q95=high, bound=self.bound(name))

    def statistical_interval(self, name: str, level: float = 0.9) -> tuple[float, float]:
        """(low, high) of the material's parameter, SI, without the errors that all shots share. Raises InputError: as
        `interval`."""
        check_level(level)
        low, _, high = self._ends(self.statistical, name, level)
        return 10.0**low, 10.0**high

    @property
    def determined(self) -> list[str]:
        """Parameters that the shots determine and do not only bound; none without draws."""
        return [name for name in self.names if len(self.centre) and self.bound(name) is None]

    def scatter(self, name: str, level: float = 0.9) -> tuple[float, float, float]:
        """(low, median, high) of the standard deviation of the shots about the material, decades. Raises
        InputError: as `draws`."""
        return self._ends(self.spread, name, level)

    def trend(self, name: str, level: float = 0.9) -> tuple[float, float, float]:
        """(low, median, high) of the slope along the column, decades per unit. Raises InputError: as `draws`, or no
        column."""
        require(self.slope is not None, "the population was made without a column (along)", "population.along")
        return self._ends(np.asarray(self.slope), name, level)

    @property
    def outliers(self) -> dict[str, float]:
        """Shots that are more probably outliers than not, and that probability."""
        return {name: float(p) for name, p in zip(self.shots, self.outlier_probability, strict=False) if p > 0.5}

    @property
    def agree(self) -> bool:
        """Whether the shots differ by no more than their intervals: for each parameter it is more probable than before
        that they hardly scatter (the ratio of Savage and Dickey)."""
        before = float(erf(HARDLY / (np.sqrt(2.0) * SPREAD_SCALE)))
        return bool(len(self.spread)) and bool(np.all(np.mean(self.spread < HARDLY, axis=0) > before))

    @property
    def evidence(self) -> Evidence | None:
        """Log evidence of the law with one material and its scatter; None if a shot has no evidence."""
        evidences = [evidence for evidence in self.shot_evidence if evidence is not None]
        if self.gain is None or len(evidences) < len(self.shots):
            return None
        error = np.sqrt((self.gain.error or 0.0) ** 2 + sum((evidence.error or 0.0) ** 2 for evidence in evidences))
        return Evidence(self.gain.log + sum(evidence.log for evidence in evidences), float(error))

    @property
    def line(self) -> str:
        """'G = 5.8 kPa (90 %: 5.1 to 6.6); shots scatter by 12 % in G; 8 of 9 shots count, 1 of them seems to be of
        another material'."""
        if not len(self.centre):
            return "no material: " + "; ".join(self.warnings)
        values = ", ".join(map(self._value, self.quantities))
        count = digits.counted_shots(len(self.shots), len(self.shots) + sum(self.left_out.values()))
        away = len(self.outliers)
        outliers = f", {away} of them seem{'s' * (away == 1)} to be of another material" * bool(away)
        return "; ".join(filter(None, [values, self._scatter_in_words(), count + outliers]))

    @property
    def remarks(self) -> list[str]:
        """Sentences below the line: outliers, shots that do not count, warnings."""
        said = list[Message]()
        if self.outliers:
            said.append(Message("group.outliers", {"probabilities": self.outliers}))
        if self.left_out:
            said.append(Message("group.left_out", {"counts": self.left_out}))
        warnings = self.warnings if len(self.centre) else ()
        return [*(message.text for message in said), *warnings]

    def _value(self, name: str) -> str:
        value, parameter = self.quantity(name), parameter_of(name)
        factor, unit = digits.unit_for(parameter.unit, value.largest)
        if value.bound:
            return f"{parameter.symbol} {digits.quantity(value, factor, unit=unit)}"
        middle, interval = digits.value_parts(value, factor)
        return f"{parameter.symbol} = {middle}{f' {unit}' if unit else ''} (90 %: {interval})"

    def _scatter_in_words(self) -> str:
        """The scatter of the parameters that are determined; that of others is not known."""
        none = self.agree
        percents = {}
        for name in self.determined:
            decades = self.scatter(name)[2 if none else 1]
            percents[parameter_of(name).symbol] = digits.significant(100 * relative_scatter(decades), 2)
        single = len(self.names) == 1 and not none
        within = ", ".join(f"{value} %" if single else f"{value} % in {symbol}" for symbol, value in percents.items())
        if none:
            return "shots agree within their intervals" + f" (they scatter by less than {within}: 95 %)" * bool(within)
        return f"shots scatter by {within}" if within else ""

    def against(self, other: Population) -> dict[str, Difference]:
        """Differences of this material from another one, by parameter that both determine; empty without draws.

        Both must have the same law and bubble. The errors that all shots share are left out, for both materials have
        them."""
        differences = {}
        for name in (name for name in self.determined if name in other.determined):
            mine, its = self.statistical[:, self._column(name)], other.statistical[:, other._column(name)]
            count = min(len(mine), len(its))
            difference = mine[:count] - its[:count]
            low, middle, high = _quantiles(difference, 0.9)
            square, mean = max(float(np.var(difference)), 1e-12), float(np.mean(difference))  # 0 between equal groups
            wide = square + DIFFERENCE_SCALE**2
            log_odds = 0.5 * np.log(square / wide) + 0.5 * mean**2 * (1.0 / square - 1.0 / wide)
            higher = float(np.mean(difference > 0))
            differences[name] = Difference((10.0**low, 10.0**middle, 10.0**high), higher, float(expit(log_odds)))
        return differences

    def to_dataframe(self) -> Any:
        """The draws as a pandas.DataFrame: of the material ("shear_modulus_Pa"), of the scatter about it
        ("shear_modulus_spread_decades") and of the slopes along the column ("shear_modulus_slope_decades").

        Raises InputError: no draws, or pandas is missing."""
        columns = {}
        for k, (name, values) in enumerate(self._draws.items()):
            columns[column_name(name, parameter_of(name).unit)] = values
            columns[f"{name}_spread_decades"] = self.spread[:, k]
            if self.slope is not None:
                columns[f"{name}_slope_decades"] = self.slope[:, k]
        return export.dataframe(columns, self._metadata)

    def to_arviz(self) -> Any:
        """The material's draws as arviz.InferenceData, or xarray.DataTree from ArviZ 1 on: group "posterior".

        Raises InputError: no draws, or arviz is missing."""
        units = {name: parameter_of(name).unit for name in self.names}
        return export.inference_data({"posterior": self._draws}, units, self._metadata)

    def corner(self, *names: str) -> Figure:
        """Figure of the draws of each of the material's parameters, with the median and the central 90 %, and of each
        pair of them. names: of the parameters; default: all.

        Raises InputError: no draws, no such parameter, or matplotlib is missing."""
        chosen = [self.names[self._column(name)] for name in names or self.names]
        return plots.corner_plot({name: self.draws(name) for name in chosen}, np.ones(len(self.centre)))

    @property
    def _draws(self) -> dict[str, Floats]:
        """(draws,) of the material's parameters by name, SI."""
        return {name: self.draws(name) for name in self.names}

    @property
    def _metadata(self) -> dict[str, str]:
        return {"material": self.material, "bubble": self.bubble.name, "line": self.line}

    def correlations(self) -> dict[str, tuple[float, float, float]]:
        """(5 %, 50 %, 95 %) of the scatter's correlations, by "name, name"."""
        return {
            f"{self.names[j]}, {name}": _quantiles(self.correlation[:, i, j], 0.9)
            for i, name in enumerate(self.names if len(self.centre) else ())
            for j in range(i)
        }


def _quantiles(values: Floats, level: float) -> tuple[float, float, float]:
    low, middle, high = np.quantile(values, [(1.0 - level) / 2.0, 0.5, (1.0 + level) / 2.0]).tolist()
    return low, middle, high


def population(
    answers: Sequence[Posterior],
    *,
    names: Sequence[str] | None = None,
    along: ArrayLike | None = None,
    only_trusted: bool = True,
    errors: CommonErrors | None = None,
    seed: int = 0,
) -> Population:
    """The material of many shots, from the draws of their posteriors without further simulations.

    Args:
        answers: of shots of one material, as `infer_many` or `fit_many` give them. Their weighted draws are divided by
            the prior that they were made with (`Posterior.prior`; flat in the logarithm if it is not known). Answers
            are left out and counted if they have no interval, another model than most, a verdict that is not trusted,
            or the draws of another answer. Answers by the default family share its switches (switches.py).
        names: of the shots; default: those of their curves if they differ, else "shot 1", ...
        along: (n,) a column on which the centre may depend, such as log10 of R_max or a concentration: the population
            then has a slope, in decades of each parameter per unit of the column.
        only_trusted: False: answers count with any verdict, as the evidence of a law needs it.
        errors: that all shots share; default: 1 % of scale, density and pressure, 0.1 % of the frame rate.
        seed: random seed of the draws.

    Returns:
        The material, log10 of SI. If fewer than 3 shots count, it has no draws, and its `warnings` say why.

    Raises:
        InputError: no answers, names or a column of another length, or a column with one value for all shots.

    Source: docs/method/population.md.
    """
    own = _checked_answers(answers)
    expect_whole(seed, "seed", 0, "option.seed")
    shots = _shot_names(own) if names is None else list(names)
    column = np.zeros(len(own)) if along is None else np.asarray(along, dtype=float)
    for argument, values in (("names", shots), ("along", column)):
        message = f"{argument} must have one entry for each of the {len(own)} answers"
        require(np.shape(values) == (len(own),), message, f"population.{argument}")
    shared = share_switches(own, only_trusted=only_trusted)
    likelihoods, excluded = _select_likelihoods(shared.answers, column, only_trusted)
    first = shared.answers[next(iter(likelihoods), 0)]
    empty = Population(
        names=tuple(natural_name(name) for name in first.names if is_law_parameter(name)),
        material=first.material,
        bubble=first.bubble,
        shots=tuple(shots[i] for i in likelihoods),
        left_out=excluded,
        switches=shared.switches,
        errors=errors or CommonErrors(),
    )
    if likelihoods and shared.switches.get("liquid", 0.0) > LIKELY:
        counted = [shared.answers[i] for i in likelihoods]
        empty = replace(empty, modulus_limit=_modulus_limit(counted, shared.modulus_limit, empty.errors))
    if len(likelihoods) < MIN_SHOTS:
        count = digits.counted_shots(len(likelihoods), len(own))
        return replace(empty, warnings=(f"{count}, and a material with its scatter needs {MIN_SHOTS}",))
    pairs = [(own[i], shared.answers[i]) for i in likelihoods]
    along_counted = None if along is None else column[[*likelihoods]]
    return _with_material(empty, pairs, [*likelihoods.values()], along_counted, seed)


def _modulus_limit(answers: Sequence[Posterior], by_statistics: float | None, errors: CommonErrors) -> float | None:
    """95 % limit of G, Pa, of a material that may be a liquid, with the errors that all shots share; None: it is 0."""
    pressure = np.median([(answer.medium or WATER).pressure for answer in answers])
    stretch = np.median([answer.stretch or USUAL_STRETCH[0] for answer in answers])
    limit = float(np.hypot(by_statistics or 0.0, hidden_modulus(errors, float(pressure), float(stretch))))
    return limit or None


def _checked_answers(answers: Sequence[Posterior]) -> list[Posterior]:
    """The answers as a list. Raises InputError: there is none, or something else."""
    own = list(answers)
    for answer in own:
        expect(answer, Posterior, "a Posterior of infer or fit for each shot")
    require(bool(own), "a population needs answers of shots, got none", "population.none")
    return own


def _with_material(
    empty: Population,
    pairs: Sequence[tuple[Posterior, Posterior]],
    likelihoods: Sequence[Likelihood],
    column: Floats | None,
    seed: int,
) -> Population:
    """The population with its draws. pairs: the answer of each shot that counts, by itself, and in the state of the
    switches that all share. column: (n,) values of the shots, or None."""
    own, answers = zip(*pairs, strict=True)
    names, along = empty.names, dict[str, Any]()
    ends = np.array([_ends(answer, [LOG10 + name for name in names]) for answer in answers])
    low, high = np.min(ends[:, 0], axis=0), np.max(ends[:, 1], axis=0)
    if column is not None:
        middle, unit = float(np.mean(column)), float(np.std(column))
        require(unit > 0, "along must not be one value for all shots", "population.along")
        column = (column - middle) / unit
    scatter = MaterialPosterior(likelihoods, low, high, column)
    draws = scatter.sample(seed)
    u = _resampled(draws, seed)
    centre, spread, correlation, slope = scatter.parts(u)
    if column is not None:
        along = {"slope": slope / unit, "along_at": middle}
    over = {name: change for name in names if (change := over_scale(answers, name)) is not None}
    shift = shifts(names, over, empty.errors, _DRAWS, seed)
    heaps = {name: two_heaps(own, empty.shots, name) for name in names if name in DECIDING}
    return replace(
        empty,
        **along,
        warnings=tuple(_warnings(empty.shots, likelihoods, effective_size(draws.log_weight))),
        centre=centre + shift,
        statistical=centre,
        spread=spread,
        correlation=correlation,
        over_scale=over,
        heaps={name: both for name, both in heaps.items() if both},
        outlier_probability=scatter.outliers(u[:: _DRAWS // 1000]),
        gain=scatter.evidence(draws),
        shot_evidence=tuple(answer.evidence for answer in answers),
        prior={name: (float(a), float(b)) for name, a, b in zip(names, low, high, strict=True)},
        shots_bound=_shots_bound(answers, names),
    )


def _warnings(shots: Sequence[str], likelihoods: Sequence[Likelihood], effective: float) -> Iterator[str]:
    """What is rough in the intervals of shots, and in those of their material, which has so many effective draws."""
    sizes = zip(digits.distinct_names(shots), likelihoods, strict=True)
    rough = [name for name, shot in sizes if shot.effective < FEW]
    if rough:
        yield f"the answer is rough: it rests on fewer than {FEW:.0f} independent draws of {', '.join(rough)}"
    if effective < _LEAST_EFFECTIVE:
        yield f"the intervals of the material are rough: they rest on {effective:.0f} independent draws"


def _shot_names(answers: Sequence[Posterior]) -> list[str]:
    """Names of the curves, or numbers if two of them have the same name."""
    names = [answer.name for answer in answers]
    return names if all(names) and len({*names}) == len(names) else [f"shot {i + 1}" for i in range(len(names))]


def with_slope_if_any(
    answers: Sequence[Posterior], names: Sequence[str], along: Sequence[float] | None, **options: Any
) -> Population:
    """As `population`, with a slope along the column if enough shots count and their values of the column differ.
    options: those of `population`."""
    if along is not None:
        with suppress(InputError):
            sloped = population(answers, names=names, along=along, **options)
            if len(sloped.centre):
                return sloped
    return population(answers, names=names, **options)


def _select_likelihoods(
    answers: Sequence[Posterior], column: Floats, only_trusted: bool
) -> tuple[dict[int, Likelihood], dict[str, int]]:
    """(likelihoods of the answers that count, by index; number of those that do not, by reason)."""
    why: dict[int, str] = {}
    for i, answer in enumerate(answers):
        verdict = answer.checks.verdict
        if verdict == "failed" or (only_trusted and verdict not in TRUSTED):
            why[i] = verdict
        elif len(answer.theta) < 2:
            why[i] = "no_interval"
        elif not np.isfinite(column[i]):
            why[i] = "no_column_value"
    usable = [i for i in range(len(answers)) if i not in why]
    counts = Counter(map(model_of, (answers[i] for i in usable)))
    most = max(counts, key=lambda model: counts[model], default=None)
    unique: set[bytes] = set()
    likelihoods: dict[int, Likelihood] = {}
    for i in usable:
        draws = answers[i].theta[:, [is_law_parameter(name) for name in answers[i].names]].tobytes()
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
    """The likelihood of a shot: its draws divided by their prior of the law's parameters, or by a flat one over the
    searched range if that is not known. None if there are too few draws."""
    law = [k for k, name in enumerate(answer.names) if is_law_parameter(name)]
    names, theta = tuple(answer.names[k] for k in law), answer.theta[:, law]
    ends, log_weight = _ends(answer, names), np.zeros(len(theta)) if answer.log_weight is None else answer.log_weight
    rows = [(*answer.prior.get(name, ends[:, k]), 0.0, np.inf)[:4] for k, name in enumerate(names)]
    log_prior = Prior(names, *np.array(rows, dtype=float).T).log_density(theta)
    return likelihood(theta, log_weight, log_prior, [answer.bound(natural_name(name)) for name in names], ends)


def _shots_bound(answers: Sequence[Posterior], names: Sequence[str]) -> dict[str, Bound]:
    """Most frequent bound of each parameter that most shots only bound, and fewer than MIN_SHOTS determine."""
    most = {}
    for name in names:
        bounds = [bound for answer in answers if (bound := answer.bound(name)) not in (None, "wide")]
        if len(answers) - len(bounds) < min(MIN_SHOTS, len(bounds)):
            most[name] = Counter(bounds).most_common(1)[0][0]
    return most


def _ends(answer: Posterior, law: Sequence[str]) -> Floats:
    """(2, d) low and high of the prior, in the scale of theta."""
    ends = []
    for name in law:
        values = answer.theta[:, answer.names.index(name)]
        searched = parameter_of(name).search_range or (float(np.min(values)) - 1.0, float(np.max(values)) + 1.0)
        ends.append(tuple(answer.prior.get(name, searched))[:2])
    return np.array(ends, dtype=float).T


def _resampled(sample: Draws, seed: int) -> Floats:
    """(_DRAWS, m) equally likely draws, in random order."""
    rng = np.random.Generator(np.random.Philox(seed).jumped())
    weight = relative_weights(sample.log_weight)
    places = (np.arange(_DRAWS) + rng.uniform()) / _DRAWS
    chosen = np.searchsorted(np.cumsum(weight) / np.sum(weight), places)
    return sample.u[rng.permutation(np.minimum(chosen, len(weight) - 1))]
