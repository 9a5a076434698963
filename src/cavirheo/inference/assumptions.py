"""Assumptions about a shot: its law (Family), and what is fitted of its recording, and how (Options)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from numbers import Integral, Real
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import expect, require
from cavirheo.parameters import DURATION, PARAMETERS, parameter_of
from cavirheo.physics.bubble import FIELD, ZERO_BY_DEFAULT, Bubble
from cavirheo.physics.laws import PowerLaw
from cavirheo.physics.materials import LAWS, Material, combine, from_inferred

FREE = {"t0": "time_origin", "scale": "radius_scale", "rmax": "max_radius_factor"}  # option: name in the answer
FREE_BY_DEFAULT = ("t0", "rmax")  # free by default
SCALE_BOUND = 0.015  # largest error of scale and R_max: a radius calibration is known to 1-1.5 %

_STRETCHES = ("plateau", "free")
_DOMAINS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "window": (
        lambda n: n in (None, "all") or (isinstance(n, Integral) and not isinstance(n, bool) and int(n) > 0),
        "collapses from 1 up, or 'all'",
    ),
    "end": (lambda time: time is None or 0 < time < np.inf, "a positive time in s"),
    "stretch": (lambda x: not isinstance(x, str) or x in _STRETCHES, "R_max/R_0, 'plateau', 'free' or left out"),
    "free": (lambda names: sorted(names) == sorted({*names} & {*FREE}), f"some of {', '.join(FREE)}, each once"),
}


@dataclass(frozen=True)
class Options:
    """Options of an experiment: keywords of `fit`, which describes them. Raises InputError."""

    window: int | str | None = None
    end: float | None = None
    stretch: float | str | None = None
    free: Sequence[str] | str = FREE_BY_DEFAULT  # or a text with commas; stored as a tuple
    bubble: Bubble = FIELD
    clock_bound: float | None = None  # largest |t0|, s; default: all times of R_max that the frames near it allow
    scale_bound: float = SCALE_BOUND

    def __post_init__(self) -> None:
        if isinstance(self.free, str):
            names = tuple(name.strip() for name in self.free.split(",") if name.strip())
            object.__setattr__(self, "free", () if names == ("none",) else names)
        for name, (holds, expected) in _DOMAINS.items():
            value = getattr(self, name)
            try:
                fine = holds(value)
            except (TypeError, ValueError):  # a value of a wrong type
                fine = False
            require(fine, f"{name} must be {expected}; got {value!r}", f"option.{name}")
        object.__setattr__(self, "free", tuple(self.free))
        if self.end is not None:
            DURATION.check("end", self.end, "option.end")
        if not isinstance(self.stretch, str):
            check_stretch(self.stretch)
        bubble = self.bubble
        message = f"the factors of damage are inferred: give its name instead of {bubble.damage!r}"
        require(isinstance(bubble.damage, str), message, "option.damage")


def fixed_bubble(bubble: Bubble, max_radius: float) -> dict[str, float]:
    """The given numbers of the bubble model that are not 0, by name. Raises InputError: the wall is within R_max."""
    values = {name: getattr(bubble, name) for name in ("accommodation", *ZERO_BY_DEFAULT)}
    if bubble.wall_distance is not None:
        values["confinement_inertia"] = bubble.inertia(max_radius)
    return {name: float(value) for name, value in values.items() if value not in ("free", 0.0)}


def check_stretch(stretch: float | str | None) -> None:
    """Raises InputError: no bubble at its largest radius has such a stretch."""
    message = f"stretch = R_max/R_0 must lie between 1 and 100, got {stretch!r}"
    fine = stretch is None or (isinstance(stretch, Real) and 1 < stretch < 100)
    require(fine, message, "option.stretch")


def _inferred(law: str, before: Sequence[str]) -> list[str]:
    """Names of the parameters of a law as they are inferred, in a sum after those with these names."""
    names = [f.name for f in fields(LAWS[law]) if f.init]  # type: ignore[arg-type]
    plain = LAWS[law] is PowerLaw and "viscosity" not in before
    return [("viscosity" if plain else "reference_viscosity") if name == "consistency" else name for name in names]


AUTO = "auto"  # the default family: a spring that may stiffen or be absent, beside a dashpot that may thin without it
_AUTO_TERMS = ("fung", ["shear_modulus", "stiffening"]), ("power-law", ["viscosity", "thinning"])
LIQUID = 1.0 / 3.0  # prior probability that G is 0
PLAIN, NEWTONIAN = 0.5, 0.5  # prior probabilities that a gel does not stiffen, and that a liquid does not thin


@dataclass(frozen=True)
class Family:
    """All materials of a law, or of a sum of laws ("gent + newtonian"): log10 of the parameters -> Material.

    If two laws of a sum have a parameter of one name, that of the later law is followed by its number: viscosity,
    viscosity_2. A parameter without a range (parameters.py) keeps the default of its law. The viscosity K
    (1e5 1/s)^(n-1) replaces the consistency K of a power law; beside another viscosity or a yield stress it is called
    reference viscosity.
    "auto" is the default family: Fung's spring beside a dashpot, in which G and the stiffening may each be exactly 0
    (`atoms`: the prior probabilities). A liquid may thin by a power law, with the viscosity at 1e5 1/s and the thinning
    1 - n.

    Raises:
        InputError: an unknown law, or laws that exclude each other.
    """

    name: str
    parameters: tuple[str, ...] = field(init=False, repr=False, compare=False)
    elastic: bool = field(init=False, repr=False, compare=False)  # whether its materials have an elastic part
    _terms: list[tuple[str, list[str]]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        expect(self.name, str, "the name of a law, such as 'nhkv' or 'gent + newtonian'")
        terms = [*_AUTO_TERMS] if self.name == AUTO else []
        names = [name for _, parameters in terms for name in parameters]
        laws = [] if terms else self.name.split("+")
        for number, law in enumerate((part.strip() for part in laws), 1):
            hint = " without parameters (all of them are fitted)" if "(" in law else ""
            message = f"cannot fit the material {law!r}{hint}; known, also as sums: {', '.join(LAWS)}"
            require(law in LAWS, message, "law.not_fittable")
            searched = [name for name in _inferred(law, names) if PARAMETERS[name].search_range]
            names += [f"{name}_{number}" if name in names else name for name in searched]
            terms.append((law, searched))
        object.__setattr__(self, "_terms", terms)
        object.__setattr__(self, "parameters", tuple(names))
        usual = self.material(np.mean(self.bounds(started=True), axis=1))  # an error if the laws exclude each other
        object.__setattr__(self, "elastic", usual.parts().elastic is not None)

    @property
    def atoms(self) -> Mapping[str, float]:
        """Prior probability by name that a parameter is exactly 0."""
        atoms = {"shear_modulus": LIQUID, "stiffening": PLAIN, "thinning": NEWTONIAN}
        return atoms if self.name == AUTO else {}

    def check_damage(self, bubble: Bubble) -> None:
        """Raises InputError: this bubble damages an elastic part that the law does not have."""
        message = f"damage needs a law with an elastic part, {self.name} has none: leave out damage, or this law"
        require(bubble.damage == "none" or self.elastic, message, "physics.damage_without_elasticity")

    def material(self, log10: Floats) -> Material:
        """The material of (parameters,) log10 values; of (k, parameters) a material whose parameters are (k, 1) arrays,
        for stresses at many parameters at once. Raises InputError where they exclude each other."""
        values = iter(10.0**log10 if log10.ndim == 1 else 10.0 ** log10.T[..., None])
        number: Any = float if log10.ndim == 1 else np.asarray
        terms = [(law, {name: number(next(values)) for name in names}) for law, names in self._terms]
        return combine([from_inferred(law, parameters) for law, parameters in terms])

    def bounds(self, *, started: bool = False) -> Floats:
        """Ranges (parameters, 2) of a search, or with `started` the parts of them in which searches start."""
        known = [parameter_of(name) for name in self.parameters]
        return np.array([each.start_range if started else each.search_range for each in known])
