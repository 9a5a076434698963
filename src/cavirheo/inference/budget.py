"""How many draws an answer may take."""

from __future__ import annotations

from dataclasses import dataclass

from cavirheo.errors import expect_whole


@dataclass(frozen=True)
class Budget:
    """How many draws a level may take.

    Attributes:
        draws: the most draws whose weights count.
        patience: so many draws of a surrogate may be worth too little; then ridges are followed instead.
        learning: rounds of rough simulations along ridges before a draw there counts.
        each: draws of a round along ridges.
        fewest: the fewest rounds along ridges.
        least: draws along ridges end after those rounds where they will not be worth so many independent ones.
        enough: draws along ridges end where they are worth so many independent ones.

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
EVIDENCE = Budget(draws=600, patience=120, learning=1, least=60.0)  # of one law among many
