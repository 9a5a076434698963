"""Materials, media, bubbles, drivings and simulations that cannot be, each with the code of its refusal."""

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
from cavirheo.physics.elastic import NeoHookean, StrainEnergy
from cavirheo.physics.materials import LAWS, TotalRelaxation, Viscoelastic
from cavirheo.physics.media import WATER, Medium, medium
from cavirheo.physics.simulate import simulate, simulate_many
from cavirheo.physics.viscous import Newtonian, Viscosity


@pytest.mark.parametrize(
    ("name", "values", "code"),
    [
        ("neo-hookean", (nan,), "shear_modulus"),
        ("mooney-rivlin", (1e3, -2e3), "C1"),
        ("yeoh", (1e3, inf), "C2"),
        ("fung", (1e3, -1.0), "stiffening"),
        ("gent", (1e3, 0.0), "limit"),
        ("arruda-boyce", (1e3, 0.0), "segments"),
        ("ogden", ((1e3,), (2.0, 3.0)), "terms"),
        ("ogden", ([1e3], [inf]), "exponent"),
        ("ogden", ([1e3], [-2.0]), "unstable"),
        ("newtonian", (-0.1,), "viscosity"),
        ("power-law", (1.0, 0.0), "exponent"),
        ("herschel-bulkley", (-1.0, 1.0, 1.0), "yield_stress"),
        ("carreau-yasuda", (0.1, 0.1, 1e-4, 0.5, 0.0), "transition"),
        ("cross", (0.1, -0.1, 1e-4), "infinite_rate"),
        ("powell-eyring", (0.1, 0.1, -1e-4), "time"),
        ("qkv", (1e3, 0.1, -0.1), "stiffening"),
        ("maxwell", (-1.0, 1e-6), "viscosity"),
        ("oldroyd-b", (1.0, 1e-6, 2e-6), "retardation_time"),
        ("zener", (-1.0, 1.0, 1e-6), "shear_modulus"),
        ("qsls", (1e3, 0.0, 1e-6, 0.1), "viscosity"),
    ],
)
def test_laws_that_cannot_be(name, values, code):
    with refused(f"physics.{code}"):
        LAWS[name](*values)


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda: StrainEnergy(lambda a, b, c: np.abs(a - 1) * 1e3 + b).table(), "not_analytic"),
        (lambda: Viscosity(lambda s: 1 - 1e-5 * s).table(), "negative_viscosity"),
        (lambda: Viscosity(lambda s: np.random.default_rng(0).uniform(size=s.shape)).table(), "rough"),
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
        (lambda: Trace([0, 0], [1, 2]), "trace_values"),
        (lambda: Accuracy(relative_error=0.5), "relative_error"),
        (lambda: Accuracy(4), "cells"),
        (lambda: simulate_many([GEL, GEL], max_radius=[1e-4] * 3, stretch=5.0, time=TIME), "shapes"),
    ],
)
def test_what_cannot_be(make, code):
    with refused(f"physics.{code}"):
        make()


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"max_radius": -1e-4}, "max_radius"),
        ({"stretch": 0.5}, "stretch"),
        ({"time": [0, 2e-6, 1e-6]}, "times_descend"),
        ({"time": [0, nan]}, "times"),
        ({"bubble": Bubble(exponent=1.4), "fields": True}, "no_fields"),
        ({"bubble": Bubble(motion="gilmore"), "medium": Medium(sound_speed=inf)}, "sound_speed"),
        ({"bubble": {"exponent": 0.0}}, "exponent"),
        ({"bubble": {"motion": "rayleigh"}}, "motion"),
        ({"bubble": {"contents": "frozen"}}, "contents"),
        ({"bubble": {"contents": "kinetic", "accommodation": 0.0}}, "accommodation"),
        ({"bubble": {"contents": "kinetic", "accommodation": 0.07, "exponent": 1.4}}, "contents_twice"),
        ({"bubble": {"confinement_inertia": -1.0}}, "confinement_inertia"),
        ({"bubble": {"wall_distance": 100e-6}}, "wall_too_near"),
        ({"bubble": {"wall_distance": 1e-3, "confinement_inertia": 0.1}}, "two_walls"),
        ({"bubble": {"vapour_excess": -1.0}}, "vapour_excess"),
        ({"bubble": {"confinement_damping": -0.1}}, "confinement_damping"),
        ({"bubble": {"confinement_damping": None}}, "confinement_damping"),
        ({"bubble": {"contents": "kinetic", "accommodation": "some"}}, "accommodation"),
        ({"bubble": {"vapour_excess": "free", "exponent": 1.4}}, "contents_twice"),
        ({"bubble": {"contents": "kinetic"}}, "free_bubble"),
        ({"bubble": {"damage": "strain"}}, "free_bubble"),
    ],
    ids=str,
)
def test_simulations_that_cannot_be(change, code):
    way = {"max_radius": 150e-6, "stretch": 5.0, "time": TIME, **change}
    with refused(f"physics.{code}"):
        bubble = way.pop("bubble", Bubble())
        simulate(GEL, bubble=Bubble(**bubble) if isinstance(bubble, dict) else bubble, **way)


@pytest.mark.parametrize("numbers", [(-0.1,), (1.1,), (0.5, 0.9), (0.5, nan), (0.5, 2.0, "age"), (0.0, 2.0, "strain")])
def test_impossible_damage(numbers):
    with pytest.raises(InputError):
        Damage(*numbers)
