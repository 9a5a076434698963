"""How many draws an answer may take."""

from __future__ import annotations

from dataclasses import dataclass

from cavirheo.errors import expect_whole


@dataclass(frozen=True)
class Budget:
    """How many draws a level may take.

    Attributes:
        draws: most whose weights count.
        patience: draws after which few simulations must be on the way to being enough; if not, ridges are followed.
        learning: rounds of rough simulations before any draw counts there,
        each: draws of a round,
        fewest: fewest rounds, after which these must be on the way to
        least: effective draws;
        enough: effective draws at which they end.

    Raises:
        InputError: draws that are no whole number from 10 up.
    """

    draws: int = 1800
    patience: int = 1200
    learning: int = 2
    each: int = 100
    fewest: int = 2
    least: float = 0.0
    enough: float = 150.0

    def __post_init__(self) -> None:
        expect_whole(self.draws, "draws of a posterior", 10, "option.draws")


POSTERIOR = Budget()  # of an answer
EVIDENCE = Budget(draws=400, patience=120, learning=1, least=60.0)  # of one law among many
