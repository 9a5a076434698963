"""Messages of an answer as records, and the sentences for users; every sentence is written here once.

Other modules create messages from a code and values, and decide by codes alone; none of them parses a sentence.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from cavirheo.errors import InputError, SolverError
from cavirheo.parameters import parameter_of, searched_bound
from cavirheo.writing import digits

_UNLIKELY = 0.05  # probability up to which a switch does not count
_MATERIALS_IN_WORDS = {
    "gel": "a gel that does not stiffen",
    "liquid": "a liquid",
    "stiffening_gel": "a gel that stiffens",
}
_Words = str | Callable[..., str]


@dataclass(frozen=True)
class Message:
    """A statement about an answer, as a code and values.

    Attributes:
        code: identifies the statement for programs: "check_input.scale", "bound.viscosity.upper", "model.rejected". It
            stays the same when the sentence is reworded. An error has the code of its `InputError`.
        parameters: the values in the sentence, SI; for a code without a sentence here, `text` holds the sentence.
    """

    code: str
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """The sentence with its values."""
        common, details = _sentence_of(self.code)
        return common + (details.format if isinstance(details, str) else details)(**self.parameters)


def is_input_warning(code: str) -> bool:
    """Whether the message concerns the recording or its settings: no answer is ok unless the user confirms these."""
    return code.startswith("check_input.")


def title(code: str) -> str:
    """The part without values, common to all messages with this code; "" for a code without a sentence."""
    return _sentence_of(code)[0]


def message_of_bound(name: str, bound: str, interval: tuple[float, float, float]) -> Message:
    """The message that the range of a parameter, not the recording, limits its interval (5 %, 50 %, 95 %), SI."""
    low, median, high = interval
    return Message(f"bound.{name}.{bound}", {"name": name, "bound": bound, "median": median, "q05": low, "q95": high})


def message_of_switches(switches: Mapping[str, float]) -> Message | None:
    """The message on the most probable kind of material and bubble, with these probabilities ("liquid", "stiffening",
    "field_bubble"; those that an answer has); None if all are small."""
    if all(probability <= _UNLIKELY for probability in switches.values()):
        return None
    liquid, stiffening = switches.get("liquid", 0.0), switches.get("stiffening", 0.0)
    kinds = {"gel": 1.0 - liquid - stiffening, "liquid": liquid, "stiffening_gel": stiffening}
    kind = max(kinds, key=lambda name: kinds[name]) if "liquid" in switches else "law"
    bubble = "field" if switches.get("field_bubble", 0.0) > 0.5 else "real"
    return Message(f"state.{kind}.{bubble}", switches)


def message_of_error(error: Exception) -> Message:
    """The message why there is no answer, from the error that ended the analysis."""
    if isinstance(error, InputError):
        return Message(error.code, {"text": error.message})
    if isinstance(error, SolverError):
        return Message("solver", {"text": str(error)})
    return Message("unexpected", {"text": f"unexpected {type(error).__name__}: {error}".removesuffix(": ")})


def value_in_words(name: str, interval: tuple[float, float, float]) -> str:
    """'µ 0.040 [0.031, 0.052] Pa s' from (5 %, 50 %, 95 %), SI; 'µ below 0.010 Pa s (95 %)' where the interval reaches
    the lower end of the searched range."""
    from cavirheo.writing.document import Quantity

    (low, median, high), parameter = interval, parameter_of(name)
    bound = searched_bound(name, low, high)
    value = Quantity.from_interval(low, median, high, bound) if low < high else Quantity(median=median)
    return f"{parameter.symbol} {digits.quantity_with_unit(value, *digits.unit_for(parameter.unit, median))}"


def _sentence_of(code: str) -> tuple[str, _Words]:
    """(the part without values, common to all messages with this code; the template for the part with values)."""
    family, *arguments = code.split(".")
    sentence = _SENTENCES.get(code) or _SENTENCES.get(family, "|{text}")
    common, details = sentence if isinstance(sentence, tuple) else sentence.partition("|")[::2]
    return common if isinstance(common, str) else common(*arguments), details


def _repeated(times: int, equal: int, frames: int) -> str:
    each = f"each frame seems to stand {'twice' if times == 2 else f'{times} times'}: keep one of each"
    cause = each if times else "frames seem to be repeated: keep the first of equal ones"
    count = f"{equal} of {frames} radii equal the one before, also where the bubble moves fast"
    return f": {count}; {cause}, with its time, or add --trust-input"


def _scale(ratio: float, max_radius: float, factors: Sequence[float]) -> str:
    collapse = f"the first collapse comes {ratio:.2g} Rayleigh times after R_max ({1e6 * max_radius:.4g} um)"
    advice = "give the true R_max (--rmax-um) or frame rate (--fps), or add --trust-input if both are right"
    if not factors:
        return f": {collapse}, which no material shows: {advice}"
    by = " to ".join(dict.fromkeys(f"{factor:.2g}" for factor in factors))
    cause, large, short = (
        ("stiff gel with its small stretch", "large (a diameter given as radius?)", "short")
        if ratio < 1.0
        else ("material", "small (a radius in pixels?)", "long")
    )
    soft = f"no {cause} follows the curve as well as a soft material does if radii are {by} times too {large}"
    return f": {collapse}, and {soft} or times that much too {short}: {advice}"


def _moved(factors: Mapping[str, float], frames: int) -> str:
    words = " and ".join(f"{name.replace('_', ' ')} times {factor:.2g}" for name, factor in factors.items())
    return f": without {'this frame' if frames == 1 else f'these {frames} frames'} it would be {words}"


def state_in_words(kind: str, bubble: str) -> str:
    """'a liquid', 'a gel that stiffens, with the field's bubble'; 'the real bubble' of a law without switches."""
    words = {"field": "the field's bubble", "real": "the real bubble"}[bubble]
    if kind == "law":
        return words
    material = _MATERIALS_IN_WORDS[kind]
    return f"{material}, with {words}" if bubble == "field" else material


def _probabilities(**switches: float) -> str:
    words = {"liquid": "liquid", "stiffening": "stiffens", "field_bubble": "field's bubble"}
    parts = (f"{words[name]}: {100.0 * value:.0f} %" for name, value in switches.items())
    return f" ({', '.join(parts)})"


def _bound_title(name: str, bound: str) -> str:
    words = {
        "undetermined": "does not determine {}",
        "upper": "gives an upper limit of {} alone",
        "lower": "gives a lower limit of {} alone",
        "wide": "gives {} to a factor of more than 10 alone",
    }
    return f"the recording {words[bound].format(parameter_of(name).symbol)}"


def _bound(name: str, bound: str, q05: float, q95: float, **_: Any) -> str:
    if bound == "undetermined":
        return ": values all over the range that is searched follow it"
    if bound == "wide":
        factor, unit = digits.unit_for(parameter_of(name).unit, q95)
        low, high = (digits.significant(factor * end, 2) for end in (q05, q95))
        return f": any value from {low} to {high} {unit}".rstrip() + " follows it as well"
    side, end = ("below", q95) if bound == "upper" else ("above", q05)
    factor, unit = digits.unit_for(parameter_of(name).unit, end)
    return f": any value {f'{side} {digits.significant(factor * end, 2)} {unit}'.rstrip()} follows it as well"


def _constant(stated: float | str, name: str, unit: str, used: object = None) -> str:
    value = stated if isinstance(stated, str) else f"{stated:.6g}"
    return f"{name.replace('_', ' ')} {value} {unit}".strip()


_STRETCH_SOURCES = {"file": "stretch that the file states", "late_plateau": "late plateau"}
_NUISANCE_WORDS = {  # by nuisance parameter: its name in messages, and what to check if it is at an end of its prior
    "time_origin": ("time origin", ": check the times of the frames, and that R_max was recorded"),
    "radius_scale": ("radius scale", ": check the µm per pixel"),
    "max_radius_factor": ("R_max", ": check that R_max was recorded"),
}


def _prior_end(name: str, end: str) -> str:
    words, advice = _NUISANCE_WORDS.get(name, (name.replace("_", " "), ""))
    return f"{words} is at the {end} end of what is expected{advice}"


def _systematic(excess: float, detectable: float, exact: bool, limit: float, **predictive: Any) -> str:
    large = excess >= detectable
    size = f"{100 * excess:.1f}" if large else f"less than {100 * detectable:.2g}"
    text = f": by {size} % of R_max beyond the noise ({digits.p_value_in_words(predictive)})"
    if exact:
        return f"{text}, and the law was taken as exact, so the interval is too narrow"
    if excess > limit:
        return f"{text} (limit {100 * limit:.0f} %)"
    return f"{text}, which the interval allows for" if large else text


def _training_range(name: str, value: float, low: float, high: float, trained_at: float = 0.0) -> str:
    if name == "max_radius":
        trained = f"trained at {1e6 * trained_at:.4g} um: right from {1e6 * low:.0f} to {1e6 * high:.0f}"
        return f" {1e6 * value:.4g} um ({trained}; the default model knows all sizes)"
    if name == "stretch":
        return f" {value:.3g} (trained in {low:g} to {high:g})"
    return f" (at the training scale 10^{value:.2f}, trained in 10^{low:g} to 10^{high:g})"


def _ends(count: int, total: int, names: Sequence[str]) -> str:
    words = ", ".join(_NUISANCE_WORDS[name][0] for name in names)
    return f": {words}, in {count} of {total}: check the µm per pixel, the frame rate, and that R_max was recorded"


def heaps_in_words(
    name: str, heaps: Sequence[tuple[float | None, float | None, Sequence[str]]], *, names: bool = False
) -> str:
    """'µ 0.026 to 0.033 Pa s in 2, below 0.020 in 3' of (low, high, shots) of each heap, SI; with the names of the
    shots on request."""
    parameter = parameter_of(name)
    factor, unit = digits.unit_for(parameter.unit, max(end for low, high, _ in heaps for end in (low, high) if end))
    parts: list[str] = []
    for low, high, shots in heaps:
        first, last = ("" if end is None else digits.significant(factor * end, 2) for end in (low, high))
        ends = f"{first} to {last}" if first and last else f"above {first}" if first else f"below {last}"
        listed = f" ({', '.join(digits.shorten_names(shots))})" if names else ""
        parts.append(f"{ends}{'' if parts else f' {unit}'} in {len(shots)}{listed}")
    return f"{parameter.symbol} {', '.join(parts)}"


def constants_in_words(values: Mapping[str, float]) -> str:
    """'density 998 kg/m3, pressure 101 kPa' of constants of the medium by name, SI."""
    words = []
    for name, value in values.items():
        factor, unit = (1e-3, "kPa") if name == "pressure" else (1.0, "kg/m3")
        words.append(f"{name} {digits.significant(factor * value)} {unit}")
    return ", ".join(words)


def _group_rival(count: int | None, total: int, models: Sequence[str]) -> str:
    where = "in all shots together" if count is None else f"in {count} of {total} shots"
    return f" {where}: {' or '.join(models)}"


_Model = Mapping[str, Any]  # "material", "bubble" (names), "values" (interval by parameter), "interval" (bool)


def _differing_keys(*models: _Model) -> list[str]:
    """The keys in which models differ: "material", "bubble" or both."""
    return [key for key in ("material", "bubble") if len({model[key] for model in models}) > 1]


def _values_text(model: _Model) -> str:
    words = ", ".join(value_in_words(name, ends) for name, ends in model["values"].items())
    return words if model["interval"] else f"{words} (no interval)"


def _models_text(this: _Model, rival: _Model) -> str:
    """Two models, named by the keys in which they differ, with their values."""
    keys = _differing_keys(this, rival)
    first, second = (f"{', '.join(model[key] for key in keys)} with {_values_text(model)}" for model in (this, rival))
    return f": {second}, instead of {first}"


def _gain_text(gain: float, rough: bool) -> str:
    return f" by a factor of {'about ' * rough}e^{abs(gain):.0f}"


def _chosen(this: _Model, rivals: Sequence[_Model]) -> str:
    keys = _differing_keys(this, *rivals)
    parts: dict[str, list[str]] = {"also possible": [], "rejected": []}
    for rival in rivals:
        odds = f"e^{abs(rival['gain']):.0f} times {'more' if rival['gain'] > 0 else 'less'} likely"
        words = f"{', '.join(rival[key] for key in keys)} ({'equally likely' if rival['equal'] else odds})"
        parts["rejected" if rival["rejected"] else "also possible"].append(words)
    parts_in_words = (f"{words}: {', '.join(models)}" for words, models in parts.items() if models)
    return f": {', '.join([*(this[key] for key in keys), *parts_in_words])}"


# By code, or by its first part where several codes share a sentence: the part without values, "|", and a template for
# the part with values; or a tuple of these two parts, if a function makes one of them.
_SENTENCES: dict[str, str | tuple[_Words, _Words]] = {
    # the recording and its settings
    "check_input.time_order": "times not in order| ({steps} steps back): frames sorted",
    "check_input.aspherical": "the bubble is no sphere|: its half-axes differ by {share:.0%} where it is large",
    "check_input.time_digits": "times have too few digits|: they are rounded to {step:.3g} us, and a frame comes every "
    "{interval:.3g} us: write more digits, or of a table give the frame rate (--fps), or add --trust-input",
    "check_input.density": "check the density|: {density:.5g} kg/m3 makes the frame rate {rate:.5g}/s; a camera at "
    "{usual:.3g}/s means --density {meant:.5g}",
    "check_input.constant": (
        "check the constant that the file states",
        lambda low, high, used, **values: (
            f": {_constant(**values)} is not between {low:g} and {high:g}; {used:g} is used: give the right one"
        ),
    ),
    "check_input.file_damaged": "the file is damaged| after frame {frames} ({cause})",
    "check_input.file_cut_short": "the file is cut short|: {frames} of {about}{stated:.0f} frames are there",
    "check_input.frames_uneven": "the file plays its frames unevenly, as if some were missing|: {steps} gaps; these "
    "are taken to be evenly spaced",
    "check_input.time_stamps": "time stamps of the .cine file are wrong|: {steps} steps among {frames} frames; these "
    "are taken to be evenly spaced, {rate:.6g} per second",
    "check_input.camera_clock": "the camera's header and its time stamps differ|: {header:.6g} frames per second by "
    "the header, {stamps:.6g} by the time stamps",
    "check_input.camera_differs": "the camera states another number than was given|: {given:.6g} {what} were given; "
    "{origin} has {value:.6g}",
    "check_input.two_bubbles": "a second bubble nearly as large is in the frames|: in {frames} of {measured} (the "
    "mirror image in a wall?): choose one with --roi x,y,width,height",
    "check_input.overexposed": "the background is overexposed: the radius is too small by some tenths of a pixel",
    "check_input.frames_repeated": ("check the frames", _repeated),
    "check_input.frames_backwards": "check the order of the frames|: {collapses} collapses come before R_max, and "
    "after each the bubble is larger than before; time seems to run backwards: give the radii in reverse, or add "
    "--trust-input",
    "check_input.late_start": "check the recording|: its first radii fall as they do {frames:.2g} frames after R_max: "
    "begin it at R_max or before, or add --trust-input",
    "check_input.scale": ("check the scale of radius and time", _scale),
    "check_input.smoothed": "the radii seem to be smoothed|: over about {frames} frames, which fills the collapses and "
    "adds to µ: give the radii as they were measured, or add --trust-input",
    "check_input.no_rebound": "no rebound is counted, and walls and sound of the vessel lengthen a first collapse as a "
    "viscosity does|: read the upper end of µ alone, or let them be free (--confinement-inertia free "
    "--confinement-damping free)",
    "check_input.spikes": ("check the recording: frames that stand out by 20 % of R_max move the answer", _moved),
    # frames and stretch that are used
    "frames.averaged": "neighbouring frames are averaged, for they are far denser than the motion needs|: {means} "
    "means of {frames} frames are compared",
    "frames.spikes": (
        "spikes are left out",
        lambda frames: f": {digits.counted(frames, 'frame')} above both neighbours by 20 % of R_max",
    ),
    "frames.other_bubble": (
        "the end is left out, where the radius rises again as by another bubble",
        lambda frames, since: f": {digits.counted(frames, 'frame')} from {1e6 * since:.4g} us after R_max on",
    ),
    "stated.used": ("a constant that the file states is used", lambda **values: f": {_constant(**values)}"),
    "stated.replaced": (
        "what was given is used, not what the file states",
        lambda stated, used, **values: f": {_constant(used, **values)}, not {_constant(stated, **values)}",
    ),
    "stretch.left_out": "the file's stretch is left out|: {stretch:.4g} is no R_max/R_0 between {low:g} and {high:g}",
    "stretch.no_plateau": "the curve has no late plateau: the stretch was fitted freely",
    "stretch_prior": (
        lambda source: f"λ was fitted, with the {_STRETCH_SOURCES[source]} as prior",
        ": {value:.3g}, taken as ± {deviation:.2g}",
    ),
    # the simulation compared with the measurement
    "misfit.rms": (
        "the simulation misses the measurement",
        lambda rms, limit: f" by {100 * rms:.2g} % of R_max RMS (limit {100 * limit:.2g} %)",
    ),
    "misfit.systematic": ("the simulation differs from the frames by more than noise explains", _systematic),
    # the interval
    "bound": (_bound_title, _bound),
    "traded": (
        lambda name: f"{parameter_of(name).symbol} is only bounded: it trades against a parameter at its end",
        lambda name, other, bound, **_: (
            f": {parameter_of(other).symbol}, of whose larger or smaller values nothing is known"
        ),
    ),
    "sampled_by_solver": "the emulator does not know this bubble: it was sampled by the solver, more slowly|: {reason}",
    "prior_end": (_prior_end, ""),
    "interval.distrusted": "the interval is not to be trusted and left out|: {draws} weighted draws are worth "
    "{effective:.0f} independent ones, and {needed:.0f} are needed",
    # networks
    "network.cut_short": "samples of the network lie after the recording's end and were taken to be its last one|: "
    "{missing} of the network's {samples} samples",
    "training_range": (
        lambda name: f"outside the training range: {'R_max' if name == 'max_radius' else name}",
        _training_range,
    ),
    "network.liquid": "so soft a material may be a liquid: try --model bdt-viscous",
    "network.elastic": "the material may be elastic: try --model bdt-viscoelastic",
    # other models, and the switches of the default family
    "state": (lambda kind, bubble: f"most probably {state_in_words(kind, bubble)}", _probabilities),
    "model.rejected": (
        "the evidence prefers another model",
        lambda this, rival, gain, rough: _gain_text(gain, rough) + _models_text(this, rival),
    ),
    "model.chosen": ("chosen by evidence", _chosen),
    "model.of_group": "chosen by the evidence of the group|: {material}",
    "model.failed": "a law has no answer, and does not count|: {material}, because {reason}",
    # a group
    "group.doubt.input": "most shots have an input warning|: {count} of {total}; the report says which",
    "group.doubt.ends": ("most shots pull the corrections of the camera to an end of what is expected", _ends),
    "group.doubt.heaps": ("the shots disagree", lambda name, heaps: f": {heaps_in_words(name, heaps, names=True)}"),
    "group.rival": ("the evidence prefers another model", _group_rival),
    "group.not_given": ("constants that were not given", lambda values: f": {constants_in_words(values)}"),
    "group.scale": (
        "the radius scale and the frame rate change G",
        lambda change: f": 1 % more by {digits.significant(change, 2)} %",
    ),
    # no answer
    "answer.not_finite": "the method's answer is not a finite number|: {parameters}",
    "answer.none": "no parameters were found",
}
