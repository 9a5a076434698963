"""All parameters of laws and shots, with symbol, SI unit and searched range; plausible values of quantities, which
reveal a wrong unit; units of time and length as people and programs write them (`µs`, `microns`, `マイクロメートル`);
and the domains of the fields of dataclasses.

A name in the scale of a prior or of draws may begin with log10_ (log10_viscosity). If two laws of a sum have the same
parameter, the name for the later law ends in its number in the sum (viscosity_2).
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import fields
from functools import cache
from math import inf, log10
from numbers import Real
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, brief

LOG10 = "log10_"
Bound = Literal["upper", "lower", "undetermined", "wide"]
"""What is known of a value without a median. Its interval reaches an end of its range: an upper limit (the interval's
upper end), a lower limit (the interval's lower end), or nothing. Or its interval is "wide": only its ends are known."""


class Parameter(NamedTuple):
    """What is known of a parameter before any measurement.

    Attributes:
        symbol, unit: as written in tables; the unit is SI, and "1" means dimensionless.
        search_range: (low, high) of the log10 of the SI value: the range of a fit and of the prior. None: the parameter
            has no such range; it keeps the default of its law, or other code defines its prior.
        start_range: (low, high) of the log10 of the SI value, between which searches start.
    """

    symbol: str
    unit: str
    search_range: tuple[float, float] | None = None
    start_range: tuple[float, float] | None = None


class PlausibleRange(NamedTuple):
    """The values of a quantity in experiments: from `low` to `high`, often near `usual`, in SI. `mistaken_units`: other
    units in which it is often given by mistake, each with (factor, offset) to SI."""

    low: float
    high: float
    usual: float
    unit: str
    mistaken_units: Mapping[str, tuple[float, float]] = {}

    def check(self, name: str, value: float, code: str, advice: str = "") -> None:
        """Raises InputError for a value out of range; the message names the unit that may be meant."""
        if not isinstance(value, Real) or isinstance(value, bool):
            raise InputError(f"{name} must be a number ({self.unit}), got {brief(value)}", code)
        if self.low <= value <= self.high:
            return
        converted = ((value * factor + offset, unit) for unit, (factor, offset) in self.mistaken_units.items())
        inside = [(meant, unit) for meant, unit in converted if self.low < meant < self.high]
        message = f"{name} must be {self.low:g} to {self.high:g} {self.unit}, got {value:.6g}"
        for meant, unit in sorted(inside, key=lambda pair: abs(np.log(pair[0] / self.usual)))[:1]:
            message += f": did you mean {meant:.6g} {self.unit} ({value:.6g} {unit})?"
        raise InputError(message + advice, code)


_SECONDS = {"us": (1e-6, 0.0), "ms": (1e-3, 0.0), "ns": (1e-9, 0.0)}
RADIUS = PlausibleRange(1e-8, 0.05, 2.5e-4, "m", {"um": (1e-6, 0.0), "mm": (1e-3, 0.0)})  # of a bubble
DEVIATION = RADIUS._replace(low=0.0, usual=1e-6)  # of a radius
INTERVAL = PlausibleRange(1e-12, 2e-3, 1e-6, "s", _SECONDS)  # between frames
FRAME_RATE = PlausibleRange(1000.0, 1e10, 1e6, "frames per second", {"kHz": (1e3, 0.0), "MHz": (1e6, 0.0)})
DURATION = PlausibleRange(0.0, 1.0, 1e-4, "s", _SECONDS)  # of a simulation, or after R_max
DISTANCE = PlausibleRange(0.0, 1.0, 1e-3, "m", RADIUS.mistaken_units)  # of a wall
STRETCH_RANGE = (1.05, 40.0)  # searched range of R_max/R_0
USUAL_STRETCH = 6.5, 2.0  # R_max/R_0 of bubbles in gels and liquids: middle, and factor of one standard deviation
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "cm": 1e-2}
_WORDS_OF_UNITS = {
    "s": "sec second seconds sekunde sekunden seconde secondes segundo segundos 秒",
    "ms": "msec millisecond milliseconds millisekunden millisecondes milisegundos ミリ秒 毫秒",
    "us": "usec microsecond microseconds mikrosekunden microsecondes microsegundos マイクロ秒 微秒",
    "ns": "nsec nanosecond nanoseconds nanosekunden nanosecondes nanosegundos ナノ秒 纳秒",
    "m": "meter meters metre metres metros",
    "mm": "millimeter millimeters millimetre millimetres milimetros ミリメートル 毫米",
    "um": "micron microns micrometer micrometers micrometre micrometres mikrometer micrometros マイクロメートル 微米",
    "px": "pixel pixels pix pixeles ピクセル 像素",
    "px2": "pixel2 pixels2",
    "frame": "frames",
    "um2": "micron2 microns2 sqmicrons squm",
}
_UNITS_BY_WORD = {word: unit for unit, words in _WORDS_OF_UNITS.items() for word in words.split()}


PARAMETERS: dict[str, Parameter] = {
    "shear_modulus": Parameter("G", "Pa", (2.0, 7.0), (2.7, 5.2)),
    "C1": Parameter("C_1", "Pa", (0.7, 5.7), (2.4, 4.9)),
    "C2": Parameter("C_2", "Pa", (-2.0, 5.7), (0.0, 4.0)),
    "C3": Parameter("C_3", "Pa", (-5.0, 3.0), (-3.0, 0.0)),
    "stiffening": Parameter("alpha", "1", (-3.0, 1.0), (-2.0, 0.3)),
    "limit": Parameter("J_m", "1", (1.0, 7.0), (2.5, 5.0)),
    "segments": Parameter("N", "1", (0.5, 7.0), (2.0, 5.0)),
    "viscosity": Parameter("µ", "Pa s", (-4.0, 1.0), (-2.3, -0.3)),
    "zero_rate": Parameter("mu_0", "Pa s", (-4.0, 3.0), (-1.5, 1.0)),
    "infinite_rate": Parameter("mu_inf", "Pa s", (-4.0, 1.0), (-3.0, -1.0)),
    "consistency": Parameter("K", "Pa s^n"),  # inferred as a viscosity, K (1e5 1/s)^(n-1)
    "reference_viscosity": Parameter("µ_ref", "Pa s", (-4.0, 1.0), (-2.3, -0.3)),
    "yield_stress": Parameter("tau_y", "Pa", (0.0, 5.7), (2.0, 4.5)),
    "exponent": Parameter("n", "1", (-1.3, 0.5), (-0.6, 0.1)),
    "thinning": Parameter("1-n", "1", (-1.0, -0.1), (-0.8, -0.3)),  # of the default family
    "rest_rate": Parameter("m", "1/s"),
    "time": Parameter("lambda_t", "s", (-9.0, 0.0), (-7.0, -4.0)),
    "transition": Parameter("a", "1"),
    "relaxation_time": Parameter("tau_1", "s", (-8.0, -3.0), (-7.0, -5.0)),
    "retardation_time": Parameter("tau_2", "s", (-9.0, -3.0), (-8.0, -6.0)),
    # of a shot
    "stretch": Parameter("λ", "1", (log10(STRETCH_RANGE[0]), log10(STRETCH_RANGE[1])), (log10(3.0), log10(12.0))),
    "time_origin": Parameter("t_0", "s"),
    "radius_scale": Parameter("scale", "1"),
    "max_radius_factor": Parameter("R_max factor", "1"),
    "accommodation": Parameter("accommodation", "1", (-2.0, 0.0), (-1.7, -0.5)),
    "damage_modulus": Parameter("damage", "1", (-2.0, 0.0), (-1.2, -0.1)),
    "damage_radius": Parameter("R_0'/R_0", "1", (0.0, 1.0), (0.02, 0.7)),
    "confinement_inertia": Parameter("β", "1"),
    "confinement_damping": Parameter("ζ", "1"),
    "vapour_excess": Parameter("Δp_v", "Pa"),
}
"""All parameters by name; those of a new law must be added here."""
CAMERA = ("time_origin", "radius_scale", "max_radius_factor")
BUBBLE = {  # parameters of the bubble itself: meaning and usual values, as text for users
    "accommodation": "share of the vapour that condenses where it hits the wall, 0.01 to 1 (all)",
    "damage_modulus": "G of the torn gel over G before, 0.01 to 1 (not torn)",
    "damage_radius": "stress-free radius of the torn gel over that before, 1 to 10",
    "confinement_inertia": "R_max over twice the distance of a rigid wall (below 0: of a free surface), 0 to 0.5",
    "confinement_damping": "confinement damping: vessel and walls slow the bubble, usually 0 (not at all) to 0.6",
    "vapour_excess": "pressure of the vapour at R_max above saturation, usually 0",
}
VISCOSITY_AT_RATE, REFERENCE_RATE = "viscosity_at_1e5_per_s", 1e5  # name of a viscosity that depends on the rate, 1/s
_LETTERS = {"α": "alpha", "β": "beta", "ζ": "zeta", "λ": "lambda", "μ": "mu", "τ": "tau", "Δ": "Delta"}
DECIDING = ("shear_modulus", "viscosity", "reference_viscosity")  # parameters that make a verdict
MOST_WIDTH = 10.0  # factor between the ends of the interval of a value; a wider one is no value
NO_ONE_VALUE = 1.0  # scatter of the shots of a group over its value, from which on no one value stands for them
UNLIKELY = 0.05  # probability up to which a group has settled that a switch is off
END_SHARE = 0.25  # of an interval's width: nearer to an end of the range, an end is due to the range


def plain_text(text: str) -> str:
    """Return the text without accents, with ' for primes, '' for double primes, a plain minus, and mu for micro."""
    if not text.isascii():
        text = unicodedata.normalize("NFKD", text)
        text = "".join(c for c in text if not unicodedata.combining(c)).replace("−", "-")
    return re.sub("[′’‘´`]", "'", re.sub('["”“″]', "''", text))


def unit_of(text: str, units: Mapping[str, float]) -> str | None:
    """Return the unit of `units` that is written, or None. `rad/s` is read as rads, `s^-1` as s-1, `µm` as um; capitals
    count if only they differ: mPa is not MPa."""
    unit = re.sub(r"[\s/·⋅.*^_()\[\]{}]+", "", plain_text(text).replace("μ", "u"))
    spellings = (unit, unit.lower(), _UNITS_BY_WORD.get(unit), _UNITS_BY_WORD.get(unit.lower()))
    return next((spelling for spelling in spellings if spelling in units), None)


def natural_name(name: str) -> str:
    """The parameter behind a name in the prior's scale: log10_viscosity -> viscosity."""
    return name.removeprefix(LOG10)


def _base_name(name: str) -> str:
    """The name without log10_ and without the number of its law in a sum."""
    return re.sub(r"_\d+$", "", natural_name(name))


def parameter_of(name: str) -> Parameter:
    """The entry of a parameter by its name, with or without log10_ and a number. Raises KeyError: unknown name."""
    return Parameter("µ at 1e5/s", "Pa s") if name == VISCOSITY_AT_RATE else PARAMETERS[_base_name(name)]


def symbol(name: str) -> str:
    """The symbol of a parameter, µ_2 for that of the second law of a sum; its name if it has none."""
    try:
        base = parameter_of(name).symbol
    except KeyError:
        return name
    number = re.search(r"_\d+$", natural_name(name))
    return base + (number.group() if number else "")


def column_name(name: str, unit: str) -> str:
    """The name of a column as in result.csv: "shear_modulus_Pa", "viscosity_Pa_s", "stretch"."""
    return name if unit in ("", "1") else f"{name}_{unit.replace(' ', '_')}"


def matching(text: object, names: Iterable[str]) -> str | None:
    """The parameter of these natural names that is meant: by its symbol ("G", "mu" or "µ", "lambda" or "λ"), its
    natural name ("shear_modulus"), or the name of its column ("shear_modulus_Pa"). None: none of them."""
    if not isinstance(text, str):
        return None
    for name in names:
        short = symbol(name)
        unit = "" if short == name else parameter_of(name).unit
        if _spelled(text) in (_spelled(short), name, column_name(name, unit)):
            return name
    return None


def require_name(text: object, names: Iterable[str], owner: str, code: str) -> str:
    """As `matching`. Raises InputError with this code: `owner`, such as "the answer", has no such parameter."""
    names = [*names]
    name = matching(text, names)
    if name is None:
        symbols = {each: symbol(each) for each in names}
        choices = ", ".join(each if each == short else f"{short} ({each})" for each, short in symbols.items())
        raise InputError(f"{owner} has no {text!r}: it has {choices or 'no parameters'}", code)
    return name


@cache
def _spelled(text: str) -> str:
    """The text with the names of its Greek letters."""
    return "".join(_LETTERS.get(letter, letter) for letter in unicodedata.normalize("NFKC", text))


def is_law_parameter(name: str) -> bool:
    """Whether a parameter belongs to the material, and not to the shot, its bubble or its camera."""
    return natural_name(name) not in ("stretch", *CAMERA, *BUBBLE)


def bound_of(name: str, low: float, high: float, ends: tuple[float, float]) -> Bound | None:
    """What an interval of a parameter tells if it reaches an end of a range, in the same scale: that end is due to the
    range, not to the curve. None: the interval lies within the range. The upper end of an exponent is none: in the
    default law a larger one is that of a liquid that does not thin, and in others hardly of any material."""
    ends = (ends[0], inf) if _base_name(name) == "exponent" else ends
    low, high = max(low, ends[0]), max(high, ends[0])  # a value of exactly 0 lies at the lower end
    room = END_SHARE * (high - low)
    below, above = low - ends[0] <= room, ends[1] - high <= room
    return "undetermined" if below and above else "upper" if below else "lower" if above else None


def is_at_rate(law: str, names: Collection[str], thinning: float = 0.0) -> bool:
    """Whether the viscosity by a law with these parameters is that at 1e5 1/s, because it depends on the rate or may:
    of a power law, of which it is a parameter, of a law that has none of its own, and of a liquid that thins with a
    probability that is not negligible."""
    of_power_law = "power-law" in law and "reference_viscosity" not in names
    derived = VISCOSITY_AT_RATE in names and "viscosity" not in names
    return of_power_law or derived or thinning > UNLIKELY


def has_no_one_value(scatter: float, *, agree: bool) -> bool:
    """Whether no one value stands for the shots of a group. scatter: over their value. agree: whether their intervals
    explain it."""
    return not agree and scatter >= NO_ONE_VALUE


def wide_bound(name: str, low: float, high: float) -> Bound | None:
    """ "wide" for the interval (natural values, SI) of a parameter of DECIDING whose ends are a factor of more than
    MOST_WIDTH apart."""
    return "wide" if name in DECIDING and high > MOST_WIDTH * low else None


def searched_bound(name: str, low: float, high: float) -> Bound | None:
    """`bound_of` for an interval in natural values, SI, and the searched range; None if there is no such range."""
    parameter = PARAMETERS.get(_base_name(name))
    if parameter is None or parameter.search_range is None or not 0 <= low < high:
        return None
    log_low, log_high = (to_prior_scale(LOG10 + name, end) for end in (low, high))
    return bound_of(name, log_low, log_high, parameter.search_range)


def units(names: tuple[str, ...]) -> tuple[str, ...]:
    """SI units of the natural values of parameters: log10_viscosity -> Pa s."""
    return tuple(parameter_of(name).unit for name in names)


def to_natural(name: str, values: ArrayLike) -> Floats:
    """Natural values in SI of a parameter from those in the prior's scale (log10 for a log10_ name)."""
    values = np.asarray(values, dtype=float)
    return np.asarray(10.0**values if name.startswith(LOG10) else values)


def to_prior_scale(name: str, value: float | None) -> float:
    """The value in the prior's scale (log10 for a log10_ name) of a natural value in SI; NaN for None."""
    if value is None:
        return np.nan
    if not name.startswith(LOG10):
        return value
    return float(np.log10(value)) if value > 0 else -np.inf


Domain = dict[str, Any]
"""The allowed numbers of a parameter, as metadata of its field: `modulus: float = field(metadata=POSITIVE)`."""


def domain(words: str, holds: Callable[[float], bool]) -> Domain:
    """The domain of numbers for which `holds` is true; `words` describe it in messages."""
    return {"domain": (words, holds)}


FINITE = domain("finite", lambda x: -inf < x < inf)
NOT_NEGATIVE = domain("finite and not negative", lambda x: 0 <= x < inf)
POSITIVE = domain("finite and positive", lambda x: 0 < x < inf)
POSITIVE_OR_INFINITE = domain("positive", lambda x: x > 0)


def optional(words: str, holds: Callable[[Any], bool]) -> Domain:
    """The domain of values for which `holds` is true, and of None, a value that is left out."""
    return domain(f"{words}, or left out", lambda x: x is None or holds(x))


def check_domain(allowed: Mapping[str, Any], name: str, value: Any, kind: str = "physics") -> None:
    """Raises InputError for a value, or a value in an array, outside a domain, which must be an interval; the code is
    `kind` and the first word of `name`. NaN in an array: of many materials there is no such one."""
    words, holds = allowed["domain"]
    try:
        if isinstance(value, np.ndarray):
            numbers = value[~np.isnan(value)]
            fine = not numbers.size or (holds(float(np.min(numbers))) and holds(float(np.max(numbers))))
        else:
            fine = holds(value) and not isinstance(value, bool | np.bool_)
    except (TypeError, ValueError):  # text, or several numbers
        fine, words = False, f"a number, {words}"
    if not fine:
        raise InputError(f"{name} must be {words}, got {value!r}", f"{kind}.{name.split()[0]}")


def check(parameters: Any, kind: str = "physics") -> None:
    """Raises InputError for the first field of a dataclass that is outside its domain; `kind` as of `check_domain`."""
    for field in fields(parameters):
        if field.metadata:
            check_domain(field.metadata, field.name, getattr(parameters, field.name), kind)
