"""Posterior: the answer for one curve, with the checks that sign or refuse it and the record of where it came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Verdict = Literal["ok", "model_does_not_fit", "outside_training_range", "failed"]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Checks:
    """What was found when the answer was simulated and laid over the measurement."""

    verdict: Verdict
    message: str = ""
    rmse_over_rmax: float | None = None
    mae_over_rmax: float | None = None
    max_difference_over_rmax: float | None = None
    collapses: int | None = None  # complete collapses inside the compared window
    t_star_end: float | None = None  # end of the compared window, t/t_c after R_max
    compared_time: Floats | None = None  # (m,) s on the measurement's clock: the frames that were compared
    residual_over_rmax: Floats | None = None  # (m,) (measured - simulated)/R_max at compared_time
    reconstruction_time: Floats | None = None  # (k,) s on the measurement's clock, fine enough to draw
    reconstruction_radius: Floats | None = None  # (k,) m
    time_scale: float | None = None  # t_c = R_max sqrt(rho/p) of the shot in its medium, s


@dataclass(frozen=True)
class WindowAnswer:
    """What another window of the same curve answers."""

    best: Mapping[str, float]  # the law's parameters and the stretch, SI
    t_star_end: float
    rmse_over_rmax: float | None
    at_bound: tuple[str, ...] = ()  # parameters that ended at the end of the range searched


@dataclass(frozen=True)
class Evidence:
    """log p(frames | law) and its standard error; None where it is Laplace's integral, which has none."""

    log: float
    error: float | None = None


@dataclass(frozen=True)
class Diagnostics:
    """How an answer was found and what its interval is worth; None or empty where the method does not say."""

    stretch_source: str = ""  # "given", "fitted", ...
    free: Mapping[str, float] = field(default_factory=dict)  # clock, scale, R_max factor that were freed, at the best
    one_sigma: Mapping[str, float] = field(default_factory=dict)  # log10 for parameters of the law and the stretch
    correlations: Mapping[str, float] = field(default_factory=dict)  # by "name, name"
    frames: int | None = None
    frames_per_independent_residual: float | None = None
    at_bound: tuple[str, ...] = ()
    draws: int | None = None  # weighted ones
    effective_sample_size: float | None = None
    tail_index: float | None = None  # generalised Pareto shape of the largest weights
    predictive: Mapping[str, Any] | None = None  # p_value; p and observed by statistic
    systematic_misfit_over_rmax: float | None = None
    simulations: int | None = None
    failed_simulations: int | None = None


@dataclass(frozen=True, eq=False)
class Posterior:
    """Draws of the parameters given one curve, and the best of them.

    `theta` is (draws, parameters) in the prior's scale (log10 for G and mu); a point answer is one draw, and a
    failed one none. `log_q` (draws,) is the proposal's log density, `log_weight` (draws,) importance weights.
    `best` has every parameter by its natural name in SI, the stretch and what was held fixed included; `stretch` is
    R_max/R_0 of the answer, whether it was inferred or given. `provenance` is a record for people: nothing reads it.
    """

    names: tuple[str, ...]  # "log10_shear_modulus", "log10_viscosity", "stretch", ...
    units: tuple[str, ...]  # of 10**theta for the log10 names: "Pa", "Pa s", "1"
    theta: Floats
    checks: Checks
    material: str  # "nhkv", "newtonian", ...
    method: str  # "bdt", "amortised", "verified", "least_squares"
    provenance: dict[str, Any] = field(default_factory=dict)  # model, settings, versions, hash of the source
    log_q: Floats | None = None
    log_weight: Floats | None = None
    seconds: float = 0.0  # wall time of this answer
    best: Mapping[str, float] = field(default_factory=dict)
    stretch: float | None = None
    windows: Mapping[str, WindowAnswer] = field(default_factory=dict)  # "1", "2", "3", "all" collapses, if fitted
    evidence: Evidence | None = None
    diagnostics: Diagnostics = Diagnostics()

    def draws(self, name: str) -> Floats | None:
        """(draws,) values of a parameter in natural units (10**theta for "log10_<name>"); None if not inferred.

        `name` is without the log10_ prefix: "shear_modulus" (Pa), "viscosity" (Pa s), "stretch" (1).
        """
        for column, given in enumerate(self.names):
            if given == name:
                return self.theta[:, column]
            if given == "log10_" + name:
                return np.asarray(10.0 ** self.theta[:, column])
        return None

    def interval(self, name: str, level: float = 0.9) -> tuple[float, float] | None:
        """Central credible interval in natural units; None for a point or failed answer (no width is made up)."""
        draws = self.draws(name)
        if draws is None or len(draws) < 2:
            return None
        tail = (1.0 - level) / 2.0
        low, high = weighted_quantile(draws, np.array([tail, 1.0 - tail]), self.log_weight)
        return float(low), float(high)

    def median(self, name: str) -> float | None:
        """Posterior median in natural units; None if the parameter was not inferred or the answer failed."""
        draws = self.draws(name)
        if draws is None or len(draws) == 0:
            return None
        return float(weighted_quantile(draws, np.array([0.5]), self.log_weight)[0])


def weighted_quantile(values: Floats, levels: Floats, log_weight: Floats | None) -> Floats:
    if log_weight is None:
        return np.asarray(np.quantile(values, levels))
    return np.asarray(
        np.quantile(values, levels, weights=np.exp(log_weight - np.max(log_weight)), method="inverted_cdf")
    )
