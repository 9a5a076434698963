"""The documents of a run: result.json (schema 1) as classes, with what is read from it in words.

Every number is SI and finite, or null: q05 and q95 are null for a method without an interval; all values of the answer
are null for a curve without one, and `messages` say why. A bound has no median. The answer of a group is that of the
population of its shots.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from math import inf
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator, PlainSerializer, model_validator
from pydantic_core import to_jsonable_python

from cavirheo.arrays import relative_scatter
from cavirheo.curve import RadiusCurve
from cavirheo.errors import listed
from cavirheo.messages import is_input_warning
from cavirheo.parameters import VISCOSITY_AT_RATE, column_name, has_no_one_value, is_law_parameter, symbol
from cavirheo.physics.bubble import FIELD, Bubble
from cavirheo.physics.media import Medium
from cavirheo.posterior import TRUSTED, Diagnostics, Evidence, Heap, Pair, Verdict
from cavirheo.writing import digits
from cavirheo.writing.document import Document, Finite, Quantity, Record, Spread
from cavirheo.writing.export import dataframe

MAIN_FIELDS = {"shear_modulus": "shear_modulus_Pa", "viscosity": "viscosity_Pa_s"}  # of every law, by parameter
WIDE_SCATTER = 0.4  # standard deviation from shot to shot over the material; one batch of gel has less
_ENDS = {"median": "", "q05": "_q05", "q95": "_q95", "bound": "_bound"}  # columns of a quantity in CSV
OUR_METHOD = "cavirheo"  # name of the answers of this program beside the values of other methods


class ParameterValues(Record):
    """A record with parameters: those of `_keys` are fields, all others are in `other_parameters`."""

    shear_modulus_Pa: Quantity = Quantity()
    """Shear modulus G, Pa."""
    viscosity_Pa_s: Quantity = Quantity()
    """Viscosity mu, Pa s, of a power law that at 1e5 1/s; null for other laws without a constant viscosity."""
    other_parameters: dict[str, Quantity] = {}
    """All other parameters by natural name, SI; of a curve also those given for the bubble, and the viscosity at a
    shear rate of 1e5 1/s of a law that has none of its own."""
    _keys: ClassVar[Mapping[str, str]] = MAIN_FIELDS

    @classmethod
    def fields_of(cls, values: Mapping[str, Quantity]) -> dict[str, Any]:
        """The fields of a record that hold these parameters."""
        standard = {key: values[name] for name, key in cls._keys.items() if name in values}
        further = {name: value for name, value in values.items() if name not in cls._keys}
        return {**standard, "other_parameters": further}

    def value(self, name: str) -> Quantity:
        """The value of a parameter by its natural name; an empty one if there is none."""
        key = self._keys.get(name)
        return getattr(self, key) if key else self.other_parameters.get(name, Quantity())

    def main(self, name: str) -> Quantity:
        """G ("shear_modulus") or mu ("viscosity"), which is that at 1e5 1/s of a law without a constant viscosity."""
        at_rate = name == "viscosity" and not self.viscosity_Pa_s.known
        return self.value(VISCOSITY_AT_RATE if at_rate else name)


def parameters_of(records: Sequence[ParameterValues]) -> list[str]:
    """Law parameters that are known in these records, G and µ first."""
    names = dict.fromkeys([*MAIN_FIELDS, *(name for record in records for name in record.other_parameters)])
    return [name for name in names if is_law_parameter(name) and any(record.value(name).known for record in records)]


class Compared(Record):
    """The part of a recording in which simulation and measurement were compared; it begins at R_max."""

    collapses: int | None = None
    """Number of complete collapses in it; null without an answer."""
    t_star_end: Finite = None
    """End of the window, as time after R_max over t_c = R_max sqrt(density/pressure); null without an answer."""


def _read_medium(value: Any) -> Any:
    """The medium in a document, where null is an infinite speed of sound; fields of a later version are left out."""
    if not isinstance(value, dict):
        return value
    constants = {field.name: value[field.name] for field in fields(Medium) if field.name in value}
    speed = constants.get("sound_speed")
    return Medium(**constants | {"sound_speed": inf if speed is None else speed}, unusual=True)


def json_data(value: Any) -> Any:
    """The value as JSON data: arrays as lists, NaN and infinity as null, other objects as their text."""
    return to_jsonable_python(value, inf_nan_mode="null", fallback=lambda v: getattr(v, "tolist", v.__str__)())


StoredMedium = Annotated[Medium, BeforeValidator(_read_medium), PlainSerializer(json_data)]


class Sentence(Record):
    """A message of an answer."""

    code: str
    """Subject of the message, for programs: "check_input.scale", "bound.viscosity.upper", "misfit.rms"."""
    text: str
    """The message as a sentence."""


class CurveRecord(ParameterValues):
    """The answer for one curve. If the verdict is "failed", all values of the answer are null, and `messages` say why.
    Fields that are not described here are those of a `Posterior` and its `Checks`."""

    name: str
    """Name of the curve."""
    source: str
    """File of the curve, as it was given."""
    group: str
    """Name of the group to which the shot belongs."""
    group_source: str
    """File or folder whose shots form the group."""
    material: str
    bubble: Bubble = FIELD
    """Model of the bubble; each of its parameters is a number or "free" (inferred)."""
    stretch: Quantity = Quantity()
    """R_max/R_0, inferred, fitted or given."""
    rmse_over_rmax: Finite = None
    max_radius_m: Finite
    """R_max, m."""
    time_of_max_s: Finite
    """Time of R_max on the clock of the file, s."""
    strain_rate_per_s: Finite
    """Mean strain rate at the wall between R_max and the first collapse, 1/s."""
    switches: dict[str, float] = {}
    medium: StoredMedium | None = None
    method: str
    best: Mapping[str, Finite] = {}
    """Parameters, SI, of the simulation that is drawn and compared: those of the law and of the bubble, the stretch,
    and the corrections of the clock, the radius scale and R_max. They are not the medians."""
    window: Compared
    """The window in which frames were compared."""
    verdict: Verdict
    messages: list[Sentence] = []
    notes: list[str]
    """What was recognised, converted or left out when the file was read."""
    seconds: float
    evidence: Evidence | None = None
    diagnostics: Diagnostics = Diagnostics()
    stretch_prior: dict[str, float] = {}
    """"mean" and "std" of the normal prior of the stretch, from the file or the late plateau; left out where there is
    no such prior."""
    provenance: dict[str, Any]
    _omitted_if_empty = ("switches", "stretch_prior")
    _keys = MAIN_FIELDS | {"stretch": "stretch"}

    @property
    def bubble_title(self) -> str:
        """'real bubble'; "real or the field's bubble" where a switch decides."""
        return "real or the field's bubble" if "field_bubble" in self.switches else self.bubble.title

    @property
    def has_answer(self) -> bool:
        return self.verdict != "failed"

    @property
    def trusted(self) -> bool:
        """Whether the curve counts in the means and in the material of its group."""
        return self.verdict in TRUSTED

    @property
    def verdict_in_words(self) -> str:
        """The verdict, and what it is about: 'bound: µ', 'wide: µ', 'check input: walls'."""
        words = digits.VERDICT_STYLES[self.verdict].words
        subjects = [message.code.split(".")[1].replace("_", " ") for message in self.warnings[:1]]
        if self.verdict == "bound":
            values = {symbol(name): self.main(name) for name in MAIN_FIELDS}
            bounds = {short: value.bound for short, value in values.items() if value.bound and not value.is_zero}
            words = "wide" if {*bounds.values()} == {"wide"} else words
            subjects = [*bounds]
        return ": ".join(filter(None, [words, ", ".join(subjects)]))

    @property
    def message(self) -> str:
        """All messages in one line."""
        return "; ".join(message.text for message in self.messages)

    @property
    def warnings(self) -> list[Sentence]:
        """Messages about the recording and its settings, if they decide the verdict."""
        decisive = self.verdict == "check_input"
        return [message for message in self.messages if decisive and is_input_warning(message.code)]


class Systematic(Record):
    """What errors that all shots of a group share do to its answer."""

    errors: dict[str, float] = {}
    """Relative standard deviations of the errors: "scale" of the radius, "rate" of the frames, "density" and "pressure"
    of the medium."""
    slopes: dict[str, dict[str, float]] = {}
    """Relative change of a parameter per relative change of each of these, by natural name."""
    statistics: dict[str, Quantity] = {}
    """The answer without these errors, by natural name, SI; the interval in the population has them."""


class PopulationRecord(ParameterValues):
    """The material of n shots. Without a material, the parameters are null, and `line` says why."""

    line: str = ""
    """The material in a sentence, for a paper; or why there is none."""
    model: str = ""
    """Law and name of the bubble model, "nhkv, real"; of a liquid that may thin "newtonian or power-law, real"."""
    n: int = 0
    """Number of shots that count."""
    switches: dict[str, float] = {}
    """Probability of each switch of the default family, by all shots together; left out for other laws."""
    heaps: dict[str, tuple[Heap, Heap]] = {}
    """The two heaps into which the shots fall in a parameter in which they disagree, by natural name; left out where
    there are none."""
    spreads_decades: dict[str, Quantity] = {}
    """Standard deviation of the shots about the material in each parameter, decades (log10), by natural name."""
    outliers: dict[str, float] = {}
    """Probability that a shot is of another material, by the name of the shot; for shots above 0.5."""
    left_out: dict[str, int] = {}
    """Number of shots that do not count, by reason: their verdict, "no_interval", "other_switches" (it excludes those
    of the group), "other_model" or "copy"."""
    agree: bool = False
    """Whether the shots differ by no more than their intervals."""
    _omitted_if_empty = ("switches", "heaps")

    @property
    def laws(self) -> list[str]:
        """The law of the model; of a liquid that may thin both."""
        return self.model.partition(",")[0].split(" or ")

    @property
    def has_material(self) -> bool:
        """Whether there is a material; if not, the line says why."""
        return bool(self.spreads_decades)

    def scatter(self, name: str) -> float:
        """Standard deviation of the shots over the material in a parameter (natural name); 0 where it is not known."""
        return relative_scatter(self.spreads_decades.get(name, Quantity()).median or 0.0)

    def has_no_one_value(self, name: str) -> bool:
        """Whether the shots scatter too much for one value of G or µ, and are no two heaps."""
        return has_no_one_value(self.wide_scatters.get(name, 0.0), agree=self.agree)

    @property
    def wide_scatters(self) -> dict[str, float]:
        """The scatters that are more than those of one batch of gel, unexplained by the intervals and by heaps."""
        scatters = {} if self.agree else {name: self.scatter(name) for name in MAIN_FIELDS if name not in self.heaps}
        return {name: size for name, size in scatters.items() if size > WIDE_SCATTER}


class MaterialRatio(Record):
    """A parameter of the material of the first group over that of the second."""

    first: str
    """Name of the group whose value is the numerator."""
    second: str
    """Name of the group whose value is the denominator."""
    parameter: str
    """Natural name."""
    ratio: Quantity
    """Value of the first material over that of the second."""
    probability_higher: float
    """Probability that the value of the first material is larger."""

    @property
    def words(self) -> str:
        """'gel B over gel A: G 1.32 (1.05 to 1.65), larger with probability 0.98'."""
        higher = self.probability_higher
        way, probability = ("larger", higher) if higher >= 0.5 else ("smaller", 1.0 - higher)
        probable = "> 0.99" if probability > 0.99 else f"{probability:.2f}"
        ratio = f"{digits.shown(self.parameter).symbol} {digits.quantity(self.ratio)}"
        return f"{self.first} over {self.second}: {ratio}, {way} with probability {probable}"


class LawOfGroup(Record):
    """The evidence of one law for the shots of a group; null where there is none."""

    log_evidence: Finite = None
    """Sum over the shots of the natural logarithm of p(frames | law)."""
    standard_error: Finite = None
    """Standard error of log_evidence."""
    probability: Finite = None
    """Probability of the law among those that have an evidence, if all are equally likely in advance."""
    material: str = ""
    """The shots as one material by this law, in a sentence, or why there is none; of a single shot its values."""


class LawsOfGroup(Record):
    """The laws that were compared for the shots of a group."""

    HEADS: ClassVar = ["law", "log evidence", "probability"]
    TITLE: ClassVar = "log evidence below the best; *: cannot be told from it; →: the simplest of these"
    shots: int
    """Number of shots over which the evidence is summed: those for which all laws have one."""
    chosen: str | None
    """Simplest law that the evidence does not reject; null where no law has an evidence."""
    contenders: list[str]
    """Laws that the evidence does not reject, the simplest first."""
    laws: dict[str, LawOfGroup]
    """The laws by name."""
    pairs: list[Pair] = []
    """Comparisons of each law with each worse one."""

    @property
    def rows(self) -> list[list[str]]:
        """Rows of a table: law, log evidence below the best, and probability."""
        best = max((law.log_evidence for law in self.laws.values() if law.log_evidence is not None), default=0.0)
        rows = []
        for name, law in self.laws.items():
            mark = ("→ " if name == self.chosen else "") + name + ("*" if name in self.contenders else "")
            evidence = digits.MISSING
            if law.log_evidence is not None:
                evidence = f"{law.log_evidence - best:.1f} ± {law.standard_error or 0.0:.1f}"
            probability = digits.MISSING if law.probability is None else f"{law.probability:.3f}"
            rows.append([mark, evidence, probability])
        return rows

    @property
    def preferences(self) -> list[str]:
        """How strongly the evidence prefers the best law to each other law, the next best first."""
        return [
            f"{pair.first} before {pair.second} by {pair.difference:.1f} ± {pair.error:.1f} in log evidence (scatter "
            f"over the shots); {pair.shots[0]} shots for, {pair.shots[1]} against"
            for pair in self.pairs[: len(self.laws) - 1]  # those with the best law come first
        ]

    @property
    def sentences(self) -> list[str]:
        """The preferences; then the material by each law."""
        materials: dict[str, list[str]] = {}  # names of the laws by what they say: often the same
        for name, law in self.laws.items():
            materials.setdefault(law.material, []).append(name)
        return self.preferences + [f"{', '.join(names)}: {said}" for said, names in materials.items() if said]


class PublishedValue(Spread):
    """The value of a parameter by another method."""

    source: str = ""
    """Publication of the value; left out where it is not known."""
    _omitted_if_empty = ("source",)

    @property
    def within_deviation(self) -> Quantity:
        """The mean between the ends of its standard deviation, of which the lower one is above 0."""
        mean, std = self.mean or 0.0, self.std or 0.0
        return Quantity(median=mean, q05=max(mean - std, 0.1 * mean), q95=mean + std)


Published = Mapping[str, Mapping[str, PublishedValue]]  # by method and parameter, SI


class GroupRecord(Record):
    """The shots of one file or folder, and the answer for their material."""

    name: str
    """Name of the file or folder."""
    n: int
    """Number of shots with an answer."""
    n_counted: int
    """Number of shots that count in the answer."""
    population: PopulationRecord = PopulationRecord()
    """The answer for the material; of a single shot that counts, its own answer. Its values are null where there is
    none."""
    systematic: Systematic = Systematic()
    """What errors that all shots share do to it; empty where that is not known."""
    verdict: Verdict
    """"ok", or what is wrong (docs/method/verdicts.md)."""
    messages: list[Sentence] = []
    """Reasons for the verdict first, then remarks."""
    verdicts: dict[str, int]
    """Number of curves by verdict."""
    published: dict[str, dict[str, PublishedValue]] = {}
    """Values of other methods, by method and parameter, SI; left out unless they were given. The parameter
    viscosity_at_1_rad_per_s is the viscosity by a rheometer at this angular frequency."""
    laws: LawsOfGroup | None = None
    """The laws that were compared by their evidence; left out unless they were (`which-law`)."""
    _omitted_if_empty = ("published", "laws")

    def value(self, name: str) -> Quantity:
        """The answer for a parameter by its natural name; an empty one if there is none, or no one value of it."""
        return Quantity() if self.population.has_no_one_value(name) else self.population.value(name)

    @property
    def has_answer(self) -> bool:
        """Whether any parameter of the material has a value or a bound."""
        return any(self.population.main(name).known for name in MAIN_FIELDS)

    @property
    def doubts(self) -> list[Sentence]:
        """The messages because of which no line of this group is to be used without a second look."""
        return [message for message in self.messages if message.code.startswith("group.doubt.")]


class Result(Document):
    """The answers of a run."""

    kind: Literal["result"] = "result"
    curves: list[CurveRecord]
    """The answer for each curve."""
    groups: list[GroupRecord]
    """The shots of each file or folder, with the answer for their material."""
    differences: list[MaterialRatio] = []
    """Ratios of each parameter of each two of the first 6 groups that have a material, where both have the same model
    and determine it; left out where there is none."""
    _omitted_if_empty = ("differences",)

    @model_validator(mode="after")
    def _each_curve_in_a_group(self) -> Result:
        if len(self.groups) != len(members_of(self.curves)):
            raise ValueError("its groups are not those of its curves")
        return self

    def shown(self, name: str) -> digits.Shown:
        """How a parameter is shown in all tables and pictures of this document: a modulus in one unit."""
        return digits.shown(name, *(curve.shear_modulus_Pa.largest for curve in self.curves))

    def to_dataframe(self) -> Any:
        """The rows of result.csv as a pandas.DataFrame, a row for each curve. Raises InputError without pandas."""
        head, rows = csv_rows(self)
        columns = {name: [np.nan if row.get(name) is None else row[name] for row in rows] for name in head}
        return dataframe(columns, {"command": self.command})

    def indices_by_group(self) -> list[tuple[GroupRecord, list[int]]]:
        """Each group with the indices of its curves."""
        return list(zip(self.groups, (indices for _, indices in members_of(self.curves)), strict=True))

    @property
    def rows(self) -> list[CurveRecord]:
        """The curves as tables show them: one alone in its group has its answer, whose intervals have common errors."""
        rows = list(self.curves)
        for group, (first, *others) in self.indices_by_group():
            answer = group.population
            if answer.n and not others:
                further = {**rows[first].other_parameters, **answer.other_parameters}
                main = {key: getattr(answer, key) for key in MAIN_FIELDS.values()}
                changed = {**main, "other_parameters": further, "verdict": group.verdict}
                rows[first] = rows[first].model_copy(update=changed)
        return rows

    def rows_by_group(self) -> list[tuple[GroupRecord, list[CurveRecord]]]:
        """Each group with its `rows`."""
        rows = self.rows
        return [(group, [rows[i] for i in indices]) for group, indices in self.indices_by_group()]

    def add_published(self, published: Mapping[str, Published]) -> None:
        """Add published values to the groups with these names, and a note on those with other names."""
        if others := [name for name in published if name not in [group.name for group in self.groups]]:
            note = f"published values of {listed(others)}: no group here has this name"
            self.notes += [note] if note not in self.notes else []
        for group in self.groups:
            group.published |= {method: dict(values) for method, values in published.get(group.name, {}).items()}


def csv_rows(result: Result) -> tuple[list[str], list[dict[str, Any]]]:
    """(column names of result.csv, which contain the SI units; a row for each curve, None for a missing number). A
    bound has no median, so that a mean of medians is one of values."""

    def columns(names: Iterable[str]) -> dict[str, tuple[str, str]]:
        titles = [(name, column_name(name, digits.shown(name).si)) for name in names]
        return {title + end: (name, part) for name, title in titles for part, end in _ENDS.items()}

    main = columns(["stretch", *MAIN_FIELDS])
    further = columns(dict.fromkeys(name for curve in result.curves for name in curve.other_parameters))
    head = ["name", "group", "source", "material", "method", "max_radius_m", *main]
    head += ["rmse_over_rmax", "collapses", "t_star_end", "verdict", "message", "bubble", *further]
    rows = []
    for record in result.curves:
        values = {title: getattr(record.value(name), part) for title, (name, part) in (main | further).items()}
        own = {"message": record.message, "bubble": record.bubble.name}
        rows.append(vars(record) | own | vars(record.window) | values)
    return head, rows


def members_of(curves: Iterable[CurveRecord | RadiusCurve]) -> list[tuple[str, list[int]]]:
    """(name, indices of its curves) of each group. Two files of one name in different folders are two groups, which are
    called by the path that was read."""
    members: dict[tuple[str, str], list[int]] = {}
    for index, curve in enumerate(curves):
        members.setdefault((curve.group, curve.group_source), []).append(index)
    count = Counter(group for group, _ in members)
    return [(source if source and count[group] > 1 else group, found) for (group, source), found in members.items()]
