"""What a worse recording costs: a model's metrics on simulated curves filmed with noise, at another frame rate, ...

Radii at the camera's own times come from the solver, not from the curves of the set. The recording then goes the way
of every measurement, R_max and its time being fitted. Without growth it begins at the frame nearest to R_max.
"""

from __future__ import annotations

from collections import Counter
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.bdt import Amortised
from cavirheo.inference.model import Network
from cavirheo.parallel import Executor, Threads
from cavirheo.parameters import natural_name, scaled
from cavirheo.posterior import Posterior
from cavirheo.problem import TrainingProblem
from cavirheo.training.dataset import Dataset, Indices
from cavirheo.training.metrics import metrics
from cavirheo.writing.terminal import bar

ANSWERS = 60  # curves that are also given the default answer, seconds each
SEED = 0
LONGER = 1.05  # the recording outlasts the network's grid by this: a fitted R_max that is too large needs later frames


@dataclass(frozen=True)
class Degradation:
    """How a curve is filmed; the default is the grid of times that the network was trained with."""

    name: str
    noise: float = 0.0  # standard deviation of the radius, of R_max
    frame_rate: float = 1.0  # of that grid
    offset: float = 0.0  # largest distance of the first frame from R_max, frames, to either side
    missing: float = 0.0  # part of the frames that have no radius


DEGRADATIONS = (
    Degradation("as in training"),
    Degradation("1 % radius noise", noise=0.01),
    Degradation("2 % radius noise", noise=0.02),
    Degradation("half the frame rate", frame_rate=0.5),
    Degradation("double the frame rate", frame_rate=2.0),
    Degradation("first frame up to half a frame off", offset=0.5),
    Degradation("10 % of the frames missing", missing=0.1),
)


def robustness(
    network: Network, data: Dataset, chosen: Indices, progress: bool, executor: Executor | None
) -> dict[str, Any]:
    """Metrics of a network on the curves `chosen` of a set, filmed in every way.

    The network reads all of them; the default answer of `infer`, of the same law, is found for ANSWERS of them, drawn
    at random. What a curve suffers depends on (SEED, its index) alone.

    Returns:
        {"seed", "curves", "answers", "rows"}; a row is {"recording", "network", "network_same_curves", "answer",
        "answer_ok"}, each of the last four {"curves", "failed", "metrics"} (None with fewer than 2 answers), the answer
        with "verdicts"; answer_ok are those whose verdict is ok.
    """
    estimator = Amortised(network, data.problem.medium, trust_input=True)
    default = Analysis(material=data.problem.material_name, medium=data.problem.medium, trust_input=True)
    names, truth = network.outputs, data.truth(network.outputs)
    nothing, R_max = np.full(len(names), np.nan), data.problem.reference_max_radius
    sample = np.sort(np.random.default_rng(SEED).permutation(len(chosen))[:ANSWERS])

    def network_answer(curve: RadiusCurve) -> Floats:
        try:
            return estimator.network_only(curve)
        except InputError:  # counted as failed
            return nothing

    def score(values: list[Floats], curves: Indices) -> dict[str, Any]:
        answers = np.reshape(values, (len(curves), len(names)))
        finite = np.isfinite(answers).all(axis=1)
        numbers = metrics(names, truth[curves][finite], answers[finite]) if finite.sum() >= 2 else None
        return {"curves": len(curves), "failed": int(np.sum(~finite)), "metrics": numbers}

    rows = []
    filmed: dict[tuple[float, float], list[tuple[Floats, Floats]]] = {}  # several ways film at the same times
    with bar("filming, answering", len(DEGRADATIONS) * len(sample), visible=progress, unit="answers") as advance:
        for degradation in DEGRADATIONS:
            key = degradation.frame_rate, degradation.offset
            if key not in filmed:
                filmed[key] = film(data.problem, data.theta, chosen, degradation)
            curves = [degrade(*true, R_max, degradation, i) for true, i in zip(filmed[key], chosen, strict=True)]
            read = [network_answer(curve) for curve in curves]
            by_index = dict[int, Posterior]()
            answer_one = partial(default.answer, workers=1)
            with closing((executor or Threads()).flow(answer_one, [curves[i] for i in sample])) as flow:
                for index, answer in flow:
                    by_index[index] = answer
                    advance()
            posteriors = [by_index[index] for index in range(len(sample))]
            medians = [[scaled(n, answer.median(natural_name(n))) for n in names] for answer in posteriors]
            answers = list(map(np.array, medians))
            verdicts = [posterior.checks.verdict for posterior in posteriors]
            ok = [i for i, verdict in enumerate(verdicts) if verdict == "ok"]
            rows.append(
                {
                    "recording": asdict(degradation),
                    "network": score(read, chosen),
                    "network_same_curves": score([read[i] for i in sample], chosen[sample]),
                    "answer": score(answers, chosen[sample]) | {"verdicts": dict(Counter(verdicts))},
                    "answer_ok": score([answers[i] for i in ok], chosen[sample[ok]]),
                }
            )
    return {"seed": SEED, "curves": len(chosen), "answers": len(sample), "rows": rows}


def film(
    problem: TrainingProblem, theta: Floats, chosen: Indices, degradation: Degradation
) -> list[tuple[Floats, Floats]]:
    """For each chosen row of theta the times of the camera's frames (n,) s and the true radii (n,) m there."""
    step = problem.grid.frame_interval / degradation.frame_rate
    count = int(np.ceil(LONGER * problem.grid.time[-1] / step)) + 1
    offset = [_random(i, 0).uniform(-degradation.offset, degradation.offset) for i in chosen]
    times = step * (np.arange(count) + np.array(offset)[:, None])
    since_max = np.abs(times)  # half a frame before R_max the curve is, to third order in time, that after it
    order = np.argsort(since_max, axis=1)
    runs = problem.simulate_many(theta[chosen], time=np.take_along_axis(since_max, order, axis=1))
    radii = np.empty_like(times)
    np.put_along_axis(radii, order, np.reshape([run.radius for run in runs], times.shape), axis=1)
    return list(zip(times, radii, strict=True))


def degrade(time: Floats, radius: Floats, max_radius: float, degradation: Degradation, index: int) -> RadiusCurve:
    """The measured curve from true radii (n,) m at the times (n,) s of the frames; R_max scales the noise."""
    rng = _random(index, 1)
    measured = radius + degradation.noise * max_radius * rng.standard_normal(len(radius))
    lost = rng.permutation(len(radius))[: round(degradation.missing * len(radius))]
    measured[lost] = np.nan
    measured[~(measured > 0)] = np.nan  # no camera reports these
    return RadiusCurve(time, measured, meta={"name": f"curve {index}"})


def _random(index: int, stream: int) -> np.random.Generator:
    return np.random.default_rng([SEED, index, stream])
