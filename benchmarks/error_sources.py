"""What is the error of a trained network made of: an offset, its training, or curves that do not hold the answer?

    python benchmarks/error_sources.py DATA [--model NAME] [--run RUN] [--curves 240] [--workers N]

DATA is the set that the model was trained on; the test part is judged, RUN (optional, needs torch) its run's folder.
Printed are, in decades for logarithmic outputs:

- the RMSE, and what an affine map of the outputs, found on the validation part, leaves of it: the rest is no offset;
- with RUN: the RMSE on as many training curves (a gap is overfitting), of the last epoch's weights (errors that two
  epochs do not share are noise of the training), and with dropout left on, averaged: where that removes a bias,
  dropout made it;
- for a sample of test curves, the sensitivity of the curve to each output (RMS over the samples of dR/R_max per unit),
  and the Cramer-Rao bound, the least standard deviation of any unbiased reading of all parameters from a curve with 1 %
  radius noise, in quarters of the curves beside the error made there. The network reads curves without noise, so an
  error above the bound is no lack of information; the bound says where reading is hard.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from cavirheo.errors import InputError
from cavirheo.inference.model import card, path_of, predict
from cavirheo.parameters import LOG10
from cavirheo.physics.accuracy import PRECISE
from cavirheo.prior import TrainingProblem
from cavirheo.training.dataset import load

STEP = {True: 0.03, False: 0.04}  # of the finite differences: decades for logarithms
NOISE = 0.01  # of R_max
DRAWS = 30  # of dropout


def rmse(error: np.ndarray) -> np.ndarray:
    """(outputs,) from errors (curves, outputs)."""
    return np.sqrt(np.mean(error**2, axis=0))


def calibrated(predicted: np.ndarray, of: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """`predicted` (n, outputs) through the affine map that fits `of` to `truth` (m, outputs)."""

    def one_and(values: np.ndarray) -> np.ndarray:
        return np.column_stack([np.ones(len(values)), values])

    return one_and(predicted) @ np.linalg.lstsq(one_and(of), truth, rcond=None)[0]


def sensitivities(problem: TrainingProblem, theta: np.ndarray, workers: int | None) -> np.ndarray:
    """(curves, parameters, frames) derivative of R/R_max by each parameter in the prior's scale."""
    steps = np.diag([STEP[name.startswith(LOG10)] for name in problem.prior.names])
    moved = np.concatenate([theta + sign * step for step in steps for sign in (1, -1)])
    runs = problem.simulate_many(moved, workers=workers, accuracy=PRECISE)
    radius = np.array([run.radius for run in runs]) / problem.reference_max_radius
    up, down = radius.reshape(len(steps), 2, len(theta), -1).transpose(1, 2, 0, 3)
    return (up - down) / (2 * steps.diagonal()[:, None])


def of_the_run(run: Path, radius: dict[str, np.ndarray], truth: dict[str, np.ndarray]) -> None:
    import torch

    from cavirheo.training.train import load_model, read_tensors

    torch.manual_seed(0)
    model = load_model(run / "best.safetensors")

    @torch.inference_mode()
    def error(part: str, draws: int = 1) -> np.ndarray:
        curves = torch.from_numpy(radius[part])
        return np.mean([model(curves).double().numpy() for _ in range(draws)], axis=0) - truth[part]

    best = error("test")
    print("| | RMSE | bias |\n|---|---|---|")

    def row(name: str, e: np.ndarray) -> None:
        print(f"| {name} | {_list(rmse(e), '.3f')} | {_list(e.mean(axis=0), '+.3f')} |")

    row("kept weights, test curves", best)
    row("kept weights, as many training curves", error("train"))
    model.train()
    dropped = error("test", DRAWS)
    model.eval()
    row(f"dropout left on, mean of {DRAWS}", dropped)
    state, _ = read_tensors(run / "last.safetensors")
    model.network.load_state_dict({k.removeprefix("network."): v for k, v in state.items() if k.startswith("network.")})
    last = error("test")
    row("weights of the last epoch", last)
    row("mean of the kept and the last", (best + last) / 2)
    shared = [np.corrcoef(a, b)[0, 1] for a, b in zip(best.T, last.T, strict=True)]
    print(f"\ncorrelation of the errors of the two epochs: {_list(np.array(shared), '.2f')}\n")
    print("| sixth of the true range | " + " | ".join(map(str, range(1, 7))) + " |\n|" + "---|" * 7)
    for k in range(truth["test"].shape[1]):
        values = truth["test"][:, k]
        place = np.clip(np.searchsorted(np.linspace(values.min(), values.max(), 7), values, side="right") - 1, 0, 5)
        for name, e in (("bias", best), ("bias, dropout left on", dropped)):
            cells = [f"{e[place == i, k].mean():+.3f}" for i in range(6)]
            print(f"| output {k + 1}: {name} | " + " | ".join(cells) + " |")
    print()


def _list(values: np.ndarray, form: str) -> str:
    return ", ".join(format(value, form) for value in values)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("data", type=Path)
    parser.add_argument("--model", default="bdt-viscoelastic")
    parser.add_argument("--run", type=Path)
    parser.add_argument("--curves", type=int, default=240)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--seed", type=int, default=3)
    options = parser.parse_args()
    path = path_of(options.model)
    about, data = card(path), load(options.data)
    if data.sha256 != about["data"]["sha256"]:
        raise InputError(f"{options.data} is not the set that {about['name']} was trained on")
    names = [output["name"] for output in about["outputs"]]
    columns = [data.problem.prior.names.index(name) for name in names]
    split = data.split(about["training"]["seed"])
    parts = split | {"train": split["train"][: len(split["test"])]}
    truth = {part: data.theta[index][:, columns] for part, index in parts.items()}
    radius = {part: data.radius[index] for part, index in parts.items()}
    predicted = {part: predict(path, radius[part]) for part in ("test", "validation")}
    error = predicted["test"] - truth["test"]
    mapped = calibrated(predicted["test"], predicted["validation"], truth["validation"]) - truth["test"]
    print(f"{about['name']}, {len(error)} test curves; outputs {', '.join(names)}\n")
    print(f"RMSE {_list(rmse(error), '.3f')}; after an affine map {_list(rmse(mapped), '.3f')}\n")
    if options.run:
        of_the_run(options.run, radius, truth)

    chosen = np.sort(np.random.default_rng(options.seed).permutation(len(error))[: options.curves])
    theta = data.theta[split["test"][chosen]]
    slope = sensitivities(data.problem, theta, options.workers)
    usable = np.isfinite(slope).all(axis=(1, 2))
    chosen, theta, slope = chosen[usable], theta[usable], slope[usable]
    covariance = NOISE**2 * np.linalg.inv(slope @ slope.transpose(0, 2, 1))
    bound = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))[:, columns]
    size = np.sqrt(np.mean(slope**2, axis=2))
    for k, name in enumerate(names):
        print(f"{name}, {len(chosen)} curves in quarters by the bound\n")
        others = [f"sensitivity to {other}" for other in data.problem.prior.names]
        medians = [f"median {other}" for other in data.problem.prior.names]
        head = ["bound at 1 % noise", "RMSE", "after the affine map", *others, *medians]
        print("| " + " | ".join(head) + " |\n|" + "---|" * len(head))
        for quarter in np.array_split(np.argsort(bound[:, k]), 4):
            ends = f"{bound[quarter, k].min():.3f}-{bound[quarter, k].max():.3f}"
            errors = [rmse(e[chosen[quarter]])[k] for e in (error, mapped)]
            numbers = [f"{value:.3f}" for value in (*errors, *np.median(size[quarter], axis=0))]
            print("| " + " | ".join([ends, *numbers, *(f"{v:.1f}" for v in np.median(theta[quarter], axis=0))]) + " |")
        print()


if __name__ == "__main__":
    main()
