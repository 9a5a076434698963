"""Messages of an answer as records, and the sentences for users: a template in sentences.toml, or a function here.

Other modules create messages from a code and values, and decide by codes alone; none of them parses a sentence.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from string import Formatter
from typing import Any

from cavirheo.errors import InputError, SolverError
from cavirheo.parameters import parameter_of
from cavirheo.writing import digits

CAMERA_TOLERANCE = 0.01  # relative; a frame rate or scale that differs by more from that of the file is a doubt
_ASPHERICAL = 0.05  # of the larger half-axis: a larger difference of both is a doubt
_MOST_NAMES = 10  # letters of the names of shots in a sentence, from which on they are counted


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
        parts = self.code.split(".")
        if writer := _WRITERS.get(self.code) or _WRITERS.get(parts[0]):
            return writer(**self.parameters)
        codes = (".".join(parts[:count]) for count in range(len(parts), 0, -1))
        template = next((_sentences()[code] for code in codes if code in _sentences()), "{text}")
        return _Templates().format(template, *parts, **self.parameters)


@cache
def _sentences() -> dict[str, str]:
    return tomllib.loads((files("cavirheo") / "sentences.toml").read_text(encoding="utf-8"))


def is_input_warning(code: str) -> bool:
    """Whether the message concerns the recording or its settings: no answer is ok unless the user confirms these."""
    return code.startswith("check_input.")


def camera_warnings(given: float, found: float, what: str, origin: str) -> tuple[Message, ...]:
    """A warning if a number of the user contradicts that of the file or its camera, which comes from `origin`."""
    if abs(given / found - 1.0) <= CAMERA_TOLERANCE:
        return ()
    values = {"given": given, "what": what, "origin": origin, "value": found}
    return (Message("check_input.camera_differs", values),)


def aspherical_warnings(share: float) -> tuple[Message, ...]:
    """A warning if the half-axes of a large bubble differ by too large a share of the larger one."""
    return (Message("check_input.aspherical", {"share": share}),) if share > _ASPHERICAL else ()


def message_of_error(error: Exception) -> Message:
    """The message why there is no answer, from the error that ended the analysis."""
    if isinstance(error, InputError):
        return Message(error.code, {"text": error.message})
    if isinstance(error, SolverError):
        return Message("solver", {"text": str(error)})
    return Message("unexpected", {"text": f"unexpected {type(error).__name__}: {error}".removesuffix(": ")})


def heaps_in_words(name: str, heaps: Sequence[Any]) -> str:
    """'either 0.026 to 0.033 Pa s in [1], [2] or below 0.020 in 12 shots' of heaps with `low`, `high` (SI), `shots`."""
    short = iter(digits.distinct_names([shot for heap in heaps for shot in heap.shots]))
    ends = [end for heap in heaps for end in (heap.low, heap.high) if end]
    _, factor, unit, _ = digits.shown(name, max(ends))
    parts: list[str] = []
    for heap in heaps:
        first, last = (digits.number(end, factor, 2) for end in (heap.low, heap.high))
        limits = (
            f"below {last}" if heap.low is None else f"above {first}" if heap.high is None else f"{first} to {last}"
        )
        names = ", ".join(next(short) for _ in heap.shots)
        where = names if len(names) <= _MOST_NAMES else digits.counted(len(heap.shots), "shot")
        parts.append(f"{limits}{'' if parts else f' {unit}'} in {where}")
    return f"either {' or '.join(parts)}"


def _constants(values: Mapping[str, float]) -> str:
    """'density 998 kg/m3, pressure 101 kPa' of constants of the medium by name, SI."""
    words = []
    for name, value in values.items():
        factor, unit = (1e-3, "kPa") if name == "pressure" else (1.0, "kg/m3")
        words.append(f"{name} {digits.number(value, factor)} {unit}")
    return ", ".join(words)


def _words(name: str) -> str:
    return "R_max" if name == "max_radius_factor" else name.replace("_", " ")


def _repeated(times: int, equal: int, frames: int) -> str:
    cause = f"each frame seems to stand {times} times: keep one of each" if times else "keep the first of equal frames"
    count = f"{equal} of {frames} radii equal the one before, also where the bubble moves fast"
    return f"check the frames: {count}; {cause}, with its time, or add --trust-input"


def _scale(ratio: float, max_radius: float, factors: Sequence[float]) -> str:
    collapse = f"the first collapse comes {ratio:.2g} Rayleigh times after R_max ({1e6 * max_radius:.4g} µm)"
    head = "check the scale of radius and time"
    advice = "give the true R_max (--rmax-um), frame rate (--fps) or --pressure, or add --trust-input if all are right"
    if not factors:
        return f"{head}: {advice}; {collapse}, which no material shows"
    size, time = ("small", "long") if ratio > 1.0 else ("large", "short")
    cause = "radii in pixels" if ratio > 1.0 else "diameters for radii"
    if all(0.5 < factor / 1000.0 < 2.0 for factor in factors):
        cause = "a unit that is wrong by a factor of 1000"
        advice = "mend the unit, or " + advice
    by = digits.ends(factors, count=2)
    which = f"radii are {by} times too {size}, or times that much too {time} ({cause}?)"
    return f"{head}: {which}: {advice}; {collapse}"


def _bound(name: str, bound: str, **_: Any) -> str:
    symbol = parameter_of(name).symbol
    return {
        "undetermined": f"the recording does not determine {symbol}: values all over the searched range follow it",
        "upper": f"the recording gives only an upper limit of {symbol}: smaller values follow it as well",
        "lower": f"the recording gives only a lower limit of {symbol}: larger values follow it as well",
        "wide": f"the recording gives {symbol} only to a factor of more than 10",
    }[bound]


def _systematic(excess: float, detectable: float, exact: bool, limit: float, p_value: float) -> str:
    size = f"less than {100 * detectable:.2g}" if excess < detectable else f"{100 * excess:.1f}"
    text = "the simulation differs from the frames by more than noise explains: "
    text += f"by {size} % of R_max beyond the noise ({digits.p_value_in_words(p_value)})"
    if exact:
        return f"{text}, and the law was taken as exact, so the interval is too narrow"
    if excess > limit:
        return f"{text} (limit {100 * limit:.0f} %)"
    return text if excess < detectable else f"{text}, which the interval allows for"


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
    "check_input.frames_repeated": _repeated,
    "check_input.scale": _scale,
    "misfit.systematic": _systematic,
    "group.doubt.heaps": lambda name, heaps: (
        f"the shots disagree: {parameter_of(name).symbol} {heaps_in_words(name, heaps)}"
    ),
    "group.left_out": _left_out,
    "group.outliers": _outliers,
}
_FORMS: dict[str, Callable[[Any], str]] = {  # how a value stands in a template, by what is behind its colon
    "symbol": lambda name: parameter_of(name).symbol,
    "words": _words,
    "list": lambda names: ", ".join(map(_words, names)),
    "does": lambda count: "does" if count == 1 else "do",
    "number": lambda value: value if isinstance(value, str) else f"{value:.6g}",
    "unit": lambda unit: f" {unit}" if unit else "",
    "two digits": lambda value: digits.number(value, count=2),
    "percent": lambda share: f"{digits.percent(share)} %",
    "µm": lambda metres: f"{1e6 * metres:.4g} µm",
    "about µm": lambda metres: f"{digits.number(metres, 1e6, 2)} µm",
    "µs": lambda seconds: f"{1e6 * seconds:.4g} µs",
    "constants": _constants,
}


class _Templates(Formatter):
    """str.format with _FORMS, and "count gap": '1 gap', '2 gaps'."""

    def format_field(self, value: Any, form: str) -> str:
        if form.startswith("count "):
            return digits.counted(value, form.removeprefix("count "))
        return _FORMS[form](value) if form in _FORMS else format(value, form)
