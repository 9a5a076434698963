"""Domains of parameters: the fields of a dataclass state theirs, and these functions check them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from math import inf
from typing import Any

from cavirheo.errors import InputError

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
