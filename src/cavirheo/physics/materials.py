"""Materials as sums of an elastic part, a viscous part and arms with memory; and all laws by name.

The solver gets tables and does not know the laws behind them (docs/method/physics.md, section 4). A Maxwell arm is a
spring and a dashpot in series, whose stress fades within the relaxation time. One number m_k per term describes the
history of its spring (section 4.3 there):

    S = sum_k C_k m_k,   m_k' = -m_k/tau - n_k (1 + m_k) U/R,   m_k = 0 in the relaxed state:

1 + m_k is the fading mean of past R^n_k over the present one. The elastic part can act through one arm
(`TotalRelaxation`).
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from difflib import get_close_matches
from inspect import Parameter, cleandoc, signature
from typing import Any, ClassVar

import numpy as np

from cavirheo.errors import InputError, expect
from cavirheo.parameters import NOT_NEGATIVE, PARAMETERS, POSITIVE, REFERENCE_RATE
from cavirheo.physics import laws
from cavirheo.physics.laws import Arm, Elastic, Linear, Material, NeoHookean, Newtonian, Parts, Quadratic, Viscous


@dataclass(frozen=True)
class Maxwell(Arm):
    """Linear Maxwell fluid, tau_rr + tau d(tau_rr)/dt = 2 mu D_rr at a fixed place: its spring is linear.
    Not frame-indifferent: for small strains. Allen and Roy 2000, doi:10.1121/1.429344."""

    terms: ClassVar[tuple[tuple[float, float], ...]] = ((4 / 3, 3.0),)


@dataclass(frozen=True)
class UpperConvectedMaxwell(Arm):
    """Maxwell fluid with the upper-convected rate (UCM), right at any strain: its spring is neo-Hookean.
    Warnez and Johnsen 2015, doi:10.1063/1.4922598."""

    name: ClassVar[str] = "ucm"
    terms: ClassVar[tuple[tuple[float, float], ...]] = ((2.0, 1.0), (0.5, 4.0))


@dataclass(frozen=True)
class TotalRelaxation(Maxwell):
    """The stress of spring and dashpot together relaxes at a fixed place: tau dT/dt + T = T_el + 2 mu D, T = T_rr.

    T_el is the stress of the elastic part of the material, which acts through this arm alone:

        m' = -(m - S_el/C)/tau - 3 (1 + m) U/R,   S = C m,   C = 4 mu/(3 tau),

    and S -> S_el - 4 mu U/R for tau -> 0. With Z = R^3 S it is the Zener model of IMRv2 and PyIMR; for a linear spring
    G it is this spring beside a Maxwell arm of viscosity mu - G tau. Hua and Johnsen 2013, doi:10.1063/1.4817673.

    stressed_by_growth = False: no stress at R_max, as in these codes, and so no stress of the elastic part either.
    """

    viscosity: float = field(metadata=POSITIVE)
    stressed_by_growth: bool = True
    relaxes_elastic_part: ClassVar[bool] = True


@dataclass(frozen=True)
class Viscoelastic(Material):
    """Any elastic law beside any viscous law (Kelvin-Voigt) and any number of Maxwell arms; their stresses add.

    `Viscoelastic(Gent(2e3, 40.0), CarreauYasuda(0.5, 0.01, 1e-4, 0.4))`.

    Attributes:
        elastic: elastic law, or None.
        viscous: viscous law, or None.
        memory: the arms.
    """

    elastic: Elastic | None = None
    viscous: Viscous | None = None
    memory: tuple[Arm, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "memory", tuple(self.memory))
        for part, kind in ((self.elastic, Elastic), (self.viscous, Viscous), *((arm, Arm) for arm in self.memory)):
            if part is not None and not isinstance(part, kind):
                why = "a material takes an elastic law, a viscous law and a list of Maxwell arms, in this order"
                raise InputError(f"{why}; got {part!r} where {kind.__name__} stands", f"physics.not_{kind.__name__}")
        if (following := sum(arm.relaxes_elastic_part for arm in self.memory)) > 1:
            why = f"the elastic part can act through one arm alone, got {following} that take it along"
            raise InputError(why, "physics.followed_twice")
        if not (self.elastic or self.viscous or self.memory):
            raise InputError("a material needs at least one law; an ideal fluid is Newtonian(0)", "physics.no_law")

    def parts(self) -> Parts:
        return Parts(self.elastic, self.viscous, self.memory)


@dataclass(frozen=True)
class NeoHookeanKelvinVoigt(Material):
    """NHKV: neo-Hookean spring (shear modulus, Pa) beside a dashpot (viscosity, Pa s).
    Estrada et al. 2018, doi:10.1016/j.jmps.2017.12.006."""

    shear_modulus: float = field(metadata=NOT_NEGATIVE)
    viscosity: float = field(metadata=NOT_NEGATIVE)
    name: ClassVar[str] = "nhkv"

    def parts(self) -> Parts:
        return Parts(NeoHookean(self.shear_modulus), Newtonian(self.viscosity))


@dataclass(frozen=True)
class QuadraticKelvinVoigt(NeoHookeanKelvinVoigt):
    """qKV: W = G/2 [(I1-3) + alpha/2 (I1-3)^2] beside a dashpot; stiffening alpha is dimensionless.
    Yang et al. 2020, doi:10.1016/j.eml.2020.100839."""

    stiffening: float = field(metadata=NOT_NEGATIVE)
    name: ClassVar[str] = "qkv"

    def parts(self) -> Parts:
        return Parts(Quadratic(self.shear_modulus, self.stiffening), Newtonian(self.viscosity))


@dataclass(frozen=True)
class OldroydB(Material):
    """Dilute polymer solution: an upper-convected Maxwell arm in a Newtonian solvent.
    viscosity mu in Pa s is the sum of both at rest; relaxation time tau_1 and retardation time tau_2 <= tau_1 in s. The
    viscosity of the solvent is mu tau_2/tau_1. Oldroyd 1950, doi:10.1098/rspa.1950.0035."""

    viscosity: float = field(metadata=NOT_NEGATIVE)
    relaxation_time: float = field(metadata=POSITIVE)
    retardation_time: float = field(metadata=NOT_NEGATIVE)

    def __post_init__(self) -> None:
        super().__post_init__()
        if laws.of_one(np.greater(self.retardation_time, self.relaxation_time)):
            both = f"{self.retardation_time!r} and {self.relaxation_time!r} s"
            why = f"the retardation time must not exceed the relaxation time, got {both}"
            raise InputError(why, "physics.retardation_time")

    def parts(self) -> Parts:
        ratio = self.retardation_time / self.relaxation_time
        share: Any = 1 - ratio if np.ndim(ratio) == 0 else np.where(ratio <= 1, 1 - ratio, np.nan)
        arm = UpperConvectedMaxwell(self.viscosity * share, self.relaxation_time)
        return Parts(None, Newtonian(self.viscosity * ratio), (arm,))


@dataclass(frozen=True)
class Zener(Material):
    """Zener solid at finite strain: a neo-Hookean spring (shear modulus, Pa) beside an upper-convected Maxwell arm.

    viscosity in Pa s and relaxation time in s are the arm's: for tau -> 0 it is NHKV. The spring is that of Gaudron,
    Warnez and Johnsen 2015, doi:10.1017/jfm.2015.7, the arm that of Warnez and Johnsen 2015, doi:10.1063/1.4922598.
    """

    shear_modulus: float = field(metadata=NOT_NEGATIVE)
    viscosity: float = field(metadata=NOT_NEGATIVE)
    relaxation_time: float = field(metadata=POSITIVE)

    def parts(self) -> Parts:
        arm = UpperConvectedMaxwell(self.viscosity, self.relaxation_time)
        return Parts(NeoHookean(self.shear_modulus), None, (arm,))


@dataclass(frozen=True)
class StandardLinearSolid(Zener):
    """The Zener solid for small strains: a linear spring beside a linear Maxwell arm.
    Hua and Johnsen 2013, doi:10.1063/1.4817673."""

    name: ClassVar[str] = "sls"

    def parts(self) -> Parts:
        return Parts(Linear(self.shear_modulus), None, (Maxwell(self.viscosity, self.relaxation_time),))


@dataclass(frozen=True)
class QuadraticStandardLinearSolid(Zener):
    """qSLS: the stress of a quadratic spring and a dashpot together relaxes at a fixed place, the field's Zener model.

    With stiffening 0 it is IMRv2's `stress = 3`, else its `stress = 4`, both without retardation; a dashpot beside it
    ("qsls + newtonian") is the retardation. As in IMRv2 the bubble starts without any stress, also without that of the
    spring (`TotalRelaxation` offers both). Hua and Johnsen 2013, doi:10.1063/1.4817673, with the
    spring of Yang et al. 2020, doi:10.1016/j.eml.2020.100839.
    """

    viscosity: float = field(metadata=POSITIVE)
    stiffening: float = field(metadata=NOT_NEGATIVE)
    name: ClassVar[str] = "qsls"

    def parts(self) -> Parts:
        arm = TotalRelaxation(self.viscosity, self.relaxation_time, stressed_by_growth=False)
        return Parts(Quadratic(self.shear_modulus, self.stiffening), None, (arm,))


MATERIALS: dict[str, type] = {m.name: m for m in (Newtonian, NeoHookeanKelvinVoigt, QuadraticKelvinVoigt)}


_ELASTIC = Linear, NeoHookean, Quadratic, laws.MooneyRivlin, laws.Yeoh, laws.Fung, laws.Gent, laws.ArrudaBoyce
_VISCOUS = Newtonian, laws.PowerLaw, laws.HerschelBulkley, laws.CarreauYasuda, laws.Cross, laws.PowellEyring
_MEMORY = Maxwell, UpperConvectedMaxwell, OldroydB, Zener, StandardLinearSolid, QuadraticStandardLinearSolid
KINDS: dict[str, dict[str, Callable[..., Material]]] = {
    "elastic": {law.name: law for law in _ELASTIC},
    "viscous": {law.name: law for law in _VISCOUS},
    "elastic and viscous": {law.name: law for law in (NeoHookeanKelvinVoigt, QuadraticKelvinVoigt)},
    "with memory": {law.name: law for law in _MEMORY},
}
LAWS = {name: law for kind in KINDS.values() for name, law in kind.items()}
"""All laws by name; all commands know a law that is added here."""
EXAMPLE = "yeoh(1e3, 20) + cross(0.5, 0.01, 1e-4)"
_ADVICE = f"write a sum of laws like {EXAMPLE}"


def usage(name: str) -> str:
    """How a law is written, with units and defaults: `gent(shear_modulus [Pa], limit [-])`."""
    parameters = []
    for key, parameter in signature(LAWS[name]).parameters.items():
        unit = "-" if PARAMETERS[key].unit == "1" else PARAMETERS[key].unit
        default = "" if parameter.default is Parameter.empty else f" = {parameter.default:g}"
        parameters.append(f"{key} [{unit}]{default}")
    return f"{name}({', '.join(parameters)})"


def summary(name: str) -> str:
    """The first line of the docstring of a law: its energy or viscosity function."""
    return cleandoc(LAWS[name].__doc__ or "").partition("\n")[0]


def parse(text: str) -> Material:
    """The material of a sum like "gent(2e3, limit=40) + carreau-yasuda(0.5, 0.01, 1e-4, 0.4)", parameters in SI units.

    Only numbers are read, nothing is executed. An underscore may replace a hyphen in a name.

    Raises:
        InputError: not a sum of laws, an unknown law, missing, surplus or invalid parameters, two parts of one kind.
    """
    expect(text, str, f"a material as text, such as {EXAMPLE!r}")
    if not text.strip():
        raise InputError(f"the material is empty; {_ADVICE}", "laws.empty")
    try:
        source = re.sub(r"(?<=[A-Za-z])-(?=[A-Za-z])", "_", " ".join(text.split()))
        terms = _terms(ast.parse(source, mode="eval").body)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        why = getattr(error, "msg", error)
        raise InputError(f"cannot read the material {text!r}: {why}; {_ADVICE}", "laws.syntax") from None
    return combine([_law(term) for term in terms])


def combine(terms: Sequence[Material]) -> Material:
    """The material whose stress is the sum of the terms; a single term is itself the material. Raises InputError: more
    than one elastic or more than one viscous part."""
    if len(terms) == 1:
        return terms[0]
    parts: dict[str, Any] = {}
    for kind in ("elastic", "viscous"):
        having = [term for term in terms if getattr(term.parts(), kind)]
        if len(having) > 1:
            got = " and ".join(term.name for term in having)
            why = f"a material has one {kind} part at most, but {got} each have one; leave all but one out"
            raise InputError(why, f"laws.{kind}_twice")
        parts[kind] = getattr(having[0].parts(), kind) if having else None
    return Viscoelastic(**parts, memory=tuple(arm for term in terms for arm in term.parts().memory))


def from_inferred(law: str, values: Mapping[str, Any]) -> Material:
    """The law of this name with parameters as they are inferred: with a viscosity K (1e5 1/s)^(n-1) in place of its
    consistency K, which is the viscosity at 1 1/s, far below the rates of bubbles, and strongly correlated with the
    exponent n; and perhaps with a thinning 1 - n in place of n, of which 0 is Newtonian."""
    values = dict(values)
    if any(one.name == "consistency" for one in fields(LAWS[law])):  # type: ignore[arg-type]
        viscosity = values.pop("reference_viscosity" if "reference_viscosity" in values else "viscosity")
        thinning = values.pop("thinning") if "thinning" in values else 1.0 - values["exponent"]
        if "exponent" not in values and not np.any(thinning > 0.0):
            return Newtonian(viscosity)
        values = {"exponent": 1.0 - thinning, **values, "consistency": viscosity * REFERENCE_RATE**thinning}
    return LAWS[law](**values)


def viscosity_at(material: str, rate: float, values: Mapping[str, float]) -> float | None:
    """Viscosity, Pa s, at a shear rate (1/s) of the rate-dependent law in a sum of laws with these parameters by name,
    as they are inferred; None if there is none, or it is a power law whose `viscosity` is that at 1e5 1/s."""
    for name in (part.strip() for part in material.split("+")):
        takes = (
            {*signature(LAWS[name]).parameters, "reference_viscosity"} if name in KINDS["viscous"] else {"viscosity"}
        )
        if "viscosity" in takes or (name == "power-law" and "reference_viscosity" not in values):
            continue
        law: Any = from_inferred(name, {key: values[key] for key in takes if key in values})
        return float(law.apparent(np.array(rate)))
    return None


def _terms(node: ast.expr) -> list[ast.expr]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return [*_terms(node.left), *_terms(node.right)]
    return [node]


def _law(node: ast.expr) -> Material:
    spelled = node.func if isinstance(node, ast.Call) else node
    if not isinstance(spelled, ast.Name):
        raise InputError(f"{ast.unparse(node)!r} is no law with its parameters; {_ADVICE}", "laws.no_law")
    name = spelled.id.replace("_", "-")
    if name not in LAWS:
        close = "".join(f"; did you mean {match}?" for match in get_close_matches(name.lower(), LAWS, 1))
        raise InputError(f"unknown material law {name!r}{close or ';'} known: {', '.join(LAWS)}", "laws.unknown")
    if not isinstance(node, ast.Call):
        raise InputError(f"{name} stands without its parameters; it reads {usage(name)}", "laws.parameters")
    takes = signature(LAWS[name])
    keywords = {keyword.arg or "**": keyword.value for keyword in node.keywords}
    try:
        if len(keywords) < len(node.keywords):
            raise TypeError("a parameter given twice")
        nodes = takes.bind(*node.args, **keywords).arguments
    except TypeError as error:
        raise InputError(f"{name}: {error}; it reads {usage(name)}", "laws.parameters") from None
    try:
        return LAWS[name](**{key: _value(key, nodes[key]) for key in nodes})
    except InputError as error:
        raise error.within(name) from None


def _value(name: str, node: ast.expr) -> float:
    """The number of a parameter."""
    try:
        value = ast.literal_eval(node)
        if type(value) not in (int, float):
            raise TypeError
        return float(value)
    except (ValueError, TypeError, OverflowError):
        raise InputError(f"{name} must be a number, got {ast.unparse(node)}", "laws.number") from None
