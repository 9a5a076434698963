"""The minima of one shot, found by searches on windows that grow by one collapse.

A long window has many minima, because a rebound can slip by a period; a short one has few, but determines less. So the
best few of each window start the searches on the next one, with the coarse simulations that are best there. While the
residual is more than noise, a further round starts with more coarse simulations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats, even_points
from cavirheo.errors import SolverError
from cavirheo.inference.camera import NAMES
from cavirheo.inference.experiment import DIFFERENCE_STEP, Experiment, Prediction
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.accuracy import COARSE, ROUGH, Accuracy
from cavirheo.physics.collapse import analytic_modulus

STARTS = 64  # coarse simulations of the first round
ROUNDS = (STARTS, 3 * STARTS, 6 * STARTS)  # coarse simulations of each round
ROUGH_ERROR = 3e-4  # RMS error over R_max of the rough simulations of a search
MAX_NOISE = 0.01  # frame-to-frame noise over R_max: what is more may be motion
MISFIT_RATIO = 2.0  # residual over frame-to-frame noise: a larger one is not only noise
NOISE_RATIO = 1.2  # a smaller one is only noise
FIRST_STARTS, LATER_STARTS = 4, 2  # of coarse simulations, on the first and each longer window; two more each round
BREADTH = 4  # most minima that start the next window
COST_FACTOR, COST_PER_FRAME = 6.0, 0.02  # limit of cost: lowest times this, plus this per frame (20 % of sigma RMS)
_SHORTER_LIMITS = {"ftol": 1e-2, "xtol": 3e-3, "gtol": 1e-8, "max_nfev": 8}  # limits on all windows but the last
SAME_MINIMUM = 0.01  # of each range: a search that is nearer to a known minimum ends
START_DISTANCE = 0.08  # of a range: starts that are nearer to each other in all parameters lead to one minimum
LIMITS: dict[str, Any] = {"ftol": 1e-3, "xtol": 1e-3, "gtol": 1e-8, "max_nfev": 15}
POLISH: dict[str, Any] = {"ftol": 3e-5, "xtol": 1e-4, "gtol": 1e-8, "max_nfev": 12}
Extent = tuple[int | None, float | None]  # a window: number of collapses (None: all), latest end in s


class Minimum(NamedTuple):
    """The end of a search: x (parameters,), cost (half the sum of squared weighted residuals), these residuals."""

    x: Floats
    cost: float
    residual: Floats


class LeastSquares:
    """The weighted residuals of an experiment, followed by those of the normal priors."""

    def __init__(self, shot: Experiment) -> None:
        self.shot, self.bounds, prior = shot, shot.bounds, shot.prior()
        self.columns = np.flatnonzero(np.isfinite(prior.std))  # of x, with a normal prior
        self.mean, self.std = prior.mean[self.columns], prior.std[self.columns]

    def predictions(self, points: Sequence[Floats], accuracy: Accuracy) -> list[Prediction | None]:
        """One simulation for each x (parameters,)."""
        return [self.shot.predict(x, accuracy) for x in points]

    def residuals(self, x: Floats, accuracy: Accuracy) -> Floats:
        """(frames + priors,) weighted residuals."""
        return self.weighted(x, self.shot.predict(x, accuracy))

    def weighted(self, x: Floats, prediction: Prediction | None) -> Floats:
        """(frames + priors,) weighted residuals of a prediction at x."""
        return np.concatenate([self.shot.residual(prediction), (x[self.columns] - self.mean) / self.std])

    def jacobian(self, x: Floats, accuracy: Accuracy, at: Prediction | None) -> Floats:
        """(frames + priors, parameters) Jacobian by forward differences from the prediction at x; a column is 0 if its
        simulation fails. In a search, columns of clock and scales need no simulation."""
        shot, residuals = self.shot, self.weighted(x, at)
        steps = DIFFERENCE_STEP * shot.steps * np.where(x < np.mean(self.bounds, axis=1), 1.0, -1.0)
        alike = accuracy is ROUGH and at is not None
        moved = [i for i, name in enumerate(shot.names) if not (alike and name in NAMES)]
        points = [x + np.where(np.arange(len(x)) == i, steps, 0.0) for i in moved]
        frames, result = len(shot.measured), np.zeros((len(residuals), len(x)))
        for i, prediction in zip(moved, self.predictions(points, accuracy), strict=True):
            if prediction is not None:
                result[:frames, i] = (shot.residual(prediction) - residuals[:frames]) / steps[i]
        if alike and at is not None:
            by_camera = [i for i, name in enumerate(shot.names) if name in NAMES]
            result[:frames, by_camera] = shot.camera_slopes(x, at, result[:frames, : shot.law_size])
        result[range(frames, len(residuals)), self.columns] = 1.0 / self.std
        return result

    def minimise(
        self,
        start: Floats,
        accuracy: Accuracy,
        limits: Mapping[str, Any] = LIMITS,
        minima: Sequence[Minimum] = (),
        min_distance: float = 0.0,
    ) -> Minimum:
        """Trust-region least squares within the bounds (scipy). Every second Jacobian is the previous one with
        Broyden's update, which needs no simulation. If a search ends on such an update, it is repeated once from its
        end, unless `minima` are given. A search that comes to one of these, or to frames that differ from its frames by
        less than `min_distance` (sum of weighted squares), ends with an infinite cost."""
        from scipy.optimize import least_squares

        low, high = self.bounds.T
        inside = 1e-6 * (high - low)
        last: list[Prediction | None] = [None]  # prediction at the current point
        slopes: list[tuple[Floats, Floats, Floats]] = []  # x, residuals, Jacobian: by differences, then updated

        def fun(x: Floats) -> Floats:
            last[0] = self.shot.predict(x, accuracy)
            return self.weighted(x, last[0])

        def jac(x: Floats) -> Floats:
            at = self.weighted(x, last[0])
            for minimum in minima:
                close = np.all(np.abs(x - minimum.x) < SAME_MINIMUM * (high - low))
                if close or np.sum((at - minimum.residual) ** 2) < min_distance:
                    raise KnownMinimumError
            if len(slopes) == 1:
                ((x0, at0, slope),) = slopes
                move = x - x0
                slope = slope + np.outer(at - at0 - slope @ move, move) / (move @ move)
            else:
                slopes.clear()
                slope = self.jacobian(x, accuracy, last[0])
            slopes.append((x.copy(), at, slope))
            return slope.copy()

        x = start
        try:
            for _ in range(1 if minima else 2):
                x = np.clip(x, low + inside, high - inside)
                solution = least_squares(fun, x, jac=jac, bounds=(low, high), method="trf", **limits)
                if len(slopes) == 1:
                    break
                slopes.clear()
                x = solution.x
        except KnownMinimumError:
            return Minimum(x, np.inf, np.empty(0))
        return Minimum(solution.x, float(solution.cost), solution.fun)


class KnownMinimumError(Exception):
    """A search came to a known minimum; caught by `LeastSquares.minimise`."""


class Scan:
    """Coarse simulations over the whole window of a shot, which start the searches on every window: every second point
    where materials usually are, the others all over the ranges. If law and curve allow it, two of four have the shear
    modulus of the collapse time (physics/collapse.py). first: index of the first point in the sequence of points.
    Raises SolverError: all simulations failed."""

    def __init__(self, fit: LeastSquares, count: int = STARTS, first: int = 0) -> None:
        shot, family = fit.shot, fit.shot.family
        self.bounds = fit.bounds
        stated = shot.stretch_prior
        logs = [PARAMETERS[name] for name in shot.log_names]
        usual = np.array([*family.bounds(started=True), *(parameter.start_range for parameter in logs)])
        wide = np.array([*family.bounds(), *(parameter.search_range for parameter in logs)])
        if stated and "stretch" in shot.log_names:
            row = shot.law_size + shot.log_names.index("stretch")
            usual[row] = np.clip(np.log10([max(stated[0] - stated[1], 1e-3), stated[0] + stated[1]]), *wide[row])
        numbers = np.arange(first, first + count)
        self.points = shot.starts(np.zeros((count, len(fit.bounds))))
        self.searched = slice(0, len(wide))  # columns of x that the points vary
        cube = even_points(first + count, len(wide))[first:]
        for box, taken in ((usual, numbers % 2 == 0), (wide, numbers % 2 == 1)):
            self.points[taken, self.searched] = box[:, 0] + cube[taken] * (box[:, 1] - box[:, 0])
        names, times = family.parameters, shot.curve.collapse_times()
        if len(times) and {"shear_modulus", "viscosity"} <= set(names):
            column = names.index("shear_modulus")
            viscosity = 10.0 ** self.points[:, names.index("viscosity")]
            stretch, until = shot.natural(self.points.T)["stretch"], float(times[0] - shot.curve.time_of_max)
            modulus = analytic_modulus(shot.max_radius, stretch, viscosity, until, shot.medium)
            log10 = np.log10(np.where(modulus > 0, modulus, np.nan))
            low, high = fit.bounds[column]
            timed = (log10 > low) & (log10 < high) & (numbers // 2 % 2 == 0)
            self.points[timed, column] = log10[timed]
        self.predictions = fit.predictions(list(self.points), COARSE)
        if not any(self.predictions):
            raise SolverError(f"all {count} simulations of {family.name} failed that were to start the search")

    def best(self, shot: Experiment, count: int, used: list[Floats]) -> list[Floats]:
        """Points with the smallest cost in the window of a shot, far from each other and from those in `used`."""
        m = len(shot.time_since_max)
        cut = [each and Prediction(*(values[:m] for values in each)) for each in self.predictions]
        costs = [np.sum(shot.residual(prediction) ** 2) for prediction in cut]
        width = (self.bounds[:, 1] - self.bounds[:, 0])[self.searched]
        chosen: list[Floats] = []
        for point in self.points[np.argsort(costs)]:
            off = [np.abs(point - start)[self.searched] / width for start in (*used, *chosen)]
            if len(chosen) < count and all(np.max(distance) > START_DISTANCE for distance in off):
                chosen.append(point)
        return chosen


class Search:
    """Searches in one or more rounds. shots: the experiment of each window, the whole one last. stages: best x of each
    window but the last. rounds: number of rounds so far. min_distance: least squared difference of the weighted frames
    of two minima; if it is not 0, coarse simulations do not start searches on a longer window where minima from the
    previous one leave only noise."""

    def __init__(self, shot: Experiment, min_distance: float = 0.0) -> None:
        self.shot, self.min_distance = shot, min_distance
        cuts: list[Extent] = [*((n, shot.extent[1]) for n in range(1, min(shot.view.collapses, 4))), shot.extent]
        self.shots: dict[Extent, Experiment] = {cut: shot.cut_to(*cut) for cut in cuts}
        self.stages: dict[Extent, Floats] = {}
        self.used: list[Floats] = []
        self.rounds = 0

    def starts(self) -> tuple[list[Floats], list[Floats]]:
        """Starts x on the whole window for one more round: minima of the previous window, and coarse simulations.
        Raises SolverError: all coarse simulations failed."""
        scan = Scan(LeastSquares(self.shot), ROUNDS[self.rounds], sum(ROUNDS[: self.rounds]))
        earlier = list[Floats]()
        *shorter, whole = self.shots
        for cut in shorter:
            new = self._coarse_starts(scan, self.shots[cut], earlier)
            earlier = [minimum.x for minimum in self._lowest_minima(self.shots[cut], earlier, new, _SHORTER_LIMITS)]
            self.stages.setdefault(cut, earlier[0])
        new = self._coarse_starts(scan, self.shots[whole], earlier)
        self.rounds += 1
        return earlier, new

    def minima(self) -> list[Minimum]:
        """Minima of the whole window from the starts of one more round, best first."""
        minima = self._lowest_minima(self.shot, *self.starts(), LIMITS)
        # a rough simulation may step over what stops the default one, such as a chain at its limit
        return [minimum for minimum in minima if self.shot.predict(minimum.x) is not None] or minima

    def is_finished(self, missed: Floats) -> bool:
        """Whether the search stops at these differences, over R_max, of frames and simulation: only noise is left, or
        two rounds were made (all rounds on a curve without noise)."""
        rmse, noise = _rms(missed), self.shot.noise_over_rmax
        if self.shot.clean:
            return bool(rmse < max(MISFIT_RATIO * noise, ROUGH_ERROR)) or self.rounds == len(ROUNDS)
        return bool(rmse < MISFIT_RATIO * min(noise, MAX_NOISE) or self.rounds > 1)

    def only_noise(self, missed: Floats) -> bool:
        """Whether these differences, over R_max, of frames and simulation are only noise; never if `min_distance`
        is 0."""
        return self.min_distance > 0 and _rms(missed) < NOISE_RATIO * self.shot.noise_over_rmax

    def _coarse_starts(self, scan: Scan, shot: Experiment, earlier: Sequence[Floats]) -> list[Floats]:
        """The best coarse simulations on the window of a shot that are far from the minima of the previous window."""
        count = (LATER_STARTS if earlier else FIRST_STARTS) + 2 * self.rounds
        new = scan.best(shot, count, [*earlier, *self.used])
        self.used += new
        return new

    def _lowest_minima(
        self, shot: Experiment, earlier: Sequence[Floats], new: Sequence[Floats], limits: Mapping[str, Any]
    ) -> list[Minimum]:
        """The lowest minima on the window of a shot, from minima of the previous window and from coarse simulations."""
        fit, minima = LeastSquares(shot), list[Minimum]()
        for number, start in enumerate([*earlier, *new]):
            if number == len(earlier) and any(self.only_noise(_missed(shot, minimum)) for minimum in minima):
                break
            minimum = fit.minimise(start, ROUGH, limits, minima, self.min_distance)
            if np.isfinite(minimum.cost):
                minima.append(minimum)
            if minimum.cost < 0.5 * np.sum((ROUGH_ERROR / shot.sigma) ** 2):
                break
        minima.sort(key=lambda minimum: minimum.cost)
        limit = COST_FACTOR * minima[0].cost + COST_PER_FRAME * len(shot.measured)
        return [minimum for minimum in minima if minimum.cost < limit][:BREADTH]


def _missed(shot: Experiment, minimum: Minimum) -> Floats:
    """Measured minus simulated radius at a minimum, over R_max, of the frames that count in the window of a shot."""
    counted = shot.counted
    return np.asarray(minimum.residual[: len(counted)][counted] * shot.sigma[counted] * shot.noise_factor)


def _rms(missed: Floats) -> float:
    return float(np.sqrt(np.mean(missed**2)))
