"""G and mu from the collapse times of bubbles in one material, each with its R_max and lambda.

The residual of a shot is r = [(t_1/t_RC)^2 (t_RC/t_model)^2 - 1]/2, which is ln(t_1/t_model) near a fit and stays
finite where the model has no collapse (Zhu et al. 2025, doi:10.1039/D5SM00397K, minimise the same). Huber's loss, with
its knee at two standard deviations of the residuals (from their median absolute value), limits the effect of a few
wrong t_1. `exact` replaces the analytic model by simulations and starts from its answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from cavirheo.arrays import Bools, Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.physics.collapse import analytic_time, inverse_square, rayleigh_time, simulated_time
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.media import medium as medium_of
from cavirheo.writing.document import Finite, Record

MATERIALS = ("nhkv", "nh", "newtonian")  # neo-Hookean Kelvin-Voigt, neo-Hookean (mu = 0), Newtonian (G = 0)
NAMES = ("G", "µ")
CONFIDENCE = 0.95

_UNIT = np.array([1e4, 0.1])  # Pa and Pa s: units of the solver's variables
_UPPER_BOUNDS = np.array([1e6, 10.0])  # upper bounds in Pa and Pa s; the lower ones are zero
_GRID = (np.append(0.0, np.geomspace(1e2, 1e6, 33)), np.append(0.0, np.geomspace(1e-4, 10.0, 41)))
_PAIRS = np.append(0.0, np.geomspace(1e-3, 1.0, 19))  # viscosities for which equally good pairs are sought, Pa s
_STEP, _LEAST_STEP = 0.02, 0.005  # steps of derivatives by simulation: relative, and the least one in units
_KNEE = 2.0  # knee of Huber's loss, standard deviations
_FLOOR = 1e-5  # relative scatter of t_1: a smaller one is that of rounding
_SINGULAR = 1e3  # condition number of the normalised Jacobian beyond which G and mu are one unknown
_MAX_SCATTER = 0.03  # largest usual scatter of t_1: gels have 1.2 %
_EQUAL_TIME = 1e-3  # relative difference of t_1 within which pairs are equally good
_LEAST_RE = 3.0  # least Reynolds number of pairs: below it hardly any bubble collapses (docs/how-to/collapse-time.md)
_MAX_MISFIT = 0.1  # relative misfit of t_1 above which a pair is no answer
_GOOD_RE, _GOOD_STRETCH = 10.0, 4.0  # above: the analytic model is within 1.5 % of t_1 (docs/how-to/collapse-time.md)


class CollapseValue(Record):
    """A parameter from collapse times, SI (Pa or Pa s); null where it is not known.

    Attributes:
        value: best value.
        low: lower end of the 95 % interval, from the scatter of the shots.
        high: upper end of the 95 % interval.
        per_percent: change of the value if all t_1 were 1 % longer.
    """

    value: Finite = None
    low: Finite = None
    high: Finite = None
    per_percent: Finite = None


class CollapseEstimate(Record):
    """The estimate of G and mu from n collapse times; null where a number is not known.

    An estimate that is not `identified` has the values of the best fit if there is a single one, else null.

    Attributes:
        shear_modulus_Pa: shear modulus G, Pa.
        viscosity_Pa_s: viscosity mu, Pa s.
        correlation: correlation coefficient of the errors of G and mu.
        scatter: standard deviation of ln(t_1/t_model); null unless there are more shots than fitted parameters.
        identified: whether the shots determine all fitted parameters.
        at_bound: names of parameters at a bound of their range.
        downweighted: names of shots with a weight below 0.5.
        pairs: equally good pairs (G in Pa, mu in Pa s), if the shots do not identify both.
        message: what is wrong, and other remarks.
        measured: measured t_1/t_RC of each shot; not written.
        model: t_1/t_RC of the model for each shot; not written.
        weight: weight of each shot, at most 1; not written.
    """

    shear_modulus_Pa: CollapseValue = CollapseValue()
    viscosity_Pa_s: CollapseValue = CollapseValue()
    correlation: Finite = None
    scatter: Finite = None
    identified: bool = False
    at_bound: list[str] = []
    downweighted: list[str] = []
    pairs: list[tuple[float, float]] = []
    message: str = ""
    measured: list[Finite] = Field(default=[], exclude=True)
    model: list[Finite] = Field(default=[], exclude=True)
    weight: list[float] = Field(default=[], exclude=True)

    @property
    def complete(self) -> bool:
        """Whether G and mu both have a value."""
        return self.shear_modulus_Pa.value is not None and self.viscosity_Pa_s.value is not None


@dataclass(eq=False)
class Shots:
    """n bubbles in one material.

    Attributes:
        max_radius: (n,) m.
        stretch: (n,) R_max/R_0.
        time: (n,) s from R_max to the first minimum.
        names: of the shots in messages; "1", "2", ... if none are given.

    Raises:
        InputError: arrays that are not (n,) of one length, or a value outside its domain (the message names the shot).
    """

    max_radius: Floats
    stretch: Floats
    time: Floats
    names: Sequence[str] = ()

    def __post_init__(self) -> None:
        arrays = [np.array(a, dtype=float, ndmin=1) for a in (self.max_radius, self.stretch, self.time)]
        shapes, n = [a.shape for a in arrays], arrays[0].size
        lengths = f"R_max, lambda and t_1 must be (n,) of one length, got {shapes}"
        require(shapes == [(n,)] * 3 and n > 0, lengths, "collapse_time.lengths")
        self.max_radius, self.stretch, self.time = arrays
        self.names = self.names or [str(k + 1) for k in range(n)]
        for k, values in enumerate(np.transpose(arrays).tolist(), 1):
            trouble = unusable(*values)
            require(not trouble, f"shot {k}: {trouble}", "collapse_time.shot")

    def __len__(self) -> int:
        return len(self.time)

    def ratio(self, medium: Medium) -> Floats:
        """(n,) t_1/t_RC."""
        return self.time / rayleigh_time(self.max_radius, medium)


def unusable(max_radius: float, stretch: float, time: float) -> str:
    """The reason why a shot with these values cannot be used; empty if it can."""
    for name, value, least in (("R_max", max_radius, 0.0), ("t_1", time, 0.0), ("lambda = R_max/R_0", stretch, 1.0)):
        if not least < value < np.inf:
            return f"{name} must be finite and above {least:g}, got {value:.4g}"
    ratio = time / float(rayleigh_time(max_radius))
    if not 0.1 < ratio < 10:
        return f"t_1 = {time * 1e6:.4g} us is {ratio:.2g} Rayleigh times of R_max = {max_radius * 1e6:.4g} um (units?)"
    return ""


def shot(curve: RadiusCurve, stretch: float | None = None) -> tuple[Shots, str]:
    """The curve's R_max, lambda and t_1, and the source of lambda: the one given, else R_max over the late plateau,
    else the value in the file. Raises InputError: no maximum, no collapse, or no lambda."""
    times, name = curve.collapse_times(), curve.name
    require(len(times) > 0, "the curve shows no collapse", "collapse_time.no_collapse", name)
    plateau = curve.stretch_from_tail() if stretch is None else None
    sources: dict[str, float | None] = {
        "given": stretch,
        "late plateau": plateau and plateau[0],
        "stated in the file": float(curve.stretch) if curve.stretch else None,
    }
    origin = next((source for source, value in sources.items() if value is not None), "")
    advice = "no late plateau to read lambda = R_max/R_0 from; give it (--stretch)"
    require(origin != "", advice, "collapse_time.no_stretch", name)
    try:
        values = np.array([curve.max_radius]), np.array([sources[origin]], dtype=float)
        return Shots(*values, times[:1] - curve.time_of_max), origin
    except InputError as error:
        raise error.within(name) from None


def estimate(
    shots: Shots,
    material: str = "nhkv",
    *,
    medium: Medium | str = WATER,
    shear_modulus: float | None = None,
    viscosity: float | None = None,
    exact: bool = False,
) -> CollapseEstimate:
    """G and/or mu of one material from n collapse times, in 20 ms.

    One collapse time cannot give both G and mu: unless one of the two is given, the answer is `pairs`, equally good (G,
    mu).

    Args:
        shots: the bubbles; `shot` reads one off a curve.
        material: "nhkv", "nh" (mu = 0) or "newtonian" (G = 0).
        shear_modulus: Pa, if it is known; viscosity is then fitted alone.
        viscosity: Pa s, if it is known; shear_modulus is then fitted alone.
        exact: use simulated collapse times, starting from the analytic answer: 5 ms per shot, unknown and iteration.

    Raises:
        InputError: unknown material, a given value outside its domain, nothing to fit.
        SolverError: a simulation of the exact fit failed.
    """
    medium = medium_of(medium)
    problem = _CollapseProblem(shots, medium, _fixed(material, shear_modulus, viscosity), False)
    why = "one collapse time is one relation between G and µ, not both: add shots of other R_max, or give one"
    answer = None
    if len(shots) >= len(problem.free):
        solved = problem.solve(problem.grid_minimum())
        if exact:
            problem = replace(problem, exact=True)
            solved = problem.solve(solved.values)
        if len(problem.free) == 1 or _condition(solved.jacobian) <= _SINGULAR:
            answer = _answer(problem, solved)
        why = "the shots are too alike (R_max, lambda) to tell G from µ: one relation, not both"
    if answer is None:
        pairs = _pairs(problem, exact)
        ends = " to ".join(f"({G:.3g} Pa, {mu:.2g} Pa s)" for G, mu in (pairs[0], pairs[-1])) if pairs else ""
        answer = CollapseEstimate(pairs=pairs, message=f"{why}; equally good: {ends or 'none in range'}")
        answer.model, answer.weight = [None] * len(shots), [1.0] * len(shots)
    answer.measured = shots.ratio(medium).tolist()
    return answer


def _fixed(material: str, shear_modulus: float | None, viscosity: float | None) -> Floats:
    """(2,) G and mu; NaN for a value that is fitted."""
    unknown = f"unknown material {material!r}; collapse times know {', '.join(MATERIALS)}"
    require(material in MATERIALS, unknown, "collapse_time.material")
    values = {"shear modulus": shear_modulus, "viscosity": viscosity}
    if none := {"newtonian": "shear modulus", "nh": "viscosity"}.get(material):
        require(not values[none], f"material {material!r} has no {none}", "collapse_time.not_of_the_material")
        values[none] = 0.0
    for (name, value), most in zip(values.items(), _UPPER_BOUNDS, strict=True):
        expected = f"the {name} must lie between 0 and {most:g} (Pa, Pa s)"
        require(value is None or 0 <= value <= most, f"{expected}, got {value!r}", "collapse_time.out_of_range")
    both = "nothing to fit: shear modulus and viscosity are both given"
    require(None in values.values(), both, "collapse_time.all_given")
    return np.array([*values.values()], dtype=float)


class _CollapseFit(NamedTuple):
    values: Floats  # (2,) G, mu
    residual: Floats  # (n,)
    jacobian: Floats  # (n, p) of the residual, per unit
    bound: Bools  # (p,) whether at a bound
    knee: float  # of Huber's loss, infinite where every shot counts fully


@dataclass(frozen=True, eq=False)
class _CollapseProblem:
    shots: Shots
    medium: Medium
    fixed: Floats  # (2,) G and mu; NaN for a value that is fitted
    exact: bool  # whether t_model is simulated

    @property
    def free(self) -> np.ndarray:
        """(p,) which of G and mu are fitted."""
        return np.flatnonzero(np.isnan(self.fixed))

    def values(self, x: Floats) -> Floats:
        values = self.fixed.copy()
        values[self.free] = x * _UNIT[self.free]
        return values

    def ratios(self, values: Floats) -> Floats:
        """(n,) t_model/t_RC, infinite where the model has no collapse."""
        R, stretch, (G, mu) = self.shots.max_radius, self.shots.stretch, values
        time = simulated_time if self.exact else analytic_time
        return time(R, stretch, G, mu, self.medium) / rayleigh_time(R, self.medium)

    def residual(self, x: Floats) -> Floats:
        G, mu = values = self.values(x)
        R, stretch, medium = self.shots.max_radius, self.shots.stretch, self.medium
        f = self.ratios(values) ** -2.0 if self.exact else inverse_square(R, stretch, G, mu, medium)
        return np.asarray((self.shots.ratio(medium) ** 2 * f - 1) / 2)

    def grid_minimum(self) -> Floats:
        """(2,) the best point of a grid, by the mean absolute residual of the analytic model."""
        axes = [_GRID[k] if np.isnan(self.fixed[k]) else self.fixed[k : k + 1] for k in range(2)]
        G, mu = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
        shots = self.shots
        f = inverse_square(shots.max_radius[:, None], shots.stretch[:, None], G, mu, self.medium)
        off = np.mean(np.abs(shots.ratio(self.medium)[:, None] ** 2 * f - 1), axis=0)
        return np.array([G, mu])[:, np.argmin(off)]

    def jacobian(self, x: Floats, base: Floats) -> Floats:
        """Derivatives (n, p) of the residual by forward differences from x, which also work at zero."""
        steps = (1.0 if self.exact else 1e-3) * np.maximum(_STEP * x, _LEAST_STEP)
        moved = [(self.residual(x + step) - base) / size for step, size in zip(np.diag(steps), steps, strict=True)]
        return np.stack(moved, axis=1)

    def solve(self, start: Floats) -> _CollapseFit:
        """The least-squares fit of the free ones of G and mu, from a start (2,)."""
        from scipy.optimize import least_squares  # a third of a second to import

        most = (_UPPER_BOUNDS / _UNIT)[self.free]
        # the solver asks for the same points again, and a simulation takes milliseconds
        fun = _cached(self.residual)
        jac = _cached(lambda x: self.jacobian(x, fun(x)))
        options: dict[str, Any] = {"method": "dogbox", "bounds": (0.0, most), "max_nfev": 30 if self.exact else 200}
        options |= {"xtol": 1e-5 if self.exact else 1e-9, "ftol": 1e-7 if self.exact else 1e-12, "gtol": 1e-12}
        knee = np.inf
        fit = least_squares(fun, np.clip((start / _UNIT)[self.free], 0.0, most), jac, **options)
        if len(self.shots) > len(self.free) + 2:  # fewer shots do not show which one is wrong
            for _ in range(1 if self.exact else 4):
                knee = _KNEE * max(float(1.4826 * np.median(np.abs(fit.fun))), _FLOOR)
                fit = least_squares(fun, fit.x, jac, loss="huber", f_scale=knee, **options)
        # the Jacobian is computed again, because the solver's includes the weights of the loss
        bound = (fit.x <= 1e-9) | (fit.x >= most * (1 - 1e-9))
        return _CollapseFit(self.values(fit.x), fun(fit.x), jac(fit.x), bound, knee)


def _cached(function: Callable[[Floats], Floats]) -> Callable[[Floats], Floats]:
    """The function with a cache of its values. Each call copies, because least_squares weights them in place."""
    cached = cache(lambda key: function(np.frombuffer(key)))
    return lambda x: cached(x.tobytes()).copy()


def _condition(jacobian: Floats) -> float:
    size = np.linalg.norm(jacobian, axis=0)
    return float(np.linalg.cond(jacobian / size)) if np.all(size > 0) else np.inf


def _answer(problem: _CollapseProblem, solved: _CollapseFit) -> CollapseEstimate:
    from scipy.stats import t as student

    free, shots = problem.free, problem.shots
    n, p = len(shots), len(free)
    r, J, unit = solved.residual, solved.jacobian, _UNIT[free]
    inside = np.abs(r) <= solved.knee
    weight = np.where(inside, 1.0, solved.knee / np.maximum(np.abs(r), _FLOOR))
    scatter = float(np.sqrt(np.sum((weight * r) ** 2) / (n - p)) / np.mean(inside)) if n > p else np.nan
    inner = ~solved.bound  # a parameter at its bound does not vary
    normal = np.full((p, p), np.nan)
    if inner.any() and _condition(J[:, inner]) < np.inf:
        normal[:] = 0.0
        normal[np.ix_(inner, inner)] = np.linalg.inv(J[:, inner].T @ J[:, inner])
    covariance, slope = np.zeros((2, 2)), np.zeros(2)  # zero where a value is given
    covariance[np.ix_(free, free)] = scatter**2 * normal * np.outer(unit, unit)
    slope[free] = -0.01 * unit * (normal @ J.sum(axis=0))
    quantile = float(student.ppf((1 + CONFIDENCE) / 2, n - p)) if n > p else np.nan
    full = np.linalg.pinv(J.T @ J)  # for the possible distance of a parameter at its bound from the bound
    bound, half = solved.bound, np.zeros(2)
    at_its_bound = quantile * scatter * np.sqrt(np.diag(full)) * unit
    half[free] = np.where(bound, at_its_bound, quantile * np.sqrt(np.diag(covariance)[free]))
    at_bound = [NAMES[k] for k in free[bound]]
    # half is NaN if there is no inverse, which counts as wide
    wide = [NAMES[k] for k in free[~bound] if n > p and not half[k] < solved.values[k]]
    G, mu = (
        CollapseValue(value=value, low=max(value - away, 0.0), high=value + away, per_percent=change)
        for value, away, change in zip(solved.values, half, slope, strict=True)
    )
    zero = [name for name, value in zip(NAMES, solved.values, strict=True) if name in at_bound and value == 0]
    upper = [name for name in at_bound if name not in zero]
    model = problem.ratios(solved.values)
    messages: list[Any] = [
        zero and f"{' and '.join(zero)} at the bound 0: these times ask for none",
        upper and f"{' and '.join(upper)} at the upper bound",
        wide and f"the interval of {' and '.join(wide)} holds zero: an upper limit only",
        n == p and "as many shots as unknowns: no interval",
        scatter > _MAX_SCATTER and f"the times scatter by {100 * scatter:.2g} % about the model: they do not follow it",
        not problem.exact and _model_warning(problem, solved.values),
        np.isinf(model).any() and f"{np.sum(np.isinf(model))} shots have no collapse in the model",
    ]
    spread = float(np.sqrt(np.prod(np.diag(covariance))))
    return CollapseEstimate(
        shear_modulus_Pa=G,
        viscosity_Pa_s=mu,
        correlation=covariance[0, 1] / spread if spread > 0 else None,
        scatter=scatter,
        identified=not wide and not upper,
        at_bound=at_bound,
        downweighted=[name for name, w in zip(shots.names, weight, strict=True) if w < 0.5],
        pairs=_pairs(problem) if wide and p == 2 else [],
        message="; ".join(filter(None, messages)),
        model=list(model),
        weight=list(weight),
    )


def _pairs(problem: _CollapseProblem, exact: bool = False) -> list[tuple[float, float]]:
    """Pairs with the best G for each of some viscosities, if they fit as well as the best pair (95 %)."""
    from scipy.stats import f as fisher

    pairs, costs = [], []
    n, medium = len(problem.shots), problem.medium
    per_radius = medium.velocity_scale / (medium.pressure * float(np.median(problem.shots.max_radius)))
    for mu in _PAIRS[_PAIRS * per_radius * _LEAST_RE <= 1]:
        subproblem = replace(problem, fixed=np.array([np.nan, mu]), exact=False)
        solved = subproblem.solve(subproblem.grid_minimum())
        if exact and np.mean(solved.residual**2) < _MAX_MISFIT**2:
            solved = replace(subproblem, exact=True).solve(solved.values)
        pairs.append((float(solved.values[0]), float(mu)))
        costs.append(float(np.sum(solved.residual**2)))
    if min(costs) > n * _MAX_MISFIT**2:  # no pair gives such times at all
        return []
    factor = 1 + 2 / (n - 2) * float(fisher.ppf(CONFIDENCE, 2, n - 2)) if n > 2 else 1.0
    return [pair for pair, cost in zip(pairs, costs, strict=True) if cost <= factor * min(costs) + n * _EQUAL_TIME**2]


def _model_warning(problem: _CollapseProblem, values: Floats) -> str:
    """A sentence if the analytic model is known to be inaccurate for these shots; else empty."""
    medium, shots = problem.medium, problem.shots
    inverse_re = values[1] * medium.velocity_scale / (medium.pressure * shots.max_radius)
    poor = {
        f"Re < {_GOOD_RE:g}": np.sum(inverse_re > 1 / _GOOD_RE),
        f"lambda < {_GOOD_STRETCH:g}": np.sum(shots.stretch < _GOOD_STRETCH),
    }
    where = "; ".join(f"{what} in {count}" for what, count in poor.items() if count)
    return f"the analytic model is poor here ({where} of {len(shots)} shots): use exact" if where else ""
