"""Materials, media, bubbles, drivings and simulations that cannot be, each with the code of its refusal."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest
from conftest import refused
from test_limits import GEL, TIME

from cavirheo.errors import InputError
from cavirheo.physics.accuracy import Accuracy
from cavirheo.physics.bubble import Bubble, Damage
from cavirheo.physics.driving import Pulse, Trace
from cavirheo.physics.elastic import (
    ArrudaBoyce,
    Fung,
    Gent,
    Linear,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    StrainEnergy,
    Yeoh,
)
from cavirheo.physics.materials import (
    Maxwell,
    NeoHookeanKelvinVoigt,
    OldroydB,
    QuadraticKelvinVoigt,
    QuadraticStandardLinearSolid,
    TotalRelaxation,
    UpperConvectedMaxwell,
    Viscoelastic,
    Zener,
)
from cavirheo.physics.media import WATER, Medium, medium
from cavirheo.physics.simulate import simulate, simulate_many
from cavirheo.physics.viscous import CarreauYasuda, Cross, HerschelBulkley, Newtonian, PowellEyring, PowerLaw, Viscosity


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda: Linear(-1.0), "shear_modulus"),
        (lambda: NeoHookean(nan), "shear_modulus"),
        (lambda: MooneyRivlin(1e3, -2e3), "C1"),
        (lambda: MooneyRivlin(1e3, inf), "C2"),
        (lambda: Yeoh(1e3, inf), "C2"),
        (lambda: Fung(1e3, -1.0), "stiffening"),
        (lambda: Gent(1e3, 0.0), "limit"),
        (lambda: ArrudaBoyce(1e3, 0.0), "segments"),
        (lambda: Ogden((1e3,), (2.0, 3.0)), "terms"),
        (lambda: Ogden([1e3], [inf]), "exponent"),
        (lambda: Ogden([1e3], [-2.0]), "unstable"),
        (lambda: StrainEnergy(lambda a, b, c: np.abs(a - 1) * 1e3 + b).table(), "not_analytic"),
        (lambda: Newtonian(-0.1), "viscosity"),
        (lambda: PowerLaw(1.0, 0.0), "exponent"),
        (lambda: HerschelBulkley(-1.0, 1.0, 1.0), "yield_stress"),
        (lambda: CarreauYasuda(0.1, 0.1, 1e-4, 0.5, 0.0), "transition"),
        (lambda: Cross(0.1, -0.1, 1e-4), "infinite_rate"),
        (lambda: PowellEyring(0.1, 0.1, -1e-4), "time"),
        (lambda: Viscosity(lambda s: 1 - 1e-5 * s).table(), "negative_viscosity"),
        (lambda: Viscosity(lambda s: np.nan * s).table(), "negative_viscosity"),
        (lambda: NeoHookeanKelvinVoigt(1e3, -0.1), "viscosity"),
        (lambda: QuadraticKelvinVoigt(1e3, 0.1, -0.1), "stiffening"),
        (lambda: Maxwell(-1.0, 1e-6), "viscosity"),
        (lambda: UpperConvectedMaxwell(1.0, 0.0), "relaxation_time"),
        (lambda: OldroydB(1.0, 1e-6, 2e-6), "retardation_time"),
        (lambda: OldroydB(1.0, 0.0, 0.0), "relaxation_time"),
        (lambda: Zener(-1.0, 1.0, 1e-6), "shear_modulus"),
        (lambda: QuadraticStandardLinearSolid(1e3, 0.0, 1e-6, 0.1), "viscosity"),
        (lambda: Viscoelastic(NeoHookean(1e3), None, 2 * [TotalRelaxation(0.1, 1e-6)]), "followed_twice"),
        (lambda: Viscoelastic(None, None, [Newtonian(1.0)]), "not_Arm"),
        (lambda: Viscoelastic(Newtonian(1.0), NeoHookean(1e3)), "not_Elastic"),
        (lambda: Viscoelastic(), "no_law"),
        (lambda: replace(WATER, temperature=400.0), "boiling"),
        (lambda: replace(WATER, density=0.0), "density"),
        (lambda: replace(WATER, surface_tension=-0.1), "surface_tension"),
        (lambda: medium("honey"), "unknown_medium"),
        (lambda: Pulse(nan, 1e6, 0.0), "amplitude"),
        (lambda: Pulse(1e6, 0.0, 0.0), "frequency"),
        (lambda: Pulse(1e6, 1e6, 0.0, 0.5), "exponent"),
        (lambda: Trace([0, 1], [1]), "trace_shape"),
        (lambda: Trace([0], [1]), "trace_shape"),
        (lambda: Trace([0, 0], [1, 2]), "trace_values"),
        (lambda: Trace([0, 1], [1, inf]), "trace_values"),
        (lambda: Accuracy(relative_error=0.5), "relative_error"),
        (lambda: Accuracy(4), "cells"),
        (lambda: simulate_many([GEL, GEL], max_radius=[1e-4] * 3, stretch=5.0, time=TIME), "shapes"),
    ],
)
def test_what_cannot_be(make, code):
    with refused(f"physics.{code}"):
        make()


@pytest.mark.parametrize(
    ("values", "code"),
    [
        ({"exponent": 0.0}, "exponent"),
        ({"motion": "rayleigh"}, "motion"),
        ({"contents": "frozen"}, "contents"),
        ({"contents": "kinetic", "accommodation": 0.0}, "accommodation"),
        ({"contents": "kinetic", "accommodation": 11.0}, "accommodation"),
        ({"contents": "kinetic", "accommodation": nan}, "accommodation"),
        ({"contents": "kinetic", "accommodation": 0.07, "exponent": 1.4}, "contents_twice"),
        ({"confinement_inertia": -1.0}, "confinement_inertia"),
        ({"wall_distance": 100e-6}, "wall_too_near"),
        ({"wall_distance": 1e-3, "confinement_inertia": 0.1}, "two_walls"),
        ({"vapour_excess": -1.0}, "vapour_excess"),
        ({"confinement_damping": -0.1}, "confinement_damping"),
        ({"contents": "kinetic"}, "free_bubble"),
        ({"confinement_damping": "free"}, "free_bubble"),
        ({"damage": "strain"}, "free_bubble"),
    ],
    ids=str,
)
def test_bubbles_that_cannot_be(values, code):
    with refused(f"physics.{code}"):
        simulate(GEL, time=TIME, max_radius=150e-6, stretch=5.0, bubble=Bubble(**values))


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"max_radius": -1e-4}, "max_radius"),
        ({"stretch": 0.5}, "stretch"),
        ({"time": [0, 2e-6, 1e-6]}, "times_descend"),
        ({"time": []}, "times"),
        ({"time": [0, nan]}, "times"),
        ({"bubble": Bubble(exponent=1.4), "fields": True}, "no_fields"),
        ({"bubble": Bubble(motion="gilmore"), "medium": Medium(sound_speed=inf)}, "sound_speed"),
    ],
)
def test_simulations_that_cannot_be(change, code):
    with refused(f"physics.{code}"):
        simulate(GEL, **{"max_radius": 1e-4, "stretch": 5.0, "time": TIME, **change})


@pytest.mark.parametrize("numbers", [(-0.1,), (1.1,), (0.5, 0.9), (0.5, nan), (0.5, 2.0, "age"), (0.0, 2.0, "strain")])
def test_impossible_damage(numbers):
    with pytest.raises(InputError):
        Damage(*numbers)
