"""The material of a group's shots as result.json holds it: one line for a paper, then the numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.parameters import VISCOSITY_AT_RATE
from cavirheo.posterior import Heap, Posterior
from cavirheo.writing import digits
from cavirheo.writing.document import Finite, Quantity, Record

if TYPE_CHECKING:
    from cavirheo.inference.population import CommonErrors, Population

MAIN_FIELDS = {"shear_modulus": "shear_modulus_Pa", "viscosity": "viscosity_Pa_s"}  # fields of documents, by parameter
_MAX_FLAT_POWER = 1.0  # power of R_max: an interval within +-1 shows no change with R_max; a wider one does not decide
_TREND_VERBS = {1: "rises", -1: "falls", 0: "may or may not change"}  # by the sign of a slope
WIDE_SCATTER = 0.4  # standard deviation from shot to shot over the material; one batch of gel has less
_MAX_COMPARED = 6  # most groups that are compared, each with each


class ParameterValues(Record):
    """A record with parameters: those of `_keys` are fields, all others are in `other_parameters`.

    Attributes:
        shear_modulus_Pa: shear modulus G, Pa.
        viscosity_Pa_s: viscosity mu, Pa s; its values are null for a law without a constant viscosity.
        other_parameters: all other parameters by natural name, SI.
    """

    shear_modulus_Pa: Quantity = Quantity()
    viscosity_Pa_s: Quantity = Quantity()
    other_parameters: dict[str, Quantity] = {}
    _keys: ClassVar[Mapping[str, str]] = MAIN_FIELDS

    @classmethod
    def fields_of(cls, values: Mapping[str, Quantity]) -> dict[str, Any]:
        """The fields of a record that hold these parameters."""
        standard = {key: values[name] for name, key in cls._keys.items() if name in values}
        further = {name: value for name, value in values.items() if name not in cls._keys}
        return {**standard, "other_parameters": further}

    def value(self, name: str) -> Quantity:
        """The value of a parameter by its natural name; an empty one if there is none."""
        if key := self._keys.get(name):
            return getattr(self, key)
        return self.other_parameters.get(name, Quantity())

    @property
    def viscosity(self) -> Quantity:
        """The viscosity, or that at 1e5 1/s of a law without a constant viscosity."""
        return self.viscosity_Pa_s if self.viscosity_Pa_s.known else self.value(VISCOSITY_AT_RATE)


def log_ends(values: Iterable[Quantity]) -> Floats:
    """(n, 3) log10 of q05, median and q95, SI; NaN where there is none. The middle of a wide interval is its median."""
    values = list(values)
    ends = np.array([[value.q05, value.median, value.q95] for value in values], dtype=float).reshape(-1, 3)
    logs = np.log10(np.where(ends > 0, ends, np.nan))
    wide = [value.bound == "wide" for value in values]
    logs[wide, 1] = 0.5 * (logs[wide, 0] + logs[wide, 2])
    return np.asarray(logs)


class Systematic(Record):
    """What errors that all shots of a group share do to its answer.

    Attributes:
        errors: relative standard deviations of the errors: "scale" of the radius, "rate" of the frames, "density" and
            "pressure" of the medium.
        slopes: relative change of a parameter per relative change of each of these, by natural name.
        statistics: the answer without these errors, by natural name, SI; the interval in the population has them.
    """

    errors: dict[str, float] = {}
    slopes: dict[str, dict[str, float]] = {}
    statistics: dict[str, Quantity] = {}


class PopulationRecord(ParameterValues):
    """The material of n shots. Without a material, the parameters are null, and `line` says why.

    Attributes:
        line: the material in a sentence, for a paper; or why there is none.
        model: law and name of the bubble model, "nhkv, real".
        n: number of shots that count.
        switches: probability of each switch of the default family, by all shots together; left out for other laws.
        heaps: the two heaps into which the shots fall in a parameter in which they disagree, by natural name; left out
            where there are none.
        spreads_decades: standard deviation of the shots about the material in each parameter, decades (log10), by
            natural name.
        correlation: correlation coefficients of the scatter of the shots, by "name, name".
        outliers: probability that a shot is of another material, by the name of the shot; for shots above 0.5.
        left_out: number of shots that do not count, by reason: their verdict, "no_interval", "no_column_value",
            "other_model" or "copy".
        log_evidence: log evidence of the law for all these shots, with one material and its scatter; null where a shot
            has none.
        log_evidence_error: standard error of log_evidence.
        agree: whether the shots differ by no more than their intervals.
        column: title of the declared column with which the material may change; left out where there is none.
        column_at: value of the column at which the parameters are given; left out where there is no column.
        slopes_decades: slope of each parameter along the column, decades per unit of the column, by natural name; left
            out where there is no column.
    """

    line: str = ""
    model: str = ""
    n: int = 0
    switches: dict[str, float] = {}
    heaps: dict[str, tuple[Heap, Heap]] = {}
    spreads_decades: dict[str, Quantity] = {}
    correlation: dict[str, Quantity] = {}
    outliers: dict[str, float] = {}
    left_out: dict[str, int] = {}
    log_evidence: Finite = None
    log_evidence_error: Finite = None
    agree: bool = False
    column: str = ""
    column_at: Finite = None
    slopes_decades: dict[str, Quantity] = {}
    _omitted_if_empty = ("switches", "heaps", "column", "column_at", "slopes_decades")

    @property
    def has_material(self) -> bool:
        """Whether there is a material; if not, the line says why."""
        return bool(self.spreads_decades)

    @property
    def wide_scatters(self) -> dict[str, float]:
        """Standard deviation of the shots over the material, by parameter in which they scatter more than one batch of
        gel does and than their intervals explain, and are no two heaps."""
        from cavirheo.inference.population import relative_scatter

        spreads = {} if self.agree else self.spreads_decades
        scatters = {name: relative_scatter(spreads[name].median or 0.0) for name in MAIN_FIELDS if name in spreads}
        return {name: size for name, size in scatters.items() if size > WIDE_SCATTER and name not in self.heaps}


class MaterialRatio(Record):
    """A parameter of the material of the first group over that of the second (`Difference` in inference/population).

    Attributes:
        first: name of the group whose value is the numerator.
        second: name of the group whose value is the denominator.
        parameter: natural name.
        ratio: value of the first material over that of the second.
        probability_higher: probability that the value of the first material is larger.
        probability_differs: probability of two materials against one, if both are equally likely in advance, and two
            materials are a factor of about 2 apart.
    """

    first: str
    second: str
    parameter: str
    ratio: Quantity
    probability_higher: float
    probability_differs: float

    @property
    def words(self) -> str:
        """'gel B over gel A: G 1.32 (1.05 to 1.65), larger with probability 0.98'."""
        higher = self.probability_higher
        way, probability = ("larger", higher) if higher >= 0.5 else ("smaller", 1.0 - higher)
        probable = "> 0.99" if probability > 0.99 else f"{probability:.2f}"
        ratio = f"{digits.symbol_and_unit(self.parameter)[0]} {digits.quantity(self.ratio)}"
        return f"{self.first} over {self.second}: {ratio}, {way} with probability {probable}"


def material_of(
    answers: tuple[Posterior, ...],
    names: tuple[str, ...],
    along: tuple[float, ...] | None = None,
    errors: CommonErrors | None = None,
) -> Population | None:
    """The population of a group by `with_slope_if_any`, with these common errors; None for a single shot, or if no shot
    has an interval."""
    if len(answers) < 2 or all(len(answer.theta) < 2 for answer in answers):
        return None
    from cavirheo.inference.population import with_slope_if_any

    return with_slope_if_any(answers, names, along, errors=errors)


cached_material_of = lru_cache(maxsize=8)(material_of)  # in a watched folder each new shot writes all groups again


def population_record(population: Population | None, column: str = "") -> PopulationRecord:
    """The record of a population for a document. column: title of the column along which it has a slope."""
    if population is None:
        return PopulationRecord()
    fields: dict[str, Any] = {name: getattr(population, name) for name in ("line", "outliers", "left_out")}
    fields |= {"model": f"{population.material}, {population.bubble.name}", "n": len(population.shots)}
    fields |= {"switches": dict(population.switches), "heaps": dict(population.heaps)}
    if not len(population.centre):
        return PopulationRecord(**fields)

    def each(of: Callable[[str], tuple[float, float, float]]) -> dict[str, Quantity]:
        return {name: Quantity.from_interval(*of(name)) for name in population.names}

    evidence = population.evidence
    if population.slope is not None:
        slopes = each(population.trend)
        fields |= {"column": column, "column_at": population.along_at, "slopes_decades": slopes}
    return PopulationRecord(
        **fields,
        **PopulationRecord.fields_of({name: population.quantity(name) for name in population.quantities}),
        spreads_decades=each(population.scatter),
        correlation={pair: Quantity.from_interval(*interval) for pair, interval in population.correlations().items()},
        log_evidence=evidence.log if evidence else None,
        log_evidence_error=evidence.error if evidence else None,
        agree=population.agree,
    )


def systematic_of(population: Population | None) -> Systematic:
    """What common errors do to a population; empty where it has no draws, or where that is not known."""
    if population is None or not len(population.centre) or not population.over_scale:
        return Systematic()
    from cavirheo.inference.population.systematic import slopes

    names = [name for name in population.over_scale if population.bound(name) is None]
    statistics = {}
    for name in names:
        low, high = population.statistical_interval(name)
        statistics[name] = Quantity(median=population.quantity(name).median, q05=low, q95=high)
    return Systematic(
        errors=asdict(population.errors),
        slopes={name: slopes(name, population.over_scale[name]) for name in names},
        statistics=statistics,
    )


def slopes_in_words(column: str, at: float, slopes: Mapping[str, Quantity]) -> str:
    """The slopes in words: 'along concentration, decades per unit: G rises 0.20 (0.15 to 0.25); the material is that at
    concentration = 3'. Along R_max they are powers of it."""
    from cavirheo.column import LOG_R_MAX

    along, place = f"along {column}, decades per unit", f"{column} = {digits.significant(at)}"
    if column == LOG_R_MAX:
        along, place = "over R_max, as a power of it", f"R_max = {digits.micrometres(1e-6 * 10.0**at)} µm"
    clauses = []
    for name, slope in slopes.items():
        verb = _TREND_VERBS[slope.sign]
        if column == LOG_R_MAX and not slope.sign and max(-(slope.q05 or 0.0), slope.q95 or 0.0) < _MAX_FLAT_POWER:
            verb = "shows no change"
        clauses.append(f"{digits.symbol_and_unit(name)[0]} {verb}, {digits.quantity(slope)}")
    return f"{along}: {'; '.join(clauses)}; the material is that at {place}"


def differences(materials: Mapping[str, Population | None]) -> list[MaterialRatio]:
    """Ratios of each two of the first _MAX_COMPARED materials with the same model."""
    whole = [(name, population) for name, population in materials.items() if population and len(population.centre)]
    records = []
    for (earlier, population), (later, second) in combinations(whole[:_MAX_COMPARED], 2):
        if (population.material, population.bubble) == (second.material, second.bubble):
            for name, difference in second.against(population).items():
                ratio = {**difference._asdict(), "ratio": Quantity.from_interval(*difference.ratio)}
                records.append(MaterialRatio(first=later, second=earlier, parameter=name, **ratio))
    return records
