"""Damage: what a violent collapse leaves of an elastic material."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.physics.domain import check as check_domains
from cavirheo.physics.domain import domain
from cavirheo.physics.table import hermite, read, scaled

KINDS = ("first-rebound", "strain")  # when damage happens


@dataclass(frozen=True)
class Damage:
    """Any elastic law becomes softer and gets another stress-free radius, with two factors m and r:

        S_el(R/R_0) becomes m S_el(R/(r R_0)).

    by="first-rebound": from there on m = modulus, r = radius. That stands for damage, it is no law of damage: the
    moment is declared. by="strain": m = modulus^e, r = radius^e, e = log10(R(0)/R_min) with R_min the smallest radius
    so far, so modulus and radius are the factors of a tenfold contraction (docs/method/physics.md, section 4.5).

    modulus: 0 (1e-6 by strain) to 1. radius: at least 1.

    Raises:
        InputError: a factor out of its domain, or damage by nothing known.
    """

    modulus: float = field(metadata=domain("between 0 and 1", lambda x: 0 <= x <= 1))
    radius: float = field(default=1.0, metadata=domain("between 1 and 20", lambda x: 1 <= x <= 20))
    by: str = field(default=KINDS[0], metadata=domain(" or ".join(KINDS), lambda x: x in KINDS))

    def __post_init__(self) -> None:
        check_domains(self)
        vanishes = f"modulus must be at least 1e-6 for damage by strain, got {self.modulus!r}"
        require(self.by != "strain" or self.modulus >= 1e-6, vanishes, "physics.modulus")

    def tables(self, elastic: Floats, stretch: float) -> tuple[Floats, Floats, Floats]:
        """From the table of a law (physics/table.py): that of the law at radii above the smallest so far, that below
        it, and (3,) both factors of a tenfold contraction and the smallest R/R(0) so far.

        At the first rebound: damaged and whole; the smallest radius counts as infinite until then. By strain: whole,
        to be scaled as the wall turns; and the law while the wall is at its smallest radius, x = L/stretch,

            S = x^a S_el(u),  u = L x^b,  a = -log10 modulus,  b = log10 radius.
        """
        if self.by != "strain":
            return scaled(elastic, self.radius, self.modulus), elastic, np.array([1.0, 1.0, np.inf])
        a, b = -np.log10(self.modulus), np.log10(self.radius)
        u = elastic[:, 0]
        u = np.append(u[u < stretch], stretch)
        L = (u * stretch**b) ** (1 / (1 + b))
        S, S1, S2 = read(elastic, u)
        share, c = (L / stretch) ** a, (1 + b) * u
        first = a * S + c * S1  # over share, by ln L
        second = a * first + c * ((a + 1 + b) * S1 + c * S2)
        falling = hermite(L, share * S, share * first / L, share * (second - first) / L**2)
        return elastic, falling, np.array([self.modulus, self.radius, 1.0])
