"""Bubble: the model of the bubble itself, besides the law of its surroundings and the medium; and Damage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from numbers import Real

from cavirheo.errors import InputError, brief
from cavirheo.parameters import DISTANCE, NOT_NEGATIVE, POSITIVE, Domain, check, domain, optional

MOTIONS = ("keller-miksis", "rayleigh-plesset", "gilmore")  # equations of the wall
CONTENTS = ("equilibrium", "kinetic")  # models of what is in the bubble
DAMAGES = ("none", "strain")  # whether the elastic part becomes softer with the wall strain
FREE = "free"  # value of a field that is inferred with the other parameters
ZERO_BY_DEFAULT = ("confinement_inertia", "confinement_damping", "vapour_excess")  # numbers that are 0 by default
ACCOMMODATION = 0.07  # of vapour at the wall: median of real gels (docs/method/physics.md, section 3.5)
_TITLES = {"real": "real bubble", "field": "field's bubble", "kinetic": "bubble with kinetic contents"}


def _one_of(words: Sequence[str]) -> Domain:
    return domain(f"one of {', '.join(words)}", lambda word: word in words)


def _or_free(words: str, holds: Callable[[float], bool]) -> Domain:
    return domain(f"{words}, or {FREE!r}", lambda x: x == FREE or (isinstance(x, Real) and holds(x)))


@dataclass(frozen=True)
class Damage:
    """Damage by strain: the elastic part becomes softer and its stress-free radius larger, the more the bubble shrinks:

        S_el(R/R_0) becomes modulus^e S_el(R/(radius^e R_0)),  e = log10(R(0)/R_min),

    R_min the smallest radius so far (docs/method/physics.md, section 4.5).

    Attributes:
        modulus: factor of the modulus at a tenfold contraction, from 1e-6 to 1.
        radius: factor of the stress-free radius at a tenfold contraction, from 1 to 20.

    Raises:
        InputError: a factor out of its domain.
    """

    modulus: float = field(metadata=domain("between 1e-6 and 1", lambda x: 1e-6 <= x <= 1))
    radius: float = field(default=1.0, metadata=domain("between 1 and 20", lambda x: 1 <= x <= 20))

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class Bubble:
    """Model of the bubble. A field of type `float | str` may be "free": it is inferred with the other parameters.

    `REAL` is the bubble that recordings show: vapour condenses at a finite rate, and the surroundings damp the motion
    and add inertia (docs/real-bubbles.md). `FIELD` is the usual model of the literature: equilibrium contents in an
    unbounded liquid.

    Attributes:
        contents: "equilibrium" (vapour at the wall is saturated) or "kinetic" (it condenses at a finite rate, and its
            diffusivity depends on temperature and pressure).
        accommodation: coefficient of kinetic contents, above 0 and at most 10: share of the vapour molecules hitting
            the wall that condense; it stands for any other resistance there, too. If free, from 0.01 to 1.
        damage: "none", or "strain": modulus and stress-free radius of the law depend on the largest contraction so far,
            by two factors that are inferred. A `Damage` has known factors, for `simulate`.
        confinement_inertia: beta = R_max sum(s_i/d_i) over the images of the bubble behind walls, d_i their distances,
            s_i = 1 for a rigid wall and -1 for a free surface.
        wall_distance: m, from the bubble's centre to one rigid wall, instead of confinement_inertia (R_max over twice
            the distance).
        vapour_excess: pressure of the vapour above saturation at R_max, Pa.
        confinement_damping: zeta = 2 pi (R_max^2/A) c/U_c of a tube of cross-section A around the bubble, along which
            its sound leaves as plane waves: they resist the growth V' of the volume by the pressure rho c V'/(2 A).
        motion: "keller-miksis", "rayleigh-plesset" (incompressible) or "gilmore" (Tait's liquid).
        exponent: polytropic exponent of the gas (1 isothermal, 1.4 adiabatic air) beside saturated vapour, instead of
            heat and vapour transport. The gas is expanded from R_0 to R_max isothermally: with an exponent above
            1 the bubble comes to rest above R_0.

    Raises:
        InputError: unknown motion, contents or damage, a value that is neither in its domain nor "free", an exponent
            with kinetic contents or vapour above saturation, or two descriptions of the walls.
    """

    contents: str = field(default="equilibrium", metadata=_one_of(CONTENTS))
    accommodation: float | str = field(default=FREE, metadata=_or_free("above 0 and at most 10", lambda x: 0 < x <= 10))
    damage: str | Damage = "none"
    confinement_inertia: float | str = field(
        default=0.0, metadata=_or_free("above -0.5 and at most 3", lambda x: -0.5 < x <= 3)
    )
    wall_distance: float | None = field(default=None, metadata=optional(*POSITIVE["domain"]))
    vapour_excess: float | str = field(default=0.0, metadata=_or_free(*NOT_NEGATIVE["domain"]))
    confinement_damping: float | str = field(default=0.0, metadata=_or_free(*NOT_NEGATIVE["domain"]))
    motion: str = field(default="keller-miksis", metadata=_one_of(MOTIONS))
    exponent: float | None = field(
        default=None, metadata=optional("from 1 to 10 (--polytropic), such as 1.4", lambda n: 1 <= n <= 10)
    )

    def __post_init__(self) -> None:
        check(self)
        if not isinstance(self.damage, Damage) and self.damage not in DAMAGES:
            raise InputError(f"damage must be {', '.join(DAMAGES)} or a Damage, got {self.damage!r}", "option.damage")
        if self.wall_distance is not None and self.confinement_inertia != 0:
            raise InputError("give either confinement_inertia or wall_distance, not both", "physics.two_walls")
        if self.wall_distance is not None:
            DISTANCE.check("wall_distance", self.wall_distance, "physics.wall_distance")
        if self.accommodation != FREE and self.contents != "kinetic":
            idle = "an accommodation changes nothing without kinetic contents (--contents kinetic): give both"
            raise InputError(idle, "option.idle")
        if self.exponent is not None and (self.contents != "equilibrium" or self.vapour_excess != 0):
            message = "with an exponent of the gas (--polytropic) no vapour condenses: leave it out, or "
            raise InputError(f"{message}kinetic contents and vapour_excess", "physics.contents_twice")

    def check_known(self) -> None:
        """Raises InputError for a value that is "free"; the message says what to give instead."""
        usual = {"accommodation": ACCOMMODATION} if self.contents == "kinetic" else {}
        usual |= dict.fromkeys(ZERO_BY_DEFAULT, 0.0)
        free = {name: value for name, value in usual.items() if isinstance(getattr(self, name), str)}
        options = " ".join(f"--{name.replace('_', '-')} {value}" for name, value in free.items())
        fields = [f"{name}={value}" for name, value in free.items()]
        fields += ["damage=Damage(0.5, 1.5)"] if self.damage == "strain" else []
        if fields:
            given = " or ".join(filter(None, [options, f"in Python {', '.join(fields)}"]))
            message = f"simulate needs a bubble whose values are known: give numbers, such as {given}"
            raise InputError(message, "physics.free_bubble")

    def inertia(self, max_radius: float) -> float:
        """beta of a bubble of this R_max (m) whose confinement is known. Raises InputError: a wall within R_max."""
        if self.wall_distance is None:
            return float(self.confinement_inertia)
        if self.wall_distance <= max_radius:
            wall = f"a wall {1e6 * self.wall_distance:.4g} um from the centre of a bubble of R_max "
            larger = "give a larger distance (--wall-distance-um; in Python wall_distance=, in m)"
            message = f"{wall}{1e6 * max_radius:.4g} um would be inside it: {larger}"
            raise InputError(message, "physics.wall_too_near")
        return 0.5 * max_radius / self.wall_distance

    @property
    def name(self) -> str:
        """'real', 'field', 'kinetic, damage by strain', 'field, confinement inertia'."""
        damped, walled = self.confinement_damping != 0, self.confinement_inertia != 0
        base = "kinetic" if self.contents == "kinetic" else "field"
        if base == "kinetic" and damped and (walled or self.wall_distance):
            base, damped, walled = "real", False, False
        more = {
            "damage by strain": self.damage != "none",
            "confinement damping": damped,
            "confinement inertia": walled,
            "wall": self.wall_distance is not None,
            "vapour excess": self.vapour_excess != 0,
            self.motion: self.motion != MOTIONS[0],
            "polytropic": self.exponent is not None,
        }
        return ", ".join([base, *(word for word, applies in more.items() if applies)])

    @property
    def title(self) -> str:
        """'real bubble', "field's bubble, damage by strain"."""
        base, *more = self.name.split(", ")
        return ", ".join([_TITLES[base], *more])

    @property
    def sentence(self) -> str:
        """The assumptions of the model, for users."""
        vapour = "vapour condenses at a finite rate" if self.contents == "kinetic" else "vapour condenses at once"
        gas = ", its gas is polytropic" if self.exponent is not None else ""
        walled = self.confinement_inertia != 0 or self.wall_distance is not None
        acts = {"damp it": self.confinement_damping != 0, "add inertia": walled}
        words = " and ".join(word for word, applies in acts.items() if applies)
        damper = f"its surroundings {words}" if words else "nothing around it damps it"
        return f"{self.title[0].upper()}{self.title[1:]}: {vapour}{gas}, and {damper}."


FIELD = Bubble()
REAL = Bubble("kinetic", confinement_inertia=FREE, confinement_damping=FREE)
BUBBLES = {"real": REAL, "field": FIELD}
Requested = Bubble | str


def bubble_of(requested: Requested) -> Bubble:
    """The bubble of a name, "real" or "field", or a Bubble itself. Raises InputError: neither of these."""
    bubble = BUBBLES.get(requested) if isinstance(requested, str) else requested
    if not isinstance(bubble, Bubble):
        message = f"bubble must be {', '.join(BUBBLES)} or a Bubble, got {brief(requested)}"
        raise InputError(message, "option.bubble")
    return bubble
