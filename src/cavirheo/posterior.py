"""Posterior: the answer for one curve, with the results of its checks and its provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from numbers import Real
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats, at_levels, relative_weights
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.messages import Message, is_input_warning
from cavirheo.parameters import (
    LOG10,
    REFERENCE_RATE,
    Bound,
    bound_of,
    column_name,
    is_law_parameter,
    matching,
    natural_name,
    require_name,
    searched_bound,
    to_natural,
    to_prior_scale,
    wide_bound,
)
from cavirheo.physics.bubble import FIELD, Bubble
from cavirheo.physics.materials import viscosity_at
from cavirheo.physics.media import Medium
from cavirheo.writing import digits, export
from cavirheo.writing.document import Quantity, finite

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Verdict = Literal["ok", "bound", "unverified", "does_not_fit", "check_input", "failed"]
SEVERITY: tuple[Verdict, ...] = get_args(Verdict)  # from the best to the most serious
TRUSTED: frozenset[Verdict] = frozenset(("ok", "bound"))
"""Verdicts of answers that count for a material."""


@dataclass(frozen=True, eq=False)
class Checks:
    """Results of comparing the simulated answer with the measurement; None for values that could not be computed.

    Attributes:
        verdict: "ok", or what is wrong (docs/method/verdicts.md).
        messages: reasons for the verdict, and other remarks; input warnings first.
        rmse_over_rmax: root mean square of measured minus simulated radius, over R_max.
        collapses: complete collapses in the compared window.
        t_star_end: end of the compared window, t/t_c after R_max.
        compared_time: (m,) s, times of the compared frames on the measurement's clock.
        residual_over_rmax: (m,) (measured - simulated)/R_max at these times.
        predicted_over_rmax: (m, 2) ends of the central 90 % of what a frame at these times would measure, by the draws
            and their noise, minus the simulation, over R_max.
        reconstruction_time: (k,) s on the measurement's clock, dense enough for a plot.
        reconstruction_radius: (k,) m, the simulated radius.
        time_scale: t_c = R_max sqrt(rho/p) of the shot in its medium, s.
    """

    verdict: Verdict
    messages: tuple[Message, ...] = ()
    rmse_over_rmax: float | None = None
    collapses: int | None = None
    t_star_end: float | None = None
    compared_time: Floats | None = field(default=None, repr=False)
    residual_over_rmax: Floats | None = field(default=None, repr=False)
    predicted_over_rmax: Floats | None = field(default=None, repr=False)
    reconstruction_time: Floats | None = field(default=None, repr=False)
    reconstruction_radius: Floats | None = field(default=None, repr=False)
    time_scale: float | None = None

    @property
    def message(self) -> str:
        """All messages in one line, for users."""
        return "; ".join(message.text for message in self.messages)

    @property
    def warnings(self) -> tuple[Message, ...]:
        """The messages about the recording and its settings."""
        return tuple(message for message in self.messages if is_input_warning(message.code))


@dataclass(frozen=True)
class Evidence:
    """The evidence (marginal likelihood) of a law.

    Attributes:
        log: natural logarithm of p(frames | law).
        error: standard error of `log`; None where it is not known.
    """

    log: float
    error: float | None = None


@dataclass(frozen=True)
class Pair:
    """The comparison of two laws by the shots of a group.

    Attributes:
        first: the law with the larger evidence.
        second: the law with the smaller evidence.
        difference: sum over the shots of the differences of log evidence.
        error: its standard error, from the scatter over the shots.
        shots: numbers of shots that have the larger evidence with the first and with the second.
    """

    first: str
    second: str
    difference: float
    error: float
    shots: tuple[int, int]


@dataclass(frozen=True)
class Heap:
    """Shots of a group whose intervals of a parameter are alike, where those of others are not.

    Attributes:
        shots: their names.
        low: lower end of their intervals, SI; None if they are only bounded from above.
        high: upper end of their intervals, SI; None if they are only bounded from below.
    """

    shots: tuple[str, ...]
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Diagnostics:
    """How an answer was computed and how reliable its interval is; None or empty if the method has no such value.

    Attributes:
        at_bound: clock, scale and R_max factor that are at an end of their priors, and other parameters that are at
            an end beyond which there is physics.
        frames_left_out: number of frames that are not used: spikes, and a rise as by another bubble.
        draws: number of weighted draws.
        effective_sample_size: number of independent draws that they are worth.
        p_value: probability that noise alone makes neighbouring residuals so alike.
        systematic_misfit_over_rmax: root mean square misfit of the best simulation beyond the noise, over R_max.
        simulations: number of simulations.
        failed_simulations: number of failed simulations.
        modulus_over_scale: relative change of G per relative change of R_max; None if G is only bounded.
        viscosity_over_scale: relative change of mu per relative change of R_max; None if mu is only bounded.
        secant_modulus: 5 %, 50 % and 95 % of the modulus, Pa, of the neo-Hookean gel that pulls as strongly at R_max;
            of a gel that most probably stiffens, whose G is that of small strains.
    """

    at_bound: tuple[str, ...] = ()
    frames_left_out: int | None = None
    draws: int | None = None
    effective_sample_size: float | None = None
    p_value: float | None = None
    systematic_misfit_over_rmax: float | None = None
    simulations: int | None = None
    failed_simulations: int | None = None
    modulus_over_scale: float | None = None
    viscosity_over_scale: float | None = None
    secant_modulus: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Posterior:
    """Posterior draws of the parameters for one curve, and their best values.

    Attributes:
        names: of the inferred parameters in the prior's scale: "log10_shear_modulus", "log10_viscosity", "stretch", ...
        units: of the parameters (of 10**theta for the log10 names): "Pa", "Pa s", "1".
        theta: (draws, parameters) in the prior's scale (log10 for G and mu); a point answer is one draw, and a
            failed one none.
        checks: results of comparing the simulated answer with the measurement.
        material: name of the law: "nhkv", "newtonian", ...
        method: name of the method: "bdt", "verified", "least_squares".
        provenance: model, settings, versions and hash of the source, as a record for users.
        log_weight: (draws,) log of importance weights.
        seconds: wall time of the computation.
        best: best value of every parameter by its natural name in SI, including the stretch and fixed parameters.
        stretch: R_max/R_0 of the answer, whether it was inferred or given.
        evidence: of the law, if it was computed.
        diagnostics: how the answer was computed.
        bubble: the model of the bubble itself.
        medium: the constants of the surroundings and of the contents of the bubble.
        prior: of the law's parameters, by name as in `names`: (low, high) if uniform, (low, high, mean, standard
            deviation) if normal; parameters with an unknown prior are missing.
        stretch_prior: mean and standard deviation of the stretch, where the file or the late plateau states it.
        traded: bounds of parameters that trade against another one, which is at the end of its range, by natural name.
        curve: the recording that was answered; None in a file of an unfinished run.
        switches: probability of each switch of the default family: "liquid" (G is 0), "stiffening", "thinning" (of a
            liquid), "field_bubble".
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    theta: Floats
    checks: Checks
    material: str
    method: str
    provenance: dict[str, Any] = field(default_factory=dict)
    log_weight: Floats | None = None
    seconds: float = 0.0
    best: Mapping[str, float] = field(default_factory=dict)
    stretch: float | None = None
    evidence: Evidence | None = None
    diagnostics: Diagnostics = Diagnostics()
    bubble: Bubble = FIELD
    medium: Medium | None = None
    prior: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    stretch_prior: tuple[float, float] | None = None
    switches: Mapping[str, float] = field(default_factory=dict)
    traded: Mapping[str, Bound] = field(default_factory=dict)
    curve: RadiusCurve | None = None

    @property
    def name(self) -> str:
        """The name of the curve; "" without one."""
        return self.curve.name if self.curve else ""

    def __repr__(self) -> str:
        """Name, material, method, verdict and messages, then a line per parameter: median, 90 % interval, unit."""
        of = f"{self.name}: " if self.curve else ""
        verdict = ": ".join(filter(None, [self.checks.verdict, self.checks.message]))
        lines = [f"Posterior({of}{self.material}, {self.method}, {len(self.theta)} draws): {verdict}"]
        for name, unit in self.parameters.items():
            value = digits.quantity(self.quantity(name), unit="" if unit == "1" else unit)
            lines.append(f"  {name:<20}{value}")
        if self.stretch is not None and "stretch" not in self.parameters:
            lines.append(f"  {'stretch':<20}{digits.number(self.stretch)}")
        return "\n".join(lines)

    @property
    def parameters(self) -> dict[str, str]:
        """Natural names of the inferred parameters, with their units: {"shear_modulus": "Pa", ...}."""
        return dict(zip(map(natural_name, self.names), self.units, strict=True))

    @property
    def weights(self) -> Floats:
        """(draws,) weights that sum to 1."""
        weight = np.ones(len(self.theta)) if self.log_weight is None else relative_weights(self.log_weight)
        return np.asarray(weight / weight.sum())

    def draws(self, name: str) -> Floats:
        """(draws,) values of a parameter in natural units: of "G" (or "shear_modulus") in Pa, of "mu" (or "viscosity")
        in Pa s, of "lambda" (or "stretch"), ...; none if the answer failed. Raises InputError: the parameter was not
        inferred."""
        prior_name = self._prior_name(name)
        return to_natural(prior_name, self.theta[:, self.names.index(prior_name)])

    def interval(self, name: str, level: float = 0.9) -> tuple[float, float] | None:
        """Central credible interval with the probability `level`, in natural units; None for a point or failed answer,
        which has no width. The high end of an upper bound of the law's parameters is by `upper_limit`. Errors that all
        shots of a camera share (scale, frame rate, density, pressure) are in the interval of a `population`, and in the
        line that the command prints. Raises InputError: as `draws`, or the level is not between 0 and 1."""
        check_level(level)
        values = self.draws(name)
        if len(values) < 2:
            return None
        low, high = weighted_quantile(values, [0.5 - 0.5 * level, 0.5 + 0.5 * level], self.log_weight).tolist()
        if self.bound(name) == "upper" and self._prior_name(name).startswith(LOG10):
            high = upper_limit(values, 0.5 + 0.5 * level, self.log_weight)
        return low, high

    def _prior_name(self, name: str) -> str:
        """The name of a parameter in the prior's scale."""
        inferred = [*self.parameters]
        held = matching(name, self.best)
        owner = f"the answer (of {held}, which was not inferred, `best` has the value)" if held else "the answer"
        return self.names[inferred.index(require_name(name, inferred, owner, "posterior.parameter"))]

    def bound(self, name: str) -> Bound | None:
        """What is known if the central 90 % of the draws reach an end of the range of `prior` (else of the search):
        "upper" (the value is below the interval's upper end), "lower" (above its lower end), "undetermined" (nothing);
        or "wide", if the interval of G or of a viscosity lies within the range, but its ends are a factor of more than
        10 apart. None: the value is known, or there are fewer than two draws. Raises InputError: as `draws`."""
        values = self.draws(name)
        if len(values) < 2:
            return None
        prior_name = self._prior_name(name)
        natural = natural_name(prior_name)
        low, high = weighted_quantile(values, [0.05, 0.95], self.log_weight).tolist()
        if prior_name in self.prior:
            least, largest, *_ = self.prior[prior_name]
            first, last = (to_prior_scale(prior_name, end) for end in (low, high))
            reached = bound_of(natural, first, last, (least, largest))
        else:
            reached = searched_bound(natural, low, high)
        return reached or self.traded.get(natural) or wide_bound(natural, low, high)

    def quantity(self, name: str) -> Quantity:
        """Median, interval and bound in natural units; empty if the answer failed. Raises InputError: as `draws`."""
        low, high = self.interval(name) or (None, None)
        return Quantity(median=finite(self.median(name)), q05=low, q95=high, bound=self.bound(name))

    def median(self, name: str) -> float | None:
        """Posterior median in natural units; NaN of a bound, None if it failed. Raises InputError: as `draws`."""
        if self.bound(name):
            return np.nan
        draws = self.draws(name)
        return float(weighted_quantile(draws, 0.5, self.log_weight)) if len(draws) else None

    def without_draws(self, *messages: Message) -> Posterior:
        """The failed answer to the same question, without draws and values, for the reasons in its messages and in
        these."""
        checks = Checks("failed", (*messages, *self.checks.messages))
        nothing: dict[str, Any] = dict.fromkeys(("log_weight", "evidence", "stretch", "stretch_prior"))
        nothing |= {"best": {}, "switches": {}}
        return replace(self, theta=self.theta[:0], checks=checks, **nothing)

    def to_dataframe(self) -> Any:
        """The draws as a pandas.DataFrame: a column per parameter, named as in result.csv ("shear_modulus_Pa", ...),
        and "weight", which sums to 1. Raises InputError without pandas."""
        columns = {column_name(name, unit): self.draws(name) for name, unit in self.parameters.items()}
        return export.dataframe({**columns, "weight": self.weights}, self._attributes)

    def to_arviz(self) -> Any:
        """The draws as arviz.InferenceData (ArviZ below 1) or xarray.DataTree (from 1 on): "posterior" holds the
        parameters in natural units (attribute "units"), one chain of draws of equal weight, which are resampled
        systematically by their weights. Raises InputError: a failed answer has no draws, or arviz is missing."""
        self._require_draws(1)
        count = len(self.theta)
        equal = at_levels(self.weights, (np.arange(count) + 0.5) / count)
        draws = {name: self.draws(name)[equal] for name in self.parameters}
        return export.inference_data(draws, self.parameters, self._attributes)

    def plot(self) -> Figure:
        """Figure of the measured radius, the band that holds 90 % of what the answer predicts, and the residual of its
        simulation. Raises InputError: the answer has no curve, or matplotlib is missing."""
        draw: Any = resolve_name("cavirheo.reporting.pictures.answer_figure")  # reporting imports this module
        figure: Figure = draw(self)
        return figure

    def corner(self, *names: str) -> Figure:
        """Figure of the draws of each parameter, with the median and the central 90 %, and of each pair of them.

        names: of the parameters; default: those of the law that are not exactly 0 in most draws, and the stretch.
        Raises InputError: a point answer or a failed one has no draws, no such parameter, or corner is missing."""
        self._require_draws(2)
        usual = [name for name in self.parameters if is_law_parameter(name) or name == "stretch"]
        counted = [name for name in usual if weighted_quantile(self.draws(name), 0.5, self.log_weight) != 0.0]
        chosen = [natural_name(self._prior_name(name)) for name in names or counted]
        draw: Any = resolve_name("cavirheo.reporting.pictures.corner_figure")
        figure: Figure = draw({name: self.draws(name) for name in chosen}, self.weights)
        return figure

    def _require_draws(self, least: int) -> None:
        if len(self.theta) < least:
            why = "failed" if self.checks.verdict == "failed" else f"is one value, by {self.method}"
            raise InputError(f"the answer has no draws, for it {why}", "posterior.no_draws", self.name)

    @property
    def _attributes(self) -> dict[str, str]:
        return {"material": self.material, "method": self.method, "verdict": self.checks.verdict}


def check_level(level: object) -> None:
    """Raises InputError unless the level is a number between 0 and 1."""
    value = float(level) if isinstance(level, Real) else 0.0
    if not 0 < value < 1:
        raise InputError(f"the level of an interval must be between 0 and 1, got {level!r}", "posterior.level")


def upper_limit(values: Floats, level: float, log_weight: Floats | None = None) -> float:
    """The value below which a parameter is with this probability, from draws (k,) with log weights (k,), where they
    reach down to 0. The prior of a limit is flat in the value, not in its logarithm as that of the draws: it hangs
    neither on how far down the range of the logarithm goes, nor on the probability that the value is exactly 0."""
    above = values > 0.0
    if not np.any(above):
        return 0.0
    flat = np.log(values[above]) + (0.0 if log_weight is None else log_weight[above])
    return float(weighted_quantile(values[above], level, flat))


def weighted_quantile(values: Floats, levels: ArrayLike, log_weight: Floats | None) -> Floats:
    """Quantiles of the values along their first axis at these levels, weighted by exp(log_weight). A level above one
    half is counted from the top, so that an interval leaves out as much on either side."""
    level = np.asarray(levels, float)
    if log_weight is None:
        return np.asarray(np.quantile(values, level, axis=0))
    options: Any = {"weights": relative_weights(log_weight), "method": "inverted_cdf", "axis": 0}
    from_below = np.quantile(values, level, **options)
    from_above = -np.quantile(-values, np.round(1.0 - level, 12), **options)
    high = np.reshape(level > 0.5, level.shape + (1,) * (values.ndim - 1))
    return np.where(high, from_above, from_below)


def viscosity_at_rate(material: str, draws: Mapping[str, Floats], log_weight: Floats | None = None) -> Quantity | None:
    """The viscosity at 1e5 1/s of a law that has none of its own, from draws (k,) of its parameters by natural name,
    SI; None for another law, or without draws. Draws of a population that are no such law are left out."""

    def of_draw(values: Mapping[str, float]) -> float | None:
        try:
            return viscosity_at(material, REFERENCE_RATE, values)
        except InputError:
            return np.nan

    rows = [dict(zip(draws, row, strict=True)) for row in zip(*draws.values(), strict=True)]
    if not rows or of_draw(rows[0]) is None:
        return None
    viscosities = np.array([of_draw(row) for row in rows], dtype=float)
    possible = np.isfinite(viscosities)
    if not possible.any():
        return None
    if len(rows) == 1:
        return Quantity(median=viscosities[0])
    log_weight = None if log_weight is None else log_weight[possible]
    ends = 10.0 ** weighted_quantile(np.log10(viscosities[possible]), [0.05, 0.5, 0.95], log_weight)
    return Quantity.from_interval(*ends.tolist())
