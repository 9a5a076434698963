"""PyIMR (https://github.com/sbryngelson/PyIMR) on the package's cases: Keller-Miksis with its gas thermal equation and
vapour transport, neo-Hookean Kelvin-Voigt, from R_max at rest.

PyIMR's model is the same one (docs/method/physics.md 3.1) once its constants are these: one conductivity for both gases
(its default has two), gas constants from molar masses, p_v(T) as here (not adjustable there, and equal), the wall at
the temperature of the liquid (`medtherm=0`). On a gentle case the two agree to 1e-7 of R_max when both are refined.
It needs Python 3.12 and jax; import this module only where `pyimr` can be imported.
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
import pyimr

from cavirheo.physics.media import Medium

UNIVERSAL = 8.3144598  # J/(mol K): only its quotients with the molar masses enter
MOST_STEPS = 10_000  # where PyIMR goes through it mostly needs hundreds


class Run(NamedTuple):
    ratio: np.ndarray | None  # R/R_max, None where the solve failed
    compile_seconds: float  # first call less second, processor time
    seconds: float  # second call
    steps: int
    why: str  # PyIMR's message where it failed


def constants(medium: Medium) -> pyimr.PhysicalParameters:
    return pyimr.PhysicalParameters(
        far_field_pressure_pa=medium.pressure,
        medium_density_kg_m3=medium.density,
        surface_tension_n_m=medium.surface_tension,
        sound_speed_m_s=medium.sound_speed,
        polytropic_exponent=medium.adiabatic_index,
        gas_conductivity_slope=medium.conductivity_slope,
        gas_conductivity_offset=medium.conductivity_intercept,
        vapor_conductivity_slope=medium.conductivity_slope,
        vapor_conductivity_offset=medium.conductivity_intercept,
        mass_diffusivity_m2_s=medium.diffusivity,
        universal_gas_constant_j_mol_k=UNIVERSAL,
        vapor_molar_mass_kg_mol=UNIVERSAL / medium.vapour_constant,
        gas_molar_mass_kg_mol=UNIVERSAL / medium.gas_constant,
    )


def solve(row: np.ndarray, medium: Medium, time_points: np.ndarray, nodes: int = 25, rtol: float = 1e-8) -> Run:
    """`row` is G Pa, mu Pa s, lambda, R_max m; the defaults are PyIMR's."""
    G, mu, stretch, R_max = map(float, row)
    problem = pyimr.prepare(
        pyimr.SimulationConfig(
            R0=R_max,
            Req=R_max / stretch,
            material=pyimr.NeoHookeanKelvinVoigt(G, mu),
            radial=2,  # Keller-Miksis in pressure
            vapor=1,
            bubtherm=1,
            masstrans=1,
            medtherm=0,
            T8=medium.temperature,
            Nt=nodes,
            rtol=rtol,
            atol=rtol / 100,  # PyIMR's own ratio
            physics=constants(medium),
            max_steps=MOST_STEPS,
        )
    )
    began = time.process_time()
    try:
        problem.solve(time_points)
        middle = time.process_time()
        result = problem.solve(time_points)
    except pyimr.SimulationError as error:
        return Run(None, np.nan, time.process_time() - began, 0, str(error))
    seconds = time.process_time() - middle
    return Run(np.array(result.radius_ratio), middle - began - seconds, seconds, result.stats.nfev, "")
