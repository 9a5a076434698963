"""The shots of one file or folder: the answer for their material, its verdict, and what a user must know of it.

The verdict of a group obeys its rows. The slope d ln(value)/d ln R_max is that of Theil and Sen (Sen 1968,
doi:10.1080/01621459.1968.10480934): it assumes only that the scatter is the same at all sizes, and a few shots in a
false mode hardly change it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.messages import Message, title
from cavirheo.parameters import CAMERA, VISCOSITY_AT_RATE, is_law_parameter, parameter_of
from cavirheo.posterior import Verdict
from cavirheo.reporting.answer import CurveRecord, OtherModel, Sentence, log_evidence_key
from cavirheo.reporting.material import (
    KEYS,
    PopulationRecord,
    Systematic,
    size_trend_in_words,
)
from cavirheo.writing.document import Quantity, Record, Spread

MIN_SLOPE_SHOTS = 5  # least number of shots for a slope
MAX_SLOPE_SHOTS = 1000  # most shots in a slope, which needs all pairs; of more shots every k-th by size is used
MATERIAL_CONSTANTS = ("viscosity", VISCOSITY_AT_RATE, "shear_modulus")
OUR_METHOD = "cavirheo"  # name of the answers of this program beside the values of other methods
REFERENCE_METHODS = ("IMR", "rheometer")  # methods relative to which errors are given, by default
MOST = 0.5  # share of the shots of a group, above which they decide its verdict
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
        n_trusted: number of these shots that count.
    """

    n: int
    n_trusted: int = 0

    @property
    def words(self) -> str:
        """The slope with its interval: '2.4 [1.6, 3.1]'."""
        median, low, high = (number or 0.0 for number in (self.median, self.q05, self.q95))
        places = 1 if high - low > 1.0 else 2
        return f"{median:.{places}f} [{low:.{places}f}, {high:.{places}f}]"


class GroupRecord(Record):
    """The shots of one file or folder, and the answer for their material.

    Slopes are over the shots that count and determine the parameter; if there are fewer than 5, those with the verdict
    "does_not_fit" are included.

    Attributes:
        name: name of the file or folder.
        n: number of shots with an answer.
        n_counted: number of shots that count in the answer.
        n_failed: number of shots without an answer.
        population: the answer for the material; of a single shot that counts, its own answer. Left out where there is
            none.
        systematic: what errors that all shots share do to it; left out where that is not known.
        verdict: "ok", or what is wrong (docs/method/verdicts.md).
        messages: reasons for the verdict first, then remarks.
        verdicts: number of curves by verdict.
        slopes: slopes d ln(value)/d ln R_max of parameters that should not depend on R_max, by natural name.
        published: values of other methods, by method and parameter, SI; left out unless they were given. The parameter
            viscosity_at_1_rad_per_s is the viscosity by a rheometer at this angular frequency.
        errors: |value - mean of the reference| / mean of the reference, by reference, method ("cavirheo" for the answer
            of this group) and parameter; left out where there is no reference.
    """

    name: str
    n: int
    n_counted: int
    n_failed: int
    population: PopulationRecord | None = None
    systematic: Systematic | None = None
    verdict: Verdict
    messages: list[Sentence] = []
    verdicts: dict[str, int]
    slopes: dict[str, Slope] = {}
    published: dict[str, dict[str, PublishedValue]] = {}
    errors: dict[str, dict[str, dict[str, float]]] = {}
    _omitted_if_empty = ("population", "systematic", "published", "errors")

    def value(self, name: str) -> Quantity:
        """The group's answer for a parameter by its natural name; an empty one if there is none."""
        return self.population.value(name) if self.population else Quantity()

    @property
    def viscosity(self) -> Quantity:
        """The viscosity, or that at 1e5 1/s of a law without a constant viscosity."""
        return self.population.viscosity if self.population else Quantity()

    @property
    def has_answer(self) -> bool:
        """Whether any parameter of the material has a value or a bound."""
        return any(self.value(name).known for name in KEYS) or self.viscosity.known

    @property
    def material(self) -> PopulationRecord | None:
        """The population of several shots; None if there is none."""
        return self.population if self.population and self.population.has_material else None

    @property
    def heaps(self) -> dict[str, list[tuple[float | None, float | None, list[str]]]]:
        """(low, high, shots) of each of two heaps into which the shots fall, by parameter in which they disagree."""
        heaps = self.population.heaps if self.population else {}
        return {name: [(heap.low, heap.high, heap.shots) for heap in parts] for name, parts in heaps.items()}

    @property
    def doubts(self) -> list[Sentence]:
        """The messages because of which no line of this group is to be used without a second look."""
        return [message for message in self.messages if message.code.startswith("group.doubt.")]

    @property
    def remarks(self) -> list[str]:
        """All messages, then the remarks on the population, as sentences."""
        of_population = self.population.remarks if self.population else []
        return [message.text for message in self.messages] + of_population

    def add_published(self, published: Published) -> None:
        """Add published values, and the errors of all methods relative to the reference methods."""
        self.published |= {method: dict(values) for method, values in published.items()}
        for reference in [name for name in REFERENCE_METHODS if self.published.get(name)]:
            expected, self.errors[reference] = self.published[reference], {}
            numbers = {
                method: {name: value.mean for name, value in values.items()}
                for method, values in self.published.items()
            }
            numbers[OUR_METHOD] = {name: self.value(name).median for name in KEYS}
            for method, values in numbers.items():
                errors = {
                    name: error_of(number, expected[name].mean) for name, number in values.items() if name in expected
                }
                finite_errors = {name: error for name, error in errors.items() if error is not None}
                if finite_errors and method != reference:
                    self.errors[reference][method] = finite_errors


def error_of(value: float | None, reference: float | None) -> float | None:
    """|value - reference| / reference; None where one of the two is not known."""
    if value is None or not reference:
        return None
    return abs(value - reference) / reference


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


def slopes(shots: Sequence[CurveRecord]) -> dict[str, Slope]:
    """Slopes of those MATERIAL_CONSTANTS that have one, by name, over these shots."""
    radii, slopes = [record.max_radius_m for record in shots], dict[str, Slope]()
    for name in MATERIAL_CONSTANTS:
        values = [shot.value(name).median for shot in shots]
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


def slopes_in_words(slopes: Mapping[str, Slope]) -> str:
    """One line on which parameters rise or fall with R_max, and which do not."""
    clauses = [size_trend_in_words(parameter_of(name).symbol, power, power.words) for name, power in slopes.items()]
    most = max(slopes.values(), key=lambda power: power.n)
    shots = f"{most.n} shots" + (f", {most.n_trusted} of which count" if most.n_trusted < most.n else "")
    line = f"{', '.join(clauses)} over {shots}"
    if any(power.sign for power in slopes.values()):
        return f"{line}, and a constant should not: the law or the bubble may be wrong (by chance so in 1 group of 10)"
    return line


def group_record(
    name: str,
    members: Sequence[CurveRecord],
    population: PopulationRecord | None = None,
    systematic: Systematic | None = None,
) -> GroupRecord:
    """The record of a group, from the records of its curves and from its material."""
    answered = [record for record in members if record.has_answer]
    followed = shots_for_slope(members)
    if len(members) == 1 and members[0].verdict in ("ok", "bound", "unverified"):
        population = _of_one_shot(members[0])
    powers = slopes(followed)
    doubts = _doubts(answered, population)
    facts = [*_not_given(answered), *_rivals(answered), *_sensitivity(systematic), *_trends(powers)]
    return GroupRecord(
        name=name,
        n=len(answered),
        n_counted=population.n if population else sum(record.trusted for record in members),
        n_failed=len(members) - len(answered),
        population=population,
        systematic=systematic,
        verdict=_verdict(answered, doubts, population),
        messages=[Sentence(code=message.code, text=message.text) for message in (*doubts, *facts)],
        verdicts=dict(Counter(record.verdict for record in members)),
        slopes=powers,
    )


def _of_one_shot(row: CurveRecord) -> PopulationRecord:
    """The answer of a single shot as that of its group."""
    names = [name for name in (*KEYS, *row.other_parameters) if name in KEYS or is_law_parameter(name)]
    values = {name: row.value(name) for name in names}
    return PopulationRecord(
        line="a single shot", model=row.model, n=1, switches=row.switches, **PopulationRecord.fields_of(values)
    )


def _most(count: int, of: int) -> bool:
    return count > MOST * of


def _doubts(answered: Sequence[CurveRecord], population: PopulationRecord | None) -> list[Message]:
    """Why the answer of a group is not to be used without a second look."""
    messages = []
    total = len(answered)
    doubted = [record for record in answered if record.verdict == "check_input"]
    if _most(len(doubted), total):
        counts = {"count": len(doubted), "total": total}
        messages.append(Message("group.doubt.input", {**counts, "reason": _reason(doubted)}))
    pulled = [record for record in answered if {*CAMERA} & {*record.diagnostics.at_bound}]
    if total > 1 and _most(len(pulled), total):
        names = sorted({name for record in pulled for name in record.diagnostics.at_bound if name in CAMERA})
        messages.append(Message("group.doubt.ends", {"count": len(pulled), "total": total, "names": names}))
    for name, heaps in (population.heaps if population else {}).items():
        parts = [(heap.low, heap.high, heap.shots) for heap in heaps]
        messages.append(Message("group.doubt.heaps", {"name": name, "heaps": parts}))
    return messages


def _reason(doubted: Sequence[CurveRecord]) -> str:
    """The input warning that most of these shots have; what its sentences have in common, if they differ."""
    warnings = [message for record in doubted for message in record.warnings or record.messages]
    if not warnings:
        return "see each shot"
    code = Counter(message.code for message in warnings).most_common(1)[0][0]
    texts = {message.text for message in warnings if message.code == code}
    return title(code) if len(texts) > 1 else texts.pop()


def _verdict(
    answered: Sequence[CurveRecord], doubts: Sequence[Message], population: PopulationRecord | None
) -> Verdict:
    """The verdict of a group. It obeys its rows; with a material it is about the material's G and mu."""
    if not answered:
        return "failed"
    if len(answered) == 1:
        return answered[0].verdict
    if doubts:
        return "check_input"
    if _most(sum(record.verdict == "does_not_fit" for record in answered), len(answered)):
        return "does_not_fit"
    if population is None or not population.has_material:
        return Counter(record.verdict for record in answered).most_common(1)[0][0]
    values = [population.value(name) for name in KEYS]
    return "bound" if any(value.bound and not value.is_zero for value in values) else "ok"


def _not_given(answered: Sequence[CurveRecord]) -> list[Message]:
    """A message on the constants that neither a file nor the user gave."""
    values = {name: value for record in answered for name, value in record.provenance.get("assumed", {}).items()}
    return [Message("group.not_given", {"values": values})] if values else []


def _rivals(answered: Sequence[CurveRecord]) -> list[Message]:
    """A message on the models that the evidence of single shots, or of all together, prefers to that of the answers."""
    preferred = Counter(model.model_title for record in answered if (model := record.preferred_model))
    if preferred:
        counts = {"count": sum(preferred.values()), "total": len(answered), "models": list(preferred)}
        return [Message("group.rival", counts)]
    jointly = _jointly_preferred([record for record in answered if record.trusted])
    return [Message("group.rival", {"count": None, "total": len(answered), "models": jointly})] if jointly else []


def _jointly_preferred(records: Sequence[CurveRecord]) -> list[str]:
    """Models that the evidence of all shots together prefers to that of the answers, in words."""
    from cavirheo.inference.alternatives import rejects

    gains: dict[str, list[float]] = {}
    for record in records:
        for name, model in _by_model(record.other_models).items():
            if record.evidence is not None and model.log_evidence is not None and name != record.model_title:
                gains.setdefault(name, []).append(model.log_evidence - record.evidence.log)
    return [name for name, mine in gains.items() if rejects(float(np.sum(mine)), [None] * len(mine))]


def _by_model(answers: Iterable[OtherModel]) -> dict[str, OtherModel]:
    """The answers by the title of their model; of several modes of a model, that with the largest evidence."""
    return {answer.model_title: answer for answer in sorted(answers, key=log_evidence_key)}


def _sensitivity(systematic: Systematic | None) -> list[Message]:
    """A message on what 1 % of scale or rate does to G."""
    change = systematic.slopes.get("shear_modulus", {}).get("scale") if systematic else None
    return [] if change is None else [Message("group.scale", {"change": change})]


def _trends(powers: Mapping[str, Slope]) -> list[Message]:
    return [Message("group.slopes", {"text": slopes_in_words(powers)})] if powers else []
