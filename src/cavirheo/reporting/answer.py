"""The row of one curve in result.json."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from math import inf
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, PlainSerializer
from pydantic_core import to_jsonable_python

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.messages import Message, is_input_warning, message_of_switches
from cavirheo.parameters import BUBBLE, LOG10, REFERENCE_RATE, VISCOSITY_AT_RATE, is_law_parameter
from cavirheo.physics.bubble import FIELD, Bubble
from cavirheo.physics.materials import viscosity_at
from cavirheo.physics.media import Medium
from cavirheo.posterior import TRUSTED, Diagnostics, Evidence, Posterior, Verdict, intervals
from cavirheo.reporting.material import MAIN_FIELDS, ParameterValues
from cavirheo.writing import digits
from cavirheo.writing.document import Finite, Quantity, Record, finite

_NEUTRAL_VALUES = {"time_origin": 0.0, "radius_scale": 1.0, "max_radius_factor": 1.0}  # values that change nothing
Unit = tuple[float, str]  # unit of G: factor from Pa, name


class Compared(Record):
    """The part of a recording in which simulation and measurement were compared; it begins at R_max.

    Attributes:
        collapses: number of complete collapses in it; null without an answer.
        t_star_end: end of the window, as time after R_max over t_c = R_max sqrt(density/pressure); null without an
            answer.
    """

    collapses: int | None = None
    t_star_end: Finite = None

    @property
    def words(self) -> str:
        """The window in words: '3 collapses, t* ≤ 3.1'."""
        words = [] if self.collapses is None else [digits.counted(self.collapses, "collapse")]
        words += [] if self.t_star_end is None else [f"t* ≤ {digits.significant(self.t_star_end, 2)}"]
        return ", ".join(words) or digits.MISSING


def _read_medium(value: Any) -> Any:
    """The medium in a document, where null is an infinite speed of sound; fields of a later version are left out."""
    if not isinstance(value, dict):
        return value
    constants = {field.name: value[field.name] for field in fields(Medium) if field.name in value}
    speed = constants.get("sound_speed")
    return Medium(**constants | {"sound_speed": inf if speed is None else speed}, unusual=True)


def _json_data(value: Any) -> Any:
    """The value as JSON data: arrays as lists, NaN and infinity as null, other objects as their text."""
    return to_jsonable_python(value, inf_nan_mode="null", fallback=lambda v: getattr(v, "tolist", v.__str__)())


StoredMedium = Annotated[Medium, BeforeValidator(_read_medium), PlainSerializer(_json_data)]


class Sentence(Record):
    """A message of an answer.

    Attributes:
        code: subject of the message, for programs: "check_input.scale", "bound.viscosity.upper", "model.rejected".
        text: the message as a sentence.
    """

    code: str
    text: str


class CurveRecord(ParameterValues):
    """The answer for one curve. If the verdict is "failed", all values of the answer are null, and `messages` say why.

    Attributes:
        name: name of the curve.
        source: file of the curve, as it was given.
        group: name of the group to which the shot belongs.
        group_source: file or folder whose shots form the group.
        material: name of the law.
        bubble: model of the bubble; each of its parameters is a number or "free" (inferred).
        max_radius_m: R_max, m.
        time_of_max_s: time of R_max on the clock of the file, s.
        strain_rate_per_s: mean strain rate at the wall between R_max and the first collapse, 1/s.
        medium: constants of the surrounding medium and of the bubble's contents, SI; null in a document of an older
            version.
        switches: probability of each switch of the default family: "liquid" (G is 0), "stiffening" and "field_bubble";
            left out for other laws.
        method: method of the answer: "bdt", "verified" or "least_squares".
        stretch: R_max/R_0, inferred, fitted or given.
        rmse_over_rmax: root mean square of measured minus simulated radius, over R_max.
        other_parameters: further parameters by natural name, SI: those inferred besides G, mu and the stretch, those
            given for the bubble, and the viscosity at a shear rate of 1e5 1/s if the law has no constant viscosity.
        best: parameters, SI, of the simulation that is drawn and compared: those of the law and of the bubble, the
            stretch, and the corrections of the clock, the radius scale and R_max. They are not the medians.
        mae_over_rmax: mean absolute difference between measured and simulated radius, over R_max.
        max_difference_over_rmax: largest absolute difference between measured and simulated radius, over R_max.
        window: the window in which frames were compared.
        verdict: "ok", or what is wrong (docs/method/verdicts.md).
        messages: reasons for the verdict, and other remarks; input warnings first.
        notes: what was recognised, converted or left out when the file was read.
        seconds: wall time of the computation, s.
        evidence: evidence of the law; null where the method gives none.
        diagnostics: how the answer was computed.
        column: title and value of the column declared by the user; left out where there is none.
        stretch_prior: "mean" and "std" of the normal prior of the stretch, from the file or the late plateau; left out
            where there is no such prior.
        provenance: model, settings, versions and hash of the source, as a record for readers; its keys may change.
    """

    name: str
    source: str
    group: str
    group_source: str
    material: str
    bubble: Bubble = FIELD
    stretch: Quantity = Quantity()
    rmse_over_rmax: Finite = None
    max_radius_m: Finite
    time_of_max_s: Finite
    strain_rate_per_s: Finite
    switches: dict[str, float] = {}
    medium: StoredMedium | None = None
    method: str
    best: Mapping[str, Finite] = {}
    mae_over_rmax: Finite
    max_difference_over_rmax: Finite
    window: Compared
    verdict: Verdict
    messages: list[Sentence] = []
    notes: list[str]
    seconds: float
    evidence: Evidence | None = None
    diagnostics: Diagnostics = Diagnostics()
    column: dict[str, float] = {}
    stretch_prior: dict[str, float] = {}
    provenance: dict[str, Any]
    _omitted_if_empty = ("switches", "column", "stretch_prior")
    _keys = MAIN_FIELDS | {"stretch": "stretch"}

    @property
    def model(self) -> str:
        """Law and name of the bubble: 'nhkv, real'."""
        return f"{self.material}, {self.bubble.name}"

    @property
    def has_answer(self) -> bool:
        return self.verdict != "failed"

    @property
    def trusted(self) -> bool:
        """Whether the curve counts in the means and in the material of its group."""
        return self.verdict in TRUSTED

    @property
    def simulation_in_words(self) -> str:
        """Kind and values of the simulation that is drawn over the measurement, or "" where they are not known:
        'best draw: G = 5.412 kPa, µ = 0.02981 Pa s, λ = 8.324, t_0 = 0.12 µs'."""
        words = []
        for name, value in self.best.items():
            if value is not None and value != _NEUTRAL_VALUES.get(name):
                symbol, factor, unit = display_unit(name, digits.modulus_unit([value]))
                words.append(f"{symbol} = {digits.significant(factor * value, 4)} {unit}".rstrip())
        return f"{digits.simulation_name(self.method)}: {', '.join(words)}" if words else ""

    @property
    def message(self) -> str:
        """All messages in one line."""
        return "; ".join(message.text for message in self.messages)

    @property
    def warnings(self) -> list[Sentence]:
        """Messages about the recording and its settings, if they decide the verdict."""
        decisive = self.verdict == "check_input"
        return [message for message in self.messages if decisive and is_input_warning(message.code)]


def curve_record(curve: RadiusCurve, posterior: Posterior) -> CurveRecord:
    """The row of one curve."""
    posterior = _failed_if_invalid(posterior)
    checks, prior = posterior.checks, posterior.stretch_prior
    values = dict.fromkeys((*MAIN_FIELDS, "stretch"), Quantity())
    values |= {name: posterior.quantity(name) for name in posterior.parameters}
    assumed = {name: posterior.best.get(name) for name in BUBBLE if name not in values}
    values |= {name: Quantity(median=value) for name, value in assumed.items() if value} | _viscosity_at_rate(posterior)
    if values["stretch"].median is None:  # no draws of the stretch: it is given, or was fitted to a network's answer
        values["stretch"] = Quantity(median=finite(posterior.stretch))
    kind = message_of_switches(posterior.switches)
    messages = [*checks.messages, *([kind] if kind else [])]
    return CurveRecord(
        **{name: getattr(curve, name) for name in ("name", "source", "group", "group_source")},
        **{name: getattr(checks, name) for name in ("rmse_over_rmax", "mae_over_rmax", "max_difference_over_rmax")},
        **{name: getattr(posterior, name) for name in ("material", "method", "bubble", "medium", "evidence")},
        max_radius_m=_value_or_none(curve, "max_radius"),
        time_of_max_s=_value_or_none(curve, "time_of_max"),
        strain_rate_per_s=_value_or_none(curve, "strain_rate"),
        **CurveRecord.fields_of(values),
        best={} if checks.reconstruction_time is None else {name: float(v) for name, v in posterior.best.items()},
        window=Compared(collapses=checks.collapses, t_star_end=checks.t_star_end),
        verdict=checks.verdict,
        messages=[Sentence(code=message.code, text=message.text) for message in messages],
        notes=list(curve.notes),
        column=dict(curve.column),
        stretch_prior={"mean": prior[0], "std": prior[1]} if prior else {},
        seconds=finite(posterior.seconds) or 0.0,
        switches=dict(posterior.switches),
        diagnostics=_json_data(posterior.diagnostics),
        provenance=_json_data(posterior.provenance),
    )


def _failed_if_invalid(posterior: Posterior) -> Posterior:
    """The answer; a failed one, or one without draws that are finite, becomes "failed" with reasons and no values."""
    if posterior.checks.verdict == "failed" or not posterior.theta.size:
        reasons = () if posterior.checks.messages else (Message("answer.none"),)
        return posterior.without_draws(*reasons)
    broken = ", ".join(name for name in posterior.parameters if not np.all(np.isfinite(posterior.draws(name))))
    return posterior.without_draws(Message("answer.not_finite", {"parameters": broken})) if broken else posterior


def _viscosity_at_rate(posterior: Posterior) -> dict[str, Quantity]:
    """The viscosity at 1e5 1/s of a law without a constant viscosity; of a power law it is the reference viscosity."""
    names = list(posterior.parameters)
    if posterior.material == "power-law" and "reference_viscosity" in names:
        return {VISCOSITY_AT_RATE: posterior.quantity("reference_viscosity")}
    draws = [dict(zip(names, row, strict=True)) for row in zip(*map(posterior.draws, names), strict=True)]
    if not draws or viscosity_at(posterior.material, REFERENCE_RATE, draws[0]) is None:
        return {}
    viscosities = np.array([viscosity_at(posterior.material, REFERENCE_RATE, draw) for draw in draws])
    ends = intervals((LOG10 + VISCOSITY_AT_RATE,), np.log10(viscosities)[:, None], posterior.log_weight)
    low, median, high = ends.get(VISCOSITY_AT_RATE, (None, viscosities[0], None))
    return {VISCOSITY_AT_RATE: Quantity.from_interval(low, float(median), high)}


def meaning_of(name: str) -> str:
    """Unit and meaning of a parameter of the bubble, 'no unit; confinement damping: ...'; "" for any other one."""
    return f"{digits.symbol_and_unit(name)[1] or 'no unit'}; {BUBBLE[name]}" if name in BUBBLE else ""


def parameter_key(names: Iterable[str]) -> list[str]:
    """Lines below a table: what its parameters of the bubble mean, and which are not properties of the material."""
    meanings = {digits.symbol_and_unit(name)[0]: (name, meaning) for name in names if (meaning := meaning_of(name))}
    symbols = [symbol for symbol, (name, _) in meanings.items() if not name.startswith("damage")]
    end = [f"{' and '.join(symbols)}: of bubble and vessel, no property of the material"] if symbols else []
    return [f"{symbol} ({meaning})" for symbol, (_, meaning) in meanings.items()] + end


def display_unit(name: str, unit: Unit = (1.0, "Pa")) -> tuple[str, float, str]:
    """(symbol, factor from SI, unit for display) of a parameter. unit: the unit for display of moduli."""
    symbol, written = digits.symbol_and_unit(name)
    return symbol, *{"Pa": unit, "s": (1e6, "µs")}.get(written, (1.0, written))


def parameters_of(records: Sequence[CurveRecord]) -> list[str]:
    """Law parameters that are known in these records, G and µ first; a reference viscosity only with a yield stress."""
    names = dict.fromkeys([*MAIN_FIELDS, *(name for record in records for name in record.other_parameters)])
    inferred = [name for name in names if any(record.value(name).known for record in records)]
    excluded = () if "yield_stress" in inferred else ("reference_viscosity",)
    return [name for name in inferred if is_law_parameter(name) and name not in excluded]


def _value_or_none(curve: RadiusCurve, name: str) -> float | None:
    """The value of an attribute or method of the curve; None if it raises InputError."""
    with suppress(InputError):
        value = getattr(curve, name)
        return value() if callable(value) else value
    return None
