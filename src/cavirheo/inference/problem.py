"""The training problem of a network that gives one value for each parameter.

R/R_max over t* = t/t_c depends on the Cauchy number p_inf/G, the Reynolds number p_inf t_c/mu and the stretch, and less
on R_max itself (docs/method/physics.md, section 1). So all training curves have one R_max, 245 um: 35 um (the R_0 of
the app of the Bubble Dynamics Transformer) times 7 (the mean stretch). A shot is sampled on their grid of t* with its
own t_c, and the answer is scaled back at equal Cauchy and Reynolds numbers (`grid_step`, `to_shot`):

    step_shot = step x t_c,shot/t_c,   G_shot = G x p_inf,shot/p_inf,   mu_shot = mu x (p_inf t_c)_shot/(p_inf t_c)
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.parameters import RADIUS, natural_name, to_natural
from cavirheo.physics.materials import MATERIALS, Material
from cavirheo.physics.media import WATER, Medium
from cavirheo.prior import Prior

if TYPE_CHECKING:
    from cavirheo.physics.simulate import Simulation

MOST_FRAMES = 5_000  # larger training sets would not fit on a machine
MAX_TIME = 1_000.0  # longest time of the frames in t_c


@dataclass(frozen=True, eq=False)
class TrainingProblem:
    """How the curves of a training set are drawn and simulated; stored in the network's card and in the data.

    Attributes:
        material_name: name of the law, "nhkv", ...
        prior: of the parameters of the law and the stretch.
        medium: liquid and gas constants.
        frame_interval: s between the frames of a curve, the first of which is at R_max.
        frames: number of frames.
        reference_max_radius: R_max of all curves, m.

    Raises:
        InputError: unknown material, a prior of other parameters or outside their domains, or invalid R_max or frames.
    """

    material_name: str
    prior: Prior
    medium: Medium = WATER
    frame_interval: float = 1e-6
    frames: int = 100
    reference_max_radius: float = 245e-6

    def __post_init__(self) -> None:
        material, names, radius = self.material_name, self.prior.names, self.reference_max_radius
        if material not in MATERIALS:
            raise InputError(f"unknown material {material!r}; known: {', '.join(MATERIALS)}", "problem.material")
        needed = sorted([*(f.name for f in fields(MATERIALS[material])), "stretch"])
        if sorted(map(natural_name, names)) != needed:
            message = f"material {material!r} needs a prior for {', '.join(needed)} (each with or without log10_), got "
            raise InputError(message + ", ".join(names), "problem.prior")
        if "stretch" not in names or self.prior.bounds("stretch")[0] < 1:
            message = "the stretch R_max/R_0 must be 1 or more and not of log10_, got the prior "
            raise InputError(f"{message}{self.prior.to_dict()}", "problem.prior")
        interval, frames = self.frame_interval, self.frames
        if not (isinstance(frames, int) and 2 <= frames <= MOST_FRAMES and 0 < interval < np.inf):
            message = f"a curve needs a positive frame interval and 2 to {MOST_FRAMES} frames, got "
            raise InputError(f"{message}{interval} s and {frames}", "problem.grid")
        if radius == np.inf:
            raise InputError("reference_max_radius must be finite, got inf", "problem.max_radius")
        RADIUS.check("reference_max_radius", radius, "problem.max_radius")
        end, scale = float(self.time[-1]), self.medium.time_scale(radius)
        if end > MAX_TIME * scale:
            message = f"the frames end {end:.3g} s after R_max, more than the {MAX_TIME:g} collapse times of "
            raise InputError(f"{message}{scale:.3g} s that are simulated; is a unit wrong?", "problem.grid")
        for ends in (self.prior.low, self.prior.high):
            self.material(ends)  # raises InputError if the law refuses a value

    @property
    def time(self) -> Floats:
        """(frames,) s after R_max."""
        return np.asarray(self.frame_interval * np.arange(self.frames, dtype=float))

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, from which `from_dict` makes the same problem again."""
        camera = {"frame_interval": self.frame_interval, "frames": self.frames}
        parts = {"medium": asdict(self.medium), "prior": self.prior.to_dict(), "camera": camera}
        return {"schema": 1, "material": self.material_name, **parts, "reference_max_radius": self.reference_max_radius}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> TrainingProblem:
        """The problem from the data of `to_dict`. Raises InputError if a part is missing or unknown."""
        try:
            medium = Medium(**data["medium"], unusual=True)  # checked when the problem was made
            prior, radius = Prior.uniform(data["prior"]), data["reference_max_radius"]
            return cls(data["material"], prior, medium, **data["camera"], reference_max_radius=radius)
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
        """The curves of theta (curves, parameters) at the reference R_max, failed ones too (see their status).
        `options` are those of the simulation."""
        from cavirheo.physics.simulate import simulate_many  # it compiles; training does not need it

        rows = np.asarray(theta, dtype=float)
        stretch = rows[:, self.prior.names.index("stretch")]
        shot: dict[str, Any] = {"max_radius": self.reference_max_radius, "stretch": stretch, "time": self.time}
        return simulate_many([self.material(row) for row in rows], medium=self.medium, **shot, **options)

    def grid_step(self, max_radius: float, medium: Medium) -> float:
        """The frame interval (s) that puts a shot of this R_max (m) on the grid in t*."""
        return self.frame_interval * self._time_ratio(max_radius, medium)

    def to_shot(self, values: Mapping[str, float], max_radius: float, medium: Medium) -> dict[str, float]:
        """Values in SI by parameter name for a shot of this R_max (m) from those at the reference scale."""
        pressure = medium.pressure / self.medium.pressure
        ratio = {"shear_modulus": pressure, "viscosity": pressure * self._time_ratio(max_radius, medium)}
        return {name: value * ratio.get(name, 1.0) for name, value in values.items()}

    def _time_ratio(self, max_radius: float, medium: Medium) -> float:
        return medium.time_scale(max_radius) / self.medium.time_scale(self.reference_max_radius)


def natural_values(names: Sequence[str], theta: ArrayLike) -> dict[str, float]:
    """Values in SI by parameter name from theta (names,) in the prior's scale. Raises InputError: another shape."""
    theta = np.asarray(theta, dtype=float)
    if theta.shape != (len(names),):
        raise InputError(f"theta must hold {', '.join(names)}, got shape {theta.shape}", "problem.theta")
    with np.errstate(over="ignore"):
        return {natural_name(name): float(to_natural(name, value)) for name, value in zip(names, theta, strict=True)}
