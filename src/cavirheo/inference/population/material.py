"""The material of a group of shots: its values with their intervals, the scatter of its shots, and its line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.special import erf

from cavirheo.arrays import Floats, relative_scatter
from cavirheo.errors import require
from cavirheo.inference.population.hierarchy import SPREAD_SCALE
from cavirheo.inference.population.systematic import CommonErrors
from cavirheo.messages import Message
from cavirheo.parameters import Bound, matching, parameter_of, require_name
from cavirheo.physics.bubble import Bubble
from cavirheo.posterior import Heap, check_level, upper_limit
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity

_EMPTY = np.empty((0, 0))
HARDLY = 0.03  # decades: shots that scatter by less hardly scatter


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
        """Median of the material's parameter, SI. Raises InputError: as `draws`."""
        return float(np.median(self.draws(name)))

    def bound(self, name: str) -> Bound | None:
        """What is known of a parameter that the shots do not determine: "upper", "lower", "undetermined" or "wide", as
        `Posterior.bound`. None if its interval is inside the range and no wider than a factor of 10, and at least three
        shots, or as many as bound it, determine it by themselves; "wide", if the shots disagree (`heaps`). Raises
        InputError: as `draws`."""
        return "upper" if self._limit_of(name) is not None else self.bounds.get(self.names[self._column(name)])

    def quantity(self, name: str) -> Quantity:
        """Median, 90 % interval and bound of a parameter, SI; where the shots disagree, the ends of all of them. Raises
        InputError: as `draws`."""
        low, high = self.interval(name)
        if self._limit_of(name) is not None:
            return Quantity(q05=low, q95=high, bound="upper")
        if heaps := self.heaps.get(self.names[self._column(name)]):
            top = heaps[1].high or max(high, heaps[1].low or 0.0)
            return Quantity(q05=heaps[0].low or 0.0, q95=top, bound="wide")
        return Quantity(median=self.median(name), q05=low, q95=high, bound=self.bound(name))

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
        values = ", ".join(map(self._value, self.quantities))
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

    def _value(self, name: str) -> str:
        value = self.quantity(name)
        shown = digits.shown(name, value.largest)
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
            percents[parameter_of(name).symbol] = digits.significant(100 * relative_scatter(decades), 2)
        single = len(self.names) == 1 and not none
        within = ", ".join(f"{value} %" if single else f"{value} % in {symbol}" for symbol, value in percents.items())
        if none:
            limit = f" (they scatter by less than {within}: 95 %)" if within else ""
            return f"shots agree within their intervals{limit}"
        return f"shots scatter by {within}" if within else ""

    def against(self, other: Population) -> dict[str, tuple[Quantity, float]]:
        """(ratio of this material's value to the other's, probability that this one is larger) of each parameter that
        both determine; empty without draws.

        Both must have the same law and bubble. The errors that all shots share are left out, for both materials have
        them."""
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
