"""G and mu from the collapse times of bubbles in one material, each with its R_max and lambda.

The residual of a shot is r = [(t_1/t_RC)^2 (t_RC/t_model)^2 - 1]/2, which is ln(t_1/t_model) near a fit and stays
finite where the model has no collapse (Zhu et al. 2025, doi:10.1039/D5SM00397K, minimise the same). Huber's loss, with
its knee at two standard deviations of the residuals (from their median absolute value), limits the effect of a few
wrong t_1. The residuals are nearly linear in G and mu: the intervals are Student's, from the derivatives at the answer,
cut at the ends of the ranges.

`exact` fits the analytic model to times that are divided by the ratio of simulated to analytic ones at the answer,
until this ratio stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field
from scipy.optimize import least_squares
from scipy.special import stdtrit

from cavirheo.arrays import Floats
from cavirheo.curve import as_numbers
from cavirheo.errors import InputError, SolverError, require
from cavirheo.parameters import DURATION, MOST_WIDTH, RADIUS, Bound
from cavirheo.physics.collapse import analytic_time, inverse_square, rayleigh_time, simulated_time
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.media import medium as medium_of
from cavirheo.writing.document import Finite, Quantity, Record

MATERIALS = ("nhkv", "nh", "newtonian")  # neo-Hookean Kelvin-Voigt, neo-Hookean (mu = 0), Newtonian (G = 0)
LARGEST = np.array([1e6, 10.0])  # G in Pa, mu in Pa s
_UNITS = np.array([1e4, 0.1])  # of G and mu in the fit, which begins there
_ROUNDS, _KNEE = 5, 2.0  # of Huber's loss, and its knee in standard deviations
_ROUNDING = 1e-5  # relative scatter or change of t_1: a smaller one is that of rounding
_EQUAL_TIME = 5e-4  # relative difference of t_1 within which values are equally good if the shots show no scatter
_MAX_SCATTER = 0.03  # largest usual scatter of t_1: gels have 1.2 %
_EXACT_ROUNDS = 30  # of simulations
_GOOD_RE, _GOOD_STRETCH = 10.0, 4.0  # above: the analytic model is within 1.5 % of t_1 (docs/how-to/collapse-time.md)


class CollapseEstimate(Record):
    """The estimate of G and mu from n collapse times.

    Attributes:
        shear_modulus_Pa: shear modulus G, Pa.
        viscosity_Pa_s: viscosity mu, Pa s.
        modulus_per_percent_Pa: change of G if all t_1 were 1 % longer, Pa; null where G is bounded only.
        scatter: standard deviation of ln(t_1/t_model); null unless there are more shots than fitted parameters.
        message: what is wrong, and other remarks.
        model: t_1/t_RC of the model for each shot; not written.
    """

    shear_modulus_Pa: Quantity = Quantity()
    viscosity_Pa_s: Quantity = Quantity()
    modulus_per_percent_Pa: Finite = None
    scatter: Finite = None
    message: str = ""
    model: list[Finite] = Field(default=[], exclude=True)

    @property
    def complete(self) -> bool:
        """Whether G and mu both have a value, and those that were fitted an interval."""
        values = self.shear_modulus_Pa.median, self.viscosity_Pa_s.median, self.scatter
        return all(value is not None for value in values)


def unusable(max_radius: float, stretch: float, time: float) -> str:
    """The reason why a shot with these values cannot be used; empty if it can."""
    try:
        RADIUS.check("R_max", max_radius, "collapse_time.shot")
        DURATION.check("t_1", time, "collapse_time.shot")
    except InputError as error:
        return error.message
    if not 1 < stretch < np.inf:
        return f"lambda = R_max/R_0 must be finite and above 1, got {stretch:.4g}"
    ratio = time / float(rayleigh_time(max_radius))
    if not 0.1 < ratio < 10:
        return f"t_1 = {time * 1e6:.4g} us is {ratio:.2g} Rayleigh times of R_max = {max_radius * 1e6:.4g} um (units?)"
    return ""


def estimate(
    max_radius: ArrayLike,
    stretch: ArrayLike,
    time: ArrayLike,
    material: str = "nhkv",
    *,
    medium: Medium | str = WATER,
    shear_modulus: float | None = None,
    viscosity: float | None = None,
    exact: bool = False,
) -> CollapseEstimate:
    """G and/or mu of one material from n collapse times, in 0.1 s.

    One collapse time cannot give both G and mu: unless one of the two is given, the answer is a message that says so.

    Args:
        max_radius: (n,) m.
        stretch: (n,) R_max/R_0.
        time: (n,) s from R_max to the first minimum of the radius.
        material: "nhkv", "nh" (mu = 0) or "newtonian" (G = 0).
        shear_modulus: Pa, if it is known; viscosity is then fitted alone.
        viscosity: Pa s, if it is known; shear_modulus is then fitted alone.
        exact: use simulated collapse times, starting from the analytic answer: 5 ms per shot and round.

    Raises:
        InputError: arrays of different lengths, a value outside its domain (with the number of the shot, from 1), an
            unknown material, or nothing to fit.
        SolverError: a simulation of the exact fit failed, or shows no collapse.
    """
    sizes = [np.size(values) for values in (max_radius, stretch, time)]
    lengths = f"R_max, lambda and t_1 must have one length, got {sizes}"
    require(len({*sizes}) == 1 and sizes[0] > 0, lengths, "collapse_time.lengths")
    arrays = zip(("max_radius", "stretch", "time"), (max_radius, stretch, time), strict=True)
    shots = np.array([as_numbers(name, values).ravel() for name, values in arrays])
    for number, values in enumerate(shots.T.tolist(), 1):
        trouble = unusable(*values)
        require(not trouble, f"shot {number}: {trouble}", "collapse_time.shot")
    unknown = f"unknown material {material!r}; collapse times know {', '.join(MATERIALS)}"
    require(material in MATERIALS, unknown, "collapse_time.material")
    given = {"shear modulus": shear_modulus, "viscosity": viscosity}
    if none := {"newtonian": "shear modulus", "nh": "viscosity"}.get(material):
        require(not given[none], f"material {material!r} has no {none}", "collapse_time.not_of_the_material")
        given[none] = 0.0
    for (name, value), most in zip(given.items(), LARGEST, strict=True):
        if value is not None and not 0 <= value <= most:
            unit = "Pa" if name == "shear modulus" else "Pa s"
            message = f"the {name} must lie between 0 and {most:g} {unit}, got {value!r}"
            raise InputError(message, "collapse_time.out_of_range")
    both = "nothing to fit: shear modulus and viscosity are both given"
    require(None in given.values(), both, "collapse_time.all_given")
    fixed = np.array([np.nan if value is None else value for value in given.values()])
    problem = _Problem(shots[0], shots[1], shots[2], medium_of(medium), fixed, np.ones(sizes[0]))
    return _answer(_corrected(problem), []) if exact else _answer(problem, _poor(problem))


class _Best(NamedTuple):
    """values: (2,) G and mu. residual: (n,). slopes: (n, fitted) of the residuals; 0 beyond the knee."""

    values: Floats
    residual: Floats
    slopes: Floats
    knee: float


@dataclass(frozen=True, eq=False)
class _Problem:
    """n shots. fixed: (2,) G and mu that are given; NaN where it is fitted. correction: (n,) of the times of the
    analytic model."""

    max_radius: Floats
    stretch: Floats
    measured: Floats
    medium: Medium
    fixed: Floats
    correction: Floats

    def time(self, values: Floats) -> Floats:
        """(n,) t_1 at G and mu, s; infinite without a collapse."""
        return self.correction * analytic_time(self.max_radius, self.stretch, values[0], values[1], self.medium)

    @cached_property
    def best(self) -> _Best:
        """Where Huber's loss is least; of few shots the sum of squares: they do not show which one is wrong."""
        values, free = self.fixed.copy(), np.isnan(self.fixed)
        unit = _UNITS[free]
        ratio = self.measured / self.correction / rayleigh_time(self.max_radius, self.medium)

        def residuals(x: Floats) -> Floats:
            values[free] = x * unit
            inverse = inverse_square(self.max_radius, self.stretch, values[0], values[1], self.medium)
            return np.asarray((ratio**2 * inverse - 1) / 2)

        options: dict[str, Any] = {"bounds": (np.zeros(len(unit)), LARGEST[free] / unit)}
        options |= dict.fromkeys(("ftol", "xtol", "gtol"), 1e-12)
        found, knee = least_squares(residuals, np.ones(len(unit)), **options), np.inf
        for _ in range(_ROUNDS if len(ratio) > len(unit) + 2 else 0):
            knee = _KNEE * max(1.4826 * float(np.median(np.abs(found.fun))), _ROUNDING)
            found = least_squares(residuals, found.x, loss="huber", f_scale=knee, **options)
        return _Best(values, residuals(found.x), found.jac / unit, knee)


def _corrected(problem: _Problem) -> _Problem:
    """With the ratio of simulated to analytic times at the answer to which it leads. Raises SolverError."""
    for _ in range(_EXACT_ROUNDS):
        G, mu = values = problem.best.values
        simulated = simulated_time(problem.max_radius, problem.stretch, G, mu, problem.medium)
        correction = simulated / problem.time(values) * problem.correction
        if not np.all(np.isfinite(correction) & (correction > 0)):
            raise SolverError(f"a bubble in {G:.3g} Pa and {mu:.2g} Pa s has no collapse")
        change = np.max(np.abs(correction / problem.correction - 1))
        problem = replace(problem, correction=correction)
        if change < _ROUNDING:
            return problem
    raise SolverError(f"after {_EXACT_ROUNDS} rounds the times still change by {change:.1g}")


def _answer(problem: _Problem, messages: list[str]) -> CollapseEstimate:
    """The estimate of a problem, with these and further messages."""
    values, residual, slopes, knee = problem.best
    n, fitted = slopes.shape
    scatter, reach, free = None, _EQUAL_TIME, n - fitted
    if free > 0:
        inside = np.mean(np.abs(residual) <= knee)
        size = float(np.sqrt(np.sum(np.minimum(np.abs(residual), knee) ** 2) / free))
        scatter = size / float(inside)
        reach = float(stdtrit(free, 0.95)) * max(size / float(np.sqrt(inside)), _ROUNDING)
    estimated = np.isnan(problem.fixed)
    # nothing is known beyond the ranges
    covariance = np.linalg.inv(slopes.T @ slopes / reach**2 + np.diag(LARGEST[estimated] ** -2))
    half = np.zeros(2)
    half[estimated] = np.sqrt(np.diag(covariance))
    ends = np.clip([values - half, values + half], 0.0, LARGEST)
    G, mu = (_quantity(values[i], ends[:, i], LARGEST[i], estimated[i]) for i in (0, 1))
    if free <= 0:  # no intervals; G trades with mu: what is fitted is known together or not at all
        known = (None not in (G.median, mu.median)) | ~estimated
        open_ = Quantity(bound="undetermined")
        G, mu = (Quantity(median=values[i]) if known[i] else open_ for i in (0, 1))
    model = problem.time(values) / rayleigh_time(problem.max_radius, problem.medium)
    found = CollapseEstimate(shear_modulus_Pa=G, viscosity_Pa_s=mu, scatter=scatter, model=list(model))
    if estimated[0] and G.median is not None:
        found.modulus_per_percent_Pa = float(np.linalg.lstsq(slopes, np.full(n, -0.01))[0][0])
    if G.median is None and mu.median is None:
        why = "one collapse time is one relation between G and µ: add shots of other R_max, or give --viscosity"
        messages.append(why if n == 1 else "the shots are too alike (R_max, lambda) to tell G from µ: give --viscosity")
    elif None in (G.median, mu.median):
        name, one = ("G", G) if G.median is None else ("µ", mu)
        what = "nothing is" if one.bound == "undetermined" else "only bounds are"
        messages.append(f"of {name} {what} known: add shots of other R_max")
    if free == 0:
        messages.append("as many shots as unknowns: no interval")
    if scatter is not None and scatter > _MAX_SCATTER:
        messages.append(f"the times scatter by {100 * scatter:.2g} % about the model: they do not follow it")
    if np.isinf(model).any():
        messages.append(f"{np.sum(np.isinf(model))} shots have no collapse in the model")
    found.message = "; ".join(messages)
    return found


def _quantity(value: float, ends: Floats, most: float, fitted: bool) -> Quantity:
    """A value with its interval, which is a bound where its ends are far apart or at the end of the range."""
    if not fitted:
        return Quantity(median=value)
    low, high = ends.tolist()
    bound: Bound | None = None
    if high > MOST_WIDTH * low:
        bound = "wide" if low > 0.0 else "upper"
    if high >= most:
        bound = "undetermined" if bound else "lower"
    return Quantity(median=value, q05=low, q95=high, bound=bound)


def _poor(problem: _Problem) -> list[str]:
    """A message if the analytic model is known to be inaccurate for these shots."""
    inverse_re = problem.best.values[1] * problem.medium.velocity_scale / (problem.medium.pressure * problem.max_radius)
    count = np.count_nonzero((inverse_re > 1 / _GOOD_RE) | (problem.stretch < _GOOD_STRETCH))
    where = f"Re < {_GOOD_RE:g} or lambda < {_GOOD_STRETCH:g}, {count} of {len(problem.measured)} shots"
    return [f"the analytic model is poor here ({where}): use exact"] if count else []
