"""Messages of an answer as records, and the sentences for users: a template in sentences.toml, or a function here.

Other modules create messages from a code and values, and decide by codes alone; none of them parses a sentence.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any

from cavirheo.errors import InputError, SolverError
from cavirheo.parameters import parameter_of
from cavirheo.writing import digits

_MOST_NAMES = 10  # letters of the names of shots in a sentence, from which on they are counted
Ends = tuple[float, float, float]  # 5 %, 50 %, 95 %


@dataclass(frozen=True)
class Message:
    """A statement about an answer, as a code and values.

    Attributes:
        code: identifies the statement for programs: "check_input.scale", "bound.viscosity.upper", ... It
            stays the same when the sentence is reworded. An error has the code of its `InputError`.
        parameters: the values in the sentence, SI; for a code without a sentence here, `text` holds the sentence.
    """

    code: str
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """The sentence with its values."""
        family, *parts = self.code.split(".")
        if writer := _WRITERS.get(self.code) or _WRITERS.get(family):
            return writer(**self.parameters) if self.parameters else writer(*parts)
        return _sentences().get(self.code, "{text}").format(**self.parameters)


@cache
def _sentences() -> dict[str, str]:
    return tomllib.loads(files("cavirheo").joinpath("sentences.toml").read_text(encoding="utf-8"))


def is_input_warning(code: str) -> bool:
    """Whether the message concerns the recording or its settings: no answer is ok unless the user confirms these."""
    return code.startswith("check_input.")


def message_of_bound(name: str, bound: str, interval: Ends) -> Message:
    """The message that the range of a parameter, not the recording, limits its interval (5 %, 50 %, 95 %), SI."""
    low, median, high = interval
    return Message(f"bound.{name}.{bound}", {"name": name, "bound": bound, "median": median, "q05": low, "q95": high})


def message_of_error(error: Exception) -> Message:
    """The message why there is no answer, from the error that ended the analysis."""
    if isinstance(error, InputError):
        return Message(error.code, {"text": error.message})
    if isinstance(error, SolverError):
        return Message("solver", {"text": str(error)})
    reason = f": {error}" if str(error) else ""
    return Message("unexpected", {"text": f"unexpected {type(error).__name__}{reason}"})


def heaps_in_words(name: str, heaps: Sequence[Any]) -> str:
    """'either 0.026 to 0.033 Pa s in [1], [2] or below 0.020 in 12 shots' of heaps with `low`, `high` (SI), `shots`."""
    short = iter(digits.distinct_names([shot for heap in heaps for shot in heap.shots]))
    ends = [end for heap in heaps for end in (heap.low, heap.high) if end]
    _, factor, unit, _ = digits.shown(name, max(ends))
    parts: list[str] = []
    for heap in heaps:
        first, last = (digits.number(end, factor, 2) for end in (heap.low, heap.high))
        limits = f"{first} to {last}"
        if heap.low is None or heap.high is None:
            limits = f"above {first}" if heap.high is None else f"below {last}"
        names = ", ".join(next(short) for _ in heap.shots)
        where = names if len(names) <= _MOST_NAMES else digits.counted(len(heap.shots), "shot")
        parts.append(f"{limits}{'' if parts else f' {unit}'} in {where}")
    return f"either {' or '.join(parts)}"


def constants_in_words(values: Mapping[str, float]) -> str:
    """'density 998 kg/m3, pressure 101 kPa' of constants of the medium by name, SI."""
    words = []
    for name, value in values.items():
        factor, unit = (1e-3, "kPa") if name == "pressure" else (1.0, "kg/m3")
        words.append(f"{name} {digits.significant(factor * value)} {unit}")
    return ", ".join(words)


def _spaced(name: str) -> str:
    return name.replace("_", " ")


def _repeated(times: int, equal: int, frames: int) -> str:
    cause = f"each frame seems to stand {times} times: keep one of each" if times else "keep the first of equal frames"
    count = f"{equal} of {frames} radii equal the one before, also where the bubble moves fast"
    return f"check the frames: {count}; {cause}, with its time, or add --trust-input"


def _walls(distance: float) -> str:
    where = f"{digits.significant(1e6 * distance, 2)} µm away"
    advice = "give --wall-distance-um, the right scale and frame rate, or --trust-input"
    return f"it collapses late, as beside a wall {where}: {advice}"


def _scale(ratio: float, max_radius: float, factors: Sequence[float]) -> str:
    collapse = f"the first collapse comes {ratio:.2g} Rayleigh times after R_max ({1e6 * max_radius:.4g} µm)"
    head = "check the scale of radius and time"
    advice = "give the true R_max (--rmax-um) or frame rate (--fps), or add --trust-input if both are right"
    if not factors:
        return f"{head}: {collapse}, which no material shows: {advice}"
    size, time = ("small", "long") if ratio > 1.0 else ("large", "short")
    cause = "radii in pixels" if ratio > 1.0 else "diameters for radii, or a higher --pressure"
    if all(0.5 < factor / 1000.0 < 2.0 for factor in factors):
        cause = "a unit that is wrong by a factor of 1000"
        advice = "mend the unit, or " + advice
    by = digits.ends(factors, count=2)
    which = f"radii are {by} times too {size}, or times that much too {time} ({cause}?)"
    return f"{head}: {which}, for {collapse}: {advice}"


def _bound(name: str, bound: str, q05: float, q95: float, **_: Any) -> str:
    symbol = parameter_of(name).symbol
    if bound == "undetermined":
        return f"the recording does not determine {symbol}: values all over the range that is searched follow it"
    shown = digits.shown(name, q05 if bound == "lower" else q95)
    low, high = (digits.significant(shown.factor * end, 2) for end in (q05, q95))
    what, limits = {
        "upper": (f"an upper limit of {symbol} alone", f"below {high}"),
        "lower": (f"a lower limit of {symbol} alone", f"above {low}"),
        "wide": (f"{symbol} to a factor of more than 10 alone", f"from {low} to {high}"),
    }[bound]
    return f"the recording gives {what}: any value {limits}{f' {shown.unit}'.rstrip()} follows it as well"


def _traded(name: str, other: str, **_: Any) -> str:
    symbol, limiting = parameter_of(name).symbol, parameter_of(other).symbol
    return f"{symbol} is only bounded: it trades against {limiting}, of whose larger or smaller values nothing is known"


def _constant(stated: float | str, name: str, unit: str, used: object = None) -> str:
    value = stated if isinstance(stated, str) else f"{stated:.6g}"
    return f"{_spaced(name)} {value}{f' {unit}' if unit else ''}"


_ADVICE = {  # by nuisance parameter
    "time_origin": ": check the times of the frames, and that R_max was recorded",
    "radius_scale": ": check the µm per pixel",
    "max_radius_factor": ": check that R_max was recorded",
}


def _prior_end(name: str, end: str) -> str:
    words = "R_max" if name == "max_radius_factor" else _spaced(name)
    return f"{words} is at the {end} end of what is expected{_ADVICE.get(name, '')}"


def _systematic(excess: float, detectable: float, exact: bool, limit: float, p_value: float) -> str:
    size = f"less than {100 * detectable:.2g}" if excess < detectable else f"{100 * excess:.1f}"
    text = "the simulation differs from the frames by more than noise explains: "
    text += f"by {size} % of R_max beyond the noise ({digits.p_value_in_words(p_value)})"
    if exact:
        return f"{text}, and the law was taken as exact, so the interval is too narrow"
    if excess > limit:
        return f"{text} (limit {100 * limit:.0f} %)"
    return text if excess < detectable else f"{text}, which the interval allows for"


def _training_range(name: str, value: float, low: float, high: float, trained_at: float = 0.0) -> str:
    text = f"outside the training range: {'R_max' if name == 'max_radius' else name}"
    if name == "max_radius":
        trained = f"trained at {1e6 * trained_at:.4g} µm: right from {1e6 * low:.0f} to {1e6 * high:.0f}"
        return f"{text} {1e6 * value:.4g} µm ({trained}; the default model knows all sizes)"
    if name == "stretch":
        return f"{text} {value:.3g} (trained in {low:g} to {high:g})"
    return f"{text} (at the training scale 10^{value:.2f}, trained in 10^{low:g} to 10^{high:g})"


def _ends(count: int, total: int, names: Sequence[str]) -> str:
    words = ", ".join("R_max" if name == "max_radius_factor" else _spaced(name) for name in names)
    text = f"most shots ({count} of {total}) fit only with a correction at the end of its range: {words}"
    return f"{text}: check the µm per pixel, the frame rate, and that R_max was recorded"


def _bubble(count: int, total: int, names: Sequence[str]) -> str:
    words = ", ".join(map(_spaced, names))
    text = f"most shots ({count} of {total}) fit only with a bubble at the end of its range: {words}"
    return f"{text}: no such bubble is known, so the law may be wrong"


def _heaps(name: str, heaps: Sequence[Any]) -> str:
    return f"the shots disagree: {parameter_of(name).symbol} {heaps_in_words(name, heaps)}"


def _scatter(name: str, scatter: float, limit: float) -> str:
    symbol = parameter_of(name).symbol
    size, usual = digits.percent(scatter), digits.percent(limit)
    return f"the shots disagree: {symbol} scatters by {size} %, of one batch of gel by less than {usual} %"


_UNCOUNTED = {  # what is said of one shot that does not count, and of several
    "does_not_fit": ("does not follow the law", "do not follow the law"),
    "check_input": ("has an input warning", "have an input warning"),
    "failed": ("has no answer", "have no answer"),
    "unverified": ("is by a network alone", "are by a network alone"),
    "no_interval": ("has no interval", "have no interval"),
    "other_switches": ("excludes the model of the others", "exclude the model of the others"),
    "other_model": ("is of another model", "are of another model"),
    "copy": ("is a copy of another", "are copies of others"),
}


def _left_out(counts: Mapping[str, int]) -> str:
    total = sum(counts.values())
    head = digits.counted(total, "shot")
    no = "does not count" if total == 1 else "do not count"
    reasons = {why: _UNCOUNTED[why][count > 1] for why, count in counts.items()}
    if len(reasons) == 1:
        return f"{head} {', '.join(reasons.values())} and {no}"
    return f"{head} {no}: {', '.join(f'{counts[why]} {words}' for why, words in reasons.items())}"


def _outliers(probabilities: Mapping[str, float]) -> str:
    chances = (f"{name} ({'> 99' if p > 0.99 else f'{100 * p:.0f}'} %)" for name, p in probabilities.items())
    return f"probably of another material, and hardly counted: {', '.join(chances)}"


_WRITERS: dict[str, Callable[..., str]] = {  # by code or its first part
    "bound": _bound,
    "prior_end": _prior_end,
    "traded": _traded,
    "training_range": _training_range,
    "check_input.frames_repeated": _repeated,
    "check_input.scale": _scale,
    "check_input.walls": _walls,
    "frames.other_bubble": lambda frames, since: (
        "the end is left out, where the radius rises again as by another bubble: "
        f"{frames} frames from {1e6 * since:.4g} µs after R_max on"
    ),
    "stated.used": lambda **of: f"a constant that the file states is used: {_constant(**of)}",
    "stated.replaced": lambda stated, used, **of: (
        f"what was given is used, not what the file states: {_constant(used, **of)}, not {_constant(stated, **of)}"
    ),
    "misfit.rms": lambda rms, limit: (
        f"the simulation misses the measurement by {100 * rms:.2g} % of R_max RMS (limit {100 * limit:.2g} %)"
    ),
    "misfit.systematic": _systematic,
    "group.doubt.ends": _ends,
    "group.doubt.bubble": _bubble,
    "group.doubt.heaps": _heaps,
    "group.doubt.scatter": _scatter,
    "group.not_given": lambda values: f"{constants_in_words(values)}: assumed, for none is given",
    "group.doubt.misfits": lambda count, total: (
        f"{count} of {total} recordings {'does' if count == 1 else 'do'} not follow the law"
    ),
    "group.doubt.switches": lambda count, total: f"{count} of {total} shots exclude the model of the others",
    "group.doubt.trend": lambda trends: f"{', '.join(trends)} with R_max, as no constant does: wrong law or bubble?",
    "group.left_out": _left_out,
    "group.outliers": _outliers,
    "group.scale": lambda change: f"1 % in scale or frame rate moves G by {digits.significant(change, 2)} %",
}
