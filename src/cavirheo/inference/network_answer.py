"""What networks read off one curve: the fields of a Posterior.

The draws of a posterior network (posterior_network.py) are an answer by themselves, in milliseconds, and their interval
is as good as the training. `infer` starts from them, and simulations weight the draws of its answer (inference/verify,
level "auto"). If the network cannot read a recording, a search starts instead.

The paper's networks are used as the paper uses them: a value is read off the curve at equal Cauchy and Reynolds numbers
(`TrainingProblem.to_shot`). This is not exact: surface tension, heat and mass transfer do not scale, and a 60 um bubble
read as a 245 um one looks 0.3 to 0.4 decades too viscous (docs/method/physics.md, section 1). Other sizes are therefore
outside the network's range. The stretch is not an output of these networks; it is fitted.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError, require
from cavirheo.inference.checks import MISFIT, Window, check_simulation, reconstruct, spike_warnings, window
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.model import Network
from cavirheo.inference.posterior_network import PosteriorModel
from cavirheo.messages import Message
from cavirheo.parameters import STRETCH_RANGE, natural_name, to_natural, to_prior_scale, units
from cavirheo.physics.accuracy import ROUGH, Accuracy
from cavirheo.physics.materials import MATERIALS, Material
from cavirheo.physics.media import Medium
from cavirheo.physics.simulate import simulate_many
from cavirheo.posterior import Checks, Diagnostics, Verdict
from cavirheo.prior import log_normal, natural_values

DRAWS = 1000
START_DRAWS = 100  # draws if a verification follows
SIMULATED_DRAWS = 8  # number of draws, the likeliest for the network, that are simulated to check the answer
MODULUS = "shear_modulus"
MIN_SAMPLES = 0.9  # least share of the network's samples inside the recording; the others repeat the last one
SIZE_RANGE = (0.73, 1.35)  # R_max over that of the training, error of log10 mu up to 0.03 (docs/reproduction.md)
_ACCURACY = Accuracy(48, 1e-3)  # accuracy of simulations that are only compared with each other

Answer = tuple[dict[str, Any], list[Message]]  # fields of a Posterior, `checks` with a verdict, and input warnings


def read_draws(
    shot: Experiment, model: PosteriorModel, checks: Checks, discrepancy: bool, seed: int, verify: str
) -> Answer:
    """The answer of a posterior network, with these checks. discrepancy: whether frames and law may differ by more than
    white noise. verify: level of the verification that starts from the answer. With "none" the likeliest draws are
    simulated, and InputError is raised if the network cannot read the curve."""
    checked, draws = verify == "none", DRAWS if verify in ("none", "map") else START_DRAWS
    source = "given" if shot.stretch else "inferred with the other parameters"
    fields: dict[str, Any] = {"checks": checks, "diagnostics": Diagnostics(stretch_source=source)}

    def network_draws(shot: Experiment) -> tuple[Any, Floats]:
        proposal = model.proposal(shot, shot.prior(), discrepancy)
        return proposal, proposal.draw(draws, np.random.Generator(np.random.Philox(seed)))

    def medians(curve: RadiusCurve) -> Floats:
        shot_without_spikes = Experiment(curve, shot.family, shot.medium, shot.options)
        proposal, u = network_draws(shot_without_spikes)
        return np.asarray(np.median(shot_without_spikes.to_theta(proposal.prior.to_x(u))[1], axis=0))

    try:
        proposal, u = network_draws(shot)
    except InputError as error:
        if checked or not error.code.startswith("network"):
            raise
        middle = shot.starts(np.zeros((1, len(shot.names))))
        middle[:, : shot.law_size] = np.mean(shot.family.bounds(started=True), axis=1)
        names, theta = shot.to_theta(middle)
        return fields | {"names": names, "units": units(names), "theta": theta}, []  # the verification gives the reason
    x = proposal.prior.to_x(u)
    names, theta = shot.to_theta(x)
    log_q = proposal.log_density(u) - log_normal(u) + proposal.prior.log_density(x)
    likeliest = np.argsort(-log_q)[:SIMULATED_DRAWS]
    best = x[likeliest[0]]
    if checked:
        missed = [float(np.mean(shot.difference(x[i], ROUGH) ** 2)) for i in likeliest]
        best = x[likeliest[int(np.argmin(np.nan_to_num(missed, nan=np.inf)))]]
        unbounded = shot.bound_messages(x, proposal.prior.low, proposal.prior.high)
        fields["checks"] = shot.checks(best, "unverified", [Message("interval.of_network"), *unbounded])
    values, log_q = shot.all_values(best), log_q - shot.log_jacobian(theta)
    fields |= {"names": names, "units": units(names), "theta": theta, "log_q": log_q, "best": values}
    fields |= {"stretch": values["stretch"], "prior": shot.law_prior(shot.prior())}
    return fields, spike_warnings(shot.curve, names, medians, np.median(theta, axis=0))


def check_outputs(network: Network) -> None:
    """Raises InputError: a network of one value that does not give all parameters of its law."""
    needed, outputs = set(network.problem.prior.names) - {"stretch"}, ", ".join(network.outputs)
    message = f"the model {network.name} answers only {outputs}; its law needs {', '.join(sorted(needed))}"
    require(needed == {*network.outputs}, message, "model.outputs")


def network_window(network: Network, curve: RadiusCurve, medium: Medium, collapses: int | None) -> Window:
    """The window of a curve that a network of one value reads, of at most `collapses` collapses. Raises InputError."""
    problem = network.problem
    end = problem.grid_step(curve.max_radius, medium) * (problem.grid.frames - 1)
    return window(curve, collapses=collapses, end=end)


def shot_values(network: Network, curve: RadiusCurve, medium: Medium) -> tuple[Floats, dict[str, float], int]:
    """Values (outputs,) in the prior's scale for the reference R_max, values by name for the shot (SI) at equal Cauchy
    and Reynolds numbers, and the number of samples that the recording lacks. Raises InputError: too few."""
    problem, top = network.problem, curve.max_radius
    step, frames = problem.grid_step(top, medium), problem.grid.frames
    features = curve.resampled(step, frames, allow_short=True) / top
    measured = ~np.isnan(features)
    if np.count_nonzero(measured) < MIN_SAMPLES * frames:
        end = step * (frames - 1)
        last = curve.time[np.isfinite(curve.radius)][-1] - curve.time_of_max
        message = f"the recording ends {last * 1e6:.4g} us after R_max; the model reads {end * 1e6:.4g} us (t* = "
        message += f"{end / medium.time_scale(top):.2f}) and needs at least {MIN_SAMPLES:.0%} of them"
        raise InputError(message, "amortised.too_short", curve.name)
    theta = network(np.where(measured, features, features[measured][-1])[None])[0]
    values = problem.to_shot(natural_values(network.outputs, theta), top, medium)
    return theta, values, int(np.count_nonzero(~measured))


def scaled_values(network: Network, values: dict[str, float]) -> Floats:
    """Values of `shot_values` by name as (outputs,) in the prior's scale."""
    return np.array([to_prior_scale(name, value) for name, value in zip(network.outputs, values.values(), strict=True)])


def read_values(
    curve: RadiusCurve, network: Network, medium: Medium, stretch: float | None, collapses: int | None
) -> Answer:
    """The answer of a network of one value. The stretch, if not given, is fitted to at most `collapses` collapses."""
    problem, outputs = network.problem, network.outputs
    theta, values, missing = shot_values(network, curve, medium)
    view = network_window(network, curve, medium, collapses)
    material, source = MATERIALS[problem.material_name](**values), "given"
    if not stretch:
        stretch, source = fit_stretch(view, material, medium), "fitted to the curve with the G and mu of the answer"
    ranges = {name: problem.prior.bounds(name) for name in outputs}
    messages = [
        _outside(natural_name(name), value, low, high)
        for (name, (low, high)), value in zip(ranges.items(), theta, strict=True)
        if not low - 0.02 <= value <= high + 0.02
    ]
    low, high = problem.prior.bounds("stretch")
    if not 0.97 * low <= stretch <= 1.03 * high:
        messages.append(_outside("stretch", stretch, low, high))
    trained_at = problem.reference_max_radius
    low, high = (trained_at * end for end in SIZE_RANGE)
    if not low <= curve.max_radius <= high:
        messages.append(_outside("max_radius", curve.max_radius, low, high, trained_at=trained_at))
    verdict: Verdict = "outside_training_range" if messages else "ok"
    modulus = next((name for name in outputs if natural_name(name) == MODULUS), None)
    if modulus and ranges[modulus][0] - theta[outputs.index(modulus)] > 0.02:
        messages.append(Message("network.liquid"))
    if missing:
        messages.append(Message("network.cut_short", {"missing": missing, "samples": problem.grid.frames}))
    simulated = reconstruct(view, material, medium, stretch)
    if not modulus and np.sqrt(np.mean(simulated["residual_over_rmax"] ** 2)) > MISFIT:
        messages.append(Message("network.elastic"))
    point = scaled_values(network, values)
    best = {natural_name(name): float(to_natural(name, x)) for name, x in zip(outputs, point, strict=True)}
    fields = {
        "theta": point[None],
        "checks": check_simulation(view, simulated, medium.time_scale(curve.max_radius), verdict, messages),
        "best": best | {"stretch": stretch},
        "stretch": stretch,
        "diagnostics": Diagnostics(stretch_source=source),
        "provenance": {"stretch": stretch, "stretch_source": source},
    }

    def read(curve: RadiusCurve) -> Floats:
        return scaled_values(network, shot_values(network, curve, medium)[1])

    return fields, spike_warnings(curve, outputs, read, point)


def _outside(name: str, value: float, low: float, high: float, **more: float) -> Message:
    """A message on a value outside the range of the training; the law's are log10 at the reference R_max."""
    numbers = {"value": float(value), "low": float(low), "high": float(high)}
    return Message(f"training_range.{name}", {"name": name, **numbers, **more})


def fit_stretch(view: Window, material: Material, medium: Medium) -> float:
    """The stretch R_max/R_0 with the smallest RMSE. The whole range is scanned first, because a rebound may slip by a
    period. Raises SolverError: no simulation succeeded."""
    top, measured = view.curve.max_radius, view.normalised
    shot: Any = {"max_radius": top, "time": view.time_since_max, "medium": medium, "workers": 1, "accuracy": _ACCURACY}

    def misfit(stretches: Floats) -> Floats:
        """(k,) RMSE/R_max, infinite where a simulation failed."""
        runs = simulate_many([material] * len(stretches), stretch=stretches, **shot)
        return np.array([np.sqrt(np.mean((run.radius / top - measured) ** 2)) if run.ok else np.inf for run in runs])

    grid = np.geomspace(*STRETCH_RANGE, 18)
    errors = misfit(grid)
    best = int(np.argmin(errors))
    if not np.isfinite(errors[best]):
        raise SolverError(f"no simulation with {material} succeeded at any stretch in {STRETCH_RANGE}")
    bracket = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    from scipy.optimize import minimize_scalar  # a tenth of a second to import

    def cost(stretch: float) -> float:
        return float(misfit(np.array([stretch]))[0])

    return float(minimize_scalar(cost, bounds=bracket, method="bounded", options={"xatol": 0.01}).x)
