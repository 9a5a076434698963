"""Answers of other programs beside ours, to the same recordings in one run: the field's way, and PyIMR
(https://github.com/sbryngelson/PyIMR) where it is installed (0.1.1 was used; it asks for Python 3.12 and runs with 3.11
after `pip install --ignore-requires-python pyimr`).

The recordings are those of the challenge's camera, half easy, half medium, of gels in the field's bubble: what all
assume. The field's way is run_scipy.py's least squares over field_standard.py with 50 nodes, from two starts; PyIMR's
is its own, with 25 nodes and as many starts in the same bounds, one conductivity for both gases and the wall as warm as
the liquid (other constants are ours within a hundredth). R_max and its time are as read; the density is known. Times
are processor times, with the loading and compiling that they need.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo import Medium, Posterior, RadiusCurve, fit_many, infer_many
from validation.challenge import answers, camera, make, run_scipy, truth
from validation.challenge.answers import Answer
from validation.claims.challenge import judged
from validation.claims.solver import standard
from validation.numbers import Number, Run

RECORDINGS = 2, 10  # in a quick and a full run
SEED = 14  # of the challenge, of which no recording was used before
STARTS = run_scipy.STARTS[::3]


def recording(number: int) -> tuple[truth.Truth, answers.Recording]:
    drawn, shown, _ = make.one((number, ("field", "nhkv", ("easy", "medium")[number % 2])), SEED)
    seen = shown.time, shown.radius, camera.read_maximum(shown.time, shown.radius)[1], shown.exposure, drawn.density
    return drawn, answers.Recording(str(number), Path(), *seen)


def our_answer(shot: answers.Recording, medium: Medium, call: Callable[..., list[Posterior]], **way: Any) -> Answer:
    curve = RadiusCurve(shot.time, shot.radius, meta={"exposure_s": shot.exposure})
    answer = call([curve], medium=medium, trust_input=True, workers=1, **way)[0]
    row: Answer = {}
    for symbol in ("G", "mu"):
        interval, bound = answer.interval(symbol), answer.bound(symbol)
        if interval and bound != "undetermined":
            row |= {f"{symbol}_low": interval[0]} if bound != "upper" else {}
            row |= {f"{symbol}_high": interval[1]} if bound != "lower" else {}
            row |= {symbol: answer.median(symbol)} if bound is None else {}
    return row


def field_answer(shot: answers.Recording, medium: Medium) -> Answer:
    times, radius = shot.from_maximum()
    nodes = np.tanh(truth.STEEPNESS * np.linspace(0, 1, 50)) / np.tanh(truth.STEEPNESS)

    def model(x: np.ndarray) -> np.ndarray:
        try:
            return standard(np.append(10.0**x, shot.max_radius), medium, times, nodes, 1e-4)
        except RuntimeError:
            return np.zeros(len(times))

    return run_scipy.bounded(*run_scipy.fit(model, radius / shot.max_radius, STARTS))


def pyimr_answer(shot: answers.Recording, medium: Medium) -> Answer:
    import pyimr.inference

    times, radius = shot.from_maximum()
    R_max = float(shot.max_radius)
    constants = pyimr.PhysicalParameters(
        medium_density_kg_m3=medium.density,
        surface_tension_n_m=medium.surface_tension,
        vapor_conductivity_slope=medium.conductivity_slope,
        vapor_conductivity_offset=medium.conductivity_intercept,
    )
    (G, mu, stretch), (G_end, mu_end, stretch_end) = (10.0 ** np.array(run_scipy.BOUNDS)).tolist()
    law = pyimr.NeoHookeanKelvinVoigt((G * G_end) ** 0.5, (mu * mu_end) ** 0.5)
    how = {"radial": 2, "vapor": 1, "bubtherm": 1, "masstrans": 1, "medtherm": 0, "Nt": 25, "rtol": 1e-6, "atol": 1e-8}
    config = pyimr.SimulationConfig(
        R0=R_max, Req=R_max / 6.5, material=law, T8=medium.temperature, physics=constants, max_steps=10_000, **how
    )
    asked = [
        pyimr.inference.InferenceParameter("material.shear_modulus_pa", G, G_end, "log"),
        pyimr.inference.InferenceParameter("material.viscosity_pa_s", mu, mu_end, "log"),
        pyimr.inference.InferenceParameter("Req", R_max / stretch_end, R_max / stretch, "log"),
    ]
    seen = pyimr.inference.RadiusObservation(times, radius, 0.01 * R_max)
    best = pyimr.inference.prepare_inference(config, seen, asked).fit_multistart(len(STARTS)).best
    return {} if best is None else dict(zip(("G", "mu"), map(float, best.physical_parameters), strict=False))


PROGRAMS: dict[str, Callable[[answers.Recording, Medium], Answer]] = {
    "infer": partial(our_answer, call=infer_many),
    "fit": partial(our_answer, call=fit_many, material="nhkv", bubble="field"),
    "field": field_answer,
    "pyimr": pyimr_answer,
}


def one(job: tuple[str, int]) -> Answer:
    program, number = job
    drawn, shot = recording(number)
    began = time.process_time()
    found = PROGRAMS[program](shot, Medium(density=shot.density))
    found["seconds"] = time.process_time() - began
    return {"name": shot.name, "half": drawn.half, "true": {"G": drawn.G, "mu": drawn.mu}} | found


def measure(run: Run) -> Iterator[Number]:
    for program in PROGRAMS if find_spec("pyimr") else [name for name in PROGRAMS if name != "pyimr"]:
        rows = run.rows("peers", one, [(program, number) for number in range(run.count(*RECORDINGS))])
        true = [
            {"name": row["name"], "half": row["half"]} | {k: str(x) for k, x in row.pop("true").items()} for row in rows
        ]
        yield from judged(f"{program}.", true, [{name: str(value) for name, value in row.items()} for row in rows])
