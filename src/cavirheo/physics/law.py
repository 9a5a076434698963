"""What every law and every material is to the solver; and the domains of parameters, which their dataclasses state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import cache, lru_cache
from inspect import cleandoc, get_annotations
from math import inf
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, cast

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.table import scaled

if TYPE_CHECKING:
    from cavirheo.physics.elastic import Elastic
    from cavirheo.physics.memory import Arm
    from cavirheo.physics.viscous import Viscous

Domain = dict[str, Any]


def domain(words: str, holds: Callable[[float], bool]) -> Domain:
    """The numbers that a parameter may be, as metadata of its field: `modulus: float = field(metadata=POSITIVE)`."""
    return {"domain": (words, holds)}


FINITE = domain("finite", lambda x: -inf < x < inf)
NOT_NEGATIVE = domain("finite and not negative", lambda x: 0 <= x < inf)
POSITIVE = domain("finite and positive", lambda x: 0 < x < inf)
POSITIVE_OR_INFINITE = domain("positive", lambda x: x > 0)


def within(allowed: Mapping[str, Any], name: str, value: float) -> None:
    """Raises InputError for what is no number of a domain; its code is `physics.` and the first word of the name."""
    words, holds = allowed["domain"]
    try:
        fine = holds(value)
    except (TypeError, ValueError):  # text, or several numbers
        fine, words = False, f"a number, {words}"
    if not fine:
        raise InputError(f"{name} must be {words}, got {value!r}", f"physics.{name.split()[0]}")


@cache
def _domains(kind: Any) -> list[tuple[str, Mapping[str, Any]]]:
    """Names and domains of the fields of a dataclass: asked at every simulation."""
    return [(field.name, field.metadata) for field in fields(kind) if field.metadata]


def check(parameters: Any) -> None:
    """Raises InputError for the first field of a dataclass that is outside its domain."""
    for name, allowed in _domains(parameters.__class__):
        within(allowed, name, getattr(parameters, name))


def check_plausible(parameters: Any, mend: str) -> None:
    """Raises InputError for the first field of a dataclass outside the "plausible" range of its metadata."""
    for field in fields(parameters):
        if "plausible" in field.metadata:
            value, code = getattr(parameters, field.name), f"physics.unusual_{field.name}"
            field.metadata["plausible"].check(field.name, value, code, mend)


_RAISES = "Raises:\n    InputError: a parameter that is no number or out of its domain."


class Parts(NamedTuple):
    """What a material is made of; the stresses add."""

    elastic: Elastic | None = None
    viscous: Viscous | None = None
    memory: tuple[Arm, ...] = ()


class Material:
    """A law, or a sum of laws: a new one defines `parts`. It is a frozen dataclass with SI parameters."""

    proportional: ClassVar[str] = ""  # the parameter that all of the stress is proportional to, where there is one

    def __init_subclass__(cls, **options: Any) -> None:
        """help() of a law ends with its parameters, as parameters.py knows them."""
        super().__init_subclass__(**options)
        names = [name for base in reversed(cls.__mro__) for name in get_annotations(base) if name in PARAMETERS]
        known = [f"{name} ({PARAMETERS[name].symbol}, {PARAMETERS[name].unit})" for name in dict.fromkeys(names)]
        if known:
            cls.__doc__ = (
                f"{cleandoc(cls.__dict__.get('__doc__') or '')}\n\nParameters: {', '.join(known)}.\n\n{_RAISES}"
            )

    def __post_init__(self) -> None:
        check(self)

    @property
    def name(self) -> str:
        return type(self).__name__

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


def table_of(law: Elastic | Viscous) -> Floats:
    """`law.table()`, kept once computed; of a law that is proportional to a modulus it is kept for 1 Pa."""
    if not law.proportional:
        return _kept(law)
    unit: Any = {law.proportional: 1.0}
    return scaled(_kept(replace(cast("Any", law), **unit)), 1.0, getattr(law, law.proportional))


@lru_cache(maxsize=128)
def _kept(law: Elastic | Viscous) -> Floats:
    return law.table()
