"""Does the answer depend on the true R_max? Simulated shots with R_max independent of everything else.

    python benchmarks/scale_bias.py [--shots 300] [--noise 0.0] [--model NAME]

Draws the parameters from the model's training prior and R_max uniformly from 60-450 um, films each shot at 1 Mfps from
the maximum on, and reports the bias of each output in three terciles of R_max: for the network's answer scaled at equal
Cauchy and Reynolds numbers, and for the default answer of `infer` with the same law. First it shows what is at stake
without any network: curves of one R_max fitted (least squares in all parameters of the prior, at equal Ca and Re) as if
they were of the model's reference R_max. NAME is a shipped model or an .onnx file.
"""

from __future__ import annotations

import argparse

import numpy as np
from cavirheo.inference.network_answer import scaled_values, shot_values
from scipy.optimize import least_squares

from cavirheo.curve import RadiusCurve
from cavirheo.inference import infer_many
from cavirheo.inference.analysis import Analysis
from cavirheo.parameters import LOG10, natural_name, to_prior_scale
from cavirheo.physics.accuracy import ROUGH
from cavirheo.physics.materials import MATERIALS
from cavirheo.physics.simulate import simulate
from cavirheo.prior import TrainingProblem, natural_values

R_MAX = (60e-6, 450e-6)  # m
SYMBOLS = {"shear_modulus": "G", "viscosity": "mu", "stretch": "lambda"}
BEYOND = {True: (1.5, 1.5), False: (1.5, 5.0)}  # room of the fits below and above the prior, by: is it a logarithm


def symbol(name: str) -> str:
    """log10_viscosity -> log10 mu."""
    return ("log10 " if name.startswith(LOG10) else "") + SYMBOLS.get(natural_name(name), natural_name(name))


def shots(
    n: int, noise: float, seed: int, problem: TrainingProblem | None = None
) -> tuple[np.ndarray, list[RadiusCurve]]:
    """(n, parameters + 1) theta in the prior's scale with R_max (m) last, and the curves; the default model's problem
    by default."""
    problem = problem or Analysis(model="bdt-viscoelastic").network.problem
    rng = np.random.default_rng(seed)
    low, high = [*problem.prior.low, R_MAX[0]], [*problem.prior.high, R_MAX[1]]
    truth = rng.uniform(low, high, (n, len(low)))
    curves = []
    for k, (*theta, R_max) in enumerate(truth):
        end = 4.3 * problem.medium.time_scale(R_max)
        time = 1e-6 * (np.arange(int(end / 1e-6) + 1) + rng.uniform())
        stretch = natural_values(problem.prior.names, theta)["stretch"]
        run = simulate(problem.material(theta), max_radius=R_max, stretch=stretch, time=time, medium=problem.medium)
        radius = run.radius + noise * R_max * rng.standard_normal(len(time))
        radius[radius <= 0] = np.nan
        known = (0.0, R_max)  # its own error is not what is asked here
        curves.append(RadiusCurve(time, radius, meta={"name": f"shot {k}"}, maximum=known))
    return truth, curves


def misread(problem: TrainingProblem, R_max: float, n: int, seed: int) -> np.ndarray:
    """(n, parameters) errors in the prior's scale when curves of R_max (m) are fitted as if of the reference R_max."""
    rng = np.random.default_rng(seed)
    names, low, high = problem.prior.names, problem.prior.low, problem.prior.high
    t_star = np.linspace(0.0, 4.07, 100)

    def curve(theta: np.ndarray, R: float) -> np.ndarray:
        of_shot = problem.to_shot(natural_values(names, theta), R)  # theta is at the reference scale
        stretch = of_shot.pop("stretch")
        run = simulate(
            MATERIALS[problem.material_name](**of_shot), max_radius=R, stretch=stretch,
            time=t_star * problem.medium.time_scale(R), medium=problem.medium, accuracy=ROUGH, throw=False,
        )  # fmt: skip
        return np.nan_to_num(run.radius / R, nan=1.0)

    below, above = np.array([BEYOND[name.startswith(LOG10)] for name in names]).T
    errors = []
    for theta in rng.uniform(low, high, (n, len(names))):
        target = curve(theta, R_max)
        found = least_squares(
            lambda x, target=target: curve(x, problem.reference_max_radius) - target,
            theta, bounds=(low - below, high + above), diff_step=1e-3, max_nfev=15,
        )  # fmt: skip
        errors.append(found.x - theta)
    return np.array(errors)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--shots", type=int, default=300)
    parser.add_argument("--noise", type=float, default=0.0)
    parser.add_argument("--model", default="bdt-viscoelastic")
    parser.add_argument("--fits", type=int, default=40, help="0 leaves out what is shown without a network")
    parser.add_argument("--seed", type=int, default=20)
    options = parser.parse_args()
    model = Analysis(model=options.model).network
    problem, names = model.problem, model.problem.prior.names
    if options.fits:
        print(f"Curves of R_max fitted as if of {problem.reference_max_radius * 1e6:.0f} um, median error\n")
        print("| R_max um | " + " | ".join(map(symbol, names)) + " |\n|" + "---|" * (len(names) + 1))
        for micrometres in (60, 100, 150, 350, 450):
            error = np.median(misread(problem, micrometres * 1e-6, options.fits, options.seed), axis=0)
            print(f"| {micrometres} | " + " | ".join(f"{value:+.3f}" for value in error) + " |")
        print()
    truth, curves = shots(options.shots, options.noise, options.seed, problem)
    of_outputs = truth[:, [names.index(name) for name in model.outputs]]
    order = np.argsort(truth[:, -1])
    print(f"{options.shots} shots, noise {options.noise:g} R_max, model {model.name}")
    for way in ("network alone, equal Ca and Re", "default answer"):
        if way == "default answer":
            how = {"material": problem.material_name, "medium": problem.medium, "bubble": "field", "trust_input": True}
            answers = infer_many(curves, **how)
            found = np.array(
                [[to_prior_scale(name, a.median(natural_name(name))) for name in model.outputs] for a in answers]
            )
        else:
            answers, medium = [], problem.medium
            found = np.array([scaled_values(model, shot_values(model, curve, medium)[1]) for curve in curves])
        failed = [a for a in answers if a.checks.verdict == "failed"]
        error = found - of_outputs
        print(f"\n{way}, {len(failed)} failed or without an interval\n")
        outputs = range(len(model.outputs))[::-1]  # the viscosity, which suffers, first
        head = [f"{what} {symbol(model.outputs[k])}" for what in ("bias", "abs. error") for k in outputs]
        print("| R_max um | " + " | ".join(head) + " |\n|" + "---|" * (len(head) + 1))
        for part in np.array_split(order, 3):
            bias, spread = np.nanmedian(error[part], axis=0), np.nanmedian(np.abs(error[part]), axis=0)
            low, high = truth[part, -1].min() * 1e6, truth[part, -1].max() * 1e6
            numbers = " | ".join(f"{values[k]:+.3f}" for values in (bias, spread) for k in outputs)
            print(f"| {low:.0f}-{high:.0f} | {numbers} |")
        for reason in sorted({a.checks.message for a in failed}):
            print("  failed:", reason)


if __name__ == "__main__":
    main()
