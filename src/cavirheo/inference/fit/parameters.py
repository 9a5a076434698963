"""What a fit varies: the parameters of a law, in log10, and those of each shot, with the ranges searched."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import MISSING, Field, dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cavirheo.errors import InputError
from cavirheo.inference.reconstruct import STRETCH_RANGE, check_stretch
from cavirheo.physics.laws import LAWS, UNITS, combine
from cavirheo.physics.materials import Material

Floats = NDArray[np.float64]

# log10 of the SI value (units: physics/laws.py): the range searched, and the part of it where searches start. What is
# not here keeps the default of its law (rest_rate, transition); a law without such a default cannot be fitted (ogden).
RANGES: dict[str, tuple[tuple[float, float], tuple[float, float]]] = {
    "shear_modulus": ((1.0, 6.0), (2.7, 5.2)),
    "C1": ((0.7, 5.7), (2.4, 4.9)),
    "C2": ((-2.0, 5.7), (0.0, 4.0)),
    "C3": ((-5.0, 3.0), (-3.0, 0.0)),
    "stiffening": ((-3.0, 1.0), (-2.0, 0.3)),
    "limit": ((1.0, 7.0), (2.5, 5.0)),
    "segments": ((0.5, 7.0), (2.0, 5.0)),
    "viscosity": ((-4.0, 1.0), (-2.3, -0.3)),
    "zero_rate": ((-4.0, 3.0), (-1.5, 1.0)),
    "infinite_rate": ((-4.0, 1.0), (-3.0, -1.0)),
    "consistency": ((-4.0, 5.0), (-2.0, 2.0)),
    "yield_stress": ((0.0, 5.7), (2.0, 4.5)),
    "exponent": ((-1.3, 0.5), (-0.6, 0.1)),
    "time": ((-9.0, 0.0), (-7.0, -4.0)),
    "relaxation_time": ((-8.0, -3.0), (-7.0, -5.0)),
    "retardation_time": ((-9.0, -3.0), (-8.0, -6.0)),
}
STRETCH_START = (3.0, 12.0)
FREE = {"t0": "time_origin", "scale": "radius_scale", "rmax": "max_radius_factor"}  # option: name in the answer
NUISANCE_UNITS = {"time_origin": "s", "radius_scale": "1", "max_radius_factor": "1"}
SCALE_BOUND = 0.015  # radius calibration and R_max are known to 1-1.5 % (two circle fits of one video differ by 1 %)
AT_BOUND = 1e-3  # of a range: nearer to its end is "at the bound"


def _fittable(parameter: Field[Any]) -> bool:
    return parameter.name in RANGES or parameter.default is not MISSING


ABLE = [name for name, law in LAWS.items() if all(_fittable(f) for f in fields(law) if f.init)]  # type: ignore[arg-type]


@dataclass(frozen=True)
class Family:
    """All materials of a law, or of a sum of laws ("gent + newtonian"): log10 of the parameters -> Material.

    A parameter that two laws of a sum have is followed by the number of the later one: viscosity, viscosity_2.

    Raises:
        InputError: unknown law, one with a parameter for which no range is set, or laws that no material can have both.
    """

    name: str
    _terms: tuple[tuple[str, tuple[str, ...]], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        terms = []
        for law in (part.strip() for part in self.name.split("+")):
            if law not in ABLE:
                hint = " without parameters (all of them are fitted)" if "(" in law else ""
                if law in LAWS:
                    lacking = [f.name for f in fields(LAWS[law]) if f.init and not _fittable(f)]  # type: ignore[arg-type]
                    hint = f" (its {', '.join(lacking)} cannot be given a range)"
                raise InputError(f"cannot fit the material {law!r}{hint}; known, also as sums: {', '.join(ABLE)}")
            terms.append((law, tuple(f.name for f in fields(LAWS[law]) if f.init and f.name in RANGES)))  # type: ignore[arg-type]
        object.__setattr__(self, "_terms", tuple(terms))
        self.material(np.mean(self.bounds(1), axis=1))  # whether the laws go together

    @property
    def parameters(self) -> tuple[str, ...]:
        names: list[str] = []
        for number, (_, own) in enumerate(self._terms, 1):
            names += [f"{name}_{number}" if name in names else name for name in own]
        return tuple(names)

    def material(self, log10: Floats) -> Material:
        """The material of (parameters,) log10 values. Raises InputError where they exclude each other."""
        values = iter(10.0**log10)
        return combine([LAWS[law](**{name: float(next(values)) for name in own}) for law, own in self._terms])

    def bounds(self, which: int = 0) -> Floats:
        """(parameters, 2): the range searched (0) or started from (1)."""
        return np.array([RANGES[name][which] for _, own in self._terms for name in own])


@dataclass(frozen=True)
class Settings:
    """The options of a fit; see `fit`."""

    window: int | str | None = None
    end: float | None = None
    stretch: float | str | None = None
    free: tuple[str, ...] = ()
    t0_bound: float | None = None
    scale_bound: float = SCALE_BOUND
    weights: str = "motion"
    windows: bool = True

    def __post_init__(self) -> None:
        if (isinstance(self.window, str) and self.window != "all") or (
            isinstance(self.window, int) and self.window < 1
        ):
            raise InputError(f"the window must be a number of collapses from 1 up, or 'all'; got {self.window!r}")
        if self.end is not None and not 0 < self.end < np.inf:
            raise InputError(f"the end of the window must be a positive time in s, got {self.end!r}")
        if isinstance(self.stretch, str):
            if self.stretch != "plateau":
                raise InputError(f"stretch must be R_max/R_0, 'plateau' or left out; got {self.stretch!r}")
        else:
            check_stretch(self.stretch)
        if unknown := [name for name in self.free if name not in FREE]:
            raise InputError(f"cannot free {', '.join(map(repr, unknown))}; known: {', '.join(FREE)}")
        if len(set(self.free)) < len(self.free):
            raise InputError(f"a parameter is freed twice: {', '.join(self.free)}")
        if self.t0_bound is not None and not 0 < self.t0_bound < np.inf:
            raise InputError(f"the bound of t0 must be a positive time in s, got {self.t0_bound!r}")
        if not 0 < self.scale_bound < 0.2:
            raise InputError(f"the bound of the radius scale must lie between 0 and 0.2, got {self.scale_bound!r}")
        if self.weights not in ("motion", "equal"):
            raise InputError(f"weights must be 'motion' or 'equal', got {self.weights!r}")

    @property
    def stretch_free(self) -> bool:
        return not isinstance(self.stretch, float | int)


@dataclass(frozen=True)
class Own:
    """The parameters of one shot, in the units in which they are fitted.

    log10 of the stretch (if it is free); the nuisances of `free` as fractions of their half-widths, -1 to 1.
    """

    free: tuple[str, ...]
    half_widths: tuple[float, ...]  # s for t0, 1 for the others
    stretch: float | None  # given, or None where it is free

    @property
    def names(self) -> tuple[str, ...]:
        return (() if self.stretch else ("stretch",)) + tuple(FREE[name] for name in self.free)

    @property
    def bounds(self) -> Floats:
        """(own, 2)"""
        stretch = [] if self.stretch else [np.log10(STRETCH_RANGE)]
        return np.array([*stretch, *[(-1.0, 1.0)] * len(self.free)]).reshape(-1, 2)

    def steps(self, time_scale: float) -> Floats:
        """(own,) by which finite differences move them, in units of the general step: t_c for t0, 1 for the others."""
        units = [time_scale if name == "t0" else 1.0 for name in self.free]
        return np.array([1.0] * (self.stretch is None) + [u / w for u, w in zip(units, self.half_widths, strict=True)])

    def natural(self, x: Floats) -> dict[str, Any]:
        """stretch, time_origin (s), radius_scale, max_radius_factor from (own,) or (own, draws)."""
        values: dict[str, Any] = {"time_origin": 0.0, "radius_scale": 1.0, "max_radius_factor": 1.0}
        values["stretch"] = self.stretch if self.stretch else 10.0 ** x[0]
        for name, width, value in zip(self.free, self.half_widths, x[len(x) - len(self.free) :], strict=True):
            values[FREE[name]] = value * width + (0.0 if name == "t0" else 1.0)
        return values


def spread_starts(bounds: Floats, count: int) -> Floats:
    """(count, d) points that fill a box (d, 2) evenly: the additive recurrence of the generalised golden ratio.

    Roberts 2018, "The unreasonable effectiveness of quasirandom sequences"; the same points every time.
    """
    d = len(bounds)
    phi = 2.0
    for _ in range(40):
        phi = (1.0 + phi) ** (1.0 / (d + 1))
    cube = (0.5 + np.outer(np.arange(1, count + 1), phi ** -np.arange(1.0, d + 1))) % 1.0
    return np.asarray(bounds[:, 0] + cube * (bounds[:, 1] - bounds[:, 0]))


def units(names: Sequence[str]) -> tuple[str, ...]:
    """SI units of the natural values of the names of an answer."""
    known = {**UNITS, **NUISANCE_UNITS, "stretch": "1"}
    found = (known[re.sub(r"^log10_|_\d+$", "", name)] for name in names)
    return tuple("1" if unit == "-" else unit for unit in found)
