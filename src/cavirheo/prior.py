"""The prior of parameters, and the training problem of a network.

*Coordinates.* u = Phi^-1(F(x)), F the cumulative distribution of a parameter's prior, x in its scale. In u, where
posteriors are sampled, there are no bounds and the prior density is prod phi(u_i). A density over u times p(x)/phi(u)
is a density over x.

*Training.* R/R_max over t* = t/t_c depends on the Cauchy number p_inf/G, the Reynolds number p_inf t_c/mu and the
stretch, and less on R_max itself (docs/method/physics.md, section 1). So all training curves have one R_max, 245 um:
35 um (the R_0 of the app of the Bubble Dynamics Transformer) times 7 (the mean stretch). A shot is sampled on
their grid of t* with its own t_c, and the answer is scaled back at equal Cauchy and Reynolds numbers (`grid_step`,
`to_shot`):

    step_shot = step x t_c,shot/t_c,   G_shot = G x p_inf,shot/p_inf,   mu_shot = mu x (p_inf t_c)_shot/(p_inf t_c)
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from cavirheo.arrays import Bools, Floats
from cavirheo.errors import InputError, require
from cavirheo.parameters import PARAMETERS, RADIUS, natural_name, to_natural
from cavirheo.physics.materials import MATERIALS, Material
from cavirheo.physics.media import WATER, Medium

if TYPE_CHECKING:
    from cavirheo.physics.simulate import Simulation

_LOG_2PI = float(np.log(2.0 * np.pi))
_LEAST_PROBABILITY = 1e-12  # least probability between a value and a bound in `to_x`
MOST_FRAMES = 5_000  # of a network's grid; larger training sets would not fit on a machine
MAX_TIME = 1_000.0  # longest time of the grid in t_c


def uniforms(seed: int, index: int, count: int, stream: int = 0) -> Floats:
    """(count,) numbers in [0, 1) that depend on (seed, stream, index) alone; streams are independent: raw words of the
    counter-based Philox generator, which numpy keeps fixed across versions."""
    require(0 <= seed < 2**64, f"a seed must be from 0 to 2^64 - 1, got {seed}", "prior.seed")
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
            message = f"a prior needs one {name} for each of its names {self.names}"
            require(values.size == size == len(set(self.names)), message, "prior.shape")
            object.__setattr__(self, name, values)
        for name, low, high in zip(self.names, self.low, self.high, strict=True):
            message = f"the prior of {name} must be [low, high] with low < high, got [{low}, {high}]"
            require(-np.inf < low < high < np.inf, message, "prior.range")

    @classmethod
    def uniform(cls, ranges: Mapping[str, Sequence[float]]) -> Prior:
        """A prior from {name: [low, high]}. Raises InputError: an unknown parameter, or not two numbers."""
        for name, pair in ranges.items():
            message = f"unknown parameter {name!r}; known, with or without log10_: {', '.join(PARAMETERS)}"
            require(natural_name(name) in PARAMETERS, message, "prior.name")
            require(len(pair) == 2, f"the prior of {name} must be [low, high], got {list(pair)}", "prior.range")
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

    def states(self, needed: Mapping[str, str]) -> list[State]:
        """The states of the switches: parameters that may be exactly 0 (-inf in x) or infinite, and are so or not.
        needed: {parameter: the switch without which it has no meaning}."""
        found = [(1.0, dict[str, float]())]
        order = sorted(range(len(self.names)), key=lambda i: self.names[i] in needed)
        for i in order:
            name, zero, infinite = self.names[i], float(self.zero[i]), float(self.infinite[i])
            split = list[tuple[float, dict[str, float]]]()
            for probability, fixed in found:
                if needed.get(name) in fixed:
                    split.append((probability, fixed | {name: -np.inf if zero else float(self.low[i])}))
                    continue
                split.append((probability * (1.0 - zero - infinite), fixed))
                split += [(probability * zero, fixed | {name: -np.inf})] if zero else []
                split += [(probability * infinite, fixed | {name: np.inf})] if infinite else []
            found = split
        return [self._state(probability, fixed) for probability, fixed in found]

    def _state(self, probability: float, fixed: Mapping[str, float]) -> State:
        free = [name for name in self.names if name not in fixed]
        at = [self.names.index(name) for name in free]
        prior = Prior(tuple(free), self.low[at], self.high[at], self.mean[at], self.std[at])
        x = np.array([fixed.get(name, 0.0) for name in self.names])
        return State(prior, np.array(at, dtype=int), x, float(np.log(probability)))

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

    def cdf(self, x: Floats) -> Floats:
        """Cumulative probabilities (..., d) of x (..., d)."""
        flat, unit, centre, below, inside = self._normal
        uniform = (x - self.low) / (self.high - self.low)
        normal = (ndtr((x - centre) / unit) - below) / inside
        return np.asarray(np.clip(np.where(flat, uniform, normal), 0.0, 1.0))

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
        p = self.zero + (1.0 - self.zero - self.infinite) * np.clip(self.cdf(x), inside, 1.0 - inside)
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


@dataclass(frozen=True)
class FrameGrid:
    """The times at which a network reads a curve, the first at R_max.

    Attributes:
        frame_interval: s between samples.
        frames: number of samples.
    """

    frame_interval: float = 1e-6
    frames: int = 100

    def __post_init__(self) -> None:
        message = f"a grid needs a positive frame interval and 2 to {MOST_FRAMES} frames, got "
        fine = isinstance(self.frames, int) and 2 <= self.frames <= MOST_FRAMES and 0 < self.frame_interval < np.inf
        require(fine, f"{message}{self.frame_interval} s and {self.frames}", "problem.grid")

    @property
    def time(self) -> Floats:
        """(frames,) s after R_max."""
        return np.asarray(self.frame_interval * np.arange(self.frames, dtype=float))


@dataclass(frozen=True, eq=False)
class TrainingProblem:
    """How the curves of a training set are drawn and simulated; stored in the network's card and in the data.

    Attributes:
        material_name: name of the law, "nhkv", ...
        prior: of the parameters of the law and the stretch.
        medium: liquid and gas constants.
        grid: times of the frames.
        reference_max_radius: R_max of all curves, m.

    Raises:
        InputError: unknown material, a prior of other parameters or outside their domains, or an invalid R_max or grid.
    """

    material_name: str
    prior: Prior
    medium: Medium = WATER
    grid: FrameGrid = FrameGrid()
    reference_max_radius: float = 245e-6

    def __post_init__(self) -> None:
        material, names = self.material_name, self.prior.names
        message = f"unknown material {material!r}; known: {', '.join(MATERIALS)}"
        require(material in MATERIALS, message, "problem.material")
        needed = sorted([*(f.name for f in fields(MATERIALS[material])), "stretch"])
        message = f"material {material!r} needs a prior for {', '.join(needed)} (each with or without log10_)"
        require(sorted(map(natural_name, names)) == needed, f"{message}, got {', '.join(names)}", "problem.prior")
        radius = self.reference_max_radius
        require(0 < radius < np.inf, f"reference_max_radius must be positive, got {radius} m", "problem.max_radius")
        RADIUS.check("reference_max_radius", radius, "problem.max_radius")
        end, scale = (self.grid.frames - 1) * self.grid.frame_interval, self.medium.time_scale(radius)
        message = f"the grid ends {end:.3g} s after R_max, more than the {MAX_TIME:g} collapse times of {scale:.3g} s"
        require(end <= MAX_TIME * scale, f"{message} that are simulated; is a unit wrong?", "problem.grid")
        message = f"the stretch R_max/R_0 must be 1 or more and not of log10_, got the prior {self.prior.to_dict()}"
        require("stretch" in names and self.prior.bounds("stretch")[0] >= 1, message, "problem.prior")
        for ends in (self.prior.low, self.prior.high):
            self.material(ends)  # raises InputError if the law refuses a value

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, from which `from_dict` makes the same problem again."""
        parts = {"medium": asdict(self.medium), "prior": self.prior.to_dict(), "camera": asdict(self.grid)}
        return {"schema": 1, "material": self.material_name, **parts, "reference_max_radius": self.reference_max_radius}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> TrainingProblem:
        """The problem from the data of `to_dict`. Raises InputError if a part is missing or unknown."""
        try:
            medium = Medium(**data["medium"], unusual=True)  # checked when the problem was made
            prior, grid = Prior.uniform(data["prior"]), FrameGrid(**data["camera"])
            return cls(data["material"], prior, medium, grid, data["reference_max_radius"])
        except InputError:
            raise
        except (AttributeError, KeyError, TypeError, IndexError, ValueError, OverflowError) as error:
            message = f"not a problem written by this version of cavirheo: {error}"
            raise InputError(message, "problem.unreadable") from error

    @cached_property
    def id(self) -> str:
        """Twelve hexadecimal digits that change with any part of the problem (the prior's order included)."""
        text = json.dumps(self.to_dict() | {"order": self.prior.names}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def material(self, theta: ArrayLike) -> Material:
        """The material of theta (parameters,) in the prior's scale."""
        values = natural_values(self.prior.names, theta)
        return MATERIALS[self.material_name](**{name: value for name, value in values.items() if name != "stretch"})

    def simulate_many(self, theta: ArrayLike, **options: Any) -> list[Simulation]:
        """The curves of theta (curves, parameters) on the grid at the reference R_max, failed ones too (see their
        status). `options` are those of the simulation."""
        from cavirheo.physics.simulate import simulate_many  # it compiles; training does not need it

        rows = np.asarray(theta, dtype=float)
        stretch = np.array([natural_values(self.prior.names, row)["stretch"] for row in rows])
        shot: dict[str, Any] = {"max_radius": self.reference_max_radius, "stretch": stretch, "time": self.grid.time}
        return simulate_many([self.material(row) for row in rows], medium=self.medium, **shot, **options)

    def grid_step(self, max_radius: float, medium: Medium | None = None) -> float:
        """The frame interval (s) that puts a shot of this R_max (m) on the grid in t*."""
        return self.grid.frame_interval * self._time_ratio(max_radius, medium or self.medium)

    def to_shot(self, values: Mapping[str, float], max_radius: float, medium: Medium | None = None) -> dict[str, float]:
        """Values in SI by parameter name for a shot of this R_max (m) from those at the reference scale."""
        medium = medium or self.medium
        pressure = medium.pressure / self.medium.pressure
        ratio = {"shear_modulus": pressure, "viscosity": pressure * self._time_ratio(max_radius, medium)}
        return {name: value * ratio.get(name, 1.0) for name, value in values.items()}

    def _time_ratio(self, max_radius: float, medium: Medium) -> float:
        message = f"R_max must be finite and positive, got {max_radius} m"
        require(0 < max_radius < np.inf, message, "problem.max_radius")
        return medium.time_scale(max_radius) / self.medium.time_scale(self.reference_max_radius)


def natural_values(names: Sequence[str], theta: ArrayLike) -> dict[str, float]:
    """Values in SI by parameter name from theta (names,) in the prior's scale. Raises InputError: another shape."""
    theta = np.asarray(theta, dtype=float)
    message = f"theta must hold {', '.join(names)}, got shape {theta.shape}"
    require(theta.shape == (len(names),), message, "problem.theta")
    with np.errstate(over="ignore"):
        return {natural_name(name): float(to_natural(name, value)) for name, value in zip(names, theta, strict=True)}
