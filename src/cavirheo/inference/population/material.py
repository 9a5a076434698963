"""The material of a group of shots: its values with their intervals, which hold the errors that all shots share, the
scatter of its shots, and its line; and whether the shots disagree, so that their intervals fall into two heaps.

Errors of the radius scale, the frame rate, the density and the pressure each change t/t_c, and so all of them act as
one (docs/method/population.md). Two different errors of the scale are told apart. `radius_scale` of each shot
(experiment.py) is what differs from shot to shot, such as the focus and the fitted outline: it widens the interval of
each shot, and averages out over many. The errors here are one number for all shots, such as the micrometres per pixel:
no shot has them, and they do not average out. So nothing is counted twice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property

import numpy as np
from scipy.special import erf

from cavirheo.arrays import LN10, NORMAL_90, Floats, relative_scatter
from cavirheo.errors import InputError, require
from cavirheo.inference.population.hierarchy import SPREAD_SCALE
from cavirheo.messages import Message
from cavirheo.parameters import (
    DECIDING,
    VISCOSITY_AT_RATE,
    Bound,
    has_no_one_value,
    is_at_rate,
    matching,
    parameter_of,
    require_name,
)
from cavirheo.physics.bubble import Bubble
from cavirheo.physics.collapse import elastic_number
from cavirheo.posterior import Heap, Posterior, check_level, upper_limit, viscosity_at_rate
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity

_EMPTY = np.empty((0, 0))
HARDLY = 0.03  # decades: shots that scatter by less hardly scatter
FEWEST = 2  # shots in a heap
LEAST_SHARE = 0.2  # of the shots in the smaller heap: fewer are outliers
APART = 0.3  # decades between the middles of the heaps
CLEAR = 4.0  # this distance over the deviation of a shot within its heap
_STREAM = 7  # of the random draws of the errors


@dataclass(frozen=True)
class CommonErrors:
    """Relative standard deviations of the errors that all shots of a group share.

    Attributes:
        scale: of the radius (micrometres per pixel).
        rate: of the frame rate.
        density: of the medium.
        pressure: far from the bubble.

    Raises:
        InputError: a number below 0, or above 0.2.
    """

    scale: float = 0.01
    rate: float = 0.001
    density: float = 0.01
    pressure: float = 0.01

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            message = f"the {name} error is a relative standard deviation from 0 to 0.2, got {value!r}"
            require(isinstance(value, int | float) and 0.0 <= value <= 0.2, message, f"option.{name}_error")


@dataclass(frozen=True, eq=False, repr=False)
class Population:
    """The material of n shots. If it failed, it has no draws, and `warnings` say why.

    Attributes:
        names: the law's parameters, "shear_modulus", ...
        material: the law.
        bubble: the model of the bubble.
        shots: names of those that count.
        left_out: number of shots that do not count, by reason: their verdict, "no_interval", "other_switches" (it
            excludes those of the group), "other_model" or "copy".
        warnings: what a user must know before using it.
        centre: (draws, d) log10 of the material's parameters, SI, with the errors that all shots share.
        statistical: (draws, d) the same without these errors.
        spread: (draws, d) standard deviation of the shots about the centre, decades.
        outlier_probability: (n,) probability that a shot is an outlier.
        bounds: what is known of each parameter, if the shots do not determine it.
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
    outlier_probability: Floats = field(default_factory=lambda: np.empty(0))
    bounds: Mapping[str, Bound | None] = field(default_factory=dict)
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

    def _limit_of(self, name: str) -> float | None:
        """`modulus_limit`, if the parameter is G."""
        return None if matching(name, ["shear_modulus"]) is None else self.modulus_limit

    def draws(self, name: str) -> Floats:
        """(draws,) equally likely values of the material's parameter, SI: of "G" or "shear_modulus" in Pa, ... Raises
        InputError: no such parameter, or no draws."""
        return np.asarray(10.0 ** self.centre[:, self._column(name)])

    @property
    def quantities(self) -> list[str]:
        """The law's parameters, and G where it has a limit alone."""
        limited = ["shear_modulus"] if self.modulus_limit is not None else []
        return [*dict.fromkeys([*limited, *self.names])]

    @cached_property
    def viscosity_at_rate(self) -> Quantity | None:
        """The viscosity at 1e5 1/s, Pa s, of a law that has none of its own; None, too, where the shots disagree too
        much in a parameter."""
        if any(map(self._disagree_in, self.names)):
            return None
        return viscosity_at_rate(self.material, {name: self.draws(name) for name in self.names if len(self.centre)})

    def _disagree_in(self, name: str) -> bool:
        """Whether the shots are two heaps in a parameter, or scatter too much for one value."""
        scatter = relative_scatter(self.scatter(name)[1]) if len(self.centre) else 0.0
        return name in self.heaps or has_no_one_value(scatter, agree=self.agree)

    def interval(self, name: str, level: float = 0.9) -> tuple[float, float]:
        """Central interval of the material's parameter with the probability `level`, SI; of a G with a limit 0 and the
        limit, of other upper bounds as `upper_limit`. Raises InputError: as `draws`, or the level is not between 0 and
        1."""
        check_level(level)
        if (limit := self._limit_of(name)) is not None:
            return 0.0, limit
        values = self.draws(name)
        low, _, high = quantiles(values, level)
        return low, upper_limit(values, 0.5 + 0.5 * level) if self.bound(name) == "upper" else high

    def median(self, name: str) -> float:
        """Median of the material's parameter, SI; NaN where `quantity` has none, as for a bound. Raises InputError: as
        `draws`."""
        middle = self.quantity(name).median
        return np.nan if middle is None else middle

    def bound(self, name: str) -> Bound | None:
        """What is known of a parameter that the shots do not determine: "upper", "lower", "undetermined" or "wide", as
        `Posterior.bound`. None if its interval is inside the range and no wider than a factor of 10, and at least three
        shots, or as many as bound it, determine it by themselves; "wide", if the shots disagree (`heaps`). Raises
        InputError: as `draws`."""
        return "upper" if self._limit_of(name) is not None else self.bounds.get(self.names[self._column(name)])

    def quantity(self, name: str) -> Quantity:
        """Median, 90 % interval and bound of a parameter, SI; where the shots disagree, the ends of all of them, and
        where they scatter too much for one value of G or of a viscosity no median. Raises InputError: as `draws`."""
        low, high = self.interval(name)
        if self._limit_of(name) is not None:
            return Quantity(q05=low, q95=high, bound="upper")
        if heaps := self.heaps.get(self.names[self._column(name)]):
            top = heaps[1].high or max(high, heaps[1].low or 0.0)
            return Quantity(q05=heaps[0].low or 0.0, q95=top, bound="wide")
        bound, known = self.bound(name), self.names[self._column(name)]
        if bound is None and known in DECIDING and self._disagree_in(known):
            return Quantity(q05=low, q95=high, bound="wide")
        return Quantity(median=np.median(self.draws(name)), q05=low, q95=high, bound=bound)

    def statistical_interval(self, name: str, level: float = 0.9) -> tuple[float, float]:
        """(low, high) of the material's parameter, SI, without the errors that all shots share. Raises InputError: as
        `interval`."""
        check_level(level)
        low, _, high = quantiles(10.0 ** self.statistical[:, self._column(name)], level)
        return low, high

    @property
    def determined(self) -> list[str]:
        """Parameters that the shots determine and do not only bound; none without draws."""
        return [name for name in self.names if len(self.centre) and self.bound(name) is None]

    def scatter(self, name: str, level: float = 0.9) -> tuple[float, float, float]:
        """(low, median, high) of the standard deviation of the shots about the material, decades. Raises
        InputError: as `draws`."""
        check_level(level)
        return quantiles(self.spread[:, self._column(name)], level)

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
    def line(self) -> str:
        """'G = 5.8 kPa (90 %: 5.1 to 6.6); shots scatter by 12 % in G; 8 of 9 shots count, 1 of them seems to be of
        another material'."""
        if not len(self.centre):
            return "no material: " + "; ".join(self.warnings)
        values = ", ".join(self._value(name, self.quantity(name)) for name in self.quantities)
        if self.viscosity_at_rate:
            values += f", {self._value(VISCOSITY_AT_RATE, self.viscosity_at_rate)}"
        count = digits.counted_shots(len(self.shots), len(self.shots) + sum(self.left_out.values()))
        if away := len(self.outliers):
            count += f", {away} of them {'seems' if away == 1 else 'seem'} to be of another material"
        return "; ".join(filter(None, [values, self._scatter_in_words(), count]))

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

    def _value(self, name: str, value: Quantity) -> str:
        at_rate = is_at_rate(self.material, self.names, self.switches.get("thinning", 0.0))
        shown = digits.shown(VISCOSITY_AT_RATE if at_rate and name == "viscosity" else name, value.largest)
        if name in self.names and self._disagree_in(name):
            return f"no one value of {shown.symbol}"
        if value.bound:
            return shown.named(value)
        middle, interval = shown.parts(value)
        return f"{shown.symbol} = {f'{middle} {shown.unit}'.rstrip()} (90 %: {interval})"

    def _scatter_in_words(self) -> str:
        """The scatter of the parameters that are determined; that of others is not known."""
        none = self.agree
        percents = {}
        for name in self.determined:
            decades = self.scatter(name)[2 if none else 1]
            percents[parameter_of(name).symbol] = digits.percent(relative_scatter(decades))
        single = len(self.names) == 1 and not none
        within = ", ".join(f"{value} %" if single else f"{value} % in {symbol}" for symbol, value in percents.items())
        if none:
            limit = f" (they scatter by less than {within}: 95 %)" if within else ""
            return f"shots agree within their intervals{limit}"
        return f"shots scatter by {within}" if within else ""

    def comparable(self, other: Population) -> bool:
        """Whether both are of one law and bubble; a liquid that thins compares with one that does not."""
        liquids = {self.material, other.material} == {"newtonian", "power-law"}
        return self.bubble == other.bubble and (liquids or self.material == other.material)

    def against(self, other: Population) -> dict[str, tuple[Quantity, float]]:
        """(ratio of this material's value to the other's, probability that this one is larger) of each parameter that
        both determine; empty without draws. The errors that all shots share are left out, for both materials have them.
        Raises InputError: laws or bubbles differ (`comparable`)."""
        if not self.comparable(other):
            models = f"{self.material} ({self.bubble.name}) and {other.material} ({other.bubble.name})"
            raise InputError(f"materials of one law and bubble have a ratio, got {models}", "population.models")
        ratios = {}
        for name in (name for name in self.determined if name in other.determined):
            difference = self.statistical[:, self._column(name)] - other.statistical[:, other._column(name)]
            ratio = Quantity.from_interval(*quantiles(10.0**difference, 0.9))
            ratios[name] = ratio, float(np.mean(difference > 0))
        return ratios


def quantiles(values: Floats, level: float) -> tuple[float, float, float]:
    """The ends and the middle of the central interval with this probability: (low, median, high) of values (k,)."""
    low, middle, high = np.quantile(values, [(1.0 - level) / 2.0, 0.5, (1.0 + level) / 2.0]).tolist()
    return low, middle, high


def two_heaps(answers: Sequence[Posterior], shots: Sequence[str], name: str) -> tuple[Heap, Heap] | None:
    """The two heaps into which the intervals of a parameter (natural name) fall, the lower one first; None if they do
    not: no interval of one reaches one of the other, and the heaps are clearly farther apart than they are wide.

    A heap of bounds alone is taken at the limit that is nearest to the other heap. A bound that reaches over the gap,
    so that its shot may belong to either heap, is in none."""
    known, ends = _intervals(answers, shots, name)
    fewest = max(FEWEST, int(np.ceil(LEAST_SHARE * len(known))))
    valued = np.all(np.isfinite(ends), axis=1)
    halves = 0.5 * np.diff(ends[valued], axis=1)
    own = float(np.median(halves)) / NORMAL_90 if len(halves) else 0.0
    best, most = None, 0
    for gap in np.unique(ends[np.isfinite(ends[:, 1]), 1]):
        low, high = ends[:, 1] <= gap, ends[:, 0] > gap
        inside = int(np.count_nonzero(low | high))
        if min(np.count_nonzero(low), np.count_nonzero(high)) < fewest or np.any(valued & ~low & ~high):
            continue
        below, above = ends[low & valued].mean(axis=1), ends[high & valued].mean(axis=1)
        off = np.concatenate([part - np.mean(part) for part in (below, above) if len(part)] or [below])
        free = max(len(off) - bool(len(below)) - bool(len(above)), 1)
        width = float(np.hypot(np.linalg.norm(off) / np.sqrt(free), own))
        bottom = np.mean(below) if len(below) else np.max(ends[low, 1])
        top = np.mean(above) if len(above) else np.min(ends[high, 0])
        if inside > most and top - bottom > max(APART, CLEAR * width):
            first, second = ([known[i] for i in np.flatnonzero(heap)] for heap in (low, high))
            best, most = (_heap(first, ends[low]), _heap(second, ends[high])), inside
    return best


def _intervals(answers: Sequence[Posterior], shots: Sequence[str], name: str) -> tuple[list[str], Floats]:
    """Names of the shots that determine a parameter, or bound it on one side, and (n, 2) log10 of the ends; infinite
    where there is a bound alone."""
    known, ends = [], []
    for answer, shot in zip(answers, shots, strict=True):
        interval, bound = answer.interval(name), answer.bound(name)
        if interval is None or bound in ("undetermined", "wide") or interval[1] <= 0.0:
            continue
        low = -np.inf if bound == "upper" or interval[0] <= 0.0 else float(np.log10(interval[0]))
        high = np.inf if bound == "lower" else float(np.log10(interval[1]))
        known.append(shot)
        ends.append((low, high))
    return known, np.array(ends, dtype=float).reshape(-1, 2)


def _heap(shots: Sequence[str], ends: Floats) -> Heap:
    lows, highs = (values[np.isfinite(values)] for values in ends.T)
    low = float(10.0 ** np.min(lows)) if len(lows) else None
    high = float(10.0 ** np.max(highs)) if len(highs) else None
    return Heap(tuple(shots), low, high)


def widened_limit(limit: float, errors: CommonErrors, pressure: float, stretch: float) -> float:
    """A 95 % limit of G, Pa, that statistics give, together with the G of a gel that looks like a liquid with a
    probability of 5 % because of these errors. The first collapse of a gel comes sqrt(1 + Be G/p) times earlier than
    that of a liquid; a relative error e of this ratio, which is that of R_max, of the rate, or half of that of density
    or pressure, moves G by 2 e p/Be."""
    halved = 0.5 * np.hypot(errors.density, errors.pressure)
    ratio = float(np.sqrt(errors.scale**2 + errors.rate**2 + halved**2))
    hidden = NORMAL_90 * 2.0 * ratio * pressure / float(elastic_number(stretch))
    return float(np.hypot(limit, hidden))


def slopes(name: str, over_scale: float) -> dict[str, float]:
    """Relative change of a parameter, by its natural name, per relative change of what `CommonErrors` names, from that
    per relative change of R_max. The rate changes the unit of times, the pressure that of stresses."""
    units = parameter_of(name).unit.split()
    rate, pressure = over_scale - ("s" in units), ("Pa" in units) - 0.5 * over_scale
    return {"scale": over_scale, "rate": rate, "density": 0.5 * over_scale, "pressure": pressure}


def widened(
    interval: tuple[float, float, float], by_error: Mapping[str, float], errors: CommonErrors
) -> tuple[float, float]:
    """Ends of the 90 % interval of one shot, given as (5 %, 50 %, 95 %) without these errors, with them. by_error: as
    `slopes`. In the logarithm the errors are normal, and the sides of the interval as those of normal distributions."""
    low, middle, high = interval
    common = NORMAL_90 * float(np.linalg.norm([by_error[name] * error for name, error in asdict(errors).items()]))
    below, above = np.hypot(np.log([middle / low, high / middle]), common).tolist()
    return middle / float(np.exp(below)), middle * float(np.exp(above))


def shifts(names: Sequence[str], over: Mapping[str, float], errors: CommonErrors, draws: int, seed: int) -> Floats:
    """(draws, d) log10 of the factor by which errors drawn from their priors change each parameter, all by the same
    errors; 0 for a parameter whose slope is not known."""
    rng = np.random.Generator(np.random.Philox(seed).jumped(_STREAM))
    deviations = asdict(errors)
    drawn = rng.standard_normal((draws, len(deviations))) * [*deviations.values()]
    changes = np.zeros((len(deviations), len(names)))
    for k, name in enumerate(names):
        if name in over:
            by_error = slopes(name, over[name])
            changes[:, k] = [by_error[error] for error in deviations]
    return np.asarray(drawn @ changes / LN10)
