"""The prior of parameters, and its coordinates u. Which prior a parameter has: `inference.experiment.Experiment.prior`.

u = Phi^-1(F(x)), F the cumulative distribution of a parameter's prior, x in its scale. In u, where posteriors are
sampled, there are no bounds and the prior density is prod phi(u_i). A density over u times p(x)/phi(u) is a density
over x.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from cavirheo.arrays import Bools, Floats
from cavirheo.errors import InputError
from cavirheo.parameters import PARAMETERS, natural_name

_LOG_2PI = float(np.log(2.0 * np.pi))
INSIDE = 1e-3  # least probability between a place and an end of the prior, where slopes are taken
_LEAST_PROBABILITY = 1e-12  # least probability between a value and a bound in `to_x`


def uniforms(seed: int, index: int, count: int, stream: int = 0) -> Floats:
    """(count,) numbers in [0, 1) that depend on (seed, stream, index) alone; streams are independent: raw words of the
    counter-based Philox generator, which numpy keeps fixed across versions."""
    if not 0 <= seed < 2**64:
        raise InputError(f"a seed must be from 0 to 2^64 - 1, got {seed}", "prior.seed")
    words = np.random.Philox(key=(stream << 64) + seed, counter=index << 128).random_raw(count)
    return np.asarray((words >> np.uint64(11)) * 2.0**-53)


def log_normal(u: Floats) -> Floats:
    """(...,) sum of log phi over the last axis."""
    return np.asarray(-0.5 * np.sum(u**2 + _LOG_2PI, axis=-1))


@dataclass(frozen=True, eq=False)
class Prior:
    """Independent, normalised priors: uniform between bounds, or normal and truncated there. Arrays: (parameters,).

    Attributes:
        names: of the parameters; log10_ at the start means the logarithm of the SI value.
        low, high: bounds.
        mean, std: of the normal distributions; std is infinite for uniform ones.
        zero, infinite: probability that the parameter is exactly 0 (log10: -inf), or infinite.

    Raises:
        InputError: a range that is not finite and rising, an array of another length than the names, or equal names.
    """

    names: tuple[str, ...]
    low: Floats
    high: Floats
    mean: Floats = field(default_factory=lambda: np.array(0.0))
    std: Floats = field(default_factory=lambda: np.array(np.inf))
    zero: Floats = field(default_factory=lambda: np.array(0.0))
    infinite: Floats = field(default_factory=lambda: np.array(0.0))

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        size = len(self.names)
        for name in ("low", "high", "mean", "std", "zero", "infinite"):
            values = np.asarray(getattr(self, name), dtype=float)
            values = values if values.ndim else np.full(size, values)
            if not values.size == size == len(set(self.names)):
                raise InputError(f"a prior needs one {name} for each of its names {self.names}", "prior.shape")
            object.__setattr__(self, name, values)
        for name, low, high in zip(self.names, self.low, self.high, strict=True):
            if not -np.inf < low < high < np.inf:
                message = f"the prior of {name} must be [low, high] with low < high, got [{low}, {high}]"
                raise InputError(message, "prior.range")

    @classmethod
    def uniform(cls, ranges: Mapping[str, Sequence[float]]) -> Prior:
        """A prior from {name: [low, high]}. Raises InputError: an unknown parameter, or not two numbers."""
        for name, pair in ranges.items():
            if natural_name(name) not in PARAMETERS:
                known = f"known, with or without log10_: {', '.join(PARAMETERS)}"
                raise InputError(f"unknown parameter {name!r}; {known}", "prior.name")
            if len(pair) != 2:
                raise InputError(f"the prior of {name} must be [low, high], got {list(pair)}", "prior.range")
        low, high = np.array(list(ranges.values()), dtype=float).reshape(-1, 2).T
        return cls(tuple(ranges), low, high)

    def bounds(self, name: str) -> tuple[float, float]:
        """(low, high) of one parameter."""
        i = self.names.index(name)
        return float(self.low[i]), float(self.high[i])

    def marginal(self, names: Sequence[str]) -> Prior:
        """The prior of these parameters alone; the parameters are independent."""
        at = [self.names.index(name) for name in names]
        columns = (self.low, self.high, self.mean, self.std, self.zero, self.infinite)
        return Prior(tuple(names), *(values[at] for values in columns))

    def states(self, dependent: Mapping[str, tuple[str, bool]]) -> list[State]:
        """The states of the switches: parameters that may be exactly 0 (-inf in x) or infinite, and are so or not.
        dependent: {parameter: (another one, whether it has a meaning where the other is on, or where it is off)}."""
        found = [(1.0, dict[str, float]())]
        order = sorted(range(len(self.names)), key=lambda i: self.names[i] in dependent)
        for i in order:
            name, zero, infinite = self.names[i], float(self.zero[i]), float(self.infinite[i])
            split = list[tuple[float, dict[str, float]]]()
            for probability, fixed in found:
                other, where_on = dependent.get(name, ("", True))
                if (other in fixed) == where_on and name in dependent:
                    split.append((probability, fixed | {name: -np.inf if zero else float(self.low[i])}))
                    continue
                split.append((probability * (1.0 - zero - infinite), fixed))
                split += [(probability * zero, fixed | {name: -np.inf})] if zero else []
                split += [(probability * infinite, fixed | {name: np.inf})] if infinite else []
            found = split
        return [self._state(probability, fixed) for probability, fixed in found]

    def _state(self, probability: float, fixed: Mapping[str, float]) -> State:
        free = [name for name in self.names if name not in fixed]
        columns = np.array([self.names.index(name) for name in free], dtype=int)
        ranges = (self.low, self.high, self.mean, self.std)
        prior = Prior(tuple(free), *(values[columns] for values in ranges))
        x = np.array([fixed.get(name, 0.0) for name in self.names])
        return State(prior, columns, x, float(np.log(probability)))

    def sample(self, draws: int | range, seed: int) -> Floats:
        """Draws (draws, parameters) of a uniform prior; draw i depends on (seed, i) alone, not on the others."""
        indices = range(draws) if isinstance(draws, int) else draws
        cube = np.array([uniforms(seed, i, len(self.names)) for i in indices]).reshape(len(indices), len(self.names))
        return np.asarray(self.low + (self.high - self.low) * cube)

    @cached_property
    def _normal(self) -> tuple[Bools, Floats, Floats, Floats, Floats]:
        """(which are uniform, unit, centre, probability below the lower bound, probability inside)."""
        uniform = ~np.isfinite(self.std)
        unit, centre = np.where(uniform, 1.0, self.std), np.where(uniform, 0.0, self.mean)
        below = ndtr((self.low - centre) / unit)
        return uniform, unit, centre, below, ndtr((self.high - centre) / unit) - below

    def to_x(self, u: Floats) -> Floats:
        """x (..., d) from u (..., d)."""
        flat, unit, centre, below, inside = self._normal
        whole = ndtr(u)
        p = (whole - self.zero) / (1.0 - self.zero - self.infinite)
        p = np.clip(p, _LEAST_PROBABILITY, 1.0 - _LEAST_PROBABILITY)
        normal = centre + unit * ndtri(np.clip(below + p * inside, _LEAST_PROBABILITY, 1.0 - _LEAST_PROBABILITY))
        x = np.clip(np.where(flat, self.low + p * (self.high - self.low), normal), self.low, self.high)
        x = np.where(whole < self.zero, -np.inf, x)
        return np.asarray(np.where(1.0 - whole < self.infinite, np.inf, x))

    def to_u(self, x: Floats, inside: float = 0.0) -> Floats:
        """u (..., d) from x (..., d); infinite at and beyond a bound, unless `inside` > 0 limits the probability. An
        atom gives the middle of its part of u."""
        flat, unit, centre, below, mass = self._normal
        uniform = (x - self.low) / (self.high - self.low)
        within = np.where(flat, uniform, (ndtr((x - centre) / unit) - below) / mass)
        p = self.zero + (1.0 - self.zero - self.infinite) * np.clip(within, inside, 1.0 - inside)
        p = np.where(np.isneginf(x), 0.5 * self.zero, p)
        return np.asarray(ndtri(np.where(np.isposinf(x), 1.0 - 0.5 * self.infinite, p)))

    def log_density(self, x: Floats) -> Floats:
        """(...,) log p(x) of x (..., d), inside the bounds."""
        flat, unit, centre, _, inside = self._normal
        z = (x - centre) / unit
        normal = -0.5 * (z**2 + _LOG_2PI) - np.log(unit * inside)
        return np.asarray(np.sum(np.where(flat, -np.log(self.high - self.low), normal), axis=-1))

    def to_dict(self) -> dict[str, list[float]]:
        """{name: [low, high]} or [low, high, mean, standard deviation], in x."""
        rows = np.column_stack([self.low, self.high, self.mean, self.std]).tolist()
        return {n: row[:2] if np.isinf(row[3]) else row for n, row in zip(self.names, rows, strict=True)}


@dataclass(frozen=True, eq=False)
class State:
    """A state of the switches of a prior.

    Attributes:
        prior: of the parameters that are free in it, given the state.
        columns: (m,) of these in x.
        fixed: (d,) x of the others.
        log_probability: of the state.
    """

    prior: Prior
    columns: NDArray[np.int64]
    fixed: Floats
    log_probability: float

    def to_x(self, u: Floats) -> Floats:
        """x (k, d) of all parameters from u (k, m) of the free ones."""
        x = np.tile(self.fixed, (len(u), 1))
        x[:, self.columns] = self.prior.to_x(u)
        return x

    def to_u(self, x: Floats, inside: float) -> Floats:
        """u (k, m) of the free parameters from x (k, d); `inside`: least probability between a value and a bound."""
        return self.prior.to_u(np.clip(x[:, self.columns], self.prior.low, self.prior.high), inside)

    def holds(self, x: Floats) -> bool:
        """Whether x (d,) is in this state."""
        others = np.setdiff1d(np.arange(len(x)), self.columns)
        switched = others[~np.isfinite(self.fixed[others])]
        return bool(np.all(np.isfinite(x[self.columns])) and np.array_equal(x[switched], self.fixed[switched]))
