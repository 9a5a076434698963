"""How answers are written for people: the same digits, units and words in the table, the pictures and the report."""

from __future__ import annotations

from math import ceil, floor, isfinite, log10

from cavirheo.reporting.record import CurveRecord, GroupRecord, Quantity, Result, Spread

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


def modulus_unit(result: Result) -> tuple[float, str]:
    """(factor from Pa, its name): one unit for a whole table, so that rows can be compared by eye."""
    medians = [c.shear_modulus_Pa.median for c in result.curves if c.shear_modulus_Pa.median is not None]
    return (1e-3, "kPa") if not medians or max(medians) >= 1000.0 else (1.0, "Pa")


def quantity(value: Quantity, factor: float = 1.0, *, joint: str = " ") -> str:
    """'6.1 [5.4, 6.9]' to the digits that the interval leaves; '6.44' where there is none."""
    if value.median is None:
        return MISSING
    if value.q05 is None or value.q95 is None:
        return digits(value.median * factor)
    half = (value.q95 - value.q05) / 2.0
    relative = half / abs(value.median) if value.median else 1.0
    count = min(max(ceil(-log10(relative)) + 1, 2), 4) if relative > 0 else 4
    middle = digits(value.median * factor, count)
    high = value.q95 * factor
    places = len(middle.partition(".")[2])
    above = digits(high, count) if "e" in middle else f"{high:.{places}f}"
    return f"{middle}{joint}[{digits(value.q05 * factor, count)}, {above}]"


def spread(value: Spread, factor: float = 1.0) -> str:
    """'6.4 ± 1.6': two digits of the deviation decide."""
    if value.mean is None:
        return MISSING
    mean = value.mean * factor
    if not value.std:
        return digits(mean) + ("" if value.std is None else " ± 0")
    std = value.std * factor
    places = min(max(1 - floor(log10(std)), 0), 9)
    return f"{mean:.{places}f} ± {std:.{places}f}"


def digits(value: float, count: int = 3) -> str:
    """So many significant digits, without exponent between 1e-4 and 1e6."""
    if value == 0.0 or not isfinite(value):
        return f"{value:g}"
    if not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{count - 1}e}"
    rounded = float(f"{value:.{count - 1}e}")  # 9.996 is 10.0, not 10.00
    return f"{rounded:.{max(count - 1 - floor(log10(abs(rounded))), 0)}f}"


def percent(value: float | None) -> str:
    return MISSING if value is None else digits(100.0 * value, 2)


def micrometres(value: float | None) -> str:
    return MISSING if value is None else digits(1e6 * value)


def window(record: CurveRecord) -> str:
    """'3 collapses, t* ≤ 3.1'."""
    count, end = record.window.collapses, record.window.t_star_end
    words = [] if count is None else [f"{count} collapse" + ("" if count == 1 else "s")]
    return ", ".join(words + ([] if end is None else [f"t* ≤ {digits(end, 2)}"])) or MISSING


def elide(text: str, width: int) -> str:
    """Shortened in the middle: beginnings name the material, ends the shot."""
    if len(text) <= width:
        return text
    tail = (width - 1) * 3 // 5
    return text[: width - 1 - tail] + "…" + text[len(text) - tail :]


def shots(group: GroupRecord) -> str:
    """'5 shots, 1 failed'."""
    words = f"{group.n} shot" + ("" if group.n == 1 else "s")
    return words + (f", {group.n_failed} failed" if group.n_failed else "")
