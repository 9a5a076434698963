"""Every law by the name that the field gives it, and materials written as a sum of laws."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from inspect import Parameter, cleandoc, signature
from typing import Any

import numpy as np

from cavirheo.errors import InputError, require
from cavirheo.parameters import PARAMETERS, RATE
from cavirheo.physics.elastic import ArrudaBoyce, Fung, Gent, Linear, MooneyRivlin, NeoHookean, Ogden, Quadratic, Yeoh
from cavirheo.physics.materials import (
    Material,
    Maxwell,
    NeoHookeanKelvinVoigt,
    OldroydB,
    QuadraticKelvinVoigt,
    QuadraticStandardLinearSolid,
    StandardLinearSolid,
    UpperConvectedMaxwell,
    Viscoelastic,
    Zener,
)
from cavirheo.physics.viscous import CarreauYasuda, Cross, HerschelBulkley, Newtonian, PowellEyring, PowerLaw


def _by_name(*laws: type[Material]) -> dict[str, Callable[..., Material]]:
    return {law.name: law for law in laws}


KINDS = {
    "elastic": _by_name(Linear, NeoHookean, Quadratic, MooneyRivlin, Yeoh, Fung, Gent, ArrudaBoyce, Ogden),
    "viscous": _by_name(Newtonian, PowerLaw, HerschelBulkley, CarreauYasuda, Cross, PowellEyring),
    "elastic and viscous": _by_name(NeoHookeanKelvinVoigt, QuadraticKelvinVoigt),
    "with memory": _by_name(
        Maxwell, UpperConvectedMaxwell, OldroydB, Zener, StandardLinearSolid, QuadraticStandardLinearSolid
    ),
}
LAWS = {name: law for laws in KINDS.values() for name, law in laws.items()}
"""Every law by the name that it is written with; a law that is put here is known to all commands."""
EXAMPLE = "yeoh(1e3, 20) + cross(0.5, 0.01, 1e-4)"
_HOW = f"write a sum of laws like {EXAMPLE}"


def _takes_tuple(parameter: Parameter) -> bool:
    return str(parameter.annotation).startswith("tuple")


def usage(name: str) -> str:
    """How a law is written, with units and defaults: `gent(shear_modulus [Pa], limit [-])`."""
    shown = []
    for key, parameter in signature(LAWS[name]).parameters.items():
        unit = "-" if PARAMETERS[key].unit == "1" else PARAMETERS[key].unit
        default = "" if parameter.default is Parameter.empty else f" = {parameter.default:g}"
        shown.append(f"{key} [({unit}, ...)]" if _takes_tuple(parameter) else f"{key} [{unit}]{default}")
    return f"{name}({', '.join(shown)})"


def summary(name: str) -> str:
    """The energy or viscosity function of a law in one line: the first of its docstring."""
    return cleandoc(LAWS[name].__doc__ or "").partition("\n")[0]


def parse(text: str) -> Material:
    """The material of a sum like "gent(2e3, limit=40) + carreau-yasuda(0.5, 0.01, 1e-4, 0.4)", parameters in SI units.

    Only numbers and tuples of numbers are read, nothing is executed. A hyphen between letters may be an underscore.

    Raises:
        InputError: not a sum of laws, an unknown law, a parameter missing, too many or out of range, a part twice.
    """
    require(text.strip() != "", f"the material is empty; {_HOW}", "laws.empty")
    try:
        source = re.sub(r"(?<=[A-Za-z])-(?=[A-Za-z])", "_", " ".join(text.split()))
        terms = _terms(ast.parse(source, mode="eval").body)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        why = getattr(error, "msg", error)
        raise InputError(f"cannot read the material {text!r}: {why}; {_HOW}", "laws.syntax") from None
    return combine([_law(term) for term in terms])


def combine(terms: Sequence[Material]) -> Material:
    """The material whose stress is the sum of the terms; a single term is itself the material.

    Raises:
        InputError: more than one elastic or more than one viscous part.
    """
    if len(terms) == 1:
        return terms[0]
    parts: dict[str, Any] = {}
    for kind in ("elastic", "viscous"):
        having = [term for term in terms if getattr(term, kind)]
        got = " and ".join(term.name for term in having)
        why = f"a material has one {kind} part at most, but {got} each have one; leave all but one out"
        require(len(having) < 2, why, f"laws.{kind}_twice")
        parts[kind] = getattr(having[0], kind) if having else None
    return Viscoelastic(**parts, memory=sum((term.memory for term in terms), ()))


def with_consistency(values: Mapping[str, float]) -> dict[str, float]:
    """Parameters of a law by name, the consistency K in place of the reference viscosity K (1e5 1/s)^(n-1)."""
    found = dict(values)
    if "reference_viscosity" in found:
        found["consistency"] = found.pop("reference_viscosity") * RATE ** (1.0 - found["exponent"])
    return found


def viscosity_at(material: str, rate: float, values: Mapping[str, float]) -> float | None:
    """Pa s at a shear rate (1/s) of the law in a sum of laws whose viscosity depends on it; None where there is none.

    `values`: its parameters by name, as they are inferred (with a reference viscosity) or as the law has them, among
    others.
    """
    values = with_consistency(values)
    for name in material.split("+"):
        law: Any = LAWS.get(name.strip())
        takes = signature(law).parameters if law in KINDS["viscous"].values() else {"viscosity": None}
        if "viscosity" not in takes:
            return float(law(**{key: values[key] for key in takes if key in values}).apparent(np.array(rate)))
    return None


def _terms(node: ast.expr) -> list[ast.expr]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return [*_terms(node.left), *_terms(node.right)]
    return [node]


def _law(node: ast.expr) -> Material:
    spelled = node.func if isinstance(node, ast.Call) else node
    if not isinstance(spelled, ast.Name):
        raise InputError(f"{ast.unparse(node)!r} is no law with its parameters; {_HOW}", "laws.no_law")
    name = spelled.id.replace("_", "-")
    close = "".join(f"; did you mean {match}?" for match in get_close_matches(name.lower(), LAWS, 1))
    require(name in LAWS, f"unknown material law {name!r}{close or ';'} known: {', '.join(LAWS)}", "laws.unknown")
    if not isinstance(node, ast.Call):
        raise InputError(f"{name} stands without its parameters; it reads {usage(name)}", "laws.parameters")
    takes = signature(LAWS[name])
    named = {keyword.arg or "**": keyword.value for keyword in node.keywords}
    try:
        if len(named) < len(node.keywords):
            raise TypeError("a parameter given twice")
        nodes = takes.bind(*node.args, **named).arguments
    except TypeError as error:
        raise InputError(f"{name}: {error}; it reads {usage(name)}", "laws.parameters") from None
    try:
        return LAWS[name](**{key: _value(takes.parameters[key], nodes[key]) for key in nodes})
    except InputError as error:
        raise error.within(name) from None


def _value(parameter: Parameter, node: ast.expr) -> float | tuple[float, ...]:
    """The number or the tuple of numbers that a parameter takes; one number does for a tuple of one."""
    many = _takes_tuple(parameter)
    try:
        value = ast.literal_eval(node)
        numbers = value if many and isinstance(value, tuple) else (value,)
        if any(type(number) not in (int, float) for number in numbers):
            raise TypeError
        return tuple(map(float, numbers)) if many else float(value)
    except (ValueError, TypeError, OverflowError):
        wanted = "a tuple of numbers" if many else "a number"
        raise InputError(f"{parameter.name} must be {wanted}, got {ast.unparse(node)}", "laws.number") from None
