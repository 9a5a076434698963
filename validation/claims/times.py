"""From start to answer: one simulated shot, 20 in one call on all cores, and the command with one shot.

Seconds are those of the clock, which the load of the machine makes longer, and of the processor (all threads of one
shot); ratios are of one run. "worth": processor seconds of an answer over those of a default simulation of its bubble,
which was run directly after it. The part `newcomer`, which installs the package in an empty environment, runs where it
is named alone: it takes minutes and asks a package index.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cavirheo import Posterior, RadiusCurve, infer_many
from cavirheo.inference.assumptions import Family, Options
from cavirheo.inference.experiment import Experiment
from validation.newcomer import steps
from validation.numbers import Number, Run, statistic
from validation.recordings import STREAM, recording

TOGETHER = 20
SIMULATED = 20  # simulations that are timed
PARTS = ("newcomer",)


def seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def simulation_seconds(curve: RadiusCurve, answer: Posterior) -> float:
    """Processor seconds of one default simulation of the answer's bubble."""
    shot = Experiment(curve, Family(answer.material), answer.medium, Options(bubble=answer.bubble))
    x = shot.from_best(answer.best)
    began = time.process_time()
    for _ in range(SIMULATED):
        shot.predict(x)
    return (time.process_time() - began) / SIMULATED


def newcomer() -> Iterator[Number]:
    """Seconds of each step from nothing to the first answers, and MB of what is installed."""
    with TemporaryDirectory() as folder:
        for step in steps(Path(folder)):
            name = f"newcomer.{step.name}"
            yield statistic(f"{name}.seconds", [step.clock], "s")
            yield statistic(f"{name}.processor_seconds", [step.processors], "s")
            if step.installed:
                yield statistic(f"{name}.size", [step.installed], "MB")


def measure(run: Run) -> Iterator[Number]:
    if run.part == "newcomer":
        yield from newcomer()
        return
    made = [one for i in range(3 * TOGETHER) if (one := recording(i)) is not None][:TOGETHER]
    infer_many(made[:1])  # what is loaded once does not count
    for law, material in (("one_law", "nhkv"), ("one", None)):
        alone, busy, worth = [], [], []
        for one in made:
            began, clock = time.process_time(), time.perf_counter()
            (answer,) = infer_many([one], material=material, trust_input=True)
            alone.append(time.perf_counter() - clock)
            busy.append(time.process_time() - began)
            worth.append(busy[-1] / simulation_seconds(one, answer))
        yield statistic(f"{law}.worth", worth, "simulations", seed=STREAM)
        yield statistic(f"{law}.processor_seconds", busy, "s", seed=STREAM)
        yield statistic(f"{law}.seconds", alone, "s", seed=STREAM)
        yield statistic(f"{law}.seconds.95", alone, "s", partial(np.quantile, q=0.95), STREAM)
    together = [seconds(lambda: infer_many(made, trust_input=True)) for _ in range(run.count(1, 5))]
    yield statistic("twenty.seconds", together, "s", seed=STREAM)
    yield statistic("twenty.ratio", np.array(together) / np.sum(alone), "1", seed=STREAM)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "shot.csv"
        rows = [f"{1e6 * t},{1e6 * r}\n" for t, r in zip(made[0].time, made[0].radius, strict=True)]
        path.write_text("time_us,radius_um\n" + "".join(rows), encoding="utf-8")
        call = [sys.executable, "-m", "cavirheo", "infer", str(path), "--no-pictures", "-o"]
        calls = [[*call, str(Path(folder) / f"out{k}")] for k in range(run.count(4, 8))]
        spent = [seconds(lambda call=call: subprocess.run(call, check=False, capture_output=True)) for call in calls]
    yield statistic("command.seconds", spent[1:], "s", seed=STREAM)
    yield statistic("command.ratio", np.array(spent[1:]) / alone[0], "1", seed=STREAM)
