"""Text of answers for people: the same digits, units and words in tables, pictures and reports."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import pairwise, takewhile
from math import ceil, floor, isfinite, log10
from typing import TYPE_CHECKING, Any, NamedTuple

from cavirheo import errors

if TYPE_CHECKING:
    from cavirheo.writing.document import Quantity, Spread


class VerdictStyle(NamedTuple):
    """How a verdict is shown: its words, its colour on white, and its colour in a terminal."""

    words: str
    colour: str
    terminal: str


SHORT_NAME = 16  # most characters of a name that is written in full everywhere
VERDICT_STYLES = {
    "ok": VerdictStyle("ok", "#00694d", "green"),
    "bound": VerdictStyle("bound", "#1f5f8b", "cyan"),
    "unverified": VerdictStyle("unverified", "#8a3068", "magenta"),
    "does_not_fit": VerdictStyle("does not fit", "#a34a00", "yellow"),
    "check_input": VerdictStyle("check input", "#7a5c00", "bright_yellow"),
    "failed": VerdictStyle("failed", "#b00020", "red"),
}
MATERIAL_TITLES = {
    "auto": "a neo-Hookean spring that may stiffen, beside a dashpot, or a liquid that may thin",
    "nhkv": "neo-Hookean Kelvin-Voigt",
    "newtonian": "Newtonian fluid (no elasticity: G is not asked for)",
    "qkv": "quadratic Kelvin-Voigt",
}
METHODS = {  # how a method answers, and what its simulation is called
    "bdt": ("Bubble Dynamics Transformer: a point answer, no interval", "answer"),
    "verified": ("posterior draws, weighted by the full physics", "best draw"),
    "least_squares": ("posterior draws under white noise, weighted by the full physics", "best fit"),
}
BUBBLES = {"real": "real (vapour condenses slowly)", "field": "the field's (vapour condenses at once)"}
SURE = "90 % sure"  # head of the ends between which a value lies with this probability
OWN = "own 90 %"  # the same of a shot in a group, as if what all its shots share were exact: scale, rate, density
MISSING = "–"
NO_BREAK = "\u00a0"
FILLER = "\0"
_SIDES = {"upper": "below", "lower": "above"}  # by bound: on which side of the limit the value lies


class Shown(NamedTuple):
    """How values of a parameter are shown: its symbol, the factor from SI, the unit, and that of SI ("": none)."""

    symbol: str
    factor: float
    unit: str
    si: str

    def parts(self, value: Quantity) -> tuple[str, str]:
        """(value, interval), as `value_parts`."""
        return value_parts(value, self.factor)

    def words(self, value: Quantity) -> str:
        """The value with its unit, as `quantity`."""
        return quantity(value, self.factor, unit=self.unit)

    def named(self, value: Quantity) -> str:
        """'G 6.1 kPa (5.4 to 6.9)'."""
        return f"{self.symbol} {self.words(value)}"


def shown(name: str, *moduli: float | None) -> Shown:
    """How a parameter is shown; an unknown one by its name, without a unit. moduli: those (SI) of a whole table or
    picture, whose largest one decides between Pa and kPa, so that its rows can be compared by eye."""
    from cavirheo.parameters import parameter_of  # imports numpy, which takes longer than a help page

    try:
        symbol, si, *_ = parameter_of(name)
    except KeyError:
        symbol, si = name, "1"
    modulus = (1e-3, "kPa") if max((G for G in moduli if G is not None), default=0.0) >= 1e3 else (1.0, "Pa")
    factor, unit = {"Pa": modulus, "s": (1e6, "µs"), "1": (1.0, "")}.get(si, (1.0, si))
    return Shown(symbol, factor, unit, "" if si == "1" else si)


def value_parts(value: Quantity, factor: float = 1.0) -> tuple[str, str]:
    """(value, interval) with digits by the width: ('6.1', '5.4 to 6.9'); ('6.44', '') without an interval; a bound has
    no value: ('', 'below 0.030'), ('', '0.010 to 0.15') or ('', 'not known')."""
    if value.bound == "undetermined":
        return "", "not known"
    if value.is_zero:
        return "", "0"
    if value.bound == "wide":
        return "", f"{number(value.q05, factor, 2)} to {number(value.q95, factor, 2)}"
    if value.bound:
        return "", f"{_SIDES[value.bound]} {number(value.largest, factor, 2)}"
    if value.median is None or value.q05 is None or value.q95 is None or value.q05 == value.q95:
        return number(value.median, factor), ""
    relative = 0.5 * (value.q95 - value.q05) / abs(value.median) if value.median else 1.0
    count = min(max(ceil(-log10(min(relative, 1.0))) + 1, 2), 4) if relative > 0 else 4
    middle = number(value.median, factor, count)
    high, places = value.q95 * factor, len(middle.partition(".")[2])
    is_far = not places or "e" in middle or high > 100.0 * abs(value.median * factor)
    above = number(high, count=count) if is_far else f"{high:.{places}f}"
    below = f"{value.q05 * factor:.{places}f}" if value.q05 < 0.0 and not is_far else number(value.q05, factor, count)
    return middle, f"{below} to {above}"


def quantity(value: Quantity, factor: float = 1.0, *, unit: str = "", joint: str = " ") -> str:
    """A quantity in words: '6.1 kPa (5.4 to 6.9)'; '6.44 kPa' without an interval; 'below 0.030 Pa s (95 %)',
    '0.010 to 0.15 Pa s' or 'not known' for a bound. `joint` stands before brackets."""
    middle, interval = value_parts(value, factor)
    unit = f" {unit}" if unit and value.known and value.bound != "undetermined" else ""
    if value.bound in ("upper", "lower"):
        return f"{interval}{unit}{joint}(95 %)"
    if not middle:
        return interval + unit
    return f"{middle}{unit}{joint}({interval})" if interval else middle + unit


def spread(value: Spread, factor: float = 1.0) -> str:
    """Mean ± deviation to two digits of the deviation, '6.4 ± 1.6'; '6.44' without one."""
    if value.mean is None or not value.std:
        return number(value.mean, factor)
    std = value.std * factor
    places = min(max(1 - floor(log10(std)), 0), 9)
    return f"{value.mean * factor:.{places}f} ± {std:.{places}f}"


def number(value: float | None, factor: float = 1.0, count: int = 3) -> str:
    """The value times the factor with `count` significant digits, from 1e-4 to 1e6 without an exponent."""
    if value is None:
        return MISSING
    value = factor * value
    if value == 0.0 or not isfinite(value):
        return f"{value:g}"
    if not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{count - 1}e}"
    rounded = float(f"{value:.{count - 1}e}")  # 9.996 is 10.0, not 10.00
    return f"{rounded:.{max(count - 1 - floor(log10(abs(rounded))), 0)}f}"


def counted(count: int, what: str) -> str:
    """A number with its noun: '1 shot', '2 shots'."""
    return f"{count} {what}" + ("" if count == 1 else "s")


def counted_shots(count: int, total: int) -> str:
    """How many shots of a group count in its material or its means: '4 of 5 shots count'."""
    return f"{count} of {counted(total, 'shot')} {'counts' if total == 1 else 'count'}"


def p_value_in_words(p: float) -> str:
    """'p = 0.04', or 'p < 1e-06': the tail of an approximate distribution tells no smaller probability."""
    return f"p = {p:.2g}" if p > 1e-6 else "p < 1e-06"


def number_ranges(numbers: Sequence[int]) -> str:
    """Sorted whole numbers as text with ranges: "12, 40-45"."""
    starts = [k for k, n in enumerate(numbers) if k == 0 or n > numbers[k - 1] + 1]
    runs = [numbers[low:high] for low, high in pairwise([*starts, len(numbers)])]
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)


def simulation_name(method: str) -> str:
    """Which simulation is drawn over a measurement for an answer by this method: 'best draw'."""
    return METHODS.get(method, ("", "answer"))[1]


def ends(values: Iterable[float | None], factor: float = 1.0, count: int = 3) -> str:
    """The smallest and the largest of these values times the factor: '120 to 310', '120' if equal; "" for none."""
    numbers = sorted(value for value in values if value is not None)
    return " to ".join(dict.fromkeys(number(end, factor, count) for end in numbers[:1] + numbers[-1:]))


def percent(value: float | None) -> str:
    return number(value, 100.0, 2)


def micrometres(value: float | None) -> str:
    return number(value, 1e6)


def spaced(text: str) -> str:
    """The text with a FILLER after each wide letter, as of Chinese: its length is its number of columns on a screen."""
    from rich.cells import cell_len  # takes longer than a help page

    return text if text.isascii() else "".join(letter + FILLER * (cell_len(letter) - 1) for letter in text)


def elide(text: str, width: int) -> str:
    """The text, shortened in the middle to `width` columns: the beginning names the material, and the end the shot."""
    letters = spaced(text)
    if len(letters) <= width:
        return text
    tail = (width - 1) * 3 // 5
    return (letters[: width - 1 - tail] + "…" + letters[len(letters) - tail :]).replace(FILLER, "")


def distinct_names(names: Sequence[str]) -> list[str]:
    """What distinguishes the names: of the shots of one file their numbers, "[7]"; of long names what stands between
    the words with which all of them begin, and those with which all of them end."""
    alike = _common_start(names)
    begin = end = 0
    if "[" in alike:
        begin = alike.rindex("[")
    elif max(map(len, names), default=0) > SHORT_NAME:
        begin = 1 + max(alike.rfind(mark) for mark in "_- /.")
        ending = _common_start([name[begin:][::-1] for name in names])  # backwards
        end = 1 + max(ending.rfind(mark) for mark in "_- /.")
    short = [name[begin : len(name) - end] for name in names]
    return short if all(short) and len(set(names)) > 1 else list(names)


def short_names(names: Sequence[str], width: int) -> list[str]:
    """What distinguishes the names, shortened to `width`; of those that are equal then, what distinguishes these."""
    short = [elide(name, width) for name in distinct_names(names)]
    for text in {text for text in short if short.count(text) > 1}:
        places = [k for k, one in enumerate(short) if one == text]
        for k, name in zip(places, distinct_names([names[k] for k in places]), strict=True):
            short[k] = elide(name, width)
    return short


def _common_start(names: Sequence[str]) -> str:
    alike = takewhile(lambda letters: len({*letters}) == 1, zip(*names, strict=False))
    return "".join(first for first, *_ in alike)


def together(text: str) -> str:
    """The text with a no-break space after each number, so that it stays with its unit where lines are broken."""
    return re.sub(r"(?<=\d) (?=\S)", NO_BREAK, text).replace("Pa s", f"Pa{NO_BREAK}s")


def printable(value: Any) -> Any:
    """The value with the control characters of every text in it escaped, except line ends."""
    if isinstance(value, dict):
        return {printable(key): printable(item) for key, item in value.items()}
    if isinstance(value, list):
        return [printable(item) for item in value]
    if isinstance(value, str):  # its type is kept: templates have texts that are marked as safe
        return type(value)("\n".join(map(errors.printable, value.split("\n"))))
    return value
