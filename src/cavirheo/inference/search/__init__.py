"""The minima of one shot: searches on windows that grow by a collapse, several of them side by side.

A long window has many minima, for a rebound can slip by a period; a short one has few, but determines less. So the best
few of each window start the next one, with the best coarse simulations there beside them. While the residual is not
noise, more coarse simulations start it all again in a further round.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.search.least_squares import LIMITS, LeastSquares, Minimum
from cavirheo.inference.search.starts import STARTS, Scan
from cavirheo.physics.accuracy import ROUGH

__all__ = ["Cut", "Search"]

ROUNDS = (STARTS, 3 * STARTS, 6 * STARTS)  # coarse simulations of each round
FOLLOWED = 3e-4  # of R_max: the rough simulations of a search are not nearer
NOISIEST = 0.01  # of R_max: what looks like more noise from frame to frame may be motion
ABOVE = 2.0  # of the frame-to-frame noise: a larger residual is not noise
WITHIN = 1.2  # of it: a smaller one is nothing else
FIRST, FURTHER = 4, 2  # starts from coarse simulations on the first window and on each longer one; two more each round
BREADTH = 4  # minima that go on to the next window
LOWEST, ALIKE = 6.0, 0.02  # of their costs: over the lowest one's, and over what 14 % of sigma give beside
_GLANCE = {"ftol": 1e-2, "xtol": 3e-3, "gtol": 1e-8, "max_nfev": 8}  # on all windows but the last

Cut = tuple[int | None, float | None]  # a window: how many collapses (None: all), its end at the latest in s


class Search:
    """cuts: the windows. stages: x of the best of each but the last. rounds: how many there were. unlike: least squared
    difference of the weighted frames of two minima; if it is not 0, no coarse simulation is gone on from in a longer
    window where minima of the one before leave nothing but noise."""

    def __init__(self, shot: Experiment, workers: int = 1, unlike: float = 0.0) -> None:
        self.shot, self.fit, self.unlike = shot, LeastSquares(shot, workers), unlike
        self.cuts: list[Cut] = [*((n, shot.cut[1]) for n in range(1, min(shot.view.collapses, 4))), shot.cut]
        self.stages: dict[Cut, Floats] = {}
        self.tried: list[Floats] = []
        self.rounds = 0

    def starts(self) -> tuple[list[Floats], list[Floats]]:
        """x of one more round where the minima of the whole window may be: minima of the window before, and coarse
        simulations. Raises SolverError: none of these succeeds."""
        shot, first = self.shot, sum(ROUNDS[: self.rounds])
        shot.set_window(*shot.cut)
        scan, kept = Scan(self.fit, ROUNDS[self.rounds], first), list[Floats]()
        for cut in self.cuts[:-1]:
            shot.set_window(*cut)
            kept = [minimum.x for minimum in self._lowest(kept, self._new(scan, kept), _GLANCE)]
            self.stages.setdefault(cut, kept[0])
        shot.set_window(*shot.cut)
        new = self._new(scan, kept)
        self.rounds += 1
        return kept, new

    def minima(self) -> list[Minimum]:
        """Those of the whole window to which the starts of one round lead, best first."""
        found = self._lowest(*self.starts(), LIMITS)
        # a rough simulation may step over what stops the default one, such as chains that are taut
        return [one for one in found if self.shot.predict(one.x) is not None] or found

    def enough(self, missed: Floats) -> bool:
        """Whether to stop at what a simulation missed, over R_max, of the frames that count: nothing but noise is left,
        or two rounds found what a law may leave of a real bubble."""
        rmse, noise = _rms(missed), self.shot.curve.noise / self.shot.max_radius
        if self.shot.clean:
            return bool(rmse < max(ABOVE * noise, FOLLOWED)) or self.rounds == len(ROUNDS)
        return bool(rmse < ABOVE * min(noise, NOISIEST) or self.rounds > 1)

    def explained(self, missed: Floats) -> bool:
        """Whether what a simulation missed, over R_max, is nothing but noise."""
        return self.unlike > 0 and _rms(missed) < WITHIN * self.shot.curve.noise / self.shot.max_radius

    def _new(self, scan: Scan, kept: Sequence[Floats]) -> list[Floats]:
        """The best coarse simulations of the present window beside the minima kept of the one before."""
        count = (FURTHER if kept else FIRST) + 2 * self.rounds
        new = scan.best(count, [*kept, *self.tried])
        self.tried += new
        return new

    def _lowest(self, kept: Sequence[Floats], new: Sequence[Floats], limits: Mapping[str, Any]) -> list[Minimum]:
        """The lowest minima of the present window, from minima of the one before and from coarse simulations."""
        shot, found = self.shot, list[Minimum]()
        for number, start in enumerate([*kept, *new]):
            if number == len(kept) and any(self.explained(self._missed(minimum)) for minimum in found):
                break
            minimum = self.fit.minimise(start, ROUGH, limits, found, self.unlike)
            if np.isfinite(minimum.cost):
                found.append(minimum)
            if minimum.cost < 0.5 * np.sum((FOLLOWED / shot.sigma) ** 2):
                break
        found.sort(key=lambda minimum: minimum.cost)
        limit = LOWEST * found[0].cost + ALIKE * len(shot.measured)
        return [minimum for minimum in found if minimum.cost < limit][:BREADTH]

    def _missed(self, minimum: Minimum) -> Floats:
        """What it missed, over R_max, of the frames that count in the present window."""
        shot = self.shot
        return (minimum.residual[: len(shot.sigma)] * shot.sigma * shot.noise_factor)[shot.counted]


def _rms(missed: Floats) -> float:
    return float(np.sqrt(np.mean(missed**2)))
