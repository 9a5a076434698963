"""Family: all materials of a law, or of a sum of laws, as a function of its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, Field, dataclass, field, fields
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import expect, require
from cavirheo.parameters import PARAMETERS, inferred_as
from cavirheo.physics.bubble import Damage
from cavirheo.physics.materials import LAWS, Material, combine, with_consistency


def _parameters(law: str) -> list[Field[Any]]:
    return [f for f in fields(LAWS[law]) if f.init]  # type: ignore[arg-type]


def _unfittable(law: str) -> list[str]:
    """Parameters that neither have a range nor a default."""
    return [f.name for f in _parameters(law) if not PARAMETERS[inferred_as(f.name)].searched and f.default is MISSING]


ABLE = [law for law in LAWS if not _unfittable(law)]


def softened(laws: Sequence[str], damage: str | Damage) -> list[str]:
    """Those of the laws that can have such damage: all without one, else those with an elastic part. Raises InputError:
    none can."""
    if damage == "none":
        return list(laws)
    with_damage = [law for law in laws if Family(law).elastic]
    message = f"damage needs a law with an elastic part, {', '.join(laws)} has none: leave out damage, or add a spring"
    require(bool(with_damage), message, "physics.damage_without_elasticity")
    return with_damage


@dataclass(frozen=True)
class Family:
    """All materials of a law, or of a sum of laws ("gent + newtonian"): log10 of the parameters -> Material.

    A parameter that two laws of a sum have is followed by the number of the later one: viscosity, viscosity_2. One
    without a range (parameters.py) keeps the default of its law. In place of a consistency K stands the reference
    viscosity K (1e5 1/s)^(n-1).

    Raises:
        InputError: unknown law, one with a parameter for which no range is set, or laws that no material can have both.
    """

    name: str
    parameters: tuple[str, ...] = field(init=False, repr=False, compare=False)
    _terms: list[tuple[str, list[str]]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        expect(self.name, str, "the name of a law, such as 'nhkv' or 'gent + newtonian'")
        terms, names = [], list[str]()
        for number, law in enumerate((part.strip() for part in self.name.split("+")), 1):
            hint = " without parameters (all of them are fitted)" if "(" in law else ""
            hint = f" (its {', '.join(_unfittable(law))} cannot be given a range)" if law in LAWS else hint
            message = f"cannot fit the material {law!r}{hint}; known, also as sums: {', '.join(ABLE)}"
            require(law in ABLE, message, "law.not_fittable")
            searched = [name for f in _parameters(law) if PARAMETERS[name := inferred_as(f.name)].searched]
            names += [f"{name}_{number}" if name in names else name for name in searched]
            terms.append((law, searched))
        object.__setattr__(self, "_terms", terms)
        object.__setattr__(self, "parameters", tuple(names))
        self.material(np.mean(self.bounds(started=True), axis=1))  # whether the laws go together

    def material(self, log10: Floats) -> Material:
        """The material of (parameters,) log10 values. Raises InputError where they exclude each other."""
        values = iter(10.0**log10)
        terms = [(law, {name: float(next(values)) for name in names}) for law, names in self._terms]
        return combine([LAWS[law](**with_consistency(parameters)) for law, parameters in terms])

    @property
    def elastic(self) -> bool:
        """Whether its materials have an elastic part."""
        return self.material(np.mean(self.bounds(started=True), axis=1)).elastic is not None

    def bounds(self, *, started: bool = False) -> Floats:
        """(parameters, 2): the ranges searched, or the parts of them that searches start from."""
        names = [name for _, searched in self._terms for name in searched]
        return np.array([PARAMETERS[n].started if started else PARAMETERS[n].searched for n in names])
