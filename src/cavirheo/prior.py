"""Prior: what is assumed of every parameter before a curve is seen; and the coordinates u in which it is normal.

u = Phi^-1(F(x)), F the cumulative distribution of a parameter's prior, x in its scale. In u, where posteriors are
sampled, there are no bounds and the prior density is prod phi(u_i). A density over x is one over u times p(x)/phi(u).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.special import ndtr, ndtri

from cavirheo.arrays import Bools, Floats
from cavirheo.errors import require
from cavirheo.parameters import PARAMETERS, natural_name

_LOG_2PI = float(np.log(2.0 * np.pi))
_INSIDE = 1e-12  # of the probability, that u keeps away from the bounds


def uniforms(seed: int, index: int, count: int, stream: int = 0) -> Floats:
    """(count,) numbers in [0, 1) that depend on (seed, stream, index) alone; streams are independent.

    Raw words of the counter-based Philox generator, whose stream numpy keeps fixed across versions.
    """
    require(0 <= seed < 2**64, f"a seed must be from 0 to 2^64 - 1, got {seed}", "prior.seed")
    words = np.random.Philox(key=(stream << 64) + seed, counter=index << 128).random_raw(count)
    return np.asarray((words >> np.uint64(11)) * 2.0**-53)


def log_normal(u: Floats) -> Floats:
    """(...,) sum of log phi over the last axis."""
    return np.asarray(-0.5 * np.sum(u**2 + _LOG_2PI, axis=-1))


@dataclass(frozen=True, eq=False)
class Prior:
    """Independent and normalised: uniform between the bounds, or normal and cut there. All arrays are (parameters,).

    Attributes:
        names: one that starts with log10_ is of the logarithm of the SI value.
        low: lower bounds.
        high: upper bounds.
        mean: of the normal.
        std: of the normal; infinite where uniform.

    Raises:
        InputError: a range that is not finite and rising, or arrays of other lengths than the names.
    """

    names: tuple[str, ...]
    low: Floats
    high: Floats
    mean: Floats = field(default_factory=lambda: np.array(0.0))
    std: Floats = field(default_factory=lambda: np.array(np.inf))

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        size = len(self.names)
        for name in ("low", "high", "mean", "std"):
            values = np.asarray(getattr(self, name), dtype=float)
            values = values if values.ndim else np.full(size, values)
            message = f"a prior needs one {name} for each of its names {self.names}"
            require(values.size == size == len(set(self.names)), message, "prior.shape")
            object.__setattr__(self, name, values)
        for name, low, high in zip(self.names, self.low, self.high, strict=True):
            message = f"the prior of {name} must be [low, high] with low < high, got [{low}, {high}]"
            require(-np.inf < low < high < np.inf, message, "prior.range")

    @classmethod
    def uniform(cls, ranges: Mapping[str, Sequence[float]]) -> Prior:
        """A prior from {name: [low, high]}. Raises InputError: an unknown parameter, or not two numbers."""
        names = ", ".join(PARAMETERS)
        for name, pair in ranges.items():
            message = f"unknown parameter {name!r}; known, with or without log10_: {names}"
            require(natural_name(name) in PARAMETERS, message, "prior.name")
            require(len(pair) == 2, f"the prior of {name} must be [low, high], got {list(pair)}", "prior.range")
        low, high = np.array(list(ranges.values()), dtype=float).reshape(-1, 2).T
        return cls(tuple(ranges), low, high)

    def bounds(self, name: str) -> tuple[float, float]:
        """(low, high) of one parameter."""
        i = self.names.index(name)
        return float(self.low[i]), float(self.high[i])

    def of(self, names: Sequence[str]) -> Prior:
        """The prior of these parameters alone, which is independent of that of the others."""
        at = [self.names.index(name) for name in names]
        return Prior(tuple(names), *(values[at] for values in (self.low, self.high, self.mean, self.std)))

    def sample(self, draws: int | range, seed: int) -> Floats:
        """(draws, parameters) of a uniform prior; draw i depends on (seed, i) alone: any part can be drawn anywhere."""
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

    def cdf(self, x: Floats) -> Floats:
        """(..., d) from x (..., d)."""
        flat, unit, centre, below, inside = self._normal
        uniform = (x - self.low) / (self.high - self.low)
        normal = (ndtr((x - centre) / unit) - below) / inside
        return np.asarray(np.clip(np.where(flat, uniform, normal), 0.0, 1.0))

    def to_x(self, u: Floats) -> Floats:
        """(..., d) from u (..., d)."""
        flat, unit, centre, below, inside = self._normal
        p = np.clip(ndtr(u), _INSIDE, 1.0 - _INSIDE)
        normal = centre + unit * ndtri(np.clip(below + p * inside, _INSIDE, 1.0 - _INSIDE))
        return np.asarray(np.clip(np.where(flat, self.low + p * (self.high - self.low), normal), self.low, self.high))

    def to_u(self, x: Floats, inside: float = 0.0) -> Floats:
        """(..., d) from x (..., d); infinite at and beyond a bound, unless it is to keep a probability `inside` it."""
        return np.asarray(ndtri(np.clip(self.cdf(x), inside, 1.0 - inside)))

    def log_density(self, x: Floats) -> Floats:
        """(...,) log p(x) of x (..., d), inside the bounds."""
        flat, unit, centre, _, inside = self._normal
        z = (x - centre) / unit
        normal = -0.5 * (z**2 + _LOG_2PI) - np.log(unit * inside)
        return np.asarray(np.sum(np.where(flat, -np.log(self.high - self.low), normal), axis=-1))

    def slope(self, u: Floats) -> Floats:
        """(d,) dx/du = phi(u)/p(x)."""
        flat, unit, centre, _, inside = self._normal
        z = (self.to_x(u) - centre) / unit
        normal = -0.5 * z**2 - np.log(unit * inside)
        log_p = np.where(flat, 0.5 * _LOG_2PI - np.log(self.high - self.low), normal)
        return np.asarray(np.exp(-0.5 * u**2 - log_p))

    def to_dict(self) -> dict[str, list[float]]:
        """{name: [low, high]} or [low, high, mean, standard deviation], in x."""
        rows = np.column_stack([self.low, self.high, self.mean, self.std]).tolist()
        return {n: row[:2] if np.isinf(row[3]) else row for n, row in zip(self.names, rows, strict=True)}
