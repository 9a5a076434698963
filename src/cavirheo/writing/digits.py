"""How answers are written for people: the same digits, units and words in the table, the pictures and the report."""

from __future__ import annotations

from collections.abc import Iterable
from math import ceil, floor, isfinite, log10

from cavirheo.writing.document import Quantity, Spread

VERDICTS = {
    "ok": "ok",
    "model_does_not_fit": "does not fit",
    "outside_training_range": "outside range",
    "failed": "failed",
}
MATERIALS = {
    "nhkv": "neo-Hookean Kelvin-Voigt",
    "newtonian": "Newtonian fluid (no elasticity: G is not asked for)",
    "qkv": "quadratic Kelvin-Voigt",
}
METHODS = {
    "bdt": "Bubble Dynamics Transformer: a point answer, no interval",
    "amortised": "posterior network",
    "verified": "posterior draws, weighted by the full physics",
    "least_squares": "least squares on the simulation",
}
MISSING = "–"


def modulus_unit(moduli: Iterable[float | None]) -> tuple[float, str]:
    """(factor from Pa, its name): one unit for a whole table or picture, so that its rows can be compared by eye."""
    return (1e-3, "kPa") if max((G for G in moduli if G is not None), default=1e3) >= 1e3 else (1.0, "Pa")


def quantity(value: Quantity, factor: float = 1.0, *, joint: str = " ") -> str:
    """'6.1 [5.4, 6.9]' to the digits that the interval leaves; '6.44' where there is none."""
    if value.median is None:
        return MISSING
    if value.q05 is None or value.q95 is None:
        return significant(value.median * factor)
    half = (value.q95 - value.q05) / 2.0
    relative = half / abs(value.median) if value.median else 1.0
    count = min(max(ceil(-log10(relative)) + 1, 2), 4) if relative > 0 else 4
    middle = significant(value.median * factor, count)
    high = value.q95 * factor
    places = len(middle.partition(".")[2])
    above = significant(high, count) if "e" in middle else f"{high:.{places}f}"
    return f"{middle}{joint}[{significant(value.q05 * factor, count)}, {above}]"


def spread(value: Spread, factor: float = 1.0) -> str:
    """'6.4 ± 1.6': two digits of the deviation decide."""
    if value.mean is None:
        return MISSING
    mean = value.mean * factor
    if not value.std:
        return significant(mean) + ("" if value.std is None else " ± 0")
    std = value.std * factor
    places = min(max(1 - floor(log10(std)), 0), 9)
    return f"{mean:.{places}f} ± {std:.{places}f}"


def significant(value: float, count: int = 3) -> str:
    """So many significant digits, without exponent between 1e-4 and 1e6."""
    if value == 0.0 or not isfinite(value):
        return f"{value:g}"
    if not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{count - 1}e}"
    rounded = float(f"{value:.{count - 1}e}")  # 9.996 is 10.0, not 10.00
    return f"{rounded:.{max(count - 1 - floor(log10(abs(rounded))), 0)}f}"


def percent(value: float | None) -> str:
    return MISSING if value is None else significant(100.0 * value, 2)


def micrometres(value: float | None) -> str:
    return MISSING if value is None else significant(1e6 * value)


def elide(text: str, width: int) -> str:
    """Shortened in the middle: beginnings name the material, ends the shot."""
    if len(text) <= width:
        return text
    tail = (width - 1) * 3 // 5
    return text[: width - 1 - tail] + "…" + text[len(text) - tail :]
