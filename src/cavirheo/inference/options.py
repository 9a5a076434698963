"""Options of an experiment: what is fitted of a curve, and how. Arguments of `fit_many`, checked once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import require
from cavirheo.inference.reconstruct import check_stretch
from cavirheo.physics.bubble import FIELD, FROM_NOTHING, Bubble

FREE = {"t0": "time_origin", "scale": "radius_scale", "rmax": "max_radius_factor"}  # option: name in the answer
FREED = ("t0", "rmax")  # by default
SCALE_BOUND = 0.015  # radius calibration and R_max are known to 1-1.5 %


_STRETCHES, _WEIGHTS = ("plateau", "free"), ("learnt", "equal")
_DOMAINS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "window": (
        lambda n: n in (None, "all") or (isinstance(n, Integral) and int(n) > 0),
        "collapses from 1 up, or 'all'",
    ),
    "end": (lambda time: time is None or 0 < time < np.inf, "a positive time in s"),
    "stretch": (lambda x: not isinstance(x, str) or x in _STRETCHES, "R_max/R_0, 'plateau', 'free' or left out"),
    "free": (lambda names: sorted(names) == sorted({*names} & {*FREE}), f"some of {', '.join(FREE)}, each once"),
    "t0_bound": (lambda time: time is None or 0 < time < np.inf, "a positive time in s"),
    "scale_bound": (lambda bound: 0 < bound < 0.2, "between 0 and 0.2"),
    "weights": (lambda name: name in _WEIGHTS, "'learnt' or 'equal'"),
}


@dataclass(frozen=True)
class Options:
    """Of an experiment: arguments of `fit_many`, which says what they are. Raises InputError."""

    window: int | str | None = None
    end: float | None = None
    stretch: float | str | None = None
    free: Sequence[str] | str = FREED  # or several with commas; kept as a tuple
    t0_bound: float | None = None
    scale_bound: float = SCALE_BOUND
    weights: str = "learnt"
    bubble: Bubble = FIELD

    def __post_init__(self) -> None:
        if isinstance(self.free, str):
            names = (name.strip() for name in self.free.split(","))
            object.__setattr__(self, "free", tuple(name for name in names if name not in ("", "none")))
        for name, (holds, expected) in _DOMAINS.items():
            value = getattr(self, name)
            try:
                fine = holds(value)
            except (TypeError, ValueError):  # of no such kind
                fine = False
            require(fine, f"{name} must be {expected}; got {value!r}", f"option.{name}")
        object.__setattr__(self, "free", tuple(self.free))
        if not isinstance(self.stretch, str):
            check_stretch(self.stretch)
        bubble = self.bubble
        message = f"the factors of damage are inferred: give its name instead of {bubble.damage!r}"
        require(isinstance(bubble.damage, str), message, "option.damage")
        idle = "an accommodation changes nothing without kinetic contents: give those too"
        require(bubble.accommodation == "free" or bubble.contents == "kinetic", idle, "option.idle")


def check_wall(bubble: Bubble, curves: Sequence[RadiusCurve] = ()) -> None:
    """Raises InputError: no distance, or the wall is too near for every curve; where it is for some, those fail."""
    if bubble.wall_distance is not None:
        largest = (float(np.max(curve.radius, initial=0.0, where=curve.radius > 0)) for curve in curves)
        bubble.inertia(min(largest, default=0.0))


def fixed_bubble(bubble: Bubble, max_radius: float) -> dict[str, float]:
    """The numbers of the model that are given and not their defaults, by name. Raises InputError: a wall too near."""
    values = {name: getattr(bubble, name) for name in ("accommodation", *FROM_NOTHING)}
    if bubble.wall_distance is not None:
        values["confinement_inertia"] = bubble.inertia(max_radius)
    return {name: float(value) for name, value in values.items() if value not in ("free", 0.0)}
