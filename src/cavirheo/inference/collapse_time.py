"""G and mu from the collapse times of bubbles in one material, each with its R_max and lambda.

The residual of a shot is r = [(t_1/t_RC)^2 (t_RC/t_model)^2 - 1]/2, which is ln(t_1/t_model) near a fit and stays
finite where the model has no collapse (Zhu et al. 2025, doi:10.1039/D5SM00397K, minimise the same). For each mu there
is one best G, so the sum of squares is a function of mu alone: its minimum is the answer, and the mu and G at which it
stays below Student's limit are their intervals. Huber's weights, with their knee at two standard deviations of the
residuals (from their median absolute value), limit the effect of a few wrong t_1.

`exact` fits the analytic model to times that are divided by the ratio of simulated to analytic ones at the answer,
until this ratio stays as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field
from scipy.optimize import brentq
from scipy.special import stdtrit

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError, require
from cavirheo.parameters import Bound
from cavirheo.physics.collapse import analytic_time, inverse_square, rayleigh_time, simulated_time
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.media import medium as medium_of
from cavirheo.writing.document import Finite, Quantity, Record

MATERIALS = ("nhkv", "nh", "newtonian")  # neo-Hookean Kelvin-Voigt, neo-Hookean (mu = 0), Newtonian (G = 0)
LARGEST_MODULUS, LARGEST_VISCOSITY = 1e6, 10.0  # Pa, Pa s
_FIRST_GRID = np.append(0.0, np.geomspace(1e-4, LARGEST_VISCOSITY, 60))  # of the search of mu, Pa s
_ZOOMS, _ZOOMED = 9, 17  # of the search of mu, and points of each
_NEWTON_STEPS, _DIFFERENCE = 8, 10.0  # of the best G; Pa
_ROUNDS, _KNEE = 8, 2.0  # of Huber's weights, and their knee in standard deviations
_FLOOR = 1e-5  # relative scatter of t_1: a smaller one is that of rounding
_EQUAL_TIME = 5e-4  # relative difference of t_1 within which values are equally good if the shots show no scatter
_MAX_SCATTER = 0.03  # largest usual scatter of t_1: gels have 1.2 %
_WIDE = 10.0  # ratio of the ends of an interval from which on it is a bound
_LINE, _PAIRS = 201, 9  # viscosities within an interval: for the ends of G, and in a list of equally good pairs
_EXACT_ROUNDS, _SAME = 30, 1e-5  # of simulations, and the relative change of their times at which they end
_GOOD_RE, _GOOD_STRETCH = 10.0, 4.0  # above: the analytic model is within 1.5 % of t_1 (docs/how-to/collapse-time.md)


class CollapseEstimate(Record):
    """The estimate of G and mu from n collapse times.

    Attributes:
        shear_modulus_Pa: shear modulus G, Pa.
        viscosity_Pa_s: viscosity mu, Pa s.
        modulus_per_percent_Pa: change of G if all t_1 were 1 % longer, Pa; null where G is bounded only.
        scatter: standard deviation of ln(t_1/t_model); null unless there are more shots than fitted parameters.
        downweighted: names of shots with a weight below 0.5.
        pairs: equally good pairs (G in Pa, mu in Pa s), where neither has a value.
        message: what is wrong, and other remarks.
        model: t_1/t_RC of the model for each shot; not written.
    """

    shear_modulus_Pa: Quantity = Quantity()
    viscosity_Pa_s: Quantity = Quantity()
    modulus_per_percent_Pa: Finite = None
    scatter: Finite = None
    downweighted: list[str] = []
    pairs: list[tuple[float, float]] = []
    message: str = ""
    model: list[Finite] = Field(default=[], exclude=True)

    @property
    def complete(self) -> bool:
        """Whether G and mu both have a value."""
        return self.shear_modulus_Pa.median is not None and self.viscosity_Pa_s.median is not None


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
    if stretch is not None:
        origin = "given"
    elif plateau := curve.stretch_from_tail():
        origin, stretch = "late plateau", plateau[0]
    elif curve.stretch:
        origin, stretch = "stated in the file", float(curve.stretch)
    else:
        advice = "no late plateau to read lambda = R_max/R_0 from; give it (--stretch)"
        raise InputError(advice, "collapse_time.no_stretch", name)
    try:
        return Shots(np.array([curve.max_radius]), np.array([stretch]), times[:1] - curve.time_of_max), origin
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
    """G and/or mu of one material from n collapse times, in 0.1 s.

    One collapse time cannot give both G and mu: unless one of the two is given, the answer is `pairs`, equally good (G,
    mu).

    Args:
        shots: the bubbles; `shot` reads one off a curve.
        material: "nhkv", "nh" (mu = 0) or "newtonian" (G = 0).
        shear_modulus: Pa, if it is known; viscosity is then fitted alone.
        viscosity: Pa s, if it is known; shear_modulus is then fitted alone.
        exact: use simulated collapse times, starting from the analytic answer: 5 ms per shot and round.

    Raises:
        InputError: unknown material, a given value outside its domain, nothing to fit.
        SolverError: a simulation of the exact fit failed, or shows no collapse.
    """
    medium = medium_of(medium)
    modulus, viscosity = _given(material, shear_modulus, viscosity)
    ones = np.ones(len(shots))
    problem = _Problem(shots, medium, ones, modulus, viscosity, weight=ones).reweighted()
    return _answer(_corrected(problem), []) if exact else _answer(problem, _poor(problem))


def _given(material: str, shear_modulus: float | None, viscosity: float | None) -> tuple[float | None, float | None]:
    """G and mu that are not fitted, by their values or by the material. Raises InputError."""
    unknown = f"unknown material {material!r}; collapse times know {', '.join(MATERIALS)}"
    require(material in MATERIALS, unknown, "collapse_time.material")
    values = {"shear modulus": shear_modulus, "viscosity": viscosity}
    if none := {"newtonian": "shear modulus", "nh": "viscosity"}.get(material):
        require(not values[none], f"material {material!r} has no {none}", "collapse_time.not_of_the_material")
        values[none] = 0.0
    for (name, value), most in zip(values.items(), (LARGEST_MODULUS, LARGEST_VISCOSITY), strict=True):
        expected = f"the {name} must lie between 0 and {most:g} (Pa, Pa s)"
        require(value is None or 0 <= value <= most, f"{expected}, got {value!r}", "collapse_time.out_of_range")
    both = "nothing to fit: shear modulus and viscosity are both given"
    require(None in values.values(), both, "collapse_time.all_given")
    return values["shear modulus"], values["viscosity"]


@dataclass(frozen=True, eq=False)
class _Problem:
    """n shots, and their weights (n,). correction: (n,) of the times of the analytic model. modulus, viscosity: given
    ones, None if they are fitted."""

    shots: Shots
    medium: Medium
    correction: Floats
    modulus: float | None
    viscosity: float | None
    weight: Floats

    @property
    def unknowns(self) -> int:
        return (self.modulus is None) + (self.viscosity is None)

    def residuals(self, G: Floats, mu: Floats) -> Floats:
        """(n, m) at G (m,) and mu (m,)."""
        R, stretch = self.shots.max_radius[:, None], self.shots.stretch[:, None]
        ratio = (self.shots.ratio(self.medium) / self.correction)[:, None]
        return np.asarray((ratio**2 * inverse_square(R, stretch, G, mu, self.medium) - 1) / 2)

    def slopes(self, G: Floats, mu: Floats) -> Floats:
        """(n, m) derivatives of the residuals by G, 1/Pa."""
        return (self.residuals(G + _DIFFERENCE, mu) - self.residuals(G, mu)) / _DIFFERENCE

    def profile(self, mu: Floats) -> tuple[Floats, Floats]:
        """The best G (m,) for each mu (m,), and the sums (m,) of weighted squares."""
        G = np.full(len(mu), 0.0 if self.modulus is None else self.modulus)
        for _ in range(_NEWTON_STEPS if self.modulus is None else 0):
            slope = self.slopes(G, mu)
            step = self.weight @ (self.residuals(G, mu) * slope) / (self.weight @ slope**2)
            G = np.clip(G - step, 0.0, LARGEST_MODULUS)
        return G, self.weight @ self.residuals(G, mu) ** 2

    def best(self) -> tuple[float, float, float]:
        """G, mu and the sum of squares at its minimum."""
        grid = _FIRST_GRID if self.viscosity is None else np.array([self.viscosity])
        for _ in range(_ZOOMS if self.viscosity is None else 0):
            k = int(np.argmin(self.profile(grid)[1]))
            grid = np.linspace(grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)], _ZOOMED)
        G, squares = self.profile(grid)
        k = int(np.argmin(squares))
        return float(G[k]), float(grid[k]), float(squares[k])

    def reweighted(self) -> _Problem:
        """With Huber's weights; few shots do not show which one is wrong."""
        problem = self
        for _ in range(_ROUNDS if len(self.shots) > self.unknowns + 2 else 0):
            G, mu, _ = problem.best()
            off = np.abs(self.residuals(np.array([G]), np.array([mu]))[:, 0])
            knee = _KNEE * max(1.4826 * float(np.median(off)), _FLOOR)
            problem = replace(problem, weight=knee / np.maximum(off, knee))
        return problem

    def edge(self, inside: float, outside: float, limit: float) -> float:
        """The mu between one with a sum of squares below a limit, and another, at which the limit is reached; the other
        where it is not."""

        def above(mu: float) -> float:
            return float(self.profile(np.array([mu]))[1][0] - limit)

        if self.viscosity is not None:
            return inside
        return outside if above(outside) <= 0.0 else float(brentq(above, inside, outside))


def _corrected(problem: _Problem) -> _Problem:
    """With the ratio of simulated to analytic times at the answer to which it leads. Raises SolverError."""
    R, stretch, medium = problem.shots.max_radius, problem.shots.stretch, problem.medium
    for _ in range(_EXACT_ROUNDS):
        G, mu, _ = problem.best()
        correction = simulated_time(R, stretch, G, mu, medium) / analytic_time(R, stretch, G, mu, medium)
        if not np.all(np.isfinite(correction) & (correction > 0)):
            raise SolverError(f"a bubble in {G:.3g} Pa and {mu:.2g} Pa s has no collapse")
        change = np.max(np.abs(correction / problem.correction - 1))
        problem = replace(problem, correction=correction).reweighted()
        if change < _SAME:
            return problem
    raise SolverError(f"after {_EXACT_ROUNDS} rounds the times still change by {change:.1g}")


def _answer(problem: _Problem, messages: list[str]) -> CollapseEstimate:
    """The estimate of a problem, with these and further messages."""
    n, free = len(problem.shots), len(problem.shots) - problem.unknowns
    G, mu, squares = problem.best()
    residual = problem.residuals(np.array([G]), np.array([mu]))[:, 0]
    scatter, reach = None, _EQUAL_TIME
    if free > 0:
        scatter = float(np.sqrt(np.sum((problem.weight * residual) ** 2) / free) / np.mean(problem.weight == 1.0))
        reach = float(stdtrit(free, 0.95)) * max(scatter, _FLOOR)
    limit = squares + reach**2
    line = np.linspace(problem.edge(mu, 0.0, limit), problem.edge(mu, LARGEST_VISCOSITY, limit), _LINE)
    at, height = problem.profile(line)
    half = np.zeros(_LINE)
    if problem.modulus is None:
        half = np.sqrt(np.maximum(limit - height, 0.0) / (problem.weight @ problem.slopes(at, line) ** 2))
    ends = max(float(np.min(at - half)), 0.0), float(np.max(at + half))
    longer = replace(problem, correction=problem.correction / (1.0 + 1e-4)).best()[0]
    found = CollapseEstimate(
        shear_modulus_Pa=_quantity(G, *ends, LARGEST_MODULUS, problem.modulus is None, free > 0),
        viscosity_Pa_s=_quantity(mu, line[0], line[-1], LARGEST_VISCOSITY, problem.viscosity is None, free > 0),
        scatter=scatter,
        downweighted=[name for name, w in zip(problem.shots.names, problem.weight, strict=True) if w < 0.5],
    )
    R, stretch, medium = problem.shots.max_radius, problem.shots.stretch, problem.medium
    model = problem.correction * analytic_time(R, stretch, G, mu, medium) / rayleigh_time(R, medium)
    found.model = list(model)
    if found.shear_modulus_Pa.median is not None:
        found.modulus_per_percent_Pa = 100.0 * (longer - G)
    if found.shear_modulus_Pa.median is None and found.viscosity_Pa_s.median is None:
        places = np.linspace(line[0], line[-1], _PAIRS)
        found.pairs = list(zip(problem.profile(places)[0].tolist(), places.tolist(), strict=True))
        why = "one collapse time is one relation between G and µ, not both: add shots of other R_max, or give one"
        messages.append(why if n == 1 else "the shots are too alike (R_max, lambda) to tell G from µ")
    if free == 0:
        messages.append("as many shots as unknowns: no interval")
    if scatter is not None and scatter > _MAX_SCATTER:
        messages.append(f"the times scatter by {100 * scatter:.2g} % about the model: they do not follow it")
    if np.isinf(model).any():
        messages.append(f"{np.sum(np.isinf(model))} shots have no collapse in the model")
    found.message = "; ".join(messages)
    return found


def _quantity(value: float, low: float, high: float, most: float, fitted: bool, interval: bool) -> Quantity:
    """A value with its interval, which is a bound where its ends are far apart or at the end of the range; without an
    interval the ends of equally good values count."""
    if not fitted:
        return Quantity(median=value)
    bound: Bound | None = None
    if high > _WIDE * low:
        bound = "upper" if low < 1e-9 * high else "wide"
    if high >= most:
        bound = "undetermined" if bound else "lower"
    if not interval:
        return Quantity(bound="undetermined") if bound else Quantity(median=value)
    return Quantity(median=value, q05=low, q95=high, bound=bound)


def _poor(problem: _Problem) -> list[str]:
    """A message if the analytic model is known to be inaccurate for these shots."""
    medium, shots = problem.medium, problem.shots
    inverse_re = problem.best()[1] * medium.velocity_scale / (medium.pressure * shots.max_radius)
    count = np.count_nonzero((inverse_re > 1 / _GOOD_RE) | (shots.stretch < _GOOD_STRETCH))
    where = f"Re < {_GOOD_RE:g} or lambda < {_GOOD_STRETCH:g}, {count} of {len(shots)} shots"
    return [f"the analytic model is poor here ({where}): use exact"] if count else []
