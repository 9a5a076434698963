"""From the weighed draws of one experiment to its Posterior: intervals, switches, checks and verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.special import betainc

from cavirheo.arrays import LN10, Bools, Floats, weighted_covariance
from cavirheo.errors import SolverError
from cavirheo.inference.assumptions import Family
from cavirheo.inference.emulator import LARGEST_PULL, elastic_stress, emulator, features, unknown, untrained
from cavirheo.inference.experiment import MISFIT, Experiment
from cavirheo.inference.noise import Noise
from cavirheo.inference.sample import DIFFERENCE, EMULATED, SIMULATED, climb, effective_size
from cavirheo.inference.weigh import Model, Weighed, posterior
from cavirheo.messages import Message
from cavirheo.parallel import run_jobs
from cavirheo.parameters import CAMERA, DECIDING, LOG10, Bound, bound_of, units
from cavirheo.physics.accuracy import BRISK, DEFAULT, Accuracy
from cavirheo.physics.bubble import ZERO_BY_DEFAULT
from cavirheo.physics.laws import NeoHookean
from cavirheo.posterior import Checks, Diagnostics, Evidence, Posterior, Verdict, weighted_quantile
from cavirheo.prior import INSIDE, Prior, State

REPLICATES = 2000  # of the predicted frames
REJECTED = 0.01  # probability under a right law at which the predictive check rejects it
SEEN_MISFIT = 5e-4  # a misfit over R_max that is smaller is not stated
PRIOR_END = 2.3  # a nuisance so far from the middle of its prior has 1 % of it beyond
OPEN_ENDS: dict[str, Bound] = {
    "stretch": "lower",
    "accommodation": "upper",
    "confinement_damping": "lower",
    "confinement_inertia": "lower",
}
"""Ends of nuisances beyond which there is physics: a larger stretch, damping or inertia, a smaller accommodation."""
TRADED = 5.0
"""A parameter is only bounded if it would move by more than so many widths of its interval, were another one that is at
its end further by its whole range."""
ENOUGH = 0.5 * EMULATED.effective  # effective draws below which there is no interval; below twice as many it is rough
DEPENDENT = {
    "stiffening": ("shear_modulus", True),
    "thinning": ("shear_modulus", False),
    "confinement_damping": ("accommodation", True),
    "confinement_inertia": ("accommodation", True),
}
"""Parameters that have a meaning only where the switch of another one is on, or only where it is off: of a gel, of a
liquid, of a real bubble."""
SWITCHES: dict[str, tuple[str, Callable[[Floats], Bools]]] = {
    "shear_modulus": ("liquid", np.isneginf),
    "stiffening": ("stiffening", np.isfinite),
    "thinning": ("thinning", np.isfinite),
    "accommodation": ("field_bubble", np.isposinf),
}
"""The switch of a parameter, and at which values it is on."""
AT_THE_END, LIKELY = 0.8, 0.1  # of the pull that the emulator knows; and a probability that it is larger


class ResidualSource:
    """Residuals of one experiment at x (k, d): quickly by the emulator, or by rough simulations where it does not know
    the bubble (`unknown` says why; `untrained` why it may not serve); and by default simulations. states: of the
    switches. simulations, failures: how many there have been."""

    def __init__(self, shot: Experiment, workers: int | None = 1, *, unknown_because: str = "") -> None:
        self.shot, self.prior, self.workers = shot, shot.prior(), workers
        self.states: list[State] = self.prior.states(DEPENDENT)
        self.measured = shot.measured[shot.counted]
        self.simulations, self.failures = 0, 0
        usual = shot.family.material(np.mean(shot.family.bounds(started=True), axis=1))
        self.unknown: str = unknown_because or unknown(usual, shot.options.bubble, shot.max_radius)
        self.untrained: str = untrained(shot.options.bubble, shot.medium, shot.max_radius)

    def quick(self, x: Floats) -> Floats:
        """Residuals (k, n)."""
        if self.unknown:
            return self._solved(x, BRISK)
        return self.measured - self.shot.emulated(x, emulator())

    def simulated(self, x: Floats) -> Floats:
        """Residuals (k, n) by the default solver; NaN where it fails, and where the emulator has none."""
        residuals = np.full((len(x), len(self.measured)), np.nan)
        known = self._pull(x) <= LARGEST_PULL
        residuals[known] = self._solved(x[known], DEFAULT)
        return residuals

    def _solved(self, x: Floats, accuracy: Accuracy) -> Floats:
        rows = run_jobs(partial(self.shot.difference, accuracy=accuracy), x, self.workers)
        residuals = np.array(rows).reshape(len(x), len(self.measured))
        self.simulations += len(x)
        self.failures += int(np.count_nonzero(~np.isfinite(residuals).all(axis=-1)))
        return residuals

    def _pull(self, x: Floats) -> Floats:
        """(k,) |S_el(R_max)|/p at x (k, d), where there is an emulator that it limits, else 0."""
        return np.zeros(len(x)) if self.unknown or not len(x) else features(self.shot.bubbles(x)).pull

    def too_stiff(self, weighed: Weighed) -> bool:
        """Whether likely bubbles are at the end of what the emulator was trained for."""
        pulled = self._pull(weighed.x) > AT_THE_END * LARGEST_PULL
        return bool(weighed.weights @ pulled > LIKELY)

    def state(self, x: Floats) -> State:
        """The state of the switches at x (d,)."""
        return next(state for state in self.states if state.holds(x))

    def jacobian(self, state: State, u: Floats) -> Floats:
        """(n, d) derivatives of the frames at u (d,) in a state."""
        steps = DIFFERENCE * np.eye(len(u))
        above, below = np.split(-self.quick(state.to_x(np.concatenate([u + steps, u - steps]))), 2)
        return np.asarray(np.nan_to_num((above - below) / (2.0 * DIFFERENCE)).T)

    def models(self, noise: Noise) -> list[Model]:
        """A model for each state of the switches."""
        shared = self.quick, self.simulated, noise
        return [Model(*shared, len(at.columns), at.log_probability, at.to_x, at.to_u) for at in self.states]


def sampled_answer(
    empty: Posterior, shot: Experiment, *, discrepancy: bool, seed: int, workers: int | None = 1
) -> Posterior:
    """The posterior of an experiment; `empty` gives what does not depend on the draws. Raises SolverError: no bubble
    can be simulated."""
    noise = shot.noise(discrepancy)
    target, weighed = _drawn(shot, noise, workers, seed)
    prior = target.prior
    found = _with_draws(replace(empty, medium=shot.medium), target, weighed)
    best = int(np.argmax(weighed.log_posterior))
    p_value, excess = predictive_misfit(target, noise, weighed, best)
    pulled = _at_prior_ends(shot, prior, weighed)
    verdict, messages = _bounds(found, shot.family)
    if target.unknown:
        messages.append(Message("sampled_by_solver", {"reason": target.unknown}))
    if p_value is not None and p_value < REJECTED and excess > 0.0:
        if not discrepancy or excess > MISFIT:
            verdict = "does_not_fit"
        limits = {"detectable": SEEN_MISFIT, "limit": MISFIT, "exact": not discrepancy}
        messages.append(Message("misfit.systematic", {"excess": excess, "p_value": p_value, **limits}))
    at_ends = open_ends(prior, weighed.x, weighed.log_weight)
    traded = trades(prior, weighed.x, weighed.log_weight, _parameters_with_bounds(shot.family), at_ends)
    found = replace(found, traded={name: bound for name, (_, bound) in traded.items()})
    if verdict == "ok" and any(name in DECIDING for name in traded):
        verdict = "bound"
    for name, (other, bound) in traded.items():
        messages.append(Message(f"traded.{name}", {"name": name, "other": other, "bound": bound}))
    stiffens = found.switches.get("stiffening", 0.0) > 0.5
    if shot.curve.begins_late and stiffens:
        messages.append(Message("stiffening.late_start"))
    messages += [Message(f"prior_end.{name}.{end}") for name, end in pulled.items()]
    messages += shot.messages
    diagnostics = Diagnostics(
        at_bound=(*(name for name in pulled if name in CAMERA), *at_ends),
        frames_left_out=int(np.count_nonzero(~shot.counted)),
        draws=len(weighed.x),
        effective_sample_size=weighed.effective,
        p_value=p_value,
        systematic_misfit_over_rmax=excess,
        simulations=target.simulations,
        failed_simulations=target.failures,
        modulus_over_scale=sensitivity_to_scale([found], "shear_modulus"),
        viscosity_over_scale=sensitivity_to_scale([found], "viscosity"),
        secant_modulus=secant_modulus(shot, weighed) if stiffens else (),
    )
    provenance = {**empty.provenance, "discrepancy": discrepancy, "prior": prior.to_dict(), "seed": seed}
    checks = shot.checks(weighed.x[best], verdict, messages)
    checks = replace(checks, predicted_over_rmax=predicted(shot, noise, weighed, best, checks, seed))
    found = replace(found, provenance=provenance, checks=checks, diagnostics=diagnostics)
    if weighed.effective < ENOUGH:
        return _without_interval(found, best)
    if weighed.effective < EMULATED.effective:
        rough = Message("interval.rough", {"effective": weighed.effective, "usual": EMULATED.effective})
        found = replace(found, checks=replace(checks, messages=(*checks.messages, rough)))
    if target.too_stiff(weighed):
        return found.without_draws(Message("interval.too_stiff", {"pull": LARGEST_PULL}))
    return found


def _drawn(shot: Experiment, noise: Noise, workers: int | None, seed: int) -> tuple[ResidualSource, Weighed]:
    """The weighed draws, by the emulator where it serves, and where their residuals come from. Raises SolverError: no
    bubble can be simulated."""
    target = ResidualSource(shot, workers)
    drawn = posterior(target.models(noise), seed, SIMULATED if target.unknown else EMULATED)
    if drawn.effective < ENOUGH and target.untrained and not target.unknown:
        tried, target = target, ResidualSource(shot, workers, unknown_because=target.untrained)
        drawn = posterior(target.models(noise), seed, SIMULATED)
        target.simulations += tried.simulations
        target.failures += tried.failures
    solved = drawn.solved
    if not len(solved.x):
        raise SolverError(f"{shot.curve.name}: none of {len(drawn.x)} likely bubbles can be simulated")
    return target, solved


def _without_interval(found: Posterior, best: int) -> Posterior:
    """The answer with too few effective draws for an interval: of a law that does not follow the recording the best
    draw, as the nearest that this law can come; of any other a failed one."""
    how = found.diagnostics
    unfit = Message(
        "interval.distrusted", {"draws": how.draws, "effective": how.effective_sample_size, "needed": ENOUGH}
    )
    if found.checks.verdict != "does_not_fit":
        return found.without_draws(unfit)
    checks = replace(found.checks, messages=(*found.checks.messages, unfit))
    return replace(found, theta=found.theta[best : best + 1], log_weight=None, checks=checks)


def _with_draws(empty: Posterior, target: ResidualSource, weighed: Weighed) -> Posterior:
    """The answer with the draws, their evidence and switches, and the best of them."""
    shot, prior, x = target.shot, target.prior, weighed.x
    names, theta = shot.to_theta(x)
    values = shot.all_values(x[int(np.argmax(weighed.log_posterior))])
    if values.get("accommodation") == np.inf:  # the field's bubble, as in theta
        values |= {"accommodation": 1.0} | dict.fromkeys(ZERO_BY_DEFAULT, 0.0)
    return replace(
        empty,
        names=names,
        units=units(names),
        theta=theta,
        log_weight=weighed.log_weight,
        best=values,
        stretch=values["stretch"],
        evidence=Evidence(weighed.log_evidence, weighed.error),
        prior={LOG10 + name: tuple(row) for name, row in prior.to_dict().items() if name in shot.family.parameters},
        stretch_prior=shot.stretch_prior,
        switches=_switches(prior, x, weighed.weights),
    )


def _parameters_with_bounds(family: Family) -> list[str]:
    """Parameters of a law of which a bound is said: no stiffening or thinning that may be 0, for the probabilities of
    the switches tell of them."""
    return [name for name in family.parameters if name == "shear_modulus" or name not in family.atoms]


def _bounds(answer: Posterior, family: Family) -> tuple[Verdict, list[Message]]:
    """A message for each parameter of the law, and for the stretch, that is only bounded, and the verdict. None for a G
    that is 0."""
    verdict: Verdict = "ok"
    messages: list[Message] = []
    for name in (*_parameters_with_bounds(family), "stretch"):
        bound = answer.bound(name) if name in answer.parameters else None
        ends = answer.interval(name) if bound else None
        if ends is None or ends[1] == 0.0:
            continue
        messages.append(Message(f"bound.{name}.{bound}", {"name": name, "bound": bound}))
        if name in DECIDING:
            verdict = "bound"
    return verdict, messages


def _switches(prior: Prior, x: Floats, weight: Floats) -> dict[str, float]:
    """Posterior probabilities of the switches that the prior has, from draws x (k, d) with weights (k,)."""
    probabilities: dict[str, float] = {}
    for name, column, zero, infinite in zip(prior.names, x.T, prior.zero, prior.infinite, strict=True):
        if name in SWITCHES and zero + infinite > 0.0:
            switch, is_on = SWITCHES[name]
            probabilities[switch] = float(weight @ is_on(column))
    return probabilities


def trades(
    prior: Prior, x: Floats, log_weight: Floats, law: Sequence[str], at_ends: Sequence[str]
) -> dict[str, tuple[str, Bound]]:
    """The parameters of a law that trade against one of those at an end of their ranges, with this one and the bound
    that is left: a value on the side to which it would move them is not excluded."""
    columns = dict(zip(prior.names, x.T, strict=True))
    found: dict[str, tuple[str, Bound]] = {}
    for other in at_ends:
        outwards = np.ptp(prior.bounds(other)) * (1.0 if OPEN_ENDS[other] == "lower" else -1.0)
        for name in law:
            pair = weighted_covariance(columns[name], columns[other], log_weight)
            if pair is None:
                continue
            moved = outwards * pair[0, 1] / (pair[1, 1] + 1e-300)
            some = np.isfinite(columns[name])
            low, high = weighted_quantile(columns[name][some], [0.05, 0.95], log_weight[some]).tolist()
            if abs(moved) > TRADED * (high - low):
                found[name] = other, "lower" if moved > 0.0 else "upper"
    return found


def open_ends(prior: Prior, x: Floats, log_weight: Floats) -> list[str]:
    """The nuisances whose intervals reach an end beyond which there is physics."""
    columns = dict(zip(prior.names, x.T, strict=True))
    reached = list[str]()
    for name, end in OPEN_ENDS.items():
        if name not in columns or len(x) < 2:
            continue
        low, high = prior.bounds(name)
        ends = weighted_quantile(columns[name], [0.05, 0.95], log_weight).tolist()
        if bound_of(name, min(ends[0], high), min(ends[1], high), (low, high)) == end:
            reached.append(name)
    return reached


def _at_prior_ends(shot: Experiment, prior: Prior, weighed: Weighed) -> dict[str, str]:
    """The free parameters of bubble and camera of which most draws are at the end of their prior, with this end."""
    weight, u = weighed.weights, prior.to_u(weighed.x, INSIDE)
    ends: dict[str, str] = {}
    for name, values in zip(prior.names, u.T, strict=True):
        for end, beyond in (("lower", values < -PRIOR_END), ("upper", values > PRIOR_END)):
            usual = name in ZERO_BY_DEFAULT and end == "lower"
            if name in (*shot.free, *shot.walls) and not usual and weight @ beyond > 0.5:
                ends[name] = end
    return ends


def predictive_misfit(target: ResidualSource, noise: Noise, weighed: Weighed, best: int) -> tuple[float | None, float]:
    """The p-value of the predictive check at the best draw, and the misfit beyond noise; if the check rejects, that of
    the nearest that the law can come by least squares."""
    shot, at, residual = target.shot, weighed.x[best], weighed.residuals[best]
    state = target.state(at)
    u = state.to_u(at[None], INSIDE)
    p_value = predictive_check(residual, target.jacobian(state, u[0]), noise.deviation)
    excess = shot.misfit(residual)
    if p_value is not None and p_value < REJECTED:
        white = Noise(np.full(len(residual), np.median(noise.deviation)), shot.time_since_max[shot.counted], 1.0, False)
        shift = residual - target.quick(at[None])[0]
        nearest = climb(lambda v: target.quick(state.to_x(v)) + shift, white, u).u
        excess = min(excess, shot.misfit(target.simulated(state.to_x(nearest))[0]))
    return p_value, excess


def predicted(shot: Experiment, noise: Noise, weighed: Weighed, best: int, checks: Checks, seed: int) -> Floats | None:
    """(m, 2) ends of the central 90 % of what a frame at the compared times (m,) would measure minus the best
    simulation: of simulations of draws, each with noise. They are widened, all alike, until they hold 90 % of the
    frames: a smooth difference of many frames is a single rare one to the distribution of the noise."""
    if checks.compared_time is None:
        return None
    residual = weighed.residuals[best]
    deviation = noise.deviations(residual, shot.averaged[shot.counted])
    rng = np.random.Generator(np.random.Philox(seed))
    chosen = rng.choice(len(weighed.x), REPLICATES, p=weighed.weights)
    frames = residual - weighed.residuals[chosen] + deviation * rng.standard_normal((REPLICATES, len(residual)))
    low, middle, high = np.quantile(frames, [0.05, 0.5, 0.95], axis=0)
    beyond = np.quantile(np.maximum((residual - middle) / (high - middle), (middle - residual) / (middle - low)), 0.9)
    ends = middle + max(beyond, 1.0) * (np.array([low, high]) - middle)
    time = shot.time_since_max[shot.counted] + shot.curve.time_of_max
    return np.column_stack([np.interp(checks.compared_time, time, end) for end in ends])


def secant_modulus(shot: Experiment, weighed: Weighed) -> tuple[float, ...]:
    """`Diagnostics.secant_modulus` of the draws."""
    elastic = shot.family.material(weighed.x[:, : shot.law_size]).parts().elastic
    if elastic is None:
        return ()
    stretch = np.broadcast_to(shot.natural(weighed.x.T)["stretch"], len(weighed.x))
    pull, of_one = (elastic_stress(law, stretch)[:, 0] for law in (elastic, NeoHookean(np.ones((len(stretch), 1)))))  # type: ignore[arg-type]
    return tuple(weighted_quantile(pull / of_one, [0.05, 0.5, 0.95], weighed.log_weight).tolist())


def sensitivity_to_scale(answers: Sequence[Posterior], name: str) -> float | None:
    """Relative change of a parameter (natural name) of G or mu per relative change of R_max: the common slope of its
    logarithm on the radius scale, within the draws of each shot that determines it. The frames hardly tell the scale,
    so its draws are those of its prior. None where no shot determines the parameter or infers the scale."""
    products, squares = 0.0, 0.0
    for answer in answers:
        if not {name, "radius_scale"} <= answer.parameters.keys() or answer.bound(name):
            continue
        value, scale = (answer.theta[:, answer.names.index(column)] for column in (LOG10 + name, "radius_scale"))
        log_weight = np.zeros(len(value)) if answer.log_weight is None else answer.log_weight
        pair = weighted_covariance(value, scale, log_weight)
        if pair is None or pair[0, 0] <= 0.0:  # one place that is drawn many times
            continue
        worth = effective_size(log_weight[np.isfinite(value)]) / pair[0, 0]
        products += worth * pair[0, 1]
        squares += worth * pair[1, 1]
    return LN10 * products / squares if squares else None


def predictive_check(residual: Floats, jacobian: Floats, deviation: Floats) -> float | None:
    """Probability that white noise alone makes neighbours as alike as those of residuals (n,) at a maximum, with the
    derivatives of the frames (n, d) there and their assumed deviations (n,); None for fewer than 9 frames. It does not
    depend on the size of the deviations.

    Noise is refitted as the measurement was: its residual is e = M z, M = 1 - J (J'J + ridge)^-1 J'. Mean and variance
    of r = e'A e/e'e, A the mean of both neighbours, are those of a projection M; r is between -1 and 1, and taken as of
    a beta distribution. The correlation of neighbours of Durbin and Watson 1951, doi:10.1093/biomet/38.1-2.159.
    """
    n, d = jacobian.shape
    if n < max(9, d + 3):
        return None
    scaled, J = residual / deviation, jacobian / deviation[:, None]
    variance = float(scaled @ scaled) / max(n - d, 1)
    left = np.eye(n) - J @ np.linalg.solve(J.T @ J + variance * np.eye(d), J.T)
    alike = 0.5 * (np.eye(n, k=1) + np.eye(n, k=-1))
    form, size = left.T @ alike @ left, float(np.sum(left**2))
    mean = float(np.trace(form)) / size
    variance_of_r = 2.0 * (float(np.sum(form**2)) / size - mean**2) / (size + 2.0)
    shapes = (1.0 - mean**2) / variance_of_r - 1.0  # sum of both shape parameters of the beta distribution of (1 + r)/2
    correlation = float(scaled @ alike @ scaled / (scaled @ scaled))
    return float(betainc(0.5 * (1.0 - mean) * shapes, 0.5 * (1.0 + mean) * shapes, 0.5 * (1.0 - correlation)))
