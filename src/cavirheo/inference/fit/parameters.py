"""What a fit varies: the parameters of a law, in log10, and those of each shot, with the ranges searched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cavirheo.errors import InputError
from cavirheo.inference.reconstruct import STRETCH_RANGE, check_stretch
from cavirheo.physics.laws import LAWS, UNITS
from cavirheo.physics.materials import Material

Floats = NDArray[np.float64]

# log10 of the SI value: the range searched, and the part of it over which a search is started.
RANGES: dict[str, tuple[tuple[float, float], tuple[float, float]]] = {
    "shear_modulus": ((1.0, 6.0), (2.7, 5.2)),
    "viscosity": ((-4.0, 1.0), (-2.3, -0.3)),
    "stiffening": ((-3.0, 1.0), (-2.0, 0.3)),
    "relaxation_time": ((-8.0, -3.0), (-7.0, -5.0)),
    "retardation_time": ((-9.0, -3.0), (-8.0, -6.0)),
}
STRETCH_START = (3.0, 12.0)
FREE = {"t0": "time_origin", "scale": "radius_scale", "rmax": "max_radius_factor"}  # option: name in the answer
NUISANCE_UNITS = {"time_origin": "s", "radius_scale": "1", "max_radius_factor": "1"}
SCALE_BOUND = 0.015  # radius calibration and R_max are known to 1-1.5 % (two circle fits of one video differ by 1 %)
AT_BOUND = 1e-3  # of a range: nearer to its end is "at the bound"


@dataclass(frozen=True)
class Family:
    """All materials of one law: log10 of its parameters -> Material.

    Raises:
        InputError: unknown law, or one with a parameter for which no range is set.
    """

    name: str

    def __post_init__(self) -> None:
        able = [name for name, law in LAWS.items() if {f.name for f in fields(law)} <= RANGES.keys()]  # type: ignore[arg-type]
        if self.name not in able:
            hint = "" if self.name in LAWS or "(" not in self.name else " without parameters (all of them are fitted)"
            raise InputError(f"cannot fit the material {self.name!r}; known{hint}: {', '.join(able)}")

    @property
    def parameters(self) -> tuple[str, ...]:
        return tuple(f.name for f in fields(LAWS[self.name]))  # type: ignore[arg-type]

    def material(self, log10: Floats) -> Material:
        """The material of (parameters,) log10 values. Raises InputError where they exclude each other."""
        return LAWS[self.name](**dict(zip(self.parameters, (float(v) for v in 10.0**log10), strict=True)))

    def bounds(self, which: int = 0) -> Floats:
        """(parameters, 2): the range searched (0) or started from (1)."""
        return np.array([RANGES[name][which] for name in self.parameters])


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
    plain = [name.removeprefix("log10_") for name in names]
    known = {**UNITS, **NUISANCE_UNITS, "stretch": "1", "stiffening": "1"}
    return tuple(known[name] for name in plain)
