"""PyIMR (https://github.com/sbryngelson/PyIMR) on the solver's cases: Keller-Miksis in pressure with heat and vapour,
neo-Hookean Kelvin-Voigt, from R_max at rest.

Its model is ours (docs/method/physics.md 3.1) once its constants are these: one conductivity for both gases (its
default has two), gas constants from molar masses, the wall at the temperature of the liquid (`medtherm=0`).
It needs Python 3.12 and `pip install pyimr` (0.1.1 was used): import this module only where `pyimr` can be imported.
"""

from __future__ import annotations

import time

import numpy as np
import pyimr

from cavirheo.physics.media import Medium

UNIVERSAL = 8.3144598  # J/(mol K): only its quotients with the molar masses enter


def solve(row: np.ndarray, medium: Medium, at: np.ndarray, nodes: int) -> tuple[np.ndarray, float] | None:
    """R/R_max at times (n,) s, and the processor time of a second call, s; None where PyIMR fails. row: G Pa, mu Pa s,
    stretch, R_max m."""
    G, mu, stretch, R_max = map(float, row)
    constants = pyimr.PhysicalParameters(
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
    problem = pyimr.prepare(
        pyimr.SimulationConfig(
            R0=R_max,
            Req=R_max / stretch,
            material=pyimr.NeoHookeanKelvinVoigt(G, mu),
            radial=2,
            vapor=1,
            bubtherm=1,
            masstrans=1,
            medtherm=0,
            T8=medium.temperature,
            Nt=nodes,
            rtol=1e-6,
            atol=1e-8,
            physics=constants,
            max_steps=10_000,
        )
    )
    try:
        problem.solve(at)  # compiles
        began = time.process_time()
        return np.array(problem.solve(at).radius_ratio), time.process_time() - began
    except pyimr.SimulationError:
        return None
