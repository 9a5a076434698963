"""Bubble: what is assumed of the bubble besides the law of its surroundings and the medium."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real

from cavirheo.errors import brief, require

CONTENTS = ("equilibrium", "kinetic")  # models of what is in the bubble
DAMAGES = ("none", "first-rebound", "strain")  # of the elastic part
FREE = "free"  # inferred with the other parameters
FROM_NOTHING = ("confinement_inertia", "confinement_damping", "vapour_excess")  # numbers that are 0 by default
_TITLES = {"real": "real bubble", "field": "field's bubble", "kinetic": "bubble with kinetic contents"}
_DAMAGE_WORDS = {"none": "", "first-rebound": "damage", "strain": "damage by strain"}


@dataclass(frozen=True)
class Bubble:
    """What is assumed of the bubble; a number, or "free" for what is inferred with the other parameters.

    `REAL` is the bubble that recordings show: vapour condenses at a finite rate, and the surroundings damp the motion
    (docs/real-bubbles.md). `FIELD` is what the field's tables assume: equilibrium contents in an unbounded liquid.

    Attributes:
        contents: "equilibrium" (vapour at the wall is saturated) or "kinetic" (it condenses at a finite rate).
        accommodation: coefficient of kinetic contents, 1: above 0 and at most 10; free from 0.01 to 1.
        damage: "none"; "first-rebound": from there on the law has another modulus and stress-free radius; or "strain":
            both follow the largest contraction so far. Its two factors are inferred.
        confinement_inertia: beta, as in `simulate`.
        wall_distance: m, of one rigid wall, instead of the confinement inertia.
        vapour_excess: Pa above saturation at R_max.
        confinement_damping: zeta, as in `simulate`.

    Raises:
        InputError: contents or damage that are not known, or what is neither a number nor "free".
    """

    contents: str = "equilibrium"
    accommodation: float | str = FREE
    damage: str = "none"
    confinement_inertia: float | str = 0.0
    wall_distance: float | None = None
    vapour_excess: float | str = 0.0
    confinement_damping: float | str = 0.0

    def __post_init__(self) -> None:
        told = f"contents must be {' or '.join(CONTENTS)}, got {self.contents!r}"
        require(self.contents in CONTENTS, told, "physics.contents")
        told = f"damage must be {', '.join(DAMAGES)}, got {self.damage!r}"
        require(self.damage in DAMAGES, told, "option.damage")
        for name in ("accommodation", *FROM_NOTHING):
            value = getattr(self, name)
            told = f"{name} must be a number or 'free', got {value!r}"
            require(value == FREE or isinstance(value, Real), told, f"physics.{name}")

    @property
    def name(self) -> str:
        """'real', 'field', 'kinetic, damage', 'field, confinement inertia'."""
        damped = self.confinement_damping != 0
        base = {("kinetic", True): "real", ("kinetic", False): "kinetic"}.get((self.contents, damped), "field")
        more = {
            "confinement damping": damped and base == "field",
            "confinement inertia": self.wall_distance is not None or self.confinement_inertia != 0,
            "vapour excess": self.vapour_excess != 0,
        }
        return ", ".join(filter(None, [base, _DAMAGE_WORDS[self.damage], *(word for word, has in more.items() if has)]))

    @property
    def title(self) -> str:
        """'real bubble', "field's bubble, damage"."""
        return title_of(self.name)

    @property
    def sentence(self) -> str:
        """What it assumes, for people."""
        vapour = "vapour condenses at a finite rate" if self.contents == "kinetic" else "vapour condenses at once"
        around = "its surroundings damp it" if self.confinement_damping != 0 else "nothing around it damps it"
        title = self.title
        return f"{title[0].upper()}{title[1:]}: {vapour}, and {around}."


def title_of(name: str) -> str:
    """'real bubble', "field's bubble, damage", of a bubble's name."""
    base, *more = name.split(", ")
    return ", ".join([_TITLES.get(base, f"{base} bubble"), *more])


FIELD = Bubble()
REAL = Bubble("kinetic", confinement_damping=FREE)
DAMAGED = Bubble("kinetic", confinement_damping=FREE, damage="strain")
BUBBLES = {"real": REAL, "field": FIELD}
AUTO = "auto"  # both, and the evidence chooses
Requested = Bubble | str | Sequence[Bubble]


def bubbles_of(requested: Requested) -> tuple[Bubble, ...]:
    """One bubble, or several among which the evidence chooses, from "real", "field", "auto", a Bubble or several.

    Raises:
        InputError: none of these.
    """
    if isinstance(requested, Bubble):
        return (requested,)
    if requested == AUTO:
        return FIELD, REAL
    told = f"bubble must be {', '.join(BUBBLES)}, {AUTO} or a Bubble, got {brief(requested)}"
    if isinstance(requested, str):
        require(requested in BUBBLES, told, "option.bubble")
        return (BUBBLES[requested],)
    fine = isinstance(requested, Sequence) and len(requested) > 0 and all(isinstance(one, Bubble) for one in requested)
    require(fine, told, "option.bubble")
    return tuple(dict.fromkeys(requested))


def rival_of(bubble: Bubble) -> Bubble | None:
    """The bubble whose answer stands beside: the field's beside the real one and the other way round."""
    return {REAL: FIELD, FIELD: REAL}.get(bubble)
