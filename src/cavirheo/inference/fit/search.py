"""The minima of one shot: searches on windows that grow by a collapse, several of them side by side.

A long window has many minima, for a rebound can slip by a period; a short one has few, but determines less. So the best
few of each window start the next one, with the best coarse simulations there beside them. While the residual is not
noise, more coarse simulations start it all again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.inference.experiment import QUICK
from cavirheo.inference.fit.least_squares import SEARCH, LeastSquares, Minimum
from cavirheo.inference.fit.starts import STARTS, Scan

ROUNDS = (STARTS, 3 * STARTS, 6 * STARTS)  # coarse simulations of each round
FOLLOWED = 3e-4  # of R_max: the rough simulations of a search are not nearer
NOISIEST = 0.01  # of R_max: what looks like more noise from frame to frame may be motion
ABOVE = 2.0  # of the frame-to-frame noise: a larger residual is not noise
FIRST, FURTHER = 4, 2  # starts from coarse simulations on the first window and on each longer one; two more each round
BREADTH = 4  # minima that go on to the next window
LOWEST, ALIKE = 6.0, 0.02  # of their costs: over the lowest one's, and over what 14 % of sigma give beside
_GLANCE = {"ftol": 1e-2, "xtol": 3e-3, "gtol": 1e-8, "max_nfev": 8}  # on all windows but the last


class Search:
    """minima: of the last of the windows `cuts`, best first. stages: the best of each window. counts: of starts.
    `once`: in one round."""

    def __init__(
        self, fit: LeastSquares, cuts: Sequence[Any], starts: Sequence[Floats] = (), *, once: bool = False
    ) -> None:
        self.fit, self.cuts = fit, cuts
        (self.shot,) = fit.shots
        self.stages: dict[Any, Floats] = {}
        self.counts = {"starts": 0, "starts_from_collapse_time": 0}
        self.tried: list[Floats] = []
        self.minima: list[Minimum] = []
        for number, count in enumerate(ROUNDS if not starts else (STARTS // 2,)):
            self.shot.set_window(*cuts[-1])
            scan = Scan(fit, count, self.counts["starts"])
            for name, more in scan.counts.items():
                self.counts[name] += more
            kept = list(starts)
            for cut in cuts[:-1]:
                kept = [minimum.x for minimum in self._best(cut, scan, kept, 2 * number)]
                self.stages.setdefault(cut, kept[0])
            self.minima = self._best(cuts[-1], scan, kept, 2 * number, self.minima)
            self.stages[cuts[-1]] = self.minima[0].x
            if once or self._enough(number):
                break
        # a rough simulation may step over what stops the default one, such as chains that are taut
        followed = [one for one in self.minima if self.shot.predict(one.x) is not None]
        self.minima = followed or self.minima

    def _enough(self, rounds: int) -> bool:
        """Whether to stop: nothing but noise is left, or two rounds found what a law may leave of a real bubble."""
        shot, (best, *_) = self.shot, self.minima
        left = self.fit.residuals(best.x, QUICK)[: len(shot.sigma)][shot.counted] * shot.sigma[shot.counted]
        rmse, noise = np.sqrt(np.mean(left**2)), self.shot.curve.noise / self.shot.max_radius
        if shot.clean:
            return bool(rmse < max(ABOVE * noise, FOLLOWED))
        return bool(rmse < ABOVE * min(noise, NOISIEST) or rounds > 0)

    def _best(
        self, cut: Any, scan: Scan, kept: Sequence[Floats], more: int, known: Sequence[Minimum] = ()
    ) -> list[Minimum]:
        """The lowest minima of a window, from those kept of the one before, from coarse simulations, and the known."""
        shot, last = self.shot, cut is self.cuts[-1]
        shot.set_window(*cut)
        new = scan.best(shot, (FIRST if cut is self.cuts[0] else FURTHER) + more, [*kept, *self.tried])
        self.tried += new
        found = list(known)
        for start in (*kept, *new):
            minimum = self.fit.minimise(start, QUICK, SEARCH if last else _GLANCE, [other.x for other in found])
            if np.isfinite(minimum.cost):
                found.append(minimum)
            if minimum.cost < 0.5 * np.sum((FOLLOWED / shot.sigma) ** 2):
                break
        found.sort(key=lambda minimum: minimum.cost)
        limit = LOWEST * found[0].cost + ALIKE * len(shot.measured)
        return [minimum for minimum in found if minimum.cost < limit][:BREADTH]
