"""Text of answers for people: the same digits, units and words in tables, pictures and reports."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
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
    "does_not_fit": VerdictStyle("does not fit", "#a34a00", "yellow"),
    "check_input": VerdictStyle("check input", "#7a5c00", "bright_yellow"),
    "failed": VerdictStyle("failed", "#b00020", "red"),
    "unverified": VerdictStyle("unverified", "#8a3068", "magenta"),
}
VERDICT_WORDS = {verdict: look.words for verdict, look in VERDICT_STYLES.items()}
MATERIAL_TITLES = {
    "auto": "a neo-Hookean spring that may stiffen or be absent, beside a dashpot",
    "nhkv": "neo-Hookean Kelvin-Voigt",
    "newtonian": "Newtonian fluid (no elasticity: G is not asked for)",
    "qkv": "quadratic Kelvin-Voigt",
}
METHOD_TITLES = {
    "bdt": "Bubble Dynamics Transformer: a point answer, no interval",
    "verified": "posterior draws, weighted by the full physics",
    "least_squares": "posterior draws under white noise, weighted by the full physics",
}
SIMULATION_NAMES = {  # by method: which simulation is drawn over a measurement
    "verified": "best draw",
    "least_squares": "best fit",
}
MISSING = "–"
_SIDES = {"upper": "below", "lower": "above"}  # by bound: on which side of the limit the value lies


def modulus_unit(moduli: Iterable[float | None]) -> tuple[float, str]:
    """(factor from Pa, name) of one unit for a whole table or picture, so that its rows can be compared by eye."""
    return (1e-3, "kPa") if max((G for G in moduli if G is not None), default=1e3) >= 1e3 else (1.0, "Pa")


def unit_for(unit: str, value: float | None) -> tuple[float, str]:
    """(factor from SI, name) of the unit of a value in a sentence: Pa or kPa of a modulus; "" if dimensionless."""
    return modulus_unit([value]) if unit == "Pa" else (1.0, "" if unit == "1" else unit)


def quantity(value: Quantity, factor: float = 1.0, *, unit: str = "", joint: str = " ") -> str:
    """A quantity in words: '6.1 [5.4, 6.9]', with digits by the width of the interval; '6.44' without an interval;
    'below 0.030 (95 %)', '0.010 to 0.15' or 'undetermined' for a bound. `unit` follows the number, `joint` stands
    before brackets."""
    unit = f" {unit}" if unit else ""
    if not value.known:
        return MISSING
    if value.bound == "undetermined":
        return value.bound
    if value.bound == "upper" and value.q95 == 0.0:
        return f"0{unit}{joint}(95 %)"
    if value.bound == "wide" and value.q05 is not None and value.q95 is not None:
        return f"{significant(value.q05 * factor, 2)} to {significant(value.q95 * factor, 2)}{unit}"
    if value.bound and (end := value.q95 if value.bound == "upper" else value.q05) is not None:
        return f"{_SIDES[value.bound]} {significant(end * factor, 2)}{unit}{joint}(95 %)"
    if value.median is None:
        return MISSING
    if value.q05 is None or value.q95 is None or value.q05 == value.q95:
        return significant(value.median * factor) + unit
    half = (value.q95 - value.q05) / 2.0
    relative = half / abs(value.median) if value.median else 1.0
    count = min(max(ceil(-log10(min(relative, 1.0))) + 1, 2), 4) if relative > 0 else 4
    middle = significant(value.median * factor, count)
    high = value.q95 * factor
    places = len(middle.partition(".")[2])
    wide = "e" in middle or high > 100.0 * abs(value.median * factor)
    above = significant(high, count) if wide else f"{high:.{places}f}"
    return f"{middle}{unit}{joint}[{significant(value.q05 * factor, count)}, {above}]"


def quantity_with_unit(value: Quantity, factor: float = 1.0, unit: str = "") -> str:
    """`quantity` for a sentence, with the unit after the interval: '6.1 [5.4, 6.9] kPa', 'below 0.030 Pa s (95 %)'."""
    if value.bound:
        return quantity(value, factor, unit=unit)
    return quantity(value, factor) + (f" {unit}" if unit else "")


def spread(value: Spread, factor: float = 1.0) -> str:
    """Mean ± deviation to two digits of the deviation, '6.4 ± 1.6'; '6.44 ± 0' if it is a rounding error."""
    if value.mean is None:
        return MISSING
    mean = value.mean * factor
    if value.std is None:
        return significant(mean)
    std = value.std * factor
    if std < 1e-4 * abs(mean):
        return f"{significant(mean)} ± {significant(std, 1) if std > 1e-12 * abs(mean) else 0}"
    places = min(max(1 - floor(log10(std)), 0), 9) if std else 0
    return f"{mean:.{places}f} ± {std:.{places}f}"


def significant(value: float, count: int = 3) -> str:
    """The value with `count` significant digits, without an exponent from 1e-4 to 1e6."""
    if value == 0.0 or not isfinite(value):
        return f"{value:g}"
    if not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{count - 1}e}"
    rounded = float(f"{value:.{count - 1}e}")  # 9.996 is 10.0, not 10.00
    return f"{rounded:.{max(count - 1 - floor(log10(abs(rounded))), 0)}f}"


def symbol_and_unit(name: str) -> tuple[str, str]:
    """Symbol and unit of a parameter, "" if it is dimensionless; (name, "") for an unknown name."""
    from cavirheo.parameters import parameter_of  # imports numpy, which takes longer than a help page

    try:
        symbol, unit, *_ = parameter_of(name)
    except KeyError:
        return name, ""
    return symbol, "" if unit == "1" else unit


def counted(count: int, what: str) -> str:
    """A number with its noun: '1 shot', '2 shots'."""
    return f"{count} {what}" + ("" if count == 1 else "s")


def counted_shots(count: int, total: int) -> str:
    """How many shots of a group count in its material or its means: '4 of 5 shots count'."""
    return f"{count} of {counted(total, 'shot')} count{'s' * (total == 1)}"


def p_value_in_words(predictive: Mapping[str, Any]) -> str:
    """p-value of a predictive check: 'p = 0.04', or 'p < 0.0015' if it is the least that its replicates can give."""
    p = predictive["p_value"]
    return f"p {'=' if p > predictive.get('least', 0.0) else '<'} {p:.2g}"


def number_ranges(numbers: Sequence[int]) -> str:
    """Sorted whole numbers as text with ranges: "12, 40-45"."""
    ends = [k for k, n in enumerate(numbers) if k == 0 or n > numbers[k - 1] + 1] + [len(numbers)]
    runs = [(numbers[low], numbers[high - 1]) for low, high in pairwise(ends)]
    return ", ".join(str(low) if low == high else f"{low}-{high}" for low, high in runs)


def simulation_name(method: str) -> str:
    """Which simulation is drawn over a measurement for an answer by this method: 'best draw'."""
    return SIMULATION_NAMES.get(method, "answer")


def number(value: float | None, factor: float = 1.0, count: int = 3) -> str:
    """The value times the factor with `count` significant digits; MISSING for None."""
    return MISSING if value is None else significant(factor * value, count)


def ends(values: Iterable[float | None], factor: float = 1.0, count: int = 3) -> str:
    """The smallest and the largest of these values times the factor: '120 to 310', '120' if equal; "" for none."""
    numbers = [value for value in values if value is not None]
    if not numbers:
        return ""
    return " to ".join(dict.fromkeys(significant(factor * end, count) for end in (min(numbers), max(numbers))))


def percent(value: float | None) -> str:
    return number(value, 100.0, 2)


def micrometres(value: float | None) -> str:
    return number(value, 1e6)


def elide(text: str, width: int) -> str:
    """The text, shortened in the middle to `width`: the beginning names the material, and the end the shot."""
    if len(text) <= width:
        return text
    tail = (width - 1) * 3 // 5
    return text[: width - 1 - tail] + "…" + text[len(text) - tail :]


def shorten_names(names: Sequence[str], width: int = 80) -> list[str]:
    """The names, elided, and of a single file only the shot numbers ("[7]"); all in full if two would be equal."""
    numbered = [name for name in names if name.endswith("]")]
    files = {name.rpartition("[")[0] for name in numbered}
    file = files.pop() if len(files) == 1 < len(numbered) else ""
    short = [elide(name.removeprefix(file) if name.endswith("]") else name, width) for name in names]
    return short if len(set(short)) == len(set(names)) else list(names)


def distinct_names(names: Sequence[str]) -> list[str]:
    """What distinguishes the names: of long ones without the words with which all of them begin."""
    short = shorten_names(names)
    if len(short) < 2 or max(map(len, short)) <= SHORT_NAME:
        return short
    least, largest = min(short), max(short)
    alike = next((k for k, pair in enumerate(zip(least, largest, strict=False)) if pair[0] != pair[1]), len(least))
    first = max(least[:alike].rfind(mark) for mark in "_- /.") + 1
    return [name[first:] for name in short]


def printable(text: str) -> str:
    """A text of several lines with its control characters escaped, safe for a terminal and a document."""
    return "\n".join(map(errors.printable, text.split("\n")))
