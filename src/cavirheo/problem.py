"""Problem: everything that is assumed about an experiment before a curve is seen (physics, prior, camera).

One scale serves every shot. For given medium constants the normalised history R/R_max as a function of
t* = t/t_c depends on the Cauchy number p_inf/G, the Reynolds number p_inf t_c/mu and the stretch R_max/R_0,
and less strongly (through conduction, diffusion, surface tension and sound speed) on R_max itself
(docs/method/physics.md, section 1). Training curves are therefore all simulated at one reference R_max, 245 um:
35 um (the R_0 that the authors of the Bubble Dynamics Transformer fix in their app) times 7 (the mean stretch
of the prior); and sampled at j x 1 us, j = 0..99: a fixed grid in t*. A measured shot is brought to that grid
through its own t_c, and the answer is brought back at the same Cauchy and Reynolds numbers:

    step_shot = step_reference x t_c,shot / t_c,reference              `Problem.grid_step`
    G_shot    = G x p_inf,shot / p_inf,reference                       `Problem.to_shot`, `Problem.from_shot`
    mu_shot   = mu x (p_inf t_c)_shot / (p_inf t_c)_reference

What does not scale (heat, vapour, surface tension, sound) is corrected by inference (inference/amortised.py).

No torch here: training and inference share this module, so that a curve is prepared in one way only.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cavirheo.errors import InputError
from cavirheo.parameters import LOG10, natural_name
from cavirheo.physics.materials import MATERIALS, Material
from cavirheo.physics.media import WATER, Medium
from cavirheo.prior import Prior

if TYPE_CHECKING:
    from cavirheo.physics.simulation import Simulation

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """The grid on which a curve is seen: `frames` samples, the first at R_max."""

    frame_interval: float = 1e-6  # s
    frames: int = 100

    def __post_init__(self) -> None:
        if not (self.frame_interval > 0 and self.frames >= 2):
            raise InputError(
                f"a camera needs a positive frame interval and at least 2 frames, "
                f"got {self.frame_interval} s and {self.frames}"
            )

    @property
    def time(self) -> Floats:
        """(frames,) s after R_max."""
        return np.asarray(self.frame_interval * np.arange(self.frames, dtype=float))


@dataclass(frozen=True, eq=False)
class Problem:
    """A material law in a medium, the prior of its parameters, and the camera.

    Raises:
        InputError: unknown material, or a prior whose names are not its parameters and the stretch.
    """

    material_name: str
    prior: Prior
    medium: Medium = WATER
    camera: Camera = field(default_factory=Camera)
    reference_max_radius: float = 245e-6  # m

    def __post_init__(self) -> None:
        if self.material_name not in MATERIALS:
            raise InputError(f"unknown material {self.material_name!r}; known: {', '.join(MATERIALS)}")
        needed = {f.name for f in fields(MATERIALS[self.material_name])} | {"stretch"}
        given = [natural_name(name) for name in self.prior.names]
        if sorted(given) != sorted(needed):
            raise InputError(
                f"material {self.material_name!r} needs a prior for {', '.join(sorted(needed))} "
                f"(each with or without log10_), got {', '.join(self.prior.names)}"
            )
        if not self.reference_max_radius > 0:
            raise InputError(f"reference_max_radius must be positive, got {self.reference_max_radius} m")

    # identity

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, from which `from_dict` makes the same problem again."""
        ranges = zip(self.prior.names, self.prior.low.tolist(), self.prior.high.tolist(), strict=True)
        return {
            "schema": 1,
            "material": self.material_name,
            "medium": asdict(self.medium),
            "prior": {name: [low, high] for name, low, high in ranges},
            "camera": asdict(self.camera),
            "reference_max_radius": self.reference_max_radius,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Problem:
        """The problem of a `to_dict`. Raises InputError if a part is missing or unknown."""
        try:
            return cls(
                material_name=data["material"],
                prior=Prior.uniform(data["prior"]),
                medium=Medium(**data["medium"]),
                camera=Camera(**data["camera"]),
                reference_max_radius=data["reference_max_radius"],
            )
        except (KeyError, TypeError, IndexError) as error:
            raise InputError(f"not a problem written by this version of cavirheo: {error}") from error

    @cached_property
    def id(self) -> str:
        """Twelve hexadecimal digits that change with any part of the problem (the prior's order included)."""
        text = json.dumps(self.to_dict() | {"order": self.prior.names}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    # theta -> curve

    def natural(self, theta: ArrayLike) -> dict[str, float]:
        """Values in SI by parameter name from theta (parameters,) in the prior's scale."""
        theta = np.asarray(theta, dtype=float)
        if theta.shape != (len(self.prior.names),):
            raise InputError(f"theta must hold {', '.join(self.prior.names)}, got shape {theta.shape}")
        return {
            natural_name(name): float(10.0**value if name.startswith(LOG10) else value)
            for name, value in zip(self.prior.names, theta, strict=True)
        }

    def material(self, theta: ArrayLike) -> Material:
        """The material of theta (parameters,); the stretch does not belong to it."""
        values = self.natural(theta)
        del values["stretch"]
        return MATERIALS[self.material_name](**values)

    def simulate(self, theta: ArrayLike) -> Simulation:
        """The curve of theta (parameters,) at the reference R_max, on the camera's grid."""
        return self.simulate_many(np.atleast_2d(np.asarray(theta, dtype=float)), workers=1)[0]

    def simulate_many(self, theta: ArrayLike, *, workers: int | None = None) -> list[Simulation]:
        """The curves of theta (curves, parameters); none is left out, failures say so in their status."""
        from cavirheo.physics.simulate import (
            simulate_many,
        )  # compiles; whoever only reads or trains need not wait

        rows = np.asarray(theta, dtype=float)
        return simulate_many(
            [self.material(row) for row in rows],
            max_radius=np.full(len(rows), self.reference_max_radius),
            stretch=np.array([self.natural(row)["stretch"] for row in rows]),
            time=self.camera.time,
            medium=self.medium,
            workers=workers,
        )

    # shot <-> reference scale

    def grid_step(self, max_radius: float, medium: Medium | None = None) -> float:
        """The frame interval (s) that puts a shot of this R_max (m) on the grid in t*."""
        return self.camera.frame_interval * self._time_ratio(max_radius, medium or self.medium)

    def to_shot(
        self, shear_modulus: float, viscosity: float, max_radius: float, medium: Medium | None = None
    ) -> tuple[float, float]:
        """(G Pa, mu Pa s) of the shot from those at the reference scale: same Cauchy and Reynolds numbers."""
        g_ratio, mu_ratio = self._ratios(max_radius, medium or self.medium)
        return shear_modulus * g_ratio, viscosity * mu_ratio

    def from_shot(
        self, shear_modulus: float, viscosity: float, max_radius: float, medium: Medium | None = None
    ) -> tuple[float, float]:
        """(G Pa, mu Pa s) at the reference scale from those of the shot: the inverse of `to_shot`."""
        g_ratio, mu_ratio = self._ratios(max_radius, medium or self.medium)
        return shear_modulus / g_ratio, viscosity / mu_ratio

    def _time_ratio(self, max_radius: float, medium: Medium) -> float:
        if not (np.isfinite(max_radius) and max_radius > 0):
            raise InputError(f"R_max must be finite and positive, got {max_radius} m")
        return medium.time_scale(max_radius) / self.medium.time_scale(self.reference_max_radius)

    def _ratios(self, max_radius: float, medium: Medium) -> tuple[float, float]:
        pressure = medium.pressure / self.medium.pressure
        return pressure, pressure * self._time_ratio(max_radius, medium)
