"""G and mu from collapse times: a table of (R_max, lambda, t_1), or one curve, whose answer starts a fit of R(t).

The residual of a shot is r = [(t_1/t_RC)^2 (t_RC/t_model)^2 - 1]/2, which is ln(t_1/t_model) near a fit and stays
finite where the model sees no collapse (Zhu et al. 2025, doi:10.1039/D5SM00397K, minimise the same). It is minimised
with Huber's loss, whose knee is at two standard deviations of the residuals (from their median absolute value), so that
a few wrong t_1 do not decide. `exact` puts simulations in the place of the analytic model, from its answer on.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.physics.collapse import Floats, analytic_time, inverse_square, rayleigh_time, simulated_time
from cavirheo.physics.media import WATER, Medium

MATERIALS = ("nhkv", "nh", "newtonian")  # neo-Hookean Kelvin-Voigt, neo-Hookean (mu = 0), Newtonian (G = 0)
NAMES = ("G", "µ")
CONFIDENCE = 0.95
USUAL_STRETCH = 7.0  # a guess where nothing is known: lambda of laser-made bubbles in gels is 5 to 10

_UNIT = np.array([1e4, 0.1])  # Pa and Pa s: what the solver counts in
_LARGEST = np.array([1e6, 10.0])  # bounds; the lower ones are zero
_GRID = (np.append(0.0, np.geomspace(1e2, 1e6, 33)), np.append(0.0, np.geomspace(1e-4, 10.0, 41)))
_PAIRS = np.append(0.0, np.geomspace(1e-3, 1.0, 19))  # viscosities of equally good pairs, Pa s
_STEP, _LEAST_STEP = 0.02, np.array([0.005, 0.005])  # of the derivatives of a simulation, relative and in units
_KNEE = 2.0  # standard deviations
_FLOOR = 1e-5  # of t_1: scatter below it is that of the digits
_SINGULAR = 1e3  # condition number of the normalised Jacobian beyond which G and mu are one unknown
_USUAL = 0.03  # largest usual scatter of t_1: gels have 1.2 %
_EQUAL = 1e-3  # of t_1: pairs as good as one another
_LEAST_RE = 3.0  # of pairs: below it hardly a bubble collapses (benchmarks/collapse_time.md)
_HOPELESS = 0.1  # of t_1: a pair so far off is no answer
_GOOD_INVERSE_RE, _GOOD_STRETCH = 0.1, 4.0  # where the analytic model is within 1.5 % of t_1 (docs/collapse-time.md)


@dataclass(frozen=True, eq=False)
class Shots:
    """n bubbles in one material: R_max (n,) m, lambda = R_max/R_0 (n,), t_1 (n,) s from R_max to the first minimum.

    Raises:
        InputError: arrays that are not (n,) of one length, or a value out of its domain (which).
    """

    max_radius: Floats
    stretch: Floats
    time: Floats

    def __post_init__(self) -> None:
        arrays = [np.array(a, dtype=float, ndmin=1) for a in (self.max_radius, self.stretch, self.time)]
        if len({a.shape for a in arrays}) > 1 or arrays[0].ndim != 1 or not arrays[0].size:
            raise InputError(f"R_max, lambda and t_1 must be (n,) of one length, got {[a.shape for a in arrays]}")
        for name, array in zip(("max_radius", "stretch", "time"), arrays, strict=True):
            object.__setattr__(self, name, array)
        for k in range(len(self)):
            if trouble := unusable(*(float(a[k]) for a in arrays)):
                raise InputError(f"shot {k + 1}: {trouble}")

    def __len__(self) -> int:
        return len(self.time)

    def ratio(self, medium: Medium) -> Floats:
        """(n,) t_1/t_RC."""
        return self.time / rayleigh_time(self.max_radius, medium)


def unusable(max_radius: float, stretch: float, time: float) -> str:
    """Why such a shot cannot be used; empty if it can."""
    for name, value, least in (("R_max", max_radius, 0.0), ("t_1", time, 0.0), ("lambda = R_max/R_0", stretch, 1.0)):
        if not least < value < np.inf:
            return f"{name} must be finite and above {least:g}, got {value:.4g}"
    ratio = time / float(rayleigh_time(max_radius))
    if not 0.1 < ratio < 10:
        return f"t_1 = {time * 1e6:.4g} us is {ratio:.2g} Rayleigh times of R_max = {max_radius * 1e6:.4g} um (units?)"
    return ""


@dataclass(frozen=True, eq=False)
class Estimate:
    """What a table of collapse times says. Values in Pa and Pa s; NaN where a number was not found.

    An estimate that is not `identified` has the best fit if there is a single one (with its wide interval), else NaN;
    `pairs` then are the equally good ones.
    """

    material: str
    exact: bool
    shots: Shots
    shear_modulus: float
    viscosity: float
    shear_modulus_interval: tuple[float, float]  # 95 %, from the scatter of the shots alone
    viscosity_interval: tuple[float, float]
    covariance: Floats  # (2, 2) of G and mu; zero where one is given, NaN where unknown
    per_percent: tuple[float, float]  # change of G and mu if all t_1 were 1 % longer (scale, frame rate, density)
    at_bound: tuple[str, ...]  # names of those at a bound of their range
    identified: bool
    message: str  # what is wrong or to be known; empty if nothing
    measured: Floats  # (n,) t_1/t_RC
    model: Floats  # (n,) the same of the model; infinite where it sees no collapse, NaN without an answer
    weight: Floats  # (n,) of the shots, 1 where the residual is within two standard deviations
    scatter: float  # standard deviation of ln(t_1/t_model), NaN where there are no more shots than unknowns
    pairs: Floats = field(default_factory=lambda: np.empty((0, 2)))  # (k, 2) equally good (G, mu)

    @property
    def start(self) -> tuple[float, float] | None:
        """(G, mu) for a fit of R(t) to begin with: the estimate, or the middle of the pairs; None without either."""
        if np.isfinite(self.shear_modulus + self.viscosity):
            return self.shear_modulus, self.viscosity
        if len(self.pairs) == 0:
            return None
        G, mu = self.pairs[len(self.pairs) // 2]
        return float(G), float(mu)


def shot(curve: RadiusCurve, stretch: float | None = None, *, guess: float | None = None) -> tuple[Shots, str]:
    """(the curve's R_max, lambda and t_1, where lambda comes from).

    lambda is the one given, else R_max over the late plateau, else what the file states, else `guess`.

    Raises:
        InputError: no maximum, no collapse, or no lambda.
    """
    times = curve.collapse_times()
    if len(times) == 0:
        raise InputError(f"{curve.name}: the curve shows no collapse")
    origin = "given"
    if stretch is None and (plateau := curve.stretch_from_tail()) is not None:
        stretch, origin = plateau[0], "late plateau"
    if stretch is None and curve.meta.get("stretch"):
        stretch, origin = float(curve.meta["stretch"]), "stated in the file"
    if stretch is None and guess is not None:
        stretch, origin = guess, "guessed"
    if stretch is None:
        raise InputError(f"{curve.name}: no late plateau to read lambda = R_max/R_0 from; give it (--stretch)")
    try:
        return Shots(*(np.array([x]) for x in (curve.max_radius, stretch, times[0] - curve.time_of_max))), origin
    except InputError as error:
        raise InputError(f"{curve.name}: {error}") from None


def estimate(
    curve: RadiusCurve,
    material: str = "nhkv",
    *,
    medium: Medium = WATER,
    stretch: float | None = None,
    shear_modulus: float | None = None,
    viscosity: float | None = None,
    exact: bool = False,
) -> Estimate:
    """The estimate from one curve: a starting point for a fit of R(t) in 20 ms (`start`).

    One collapse time cannot give both G and mu: without one of the two the answer is `pairs`, equally good (G, mu).
    A lambda that is neither given nor in the curve or its file is guessed as 7 (and `message` says so).

    Raises:
        InputError: the curve has no maximum or no collapse, or an option is out of its domain.
    """
    shots, origin = shot(curve, stretch, guess=USUAL_STRETCH)
    found = fit(shots, material, medium=medium, shear_modulus=shear_modulus, viscosity=viscosity, exact=exact)
    if origin != "guessed":
        return found
    return replace(found, message=_joined(f"lambda is not known: guessed as {USUAL_STRETCH:g}", found.message))


def fit(
    shots: Shots,
    material: str = "nhkv",
    *,
    medium: Medium = WATER,
    shear_modulus: float | None = None,
    viscosity: float | None = None,
    exact: bool = False,
) -> Estimate:
    """G and/or mu of one material from n collapse times.

    Args:
        material: "nhkv", "nh" (mu = 0) or "newtonian" (G = 0).
        shear_modulus, viscosity: Pa and Pa s where one is known; the other is then fitted alone.
        exact: with simulated collapse times, from the analytic answer on: 5 ms per shot, unknown and iteration.

    Raises:
        InputError: unknown material, a given value out of its domain, or nothing to fit.
        SolverError: a simulation of the exact fit failed.
    """
    given = _given(material, shear_modulus, viscosity)
    free = np.flatnonzero(np.isnan(given))
    problem = _Problem(shots, medium, given, free)
    n, p = len(shots), len(free)
    if n < p:
        return _unidentified(
            problem, material, exact,
            "one collapse time is one relation between G and µ, not both: add shots of other R_max, or give one",
        )  # fmt: skip
    solved = problem.solve(problem.coarse(), exact=False)
    if exact:
        solved = problem.solve(solved.values, exact=True)
    if p == 2 and _condition(solved.jacobian) > _SINGULAR:
        return _unidentified(
            problem, material, exact, "the shots are too alike (R_max, lambda) to tell G from µ: one relation, not both"
        )
    return _answer(problem, material, exact, solved)


def _given(material: str, shear_modulus: float | None, viscosity: float | None) -> Floats:
    """(2,) G and mu, NaN where to be fitted."""
    if material not in MATERIALS:
        raise InputError(f"unknown material {material!r}; collapse times know {', '.join(MATERIALS)}")
    if (material == "nh" and viscosity) or (material == "newtonian" and shear_modulus):
        raise InputError(f"material {material!r} has no {'viscosity' if material == 'nh' else 'shear modulus'}")
    values = [0.0 if material == "newtonian" else shear_modulus, 0.0 if material == "nh" else viscosity]
    for name, value, largest in zip(("the shear modulus", "the viscosity"), values, _LARGEST, strict=True):
        if value is not None and not 0 <= value <= largest:
            raise InputError(f"{name} must lie between 0 and {largest:g} (Pa, Pa s), got {value!r}")
    if None not in values:
        raise InputError("nothing to fit: both the shear modulus and the viscosity are given")
    return np.array([np.nan if value is None else value for value in values])


@dataclass(frozen=True, eq=False)
class _Solved:
    values: Floats  # (2,) G, mu
    residual: Floats  # (n,)
    jacobian: Floats  # (n, p) of the residual, per unit
    bound: np.ndarray  # (p,) whether at a bound
    knee: float  # of Huber's loss, infinite where every shot counts fully


@dataclass(frozen=True, eq=False)
class _Problem:
    shots: Shots
    medium: Medium
    given: Floats
    free: np.ndarray

    def values(self, x: Floats) -> Floats:
        values = self.given.copy()
        values[self.free] = x * _UNIT[self.free]
        return values

    def ratios(self, values: Floats, exact: bool) -> Floats:
        """(n,) t_model/t_RC, infinite where the model sees no collapse."""
        time = simulated_time if exact else analytic_time
        R = self.shots.max_radius
        return time(R, self.shots.stretch, values[0], values[1], self.medium) / rayleigh_time(R, self.medium)

    def residual(self, values: Floats, exact: bool) -> Floats:
        if exact:
            f = self.ratios(values, exact) ** -2.0
        else:
            shots = self.shots
            f = inverse_square(shots.max_radius, shots.stretch, values[0], values[1], self.medium)
        return np.asarray((self.shots.ratio(self.medium) ** 2 * f - 1) / 2)

    def coarse(self) -> Floats:
        """(2,) the best point of a grid, by the mean absolute residual."""
        axes = [_GRID[k] if np.isnan(self.given[k]) else self.given[k : k + 1] for k in range(2)]
        G, mu = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
        shots = self.shots
        f = inverse_square(shots.max_radius[:, None], shots.stretch[:, None], G, mu, self.medium)
        off = np.mean(np.abs(shots.ratio(self.medium)[:, None] ** 2 * f - 1), axis=0)
        best = int(np.argmin(off))
        return np.array([G[best], mu[best]])

    def jacobian(self, x: Floats, base: Floats, exact: bool) -> Floats:
        """(n, p) by differences from the residual at x: upwards, so that zero needs no exception."""
        scale = 1.0 if exact else 1e-3
        least = _LEAST_STEP[self.free]
        columns = []
        for k in range(len(x)):
            step = scale * max(_STEP * x[k], least[k])
            moved = x.copy()
            moved[k] += step
            columns.append((self.residual(self.values(moved), exact) - base) / step)
        return np.stack(columns, axis=1)

    def solve(self, start: Floats, exact: bool) -> _Solved:
        from scipy.optimize import least_squares  # a third of a second to import

        unit, most = _UNIT[self.free], (_LARGEST / _UNIT)[self.free]
        x = np.clip(start[self.free] / unit, 0.0, most)
        known: dict[bytes, Floats] = {}  # the same points are asked for again, and a simulation takes milliseconds

        def fun(x: Floats) -> Floats:
            key = x.tobytes()
            if key not in known:
                known[key] = self.residual(self.values(x), exact)
            return known[key].copy()

        slopes: dict[bytes, Floats] = {}

        def jac(x: Floats) -> Floats:
            key = x.tobytes()
            if key not in slopes:
                slopes[key] = self.jacobian(x, fun(x), exact)
            return slopes[key].copy()  # least_squares weights it in place

        options: dict[str, Any] = {"method": "dogbox", "bounds": (0.0, most), "max_nfev": 30 if exact else 200}
        options |= {"xtol": 1e-5 if exact else 1e-9, "ftol": 1e-7 if exact else 1e-12, "gtol": 1e-12}
        knee = np.inf
        done = least_squares(fun, x, jac, **options)
        if len(self.shots) > len(self.free) + 2:  # fewer shots cannot outvote one another
            for _ in range(1 if exact else 4):
                knee = _KNEE * max(float(1.4826 * np.median(np.abs(done.fun))), _FLOOR)
                done = least_squares(fun, done.x, jac, loss="huber", f_scale=knee, **options)
        # the solver's own Jacobian carries the weights of the loss
        bound = (done.x <= 1e-9) | (done.x >= most * (1 - 1e-9))
        return _Solved(self.values(done.x), fun(done.x), jac(done.x), bound, knee)


def _condition(jacobian: Floats) -> float:
    size = np.linalg.norm(jacobian, axis=0)
    return float(np.linalg.cond(jacobian / size)) if np.all(size > 0) else np.inf


def _answer(problem: _Problem, material: str, exact: bool, solved: _Solved) -> Estimate:
    from scipy.stats import t as student

    n, p = len(problem.shots), len(problem.free)
    r, J, unit = solved.residual, solved.jacobian, _UNIT[problem.free]
    inside = np.abs(r) <= solved.knee
    weight = np.where(inside, 1.0, solved.knee / np.maximum(np.abs(r), _FLOOR))
    scatter = float(np.sqrt(np.sum((weight * r) ** 2) / (n - p)) / np.mean(inside)) if n > p else np.nan
    inner = ~solved.bound  # a parameter at its bound does not vary with the others
    normal = np.full((p, p), np.nan)
    if inner.any() and _condition(J[:, inner]) < np.inf:
        normal[:] = 0.0
        normal[np.ix_(inner, inner)] = np.linalg.inv(J[:, inner].T @ J[:, inner])
    covariance, slope = np.zeros((2, 2)), np.zeros(2)
    covariance[np.ix_(problem.free, problem.free)] = scatter**2 * normal * np.outer(unit, unit)
    slope[problem.free] = -0.01 * unit * (normal @ J.sum(axis=0))
    quantile = float(student.ppf((1 + CONFIDENCE) / 2, n - p)) if n > p else np.nan
    full = np.linalg.pinv(J.T @ J)  # for how far one at its bound may be from it
    intervals, at_bound, wide = [], [], []
    for k in range(2):
        value, where = float(solved.values[k]), np.flatnonzero(problem.free == k)
        half = quantile * float(np.sqrt(covariance[k, k])) if len(where) else 0.0
        if len(where) and solved.bound[where[0]]:
            at_bound.append(NAMES[k])
            half = quantile * scatter * float(np.sqrt(full[where[0], where[0]])) * unit[where[0]]
        elif len(where) and not half < value and n > p:  # also where there is no inverse (NaN)
            wide.append(NAMES[k])
        intervals.append((max(value - half, 0.0) if np.isfinite(half) else np.nan, value + half))
    zero = [name for name, k in (("G", 0), ("µ", 1)) if name in at_bound and solved.values[k] == 0]
    message = _joined(
        f"{' and '.join(zero)} at the bound 0: these times ask for none" if zero else "",
        f"{' and '.join(set(at_bound) - set(zero))} at the upper bound" if set(at_bound) - set(zero) else "",
        f"the interval of {' and '.join(wide)} holds zero: an upper limit only" if wide else "",
        "as many shots as unknowns: no interval" if n == p else "",
        f"the times scatter by {100 * scatter:.2g} % about the model: they do not follow it"
        if scatter > _USUAL
        else "",
        _outside(problem, solved.values) if not exact else "",
    )
    model = problem.ratios(solved.values, exact)
    if not np.all(np.isfinite(model)):
        message = _joined(message, f"{int(np.sum(np.isinf(model)))} shots have no collapse in the model")
    pairs = _pairs(problem, False) if wide and p == 2 else np.empty((0, 2))
    return Estimate(
        material, exact, problem.shots, float(solved.values[0]), float(solved.values[1]),
        intervals[0], intervals[1], covariance, (float(slope[0]), float(slope[1])),
        tuple(at_bound), not wide and not set(at_bound) - set(zero), message,
        problem.shots.ratio(problem.medium), model, weight, scatter, pairs,
    )  # fmt: skip


def _unidentified(problem: _Problem, material: str, exact: bool, why: str) -> Estimate:
    n = len(problem.shots)
    pairs = _pairs(problem, exact)
    unknown, empty = (np.nan, np.nan), np.full(n, np.nan)
    ends = " to ".join(f"({G:.3g} Pa, {mu:.2g} Pa s)" for G, mu in pairs[[0, -1]]) if len(pairs) else "none in range"
    message = f"{why}; equally good: {ends}"
    return Estimate(
        material, exact, problem.shots, np.nan, np.nan, unknown, unknown, np.full((2, 2), np.nan), unknown,
        (), False, message, problem.shots.ratio(problem.medium), empty, np.ones(n), np.nan, pairs,
    )  # fmt: skip


def _pairs(problem: _Problem, exact: bool) -> Floats:
    """(k, 2): the best G for each of some viscosities, where that is as good as the best of all to the 95 % level."""
    from scipy.stats import f as fisher

    found, costs = [], []
    per_radius = problem.medium.velocity_scale / (problem.medium.pressure * float(np.median(problem.shots.max_radius)))
    for mu in _PAIRS[_PAIRS * per_radius * _LEAST_RE <= 1]:
        fixed = replace(problem, given=np.array([np.nan, mu]), free=np.array([0]))
        solved = fixed.solve(fixed.coarse(), False)
        if exact and np.mean(solved.residual**2) < _HOPELESS**2:
            solved = fixed.solve(solved.values, True)
        found.append(solved.values)
        costs.append(float(np.sum(solved.residual**2)))
    n = len(problem.shots)
    factor = 1 + 2 / (n - 2) * float(fisher.ppf(CONFIDENCE, 2, n - 2)) if n > 2 else 1.0
    good = np.array(costs) <= factor * min(costs) + n * _EQUAL**2
    if min(costs) > n * _HOPELESS**2:  # no pair gives such times at all
        good[:] = False
    return np.array(found)[good].reshape(-1, 2)


def _outside(problem: _Problem, values: Floats) -> str:
    """A sentence where the analytic model is known to be poor."""
    medium, shots = problem.medium, problem.shots
    inverse_re = values[1] * medium.velocity_scale / (medium.pressure * shots.max_radius)
    viscous = int(np.sum(inverse_re > _GOOD_INVERSE_RE))
    small = int(np.sum(shots.stretch < _GOOD_STRETCH))
    which = _joined(
        f"Re < {1 / _GOOD_INVERSE_RE:g} in {viscous}" if viscous else "",
        f"lambda < {_GOOD_STRETCH:g} in {small}" if small else "",
    )
    return f"the analytic model is poor here ({which} of {len(shots)} shots): use exact" if which else ""


def _joined(*parts: str) -> str:
    return "; ".join(part for part in parts if part)
