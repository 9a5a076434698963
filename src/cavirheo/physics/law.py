"""What a material is to the solver: the sum of an elastic law, a viscous law and arms with memory."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import lru_cache
from inspect import cleandoc, get_annotations
from math import sqrt
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.parameters import NOT_NEGATIVE, PARAMETERS, POSITIVE, check
from cavirheo.physics.table import continued, read, scaled, tabulate

_RAISES = "Raises:\n    InputError: a parameter that is no number or out of its domain."
SMALLEST, LARGEST = 1e-3, 1e3  # R/R_0: beyond what a collapse or a stretch reaches


def nodes(spacing: float) -> Floats:
    """From SMALLEST to LARGEST, about `spacing` apart in log L; 1 is one of them."""
    n = int(np.ceil(np.log(LARGEST) / spacing))
    return np.concatenate([np.geomspace(SMALLEST, 1, n + 1)[:-1], np.geomspace(1, LARGEST, n + 1)])


_COARSE = nodes(0.1)  # halved where a law needs it
SHEAR = 2 * sqrt(3)  # shear rate at the wall over |U/R|
SLOWEST, FASTEST = 1e-3, 1e12  # U/R in 1/s: below the first and above the second the viscosity counts as constant


class Parts(NamedTuple):
    """What a material is made of; the stresses add."""

    elastic: Elastic | None = None
    viscous: Viscous | None = None
    memory: tuple[Arm, ...] = ()


class Material:
    """A law, or a sum of laws: a new one defines `parts`. It is a frozen dataclass with SI parameters."""

    proportional: ClassVar[str] = ""  # the parameter that all of the stress is proportional to, where there is one
    name: ClassVar[str]  # as it is written; by default that of the class, "power-law" of PowerLaw

    def __init_subclass__(cls, **options: Any) -> None:
        """help() of a law ends with its parameters, as parameters.py knows them."""
        super().__init_subclass__(**options)
        if "name" not in cls.__dict__:
            cls.name = re.sub(r"(?<=[a-z])(?=[A-Z])", "-", cls.__name__).lower()
        names = [name for base in reversed(cls.__mro__) for name in get_annotations(base) if name in PARAMETERS]
        described = [f"{name} ({PARAMETERS[name].symbol}, {PARAMETERS[name].unit})" for name in dict.fromkeys(names)]
        if described:
            cls.__doc__ = (
                f"{cleandoc(cls.__dict__.get('__doc__') or '')}\n\nParameters: {', '.join(described)}.\n\n{_RAISES}"
            )

    def __post_init__(self) -> None:
        check(self)

    def parts(self) -> Parts:
        """The elastic and the viscous part and the arms with memory of which it is the sum."""
        return Parts()

    @property
    def elastic(self) -> Elastic | None:
        return self.parts().elastic

    @property
    def viscous(self) -> Viscous | None:
        return self.parts().viscous

    @property
    def memory(self) -> tuple[Arm, ...]:
        return self.parts().memory


class Elastic(Material):
    """Base of the elastic laws: a new one defines `slope`, or `first` if its energy depends on I_1 only."""

    def parts(self) -> Parts:
        return Parts(elastic=self)

    def first(self, I1: Floats) -> Floats:
        """W_1 = dW/dI_1 in Pa at the first invariant I1 (any shape)."""
        raise NotImplementedError

    def slope(self, ratio: Floats) -> Floats:
        """dS_el/dL in Pa at L = ratio = R/R_0 (any shape); not finite where the law does not hold."""
        q2 = 1 / (ratio * ratio)
        return -4 * self.first(q2 * q2 + 2 * ratio * ratio) * (q2 + q2 * q2 / ratio)

    def table(self) -> Floats:
        """(n, 7) S_el over L in Pa for the solver (physics/table.py); it ends where the law does."""
        table = tabulate(self.slope, _COARSE, origin=1.0)
        why = f"the stress of {self} must be finite and smooth around R = R_0, which it is not"
        require(bool(table[0, 0] < 1 < table[-1, 0]), why, "physics.no_stress_at_rest")
        return table

    def stress(self, ratio: ArrayLike) -> Floats:
        """S_el in Pa at R/R_0 (any shape); NaN where the law does not hold."""
        return read(table_of(self), ratio)[0]


class Viscous(Material):
    """Base of the viscous laws: a new one defines `apparent`."""

    def parts(self) -> Parts:
        return Parts(viscous=self)

    def apparent(self, shear_rate: Floats) -> Floats:
        """Viscosity in Pa s at a shear rate in 1/s (any shape, not negative)."""
        raise NotImplementedError

    def stress(self, rate: ArrayLike) -> Floats:
        """S_v in Pa at U/R in 1/s (any shape)."""
        rate = np.asarray(rate, float)
        return np.sign(rate) * read(table_of(self), np.abs(rate))[0]

    def table(self) -> Floats:
        """(n, 7) S_v over g >= 0 in Pa for the solver (physics/table.py)."""
        nodes = np.geomspace(SLOWEST, FASTEST, 200)
        table = tabulate(lambda g: -4 * self.apparent(SHEAR * g), nodes, origin=SLOWEST)
        fine = (table[0, 0], table[-1, 0]) == (SLOWEST, FASTEST) and np.all(table[:, 2] <= 0)
        why = f"the viscosity of {self} must be finite and not negative at all shear rates"
        require(bool(fine), why, "physics.negative_viscosity")
        slope, (value, last_slope, _) = table[0, 2], read(table, FASTEST)
        table[:, 1] += SLOWEST * slope
        return continued(table, (0.0, 0.0, slope), (FASTEST, float(value) + SLOWEST * slope, float(last_slope)))


@dataclass(frozen=True)
class Arm(Material):
    """Base of the arms: viscosity in Pa s and relaxation time tau in s; the spring's shear modulus is their ratio."""

    viscosity: float = field(metadata=NOT_NEGATIVE)
    relaxation_time: float = field(metadata=POSITIVE)
    terms: ClassVar[tuple[tuple[float, float], ...]] = ()  # C_k/modulus and n_k
    follows: ClassVar[bool] = False  # whether the elastic part of the material acts through this arm alone

    @property
    def starts_stressed(self) -> bool:
        """Whether the growth to R_max leaves stress in it, where the simulation does not start relaxed."""
        return True

    def parts(self) -> Parts:
        return Parts(memory=(self,))

    @property
    def modulus(self) -> float:
        """Shear modulus of the spring, Pa."""
        return self.viscosity / self.relaxation_time

    def table(self) -> Floats:
        """(k, 4) rows C_k in Pa, n_k, 1/tau in 1/s, and 1/C_k in 1/Pa of an arm that follows the elastic part or 0,
        for the solver."""
        stiff = [(self.modulus * c, n) for c, n in self.terms]
        return np.array([[C, n, 1 / self.relaxation_time, 1 / C if self.follows else 0.0] for C, n in stiff])


def table_of(law: Elastic | Viscous) -> Floats:
    """`law.table()`, kept once computed; of a law that is proportional to a modulus it is kept for 1 Pa."""
    if not law.proportional:
        return _table_of(law)
    unit: Any = {law.proportional: 1.0}
    return scaled(_table_of(replace(cast("Any", law), **unit)), 1.0, getattr(law, law.proportional))


@lru_cache(maxsize=128)
def _table_of(law: Elastic | Viscous) -> Floats:
    return law.table()
