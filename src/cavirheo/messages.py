"""Messages of an answer as records, and the sentences that people read: every sentence stands here once.

Other code makes messages by code and values, and decides by codes alone; nothing looks into a sentence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from cavirheo.errors import InputError, SolverError
from cavirheo.parameters import about, searched_bound

INPUT = "check_input"  # first part of the code of an input warning
UNIT = "check_input.radius_unit"


@dataclass(frozen=True)
class Message:
    """What is to be known of an answer.

    Attributes:
        code: what it is about, for programs: "check_input.scale", "bound.viscosity.upper", "model.rejected". It stays
            the same when the sentence is put better. The code of an error is that of `InputError`.
        parameters: the values in the sentence, SI; of a code without a sentence of its own, the sentence as `text`.
    """

    code: str
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """The sentence."""
        known = _sentence_of(self.code)
        if known is None:
            return str(self.parameters["text"])
        details, values = known.details, self.parameters
        return title(self.code) + (details.format(**values) if isinstance(details, str) else details(values))

    @property
    def input_warning(self) -> bool:
        """Whether the recording or its settings are doubtful, so that the answer is not ok unless the user vouches."""
        return is_input_warning(self.code)


def is_input_warning(code: str) -> bool:
    """Whether a message with this code is about the recording or its settings."""
    return code.partition(".")[0] == INPUT


def joined(messages: Iterable[Message]) -> str:
    """All sentences in one line."""
    return "; ".join(message.text for message in messages)


def title(code: str) -> str:
    """What all messages with this code have in common, without the values of one; "" of a code without a sentence."""
    known = _sentence_of(code)
    if known is None:
        return ""
    return known.title if isinstance(known.title, str) else known.title(*code.split(".")[1:])


def of_error(error: Exception) -> Message:
    """Why there is no answer, of the error that ended it."""
    code = error.code if isinstance(error, InputError) else "solver" if isinstance(error, SolverError) else "unexpected"
    return Message(code, {"text": reason(error)})


def reason(error: Exception) -> str:
    """What is said of a curve whose answer an error ended."""
    if isinstance(error, InputError | SolverError):
        return error.message if isinstance(error, InputError) else str(error)
    return f"unexpected {type(error).__name__}: {error}".removesuffix(": ")


def value_in_words(name: str, interval: tuple[float, float, float]) -> str:
    """'µ 0.040 [0.031, 0.052] Pa s' of (5 %, 50 %, 95 %), SI; 'µ below 0.010 Pa s (95 %)' where the interval reaches
    the lower end of the range that is searched."""
    from cavirheo.writing import digits
    from cavirheo.writing.document import Quantity

    (low, median, high), known = interval, about(name)
    value = Quantity(median=median)  # without an interval, where its ends are one
    if low < high:
        value = Quantity(median=median, q05=low, q95=high, bound=searched_bound(name, low, high))
    return f"{known.symbol} {digits.measured(value, *digits.unit_for(known.unit, median))}"


class _Sentence(NamedTuple):
    """title: of all messages with the code; where several codes share it, of the parts behind the first. details: what
    one message adds, a template of its parameters, or a function of them."""

    title: str | Callable[..., str]
    details: str | Callable[[Mapping[str, Any]], str] = ""


def _sentence_of(code: str) -> _Sentence | None:
    return _SENTENCES.get(code) or _SENTENCES.get(code.partition(".")[0])


def _counted(count: int, what: str) -> str:
    from cavirheo.writing.digits import counted

    return counted(count, what)


def _repeated(p: Mapping[str, Any]) -> str:
    often = {2: "twice"}.get(p["times"], f"{p['times']} times")
    each = f"each frame seems to stand {often}: keep one of each"
    cause = each if p["times"] else "frames seem to be repeated: keep the first of equal ones"
    seen = f"{p['equal']} of {p['frames']} radii equal the one before, also where the bubble moves fast"
    return f": {seen}; {cause}, with its time, or add --trust-input"


def _scale(p: Mapping[str, Any]) -> str:
    fast = p["ratio"] < 1.0
    seen = f"the first collapse comes {p['ratio']:.2g} Rayleigh times after R_max ({1e6 * p['max_radius']:.4g} um)"
    mend = "give the true R_max (--rmax-um) or frame rate (--frame-rate-hz), or add --trust-input if both are right"
    if not p["factors"]:
        return f": {seen}, which no material shows: {mend}"
    by = " to ".join(dict.fromkeys(f"{factor:.2g}" for factor in p["factors"]))
    large, short = ("large (a diameter given as radius?)", "short") if fast else ("small (a radius in pixels?)", "long")
    cause = "stiff gel with its small stretch" if fast else "material"
    return (
        f": {seen}, and no {cause} follows the curve as well as a soft material does if radii are {by} times too "
        f"{large} or times that much too {short}: {mend}"
    )


def _moved(p: Mapping[str, Any]) -> str:
    words = " and ".join(f"{name.replace('_', ' ')} times {factor:.2g}" for name, factor in p["factors"].items())
    return f": without {_counted(p['frames'], 'frame')} the answer would be {words}"


def _bound_title(name: str, bound: str) -> str:
    symbol = about(name).symbol
    if bound == "undetermined":
        return f"the recording does not determine {symbol}"
    return f"the recording gives {'an upper' if bound == 'upper' else 'a lower'} limit of {symbol} alone"


def _bound(p: Mapping[str, Any]) -> str:
    from cavirheo.writing import digits
    from cavirheo.writing.document import Quantity

    if p["bound"] == "undetermined":
        return ": values all over the range that is searched follow it"
    value = Quantity(median=p["median"], q05=p["q05"], q95=p["q95"], bound=p["bound"])
    end = value.q95 if value.bound == "upper" else value.q05
    words = digits.measured(value, *digits.unit_for(about(p["name"]).unit, end)).removesuffix(" (95 %)")
    return f": any value {words} follows it as well"


_STATED = {"file": "stretch that the file states", "late_plateau": "late plateau"}
_CHECKED = {  # by nuisance: what to check where it runs to the end of its prior
    "time_origin": ": check the times of the frames, and that R_max was recorded",
    "radius_scale": ": check the µm per pixel",
    "max_radius_factor": ": check that R_max was recorded",
}


def _prior_end(name: str, end: str) -> str:
    words = "R_max" if name == "max_radius_factor" else name.replace("_", " ")
    return f"{words} is at the {end} end of what is expected{_CHECKED.get(name, '')}"


def _systematic(p: Mapping[str, Any]) -> str:
    from cavirheo.writing.digits import chance

    seen = p["excess"] >= p["seen"]
    size = f"by {100 * p['excess']:.1f} %" if seen else f"by less than {100 * p['seen']:.2g} %"
    text = f": {size} of R_max beyond the noise ({chance(p)})"
    if p["exact"]:
        return f"{text}, and the law was taken as exact, so the interval is too narrow"
    if p["excess"] > p["limit"]:
        return f"{text} (limit {100 * p['limit']:.0f} %)"
    return f"{text}, which the interval allows for" if seen else text


def _distrusted(p: Mapping[str, Any]) -> str:
    said = f": {p['draws']} weighted draws are worth {p['effective']:.0f} independent ones, and {p['needed']:.0f} are "
    said += "needed"
    if p["unseen"] is None:
        return said
    missed = "more than was met" if not p["unseen"] < 1.0 else f"about {p['unseen']:.0%} of it"
    return f"{said}, and a few of them carry the weight: {missed} is still to be met (tail index {p['tail']:.2f})"


def _training_range(p: Mapping[str, Any]) -> str:
    if p["name"] == "max_radius":
        return " {} um (trained at {:.4g} um: right from {:.0f} to {:.0f}; the default model knows all sizes)".format(
            f"{1e6 * p['value']:.4g}", 1e6 * p["trained_at"], 1e6 * p["low"], 1e6 * p["high"]
        )
    if p["name"] == "stretch":
        return f" {p['value']:.3g} (trained in {p['low']:g} to {p['high']:g})"
    return f" (at the training scale 10^{p['value']:.2f}, trained in 10^{p['low']:g} to 10^{p['high']:g})"


def _model(one: Mapping[str, Any], law: bool, bubble: bool) -> str:
    """A model by its law, by the words for its bubble, or both."""
    return ", ".join([one["material"]] * law + [one["bubble"]] * bubble)


def _values(one: Mapping[str, Any]) -> str:
    words = ", ".join(value_in_words(name, ends) for name, ends in one["values"].items())
    return words if one["interval"] else f"{words} (no interval)"


def _both(p: Mapping[str, Any]) -> str:
    """Two models by what tells them apart, law or bubble, with their values."""
    there, here = p["there"], p["here"]
    tells = here["material"] != there["material"], here["bubble"] != there["bubble"]
    first, second = (f"{_model(one, *tells)} with {_values(one)}" for one in (here, there))
    return f"{second}, instead of {first}"


def _by(p: Mapping[str, Any]) -> str:
    return f" by a factor of {'about ' * p['rough']}e^{abs(p['gain']):.0f}"


def _preferred(p: Mapping[str, Any], there: str, here: str) -> str:
    """' (the evidence prefers the second by a factor of e^12)'; nothing where one has no evidence."""
    if p["gain"] is None:
        return ""
    if p["equal"]:
        return " (equally likely)"
    return f" (the evidence prefers {there if p['gain'] > 0 else here}{_by(p)})"


def _two_modes(p: Mapping[str, Any]) -> str:
    values = f"{_values(p['here'])}, or {_values(p['there'])}"
    return f": {values}{_preferred(p, 'the second', 'the first')}"


def _chosen(p: Mapping[str, Any]) -> str:
    here, rivals = p["here"], p["rivals"]
    tells = tuple(any(one[key] != here[key] for one in rivals) for key in ("material", "bubble"))
    parts: dict[bool, list[str]] = {False: [], True: []}
    for one in rivals:
        gain = one["gain"]
        words = "equally likely" if one["equal"] else f"e^{abs(gain):.0f} times {'more' if gain > 0 else 'less'} likely"
        parts[one["rejected"]].append(f"{_model(one, *tells)} ({words})")
    said = [
        f"{words}: {', '.join(parts[key])}"
        for key, words in ((False, "also possible"), (True, "rejected"))
        if parts[key]
    ]
    return f": {_model(here, *tells)}, {', '.join(said)}"


_SENTENCES: dict[str, _Sentence] = {
    # the recording and its settings
    UNIT: _Sentence(
        "the unit of the radius contradicts its numbers",
        ": given in {given}, but the largest value {largest:.4g} only makes sense in {taken}: taken as {taken}",
    ),
    "check_input.time_order": _Sentence("times not in order", " ({steps} steps back): frames sorted"),
    "check_input.frame_rate": _Sentence(
        "the frame rate is given as another than the file states", ": {given:.6g}/s, and the file has {stated:.6g}/s"
    ),
    "check_input.density": _Sentence(
        "check the density",
        ": {density:.5g} kg/m3 makes the frame rate {rate:.5g}/s; a camera at {usual:.3g}/s means "
        "--density {meant:.5g}",
    ),
    "check_input.file_damaged": _Sentence("the file is damaged", " after frame {frames} ({cause})"),
    "check_input.file_cut_short": _Sentence(
        "the file is cut short", ": {frames} of {about}{stated:.0f} frames are there"
    ),
    "check_input.time_stamps": _Sentence("the time stamps of the .cine file do not increase and are not used"),
    "check_input.camera_clock": _Sentence(
        "the camera's header and its time stamps differ",
        ": {header:.6g} frames per second by the header, {stamps:.6g} by the time stamps",
    ),
    "check_input.camera_differs": _Sentence(
        "the camera states another number than was given", ": {given:.6g} {what} were given; {origin} has {value:.6g}"
    ),
    "check_input.two_bubbles": _Sentence(
        "a second bubble nearly as large is in the frames",
        ": in {frames} of {measured} (the mirror image in a wall?): choose one with --roi x,y,width,height",
    ),
    "check_input.overexposed": _Sentence(
        "the background is overexposed: the radius is too small by some tenths of a pixel"
    ),
    "check_input.frames_repeated": _Sentence("check the frames", _repeated),
    "check_input.frames_backwards": _Sentence(
        "check the order of the frames",
        ": {collapses} collapses come before R_max, and after each the bubble is larger than before; time seems to run "
        "backwards: give the radii in reverse, or add --trust-input",
    ),
    "check_input.late_start": _Sentence(
        "check the recording",
        ": its first radii fall as they do {frames:.2g} frames after R_max: begin it at R_max or before, or add "
        "--trust-input",
    ),
    "check_input.scale": _Sentence("check the scale of radius and time", _scale),
    "check_input.no_rebound": _Sentence(
        "no rebound is counted, and walls and sound of the vessel lengthen a first collapse as a viscosity does",
        ": read the upper end of µ alone, or let them be free (--confinement-inertia free --confinement-damping free)",
    ),
    "check_input.spikes": _Sentence(
        "check the recording: frames that stand out by more than 20 % of R_max move the answer", _moved
    ),
    # what counts
    "frames.spikes": _Sentence(
        "spikes are left out", lambda p: f": {_counted(p['frames'], 'frame')} above both neighbours by 20 % of R_max"
    ),
    "frames.other_bubble": _Sentence(
        "the end is left out, where the radius rises again as by another bubble",
        lambda p: f": {_counted(p['frames'], 'frame')} from {1e6 * p['since']:.4g} us after R_max on",
    ),
    "stretch.left_out": _Sentence(
        "the file's stretch is left out", ": {stretch:.4g} is no R_max/R_0 between {low:g} and {high:g}"
    ),
    "stretch.no_plateau": _Sentence("the curve has no late plateau: the stretch was fitted freely"),
    "stretch_prior": _Sentence(
        lambda source: f"λ was fitted, with the {_STATED[source]} as prior", ": {value:.3g}, taken as ± {deviation:.2g}"
    ),
    # the simulation beside the measurement
    "misfit.rms": _Sentence(
        "the simulation misses the measurement",
        lambda p: f" by {100 * p['rms']:.2g} % of R_max RMS (limit {100 * p['limit']:g} %)",
    ),
    "misfit.systematic": _Sentence("the simulation differs from the frames by more than noise explains", _systematic),
    # the interval
    "bound": _Sentence(_bound_title, _bound),
    "prior_end": _Sentence(_prior_end),
    "interval.distrusted": _Sentence("the interval is not to be trusted and left out", _distrusted),
    "interval.of_network": _Sentence("the interval is the network's own: it is not verified by simulations"),
    # networks
    "network.outside": _Sentence("the search began all over the ranges", ", for {reason}"),
    "network.cut_short": _Sentence(
        "samples of the network lie after the recording's end and were taken to be its last one",
        ": {missing} of the network's {samples} samples",
    ),
    "training_range": _Sentence(
        lambda name: f"outside the training range: {'R_max' if name == 'max_radius' else name}", _training_range
    ),
    "network.liquid": _Sentence("so soft a material may be a liquid: try --model bdt-viscous"),
    "network.elastic": _Sentence("the material may be elastic: try --model bdt-viscoelastic"),
    # other models, other modes
    "model.rejected": _Sentence("the evidence prefers another model", lambda p: f"{_by(p)}: {_both(p)}"),
    "model.possible": _Sentence(
        "another model is not rejected and gives other values",
        lambda p: f": {_both(p)}{_preferred(p, 'the other', 'this answer')}",
    ),
    "model.chosen": _Sentence("chosen by evidence", _chosen),
    "model.of_group": _Sentence("chosen by the evidence of the group", ": {material}"),
    "mode.other": _Sentence("two solutions of the same model follow the recording", _two_modes),
    # none
    "answer.unverified": _Sentence("not verified", ": {reason}"),
    "answer.not_finite": _Sentence(
        "the method's answer is not a finite number", lambda p: f": {', '.join(p['parameters'])}"
    ),
    "answer.none": _Sentence("no parameters were found"),
}
