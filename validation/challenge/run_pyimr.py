"""PyIMR's answers to the recordings: neo-Hookean Kelvin-Voigt, the field's bubble, R_max and its time known.

    python -m validation.challenge.run_pyimr RECORDINGS ANSWERS.csv

Needs Python 3.12 and `pip install pyimr scipy` (0.1.1 was used), and nothing of cavirheo. PyIMR solves and
differentiates; scipy's least squares goes from the best of three stretches over the first three and a half t_c, with
the textbook's covariance. Most of the time is compilation, which each new number of frames needs.

PyIMR's model is ours (docs/method/physics.md 3.1) once its constants are these: one conductivity for both gases (its
default has two), gas constants from molar masses, the wall at the temperature of the liquid (`medtherm=0`).
"""

from __future__ import annotations

import time
from functools import lru_cache

import numpy as np
import pyimr
from pyimr import inference
from scipy.optimize import least_squares

from validation.challenge.answers import Answer, Recording, run

PRESSURE, TEMPERATURE, UNIVERSAL = 101325.0, 298.15, 8.3144598  # Pa, K, J/(mol K)
G, MU, STRETCH = (100.0, 2e5), (1e-3, 1.0), (2.5, 12.0)  # ranges, Pa and Pa s
STARTS = [(5e3, 0.05, stretch) for stretch in (5.0, 7.0, 9.0)]
END = 3.5  # t_c
STEPS = 25  # of the least squares
NORMAL_90 = 1.645
CONSTANTS = {  # those of the page README.md
    "far_field_pressure_pa": PRESSURE,
    "surface_tension_n_m": 0.072,
    "sound_speed_m_s": 1484.0,
    "polytropic_exponent": 1.4,
    "gas_conductivity_slope": 5.3e-5,
    "gas_conductivity_offset": 1.17e-2,
    "vapor_conductivity_slope": 5.3e-5,
    "vapor_conductivity_offset": 1.17e-2,
    "mass_diffusivity_m2_s": 24.2e-6,
    "universal_gas_constant_j_mol_k": UNIVERSAL,
    "vapor_molar_mass_kg_mol": UNIVERSAL / 462.0,
    "gas_molar_mass_kg_mol": UNIVERSAL / 287.0,
}


def configuration(
    G: float, mu: float, stretch: float, R_max: float, density: float, nodes: int
) -> pyimr.SimulationConfig:
    """Keller-Miksis in pressure, with heat and vapour, from R_max at rest; SI."""
    return pyimr.SimulationConfig(
        R0=R_max,
        Req=R_max / stretch,
        material=pyimr.NeoHookeanKelvinVoigt(G, mu),
        radial=2,
        vapor=1,
        bubtherm=1,
        masstrans=1,
        medtherm=0,
        T8=TEMPERATURE,
        Nt=nodes,
        rtol=1e-6,
        atol=1e-8,
        physics=pyimr.PhysicalParameters(medium_density_kg_m3=density, **CONSTANTS),
        max_steps=10_000,
    )


def solve(row: np.ndarray, density: float, at: np.ndarray, nodes: int) -> tuple[np.ndarray, float] | None:
    """R/R_max at times (n,) s, and the processor time of a second call, s; None where PyIMR fails. row: G Pa, mu Pa s,
    stretch, R_max m."""
    problem = pyimr.prepare(configuration(*map(float, row), density, nodes))
    try:
        problem.solve(at)  # compiles
        began = time.process_time()
        return np.array(problem.solve(at).radius_ratio), time.process_time() - began
    except pyimr.SimulationError:
        return None


def prepared(recording: Recording) -> inference.PreparedInference:
    since, radius = recording.from_maximum()
    seen = since < END * recording.max_radius * np.sqrt(recording.density / PRESSURE)
    R_max = recording.max_radius
    config = configuration(5e3, 0.05, 7.0, R_max, recording.density, 25)
    parameters = [
        inference.InferenceParameter("material.shear_modulus_pa", *G, "log"),
        inference.InferenceParameter("material.viscosity_pa_s", *MU, "log"),
        inference.InferenceParameter("Req", R_max / STRETCH[1], R_max / STRETCH[0], "log"),
    ]
    observation = inference.RadiusObservation(since[seen], radius[seen], 0.01 * R_max)
    return inference.prepare_inference(config, observation, parameters)


def answer(recording: Recording, _: list[str]) -> Answer:
    try:
        problem = prepared(recording)

        @lru_cache
        def solved(point: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
            evaluation, slopes = problem.evaluate_with_jacobian(np.array(point))
            return np.asarray(evaluation.residual), np.asarray(slopes)

        low, spans = np.log([G[0], MU[0], 1.0]), np.log([G[1] / G[0], MU[1] / MU[0], STRETCH[1] / STRETCH[0]])
        places = [(np.log(start) - low) / spans for start in STARTS]
        for place, (*_, stretch) in zip(places, STARTS, strict=True):
            place[2] = np.log(STRETCH[1] / stretch) / spans[2]
        start = min(places, key=lambda place: float(np.sum(solved(tuple(place))[0] ** 2)))
        end = least_squares(
            lambda x: solved(tuple(x))[0], start, lambda x: solved(tuple(x))[1], bounds=(0, 1), max_nfev=STEPS
        )
    except (pyimr.SimulationError, RuntimeError, ValueError) as error:
        return {"verdict": f"failed: {error}"[:100]}
    variance = 2.0 * end.cost / max(len(end.fun) - 3, 1)
    sigma = np.sqrt(variance * np.diag(np.linalg.pinv(end.jac.T @ end.jac)))
    row: Answer = {}
    for k, name in enumerate(("G", "mu")):
        ends = (end.x[k], end.x[k] - NORMAL_90 * sigma[k], end.x[k] + NORMAL_90 * sigma[k])
        values = np.exp(np.clip(low[k] + spans[k] * np.array(ends), -20, 20))
        row |= dict(zip((name, f"{name}_low", f"{name}_high"), (f"{value:.6g}" for value in values), strict=True))
    return row


if __name__ == "__main__":
    run(__doc__, answer)
