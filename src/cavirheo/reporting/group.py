"""The shots of one file or folder: their means, and whether a constant of the material changes with the bubble's size.

The slope d ln(value)/d ln R_max is that of Theil and Sen (Sen 1968, doi:10.1080/01621459.1968.10480934): it assumes
only that the scatter is the same at all sizes, and a few shots in a false mode hardly change it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.parameters import CAMERA, VISCOSITY_AT_RATE, parameter_of
from cavirheo.physics.bubble import title_of
from cavirheo.reporting.answer import Answer, CurveRecord, OtherModel, log_evidence_key
from cavirheo.reporting.material import KEYS, ParameterValues, PopulationRecord, size_trend_in_words
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity, Record, Spread, spread_of

MIN_SLOPE_SHOTS = 5  # least number of shots for a slope
MIN_SENSITIVITY = 3.0  # relative change of G over that of the scale, from which a remark is made
MAX_SLOPE_SHOTS = 1000  # most shots in a slope, which needs all pairs; of more shots every k-th by size is used
MATERIAL_CONSTANTS = ("viscosity", VISCOSITY_AT_RATE, "shear_modulus")
OUR_MEANS = "cavirheo"  # name of the means of this program beside the values of other methods
REFERENCE_METHODS = ("IMR", "rheometer")  # methods relative to which errors are given, by default
_EQUAL_LOG_RANGE = 1e-6  # range of the logarithm of values, below which they count as equal


class PublishedValue(Spread):
    """The value of a parameter by another method.

    Attributes:
        source: publication of the value; left out where it is not known.
    """

    source: str = ""
    _omitted_if_empty = ("source",)


Published = Mapping[str, Mapping[str, PublishedValue]]  # by method and parameter, SI


class Slope(Quantity):
    """The slope d ln(value)/d ln R_max of a parameter over the shots of a group.

    Attributes:
        median: median of the slopes of all pairs of shots.
        n: number of shots in the slope.
        n_trusted: number of these shots with a trusted verdict (`TRUSTED` of cavirheo.posterior).
    """

    n: int
    n_trusted: int = 0

    @property
    def words(self) -> str:
        """The slope with its interval: '2.4 [1.6, 3.1]'."""
        median, low, high = (number or 0.0 for number in (self.median, self.q05, self.q95))
        places = 1 if high - low > 1.0 else 2
        return f"{median:.{places}f} [{low:.{places}f}, {high:.{places}f}]"


class GroupModel(Record):
    """The answers of another model for the trusted shots of a group, each shot by itself.

    Attributes:
        material: name of the law.
        bubble: name of the bubble model.
        n: number of trusted shots with an answer of this model.
        shear_modulus_Pa: statistics of G, Pa, over the answers that determine it.
        viscosity_Pa_s: statistics of mu, Pa s, over the answers that determine it; for a law without a constant
            viscosity, of the viscosity at a shear rate of 1e5 1/s.
        log_evidence: log evidence of this model minus that of the answer, summed over the shots that have both; null
            where no shot has both.
        slopes: slopes over R_max by natural name; empty unless all shots of the group's slopes have an answer of this
            model.
    """

    material: str
    bubble: str
    n: int
    shear_modulus_Pa: Spread
    viscosity_Pa_s: Spread
    log_evidence: float | None = None
    slopes: dict[str, Slope] = {}

    @property
    def words(self) -> str:
        """Sentence: "with nhkv, field's bubble: G 6.5 ± 0.8 kPa; the evidence prefers it to the answer by ..."."""
        from cavirheo.inference.alternatives import equal_odds

        factor, unit = digits.modulus_unit([self.shear_modulus_Pa.mean])
        modulus = f"G {digits.spread(self.shear_modulus_Pa, factor)} {unit}"
        viscosity = f"µ {digits.spread(self.viscosity_Pa_s)} Pa s"
        values = [text for text in (modulus, viscosity) if digits.MISSING not in text]
        sentence = f"with {self.material}, {title_of(self.bubble)}: {', '.join(values) or 'nothing is determined'}"
        if self.log_evidence is None:
            return sentence
        if equal_odds(self.log_evidence):
            return f"{sentence}; as likely as the answer"
        preferred = "it to the answer" if self.log_evidence > 0 else "the answer"
        return f"{sentence}; the evidence prefers {preferred} by a factor of e^{abs(self.log_evidence):.0f}"

    @property
    def is_preferred(self) -> bool:
        """Whether the evidence of all shots together rejects the model of the answers in favour of this model."""
        from cavirheo.inference.alternatives import rejects

        return self.log_evidence is not None and rejects(self.log_evidence, [None] * self.n)


class GroupRecord(Record, ParameterValues[Spread]):
    """The shots of one file or folder, and their statistics.

    The statistics of each parameter are over the trusted shots that determine it. Slopes are over the same values; if
    there are fewer than 5 trusted shots, those with the verdict "does_not_fit" are included.

    Attributes:
        name: name of the file or folder.
        n: number of shots with an answer.
        n_trusted: number of shots with a trusted verdict ("ok" or "bound").
        n_failed: number of shots without an answer.
        verdicts: number of curves by verdict.
        models: number of trusted answers by model, "law, bubble".
        preferred: number of shots whose evidence prefers another model to that of the answer, by this other model in
            words; left out where there is none.
        slopes: slopes d ln(value)/d ln R_max of parameters that should not depend on R_max, by natural name.
        other_models: answers of other models for the trusted shots, such as the field's bubble beside the real one.
        population: the material of the shots, from their intervals; left out for a single shot, and where no shot has
            an interval.
        modulus_over_scale: relative change of G per relative change of R_max or of the frame rate, as the median over
            the trusted shots that determine G; half as large per relative change of the density. Left out where it is
            not known.
        published: values of other methods, by method and parameter, SI; left out unless they were given. The parameter
            viscosity_at_1_rad_per_s is the viscosity by a rheometer at this angular frequency.
        errors: |mean - mean of the reference| / mean of the reference, by reference, method ("cavirheo" for the means
            of this group) and parameter; left out where there is no reference.
    """

    name: str
    n: int
    n_trusted: int
    n_failed: int
    shear_modulus_Pa: Spread
    viscosity_Pa_s: Spread
    other_parameters: dict[str, Spread] = {}
    verdicts: dict[str, int]
    models: dict[str, int] = {}
    preferred: dict[str, int] = {}
    slopes: dict[str, Slope] = {}
    other_models: list[GroupModel] = []
    population: PopulationRecord | None = None
    modulus_over_scale: float | None = None
    published: dict[str, dict[str, PublishedValue]] = {}
    errors: dict[str, dict[str, dict[str, float]]] = {}
    _omitted_if_empty = ("preferred", "population", "modulus_over_scale", "published", "errors")

    @property
    def by_method(self) -> dict[str, Mapping[str, Spread]]:
        """Published values by method, then the means of this program if there are answered shots as well."""
        means = {name: self.value(name) for name in KEYS}
        return {**self.published, **({OUR_MEANS: means} if self.n and self.published else {})}

    def add_published(self, published: Published, references: Sequence[str] = REFERENCE_METHODS) -> None:
        """Add published values, and the errors of all methods relative to the reference methods."""
        self.published |= {method: dict(values) for method, values in published.items()}
        for reference in [name for name in references if self.published.get(name)]:
            expected, self.errors[reference] = self.published[reference], {}
            for method, values in self.by_method.items():
                errors = {name: error_of(value, expected.get(name, Spread())) for name, value in values.items()}
                finite_errors = {name: error for name, error in errors.items() if error is not None}
                if finite_errors and method != reference:
                    self.errors[reference][method] = finite_errors

    def mean(self, value: Spread, factor: float = 1.0) -> str:
        """Mean and deviation, '6.4 ± 1.6', or '0.041 ± 0.006 (n = 3)' if n is not `n_counted`."""
        fewer = value.mean is not None and value.n not in (None, self.n_counted)
        return digits.spread(value, factor) + (f" (n = {value.n})" if fewer else "")

    @property
    def remarks(self) -> list[str]:
        """Remarks on a preferred model, mixed models, slopes, how the scale changes G, and each other model."""
        lines = [self.warning] if self.warning and not self.material else []
        if len(self.models) > 1:
            models = ", ".join(f"{count} {model}" for model, count in self.models.items())
            lines.append(f"the means are over answers of different models: {models}")
        if self.slopes:
            lines.append(slopes_in_words(self.slopes))
        if abs(slope := self.modulus_over_scale or 0.0) >= MIN_SENSITIVITY:
            more = "1 % more in R_max or in the frame rate would change"
            lines.append(f"{more} G by {slope:+.0f} %, in the density by {slope / 2.0:+.0f} %")
        return lines + [model.words for model in self.other_models]

    @property
    def material(self) -> PopulationRecord | None:
        """The material of the shots; None if there is none."""
        return self.population if self.population and self.population.has_material else None

    @property
    def n_counted(self) -> int:
        """Number of shots in the material, or else in the means."""
        return self.material.n if self.material else self.n_trusted

    @property
    def counted_in_words(self) -> str:
        """How many shots count, as in the line of the material: '3 of 5 shots count'; "" if all do."""
        total = self.n + self.n_failed
        return "" if self.n_counted == total else digits.counted_shots(self.n_counted, total)

    @property
    def warning(self) -> str:
        """Warning 'the evidence prefers another model in 3 of 5 shots: nhkv, real bubble'; if it does in no single
        shot, a warning if the evidence of all shots together does; else ""."""
        if self.preferred:
            of = f"{sum(self.preferred.values())} of {digits.counted(self.n + self.n_failed, 'shot')}"
            return f"the evidence prefers another model in {of}: {' or '.join(self.preferred)}"
        models = " or ".join(self.jointly_preferred_models)
        return f"the evidence of all shots together prefers another model: {models}" if models else ""

    @property
    def jointly_preferred_models(self) -> list[str]:
        """Models that only the evidence of all shots together prefers, in words."""
        if self.preferred:
            return []
        return [f"{model.material}, {title_of(model.bubble)}" for model in self.other_models if model.is_preferred]

    @property
    def badges(self) -> list[tuple[str, str]]:
        """(verdict, words) for the count of each verdict."""
        return [(verdict, f"{n} {digits.VERDICT_WORDS[verdict]}") for verdict, n in self.verdicts.items()]

    @property
    def headline(self) -> str:
        """The line of the material for a paper, after the warning, if any; "" without a material."""
        return "; ".join(filter(None, [self.warning, self.material.line])) if self.material else ""


def error_of(value: Spread, reference: Spread) -> float | None:
    """|mean - mean of the reference| / mean of the reference; None where one of the two is not known."""
    if value.mean is None or not reference.mean:
        return None
    return abs(value.mean - reference.mean) / reference.mean


def spread_over(answers: Iterable[Answer], name: str) -> Spread:
    """Mean, deviation and median of a parameter over the answers that determine it."""
    return spread_of([answer.determined_median(name) for answer in answers])


def slope(radius: Sequence[float | None], values: Sequence[float | None], trusted: int = 0) -> Slope | None:
    """The slope over the shots with both numbers; None if these are too few, or all sizes or values are equal."""
    pairs = [(r, v) for r, v in zip(radius, values, strict=True) if r and v and v > 0]
    if len(pairs) < MIN_SLOPE_SHOTS:
        return None
    if len(pairs) > MAX_SLOPE_SHOTS:
        pairs = sorted(pairs)[:: -(-len(pairs) // MAX_SLOPE_SHOTS)]
    x, y = np.log(np.array(pairs)).T
    if min(np.ptp(x), np.ptp(y)) < _EQUAL_LOG_RANGE:
        return None
    median, low, high = theil_sen(x, y)
    return Slope(median=median, q05=low, q95=high, n=len(pairs), n_trusted=min(trusted, len(pairs)))


def shots_for_slope(members: Sequence[CurveRecord]) -> list[CurveRecord]:
    """The shots for a slope: the trusted ones; if these are too few, also those that the model does not fit."""
    trusted = [record for record in members if record.trusted]
    followed = [record for record in members if record.trusted or record.verdict == "does_not_fit"]
    return trusted if len(trusted) >= MIN_SLOPE_SHOTS else followed


def slopes(shots: Sequence[CurveRecord], answers: Sequence[Answer]) -> dict[str, Slope]:
    """Slopes of those MATERIAL_CONSTANTS that have one, by name, over these shots with one answer each."""
    radii, slopes = [record.max_radius_m for record in shots], dict[str, Slope]()
    for name in MATERIAL_CONSTANTS:
        values = [answer.value(name).determined_median for answer in answers]
        trusted = sum(shot.trusted and value is not None for shot, value in zip(shots, values, strict=True))
        if power := slope(radii, values, trusted):
            slopes[name] = power
    return slopes


def theil_sen(x: Floats, y: Floats) -> tuple[float, float, float]:
    """Median slope of all pairs, and the ends of its 90 % interval by Kendall's rank correlation; x and y: (n,).
    Same method as theilslopes of scipy.stats, whose import takes 20 MB and half a second."""
    from scipy.special import ndtri

    across = np.subtract.outer(x, x)
    slopes = np.sort(np.subtract.outer(y, y)[across > 0] / across[across > 0])
    ties = [np.unique(values, return_counts=True)[1] for values in (x, y)]
    n, *equal = ((k * (k - 1) * (2 * k + 5)).sum() for k in (np.array([len(x)]), *ties))
    half = -ndtri(0.05) * np.sqrt((n - sum(equal)) / 18)
    low = max(round((len(slopes) - half) / 2) - 1, 0)
    high = min(round((len(slopes) + half) / 2), len(slopes) - 1)
    return float(np.median(slopes)), float(slopes[low]), float(slopes[high])


def slopes_in_words(slopes: dict[str, Slope]) -> str:
    """One line on which parameters rise or fall with R_max, and which do not."""
    clauses = [size_trend_in_words(parameter_of(name).symbol, power, power.words) for name, power in slopes.items()]
    most = max(slopes.values(), key=lambda power: power.n)
    shots = f"{most.n} shots" + (f", {most.n_trusted} of them trusted" if most.n_trusted < most.n else "")
    wrong = ", and a constant should not: the law or the bubble may be wrong (by chance so in 1 group of 10)"
    return f"{', '.join(clauses)} over {shots}" + wrong * any(power.sign for power in slopes.values())


def group_record(name: str, members: list[CurveRecord], population: PopulationRecord | None = None) -> GroupRecord:
    """The record of a group, from the records of its curves and from its material."""
    trusted, followed = [record for record in members if record.trusted], shots_for_slope(members)
    n = sum(record.has_answer for record in members)
    more = dict.fromkeys(key for record in trusted for key in record.other_parameters if key not in CAMERA)
    firm = [record.diagnostics.modulus_over_scale for record in trusted if record.determined_median("shear_modulus")]
    return GroupRecord(
        name=name,
        n=n,
        n_trusted=len(trusted),
        n_failed=len(members) - n,
        **GroupRecord.fields_of({name: spread_over(trusted, name) for name in (*KEYS, *more)}),
        verdicts=dict(Counter(record.verdict for record in members)),
        models=dict(Counter(record.model for record in trusted)),
        preferred=dict(Counter(shot.model_title for record in members if (shot := record.preferred_model))),
        slopes=slopes(followed, followed),
        other_models=_other_models(trusted, followed),
        population=population,
        modulus_over_scale=spread_of(firm).median,
    )


def _other_models(trusted: list[CurveRecord], followed: list[CurveRecord]) -> list[GroupModel]:
    """A summary of each other model of the trusted shots; its slopes are over the shots of `followed`."""
    alternatives = [(record, _by_model(record.other_models)) for record in trusted]
    of_followed = [_by_model(record.other_models) for record in followed]
    summaries = []
    for model, first in _by_model(answer for _, models in alternatives for answer in models.values()).items():
        if {record.model for record in trusted} == {model}:  # another mode of the same model
            continue
        pairs = [(record, models[model]) for record, models in alternatives if model in models]
        answers = [answer for _, answer in pairs]
        logs = [(answer.log_evidence, record.evidence) for record, answer in pairs]
        gains = [log - evidence.log for log, evidence in logs if log is not None and evidence is not None]
        complete = all(model in models for models in of_followed)
        summary = GroupModel(
            material=first.material,
            bubble=first.bubble.name,
            n=len(pairs),
            shear_modulus_Pa=spread_over(answers, "shear_modulus"),
            viscosity_Pa_s=spread_of([answer.viscosity.determined_median for answer in answers]),
            log_evidence=float(np.sum(gains)) if gains else None,
            slopes=slopes(followed, [models[model] for models in of_followed]) if complete else {},
        )
        summaries.append(summary)
    return summaries


def _by_model(answers: Iterable[OtherModel]) -> dict[str, OtherModel]:
    """The answers by model; of several modes of a model, that with the largest evidence."""
    return {answer.model: answer for answer in sorted(answers, key=log_evidence_key)}
