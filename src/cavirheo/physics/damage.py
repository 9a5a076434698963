"""Damage: what a violent collapse leaves of an elastic material."""

from __future__ import annotations

from dataclasses import dataclass, field

from cavirheo.arrays import Floats
from cavirheo.physics.law import check as check_domains
from cavirheo.physics.law import domain
from cavirheo.physics.table import scaled


@dataclass(frozen=True)
class Damage:
    """From the first rebound on, any elastic law is softer and has another stress-free radius:

        S_el(R/R_0) becomes modulus x S_el(R/(radius x R_0)).

    It stands for damage, it is no law of damage: the moment is declared (docs/method/physics.md, section 4.5).

    modulus: factor of the stress, from 0 to 1. radius: new stress-free radius over R_0, at least 1.

    Raises:
        InputError: a factor out of its domain.
    """

    modulus: float = field(metadata=domain("between 0 and 1", lambda x: 0 <= x <= 1))
    radius: float = field(default=1.0, metadata=domain("between 1 and 20", lambda x: 1 <= x <= 20))

    def __post_init__(self) -> None:
        check_domains(self)

    def table(self, elastic: Floats) -> Floats:
        """The table of the damaged law over R/R_0 from that of the law (physics/table.py)."""
        return scaled(elastic, self.radius, self.modulus)
