"""G and mu from collapse times: a table of (R_max, lambda, t_1), or one curve, whose answer starts a fit of R(t).

The residual of a shot is r = [(t_1/t_RC)^2 (t_RC/t_model)^2 - 1]/2, which is ln(t_1/t_model) near a fit and stays
finite where the model sees no collapse (Zhu et al. 2025, doi:10.1039/D5SM00397K, minimise the same). It is minimised
with Huber's loss, whose knee is at two standard deviations of the residuals (from their median absolute value), so that
a few wrong t_1 do not decide. `exact` puts simulations in the place of the analytic model, from its answer on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.physics.collapse import analytic_time, inverse_square, rayleigh_time, simulated_time
from cavirheo.physics.media import WATER, Medium
from cavirheo.writing.document import Finite, Record

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
_GOOD_INVERSE_RE, _GOOD_STRETCH = (
    0.1,
    4.0,
)  # where the analytic model is within 1.5 % of t_1 (docs/method/collapse-time.md)


@dataclass(frozen=True, eq=False)
class Shots:
    """n bubbles in one material: R_max (n,) m, lambda = R_max/R_0 (n,), t_1 (n,) s from R_max to the first minimum.

    `names` are those of the shots in messages; "1", "2", ... if none are given.

    Raises:
        InputError: arrays that are not (n,) of one length, or a value out of its domain (which).
    """

    max_radius: Floats
    stretch: Floats
    time: Floats
    names: Sequence[str] = ()

    def __post_init__(self) -> None:
        arrays = [np.array(a, dtype=float, ndmin=1) for a in (self.max_radius, self.stretch, self.time)]
        if len({a.shape for a in arrays}) > 1 or arrays[0].ndim != 1 or not arrays[0].size:
            shapes = [a.shape for a in arrays]
            raise InputError(f"R_max, lambda and t_1 must be (n,) of one length, got {shapes}", "collapse_time.lengths")
        names = self.names or [str(k) for k in range(1, len(arrays[0]) + 1)]
        for field, values in zip(("max_radius", "stretch", "time", "names"), (*arrays, names), strict=True):
            object.__setattr__(self, field, values)
        for k in range(len(self)):
            if trouble := unusable(*(float(a[k]) for a in arrays)):
                raise InputError(f"shot {k + 1}: {trouble}", "collapse_time.shot")

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


class CollapseValue(Record):
    """`low`, `high`: 95 % interval from the scatter of the shots; `per_percent`: change if all t_1 were 1 % longer."""

    value: Finite = None
    low: Finite = None
    high: Finite = None
    per_percent: Finite = None


class CollapseEstimate(Record):
    """What n collapse times say, as it is written; null where a number was not found.

    An estimate that is not `identified` has the best fit if there is a single one (with its wide interval), else null;
    `pairs` then are the equally good (G in Pa, mu in Pa s). `message`: what is wrong or to be known; empty if nothing.
    """

    shear_modulus_Pa: CollapseValue = CollapseValue()
    viscosity_Pa_s: CollapseValue = CollapseValue()
    correlation: Finite = None
    scatter: Finite = None  # standard deviation of ln(t_1/t_model); null where there are no more shots than unknowns
    identified: bool = False
    at_bound: list[str] = []  # names of those at a bound of their range
    downweighted: list[str] = []  # shots that count less than half
    pairs: list[tuple[float, float]] = []
    message: str = ""
    # of each shot, not written here: t_1/t_RC as measured, the same of the model (null where it has none), the weight
    measured: list[Finite] = Field(default=[], exclude=True)
    model: list[Finite] = Field(default=[], exclude=True)
    weight: list[float] = Field(default=[], exclude=True)  # 1 where the residual is within two standard deviations

    @property
    def answered(self) -> bool:
        """Whether there is a number for both."""
        return self.shear_modulus_Pa.value is not None and self.viscosity_Pa_s.value is not None

    @property
    def start(self) -> tuple[float, float] | None:
        """(G, mu) for a fit of R(t) to begin with: the estimate, or the middle of the pairs; None without either."""
        G, mu = self.shear_modulus_Pa.value, self.viscosity_Pa_s.value
        if G is not None and mu is not None:
            return G, mu
        return self.pairs[len(self.pairs) // 2] if self.pairs else None


def shot(curve: RadiusCurve, stretch: float | None = None, *, guess: float | None = None) -> tuple[Shots, str]:
    """(the curve's R_max, lambda and t_1, where lambda comes from).

    lambda is the one given, else R_max over the late plateau, else what the file states, else `guess`.

    Raises:
        InputError: no maximum, no collapse, or no lambda.
    """
    times = curve.collapse_times()
    if len(times) == 0:
        raise InputError(f"{curve.name}: the curve shows no collapse", "collapse_time.no_collapse")
    origin = "given"
    if stretch is None and (plateau := curve.stretch_from_tail()) is not None:
        stretch, origin = plateau[0], "late plateau"
    if stretch is None and curve.stretch:
        stretch, origin = float(curve.stretch), "stated in the file"
    if stretch is None and guess is not None:
        stretch, origin = guess, "guessed"
    if stretch is None:
        advice = "no late plateau to read lambda = R_max/R_0 from; give it (--stretch)"
        raise InputError(f"{curve.name}: {advice}", "collapse_time.no_stretch")
    try:
        return Shots(np.array([curve.max_radius]), np.array([stretch]), times[:1] - curve.time_of_max), origin
    except InputError as error:
        raise error.within(curve.name) from None


def estimate(
    shots: Shots | RadiusCurve,
    material: str = "nhkv",
    *,
    stretch: float | None = None,
    medium: Medium = WATER,
    shear_modulus: float | None = None,
    viscosity: float | None = None,
    exact: bool = False,
) -> CollapseEstimate:
    """G and/or mu of one material from n collapse times, or from one curve: a start for a fit of R(t) in 20 ms.

    One collapse time cannot give both G and mu: without one of the two the answer is `pairs`, equally good (G, mu).
    A lambda that is neither given nor in the curve or its file is guessed as 7 (and `message` says so).

    Args:
        material: "nhkv", "nh" (mu = 0) or "newtonian" (G = 0).
        stretch: lambda of a curve, if it is known.
        shear_modulus, viscosity: Pa and Pa s where one is known; the other is then fitted alone.
        exact: with simulated collapse times, from the analytic answer on: 5 ms per shot, unknown and iteration.

    Raises:
        InputError: unknown material, a given value out of its domain, nothing to fit, a curve without a collapse.
        SolverError: a simulation of the exact fit failed.
    """
    guessed = ""
    if isinstance(shots, RadiusCurve):
        shots, origin = shot(shots, stretch, guess=USUAL_STRETCH)
        guessed = f"lambda is not known: guessed as {USUAL_STRETCH:g}" if origin == "guessed" else ""
    given = _given(material, shear_modulus, viscosity)
    problem = _CollapseProblem(shots, medium, given, np.flatnonzero(np.isnan(given)))
    why = "one collapse time is one relation between G and µ, not both: add shots of other R_max, or give one"
    if len(shots) >= len(problem.free):
        solved = problem.solve(problem.coarse(), exact=False)
        if exact:
            solved = problem.solve(solved.values, exact=True)
        if len(problem.free) == 1 or _condition(solved.jacobian) <= _SINGULAR:
            found = _answer(problem, exact, solved)
            found.message = "; ".join(filter(None, (guessed, found.message)))
            return found
        why = "the shots are too alike (R_max, lambda) to tell G from µ: one relation, not both"
    pairs = _pairs(problem, exact)
    ends = " to ".join(f"({G:.3g} Pa, {mu:.2g} Pa s)" for G, mu in (pairs[0], pairs[-1])) if pairs else "none in range"
    n = len(shots)
    return CollapseEstimate(
        pairs=pairs, message="; ".join(filter(None, (guessed, why, f"equally good: {ends}"))),
        measured=list(shots.ratio(medium)), model=[None] * n, weight=[1.0] * n,
    )  # fmt: skip


def _given(material: str, shear_modulus: float | None, viscosity: float | None) -> Floats:
    """(2,) G and mu, NaN where to be fitted."""
    if material not in MATERIALS:
        known = ", ".join(MATERIALS)
        raise InputError(f"unknown material {material!r}; collapse times know {known}", "collapse_time.material")
    if (material == "nh" and viscosity) or (material == "newtonian" and shear_modulus):
        none = "viscosity" if material == "nh" else "shear modulus"
        raise InputError(f"material {material!r} has no {none}", "collapse_time.not_of_the_material")
    values = [0.0 if material == "newtonian" else shear_modulus, 0.0 if material == "nh" else viscosity]
    for name, value, largest in zip(("the shear modulus", "the viscosity"), values, _LARGEST, strict=True):
        if value is not None and not 0 <= value <= largest:
            expected = f"{name} must lie between 0 and {largest:g} (Pa, Pa s)"
            raise InputError(f"{expected}, got {value!r}", "collapse_time.out_of_range")
    if None not in values:
        raise InputError("nothing to fit: shear modulus and viscosity are both given", "collapse_time.all_given")
    return np.array([np.nan if value is None else value for value in values])


class _CollapseFit(NamedTuple):
    values: Floats  # (2,) G, mu
    residual: Floats  # (n,)
    jacobian: Floats  # (n, p) of the residual, per unit
    bound: np.ndarray  # (p,) whether at a bound
    knee: float  # of Huber's loss, infinite where every shot counts fully


@dataclass(frozen=True, eq=False)
class _CollapseProblem:
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
        R, stretch, (G, mu) = self.shots.max_radius, self.shots.stretch, values
        f = self.ratios(values, True) ** -2.0 if exact else inverse_square(R, stretch, G, mu, self.medium)
        return np.asarray((self.shots.ratio(self.medium) ** 2 * f - 1) / 2)

    def coarse(self) -> Floats:
        """(2,) the best point of a grid, by the mean absolute residual."""
        axes = [_GRID[k] if np.isnan(self.given[k]) else self.given[k : k + 1] for k in range(2)]
        G, mu = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
        shots = self.shots
        f = inverse_square(shots.max_radius[:, None], shots.stretch[:, None], G, mu, self.medium)
        off = np.mean(np.abs(shots.ratio(self.medium)[:, None] ** 2 * f - 1), axis=0)
        return np.array([G, mu])[:, np.argmin(off)]

    def jacobian(self, x: Floats, base: Floats, exact: bool) -> Floats:
        """(n, p) by differences from the residual at x: upwards, so that zero needs no exception."""
        steps = (1.0 if exact else 1e-3) * np.maximum(_STEP * x, _LEAST_STEP[self.free])
        moved = (self.residual(self.values(x + step), exact) for step in np.diag(steps))
        return np.stack([(there - base) / step for there, step in zip(moved, steps, strict=True)], axis=1)

    def solve(self, start: Floats, exact: bool) -> _CollapseFit:
        from scipy.optimize import least_squares  # a third of a second to import

        unit, most = _UNIT[self.free], (_LARGEST / _UNIT)[self.free]
        x = np.clip(start[self.free] / unit, 0.0, most)
        # the same points are asked for again, and a simulation takes milliseconds
        fun = _remembered(lambda x: self.residual(self.values(x), exact))
        jac = _remembered(lambda x: self.jacobian(x, fun(x), exact))
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
        return _CollapseFit(self.values(done.x), fun(done.x), jac(done.x), bound, knee)


def _remembered(function: Callable[[Floats], Floats]) -> Callable[[Floats], Floats]:
    """The function with its values kept; each call gives a copy, for least_squares weights them in place."""
    known: dict[bytes, Floats] = {}

    def value(x: Floats) -> Floats:
        key = x.tobytes()
        if key not in known:
            known[key] = function(x)
        return known[key].copy()

    return value


def _condition(jacobian: Floats) -> float:
    size = np.linalg.norm(jacobian, axis=0)
    return float(np.linalg.cond(jacobian / size)) if np.all(size > 0) else np.inf


def _answer(problem: _CollapseProblem, exact: bool, solved: _CollapseFit) -> CollapseEstimate:
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
    covariance, slope = np.zeros((2, 2)), np.zeros(2)  # zero where a value is given
    covariance[np.ix_(problem.free, problem.free)] = scatter**2 * normal * np.outer(unit, unit)
    slope[problem.free] = -0.01 * unit * (normal @ J.sum(axis=0))
    quantile = float(student.ppf((1 + CONFIDENCE) / 2, n - p)) if n > p else np.nan
    full = np.linalg.pinv(J.T @ J)  # for how far one at its bound may be from it
    values, at_bound, wide = [], [], []
    for k in range(2):
        value, where = float(solved.values[k]), np.flatnonzero(problem.free == k)
        half = quantile * float(np.sqrt(covariance[k, k])) if len(where) else 0.0
        if len(where) and solved.bound[where[0]]:
            at_bound.append(NAMES[k])
            half = quantile * scatter * float(np.sqrt(full[where[0], where[0]])) * unit[where[0]]
        elif len(where) and not half < value and n > p:  # also where there is no inverse (NaN)
            wide.append(NAMES[k])
        low = max(value - half, 0.0) if np.isfinite(half) else None
        values.append(CollapseValue(value=value, low=low, high=value + half, per_percent=slope[k]))
    zero = [name for k, name in enumerate(NAMES) if name in at_bound and solved.values[k] == 0]
    upper = [name for name in at_bound if name not in zero]
    model = problem.ratios(solved.values, exact)
    said = {
        f"{' and '.join(zero)} at the bound 0: these times ask for none": bool(zero),
        f"{' and '.join(upper)} at the upper bound": bool(upper),
        f"the interval of {' and '.join(wide)} holds zero: an upper limit only": bool(wide),
        "as many shots as unknowns: no interval": n == p,
        f"the times scatter by {100 * scatter:.2g} % about the model: they do not follow it": scatter > _USUAL,
        (poor := "" if exact else _outside(problem, solved.values)): bool(poor),
        f"{np.sum(np.isinf(model))} shots have no collapse in the model": not np.all(np.isfinite(model)),
    }
    spread = float(np.sqrt(np.prod(np.diag(covariance))))
    return CollapseEstimate(
        shear_modulus_Pa=values[0],
        viscosity_Pa_s=values[1],
        correlation=covariance[0, 1] / spread if spread > 0 else None,
        scatter=scatter,
        identified=not wide and not upper,
        at_bound=at_bound,
        downweighted=[name for name, w in zip(problem.shots.names, weight, strict=True) if w < 0.5],
        pairs=_pairs(problem, False) if wide and p == 2 else [],
        message="; ".join(message for message, holds in said.items() if holds),
        measured=list(problem.shots.ratio(problem.medium)),
        model=list(model),
        weight=list(weight),
    )


def _pairs(problem: _CollapseProblem, exact: bool) -> list[tuple[float, float]]:
    """The best G for each of some viscosities, where that is as good as the best of all to the 95 % level."""
    from scipy.stats import f as fisher

    found, costs = [], []
    per_radius = problem.medium.velocity_scale / (problem.medium.pressure * float(np.median(problem.shots.max_radius)))
    for mu in _PAIRS[_PAIRS * per_radius * _LEAST_RE <= 1]:
        fixed = replace(problem, given=np.array([np.nan, mu]), free=np.array([0]))
        solved = fixed.solve(fixed.coarse(), False)
        if exact and np.mean(solved.residual**2) < _HOPELESS**2:
            solved = fixed.solve(solved.values, True)
        found.append((float(solved.values[0]), float(mu)))
        costs.append(float(np.sum(solved.residual**2)))
    n, least = len(problem.shots), min(costs)
    if least > n * _HOPELESS**2:  # no pair gives such times at all
        return []
    factor = 1 + 2 / (n - 2) * float(fisher.ppf(CONFIDENCE, 2, n - 2)) if n > 2 else 1.0
    return [pair for pair, cost in zip(found, costs, strict=True) if cost <= factor * least + n * _EQUAL**2]


def _outside(problem: _CollapseProblem, values: Floats) -> str:
    """A sentence where the analytic model is known to be poor."""
    medium, shots = problem.medium, problem.shots
    inverse_re = values[1] * medium.velocity_scale / (medium.pressure * shots.max_radius)
    viscous, small = np.sum(inverse_re > _GOOD_INVERSE_RE), np.sum(shots.stretch < _GOOD_STRETCH)
    where = [f"Re < {1 / _GOOD_INVERSE_RE:g} in {viscous}"] if viscous else []
    where += [f"lambda < {_GOOD_STRETCH:g} in {small}"] if small else []
    return f"the analytic model is poor here ({'; '.join(where)} of {len(shots)} shots): use exact" if where else ""
