"""Accuracy of a simulation, and those that are in use (what each is worth: docs/validation.md)."""

from __future__ import annotations

from dataclasses import dataclass, field

from cavirheo.errors import expect_whole
from cavirheo.physics.domain import check, domain


@dataclass(frozen=True)
class Accuracy:
    """Of the radius in space and in time.

    Attributes:
        cells: shells across the bubble, a whole number from 8 up.
        relative_error: of a step, between 1e-12 and 0.1; of kinetic contents a tenth of it counts, and of a gas with
            an exponent, which has no shells, at most 1e-7.

    Raises:
        InputError: cells or relative_error are not so.
    """

    cells: int = 152
    relative_error: float = field(default=1e-4, metadata=domain("between 1e-12 and 0.1", lambda x: 1e-12 < x < 0.1))

    def __post_init__(self) -> None:
        expect_whole(self.cells, "cells", 8, "physics.cells")
        check(self)


DEFAULT = Accuracy()  # 1e-4 of R_max in the median, up to 2e-3 in the most violent collapses
PRECISE = Accuracy(384, 1e-5)  # ten times as accurate as the default, and five times as long
ROUGH = Accuracy(64, 3e-4)  # inside a search: 2 ms, good to 1 % of R_max, most to 0.04 %
BRISK = Accuracy(64, 1e-3)  # for draws, with what it misses of the default's: that hardly changes
COARSE = Accuracy(24, 3e-3)  # for starts: 1 ms
