"""The registry of laws and the notation for sums of them, and a clear word for every mistake of whoever simulates."""

from dataclasses import fields, is_dataclass, replace
from inspect import signature
from math import inf, nan

import numpy as np
import pytest
from conftest import refused
from test_limits import GEL, TIME

from cavirheo import Bubble, InputError, Medium, Newtonian, simulate, simulate_many
from cavirheo.parameters import PARAMETERS
from cavirheo.physics import elastic, materials, viscous
from cavirheo.physics.accuracy import Accuracy
from cavirheo.physics.bubble import Damage
from cavirheo.physics.driving import Pulse, Trace
from cavirheo.physics.elastic import NeoHookean, StrainEnergy
from cavirheo.physics.law import Arm
from cavirheo.physics.materials import EXAMPLE, LAWS, Material, TotalRelaxation, Viscoelastic, parse, summary, usage
from cavirheo.physics.media import WATER, medium
from cavirheo.physics.viscous import Viscosity

THIN = Viscoelastic(elastic.Gent(2e3, 40.0), viscous.CarreauYasuda(0.5, 0.01, 1e-4, 0.4))
FLUIDS = materials.Maxwell(0.1, 2e-6), materials.UpperConvectedMaxwell(0.2, 1e-5)
ARMS = Viscoelastic(elastic.NeoHookean(1e3), viscous.Newtonian(0.01), FLUIDS)
QSLS = [materials.TotalRelaxation(0.1, 2e-6, grown=False)]


@pytest.mark.parametrize(
    ("text", "material"),
    [
        ("gent(shear_modulus=2e3, limit=40) + carreau-yasuda(0.5, 0.01, 1e-4, 0.4)", THIN),
        ("carreau_yasuda(0.5, 0.01, time=1e-4, exponent=.4)+gent(limit=40, shear-modulus=2e+3)", THIN),
        (" gent(2_000, 40)\n + (carreau-yasuda(0.5, 0.01, 1e-4, 0.4)) ", THIN),
        ("nhkv(7690, 0.05)", materials.NeoHookeanKelvinVoigt(7690.0, 0.05)),
        ("ogden((2e3, -500), (2.5, -2))", elastic.Ogden((2e3, -500.0), (2.5, -2.0))),
        ("ogden(moduli=2e3, exponents=(2,))", elastic.Ogden((2e3,), (2.0,))),
        ("yeoh(C1=1500, C2=20)", elastic.Yeoh(1500.0, 20.0)),
        ("neo-hookean(1e3) + newtonian(0.1)", Viscoelastic(elastic.NeoHookean(1e3), viscous.Newtonian(0.1))),
        ("power-law(2, 0.6)", viscous.PowerLaw(2.0, 0.6)),
        ("zener(7e3, 0.1, 2e-6)", materials.Zener(7e3, 0.1, 2e-6)),
        (
            "qsls(7e3, 0.1, 2e-6, stiffening=0.3) + newtonian(0.01)",
            Viscoelastic(elastic.Quadratic(7e3, 0.3), viscous.Newtonian(0.01), QSLS),
        ),
        ("ucm(0.1, relaxation_time=2e-6)", materials.UpperConvectedMaxwell(0.1, 2e-6)),
        ("maxwell(0.1, 2e-6) + nhkv(1e3, 0.01) + ucm(0.2, 1e-5)", ARMS),
    ],
)
def test_what_is_read(text, material):
    assert parse(text) == material
    assert repr(parse(text)) == repr(material)  # also 40 as 40.0


@pytest.mark.parametrize("name", LAWS)
def test_every_law_by_position_and_by_name(name):
    law, takes = LAWS[name], signature(LAWS[name]).parameters
    values = [1.5 - 0.25 * k for k in range(len(takes))]
    given = {
        key: (value, 2 * value) if "tuple" in str(parameter.annotation) else value
        for value, (key, parameter) in zip(values, takes.items(), strict=True)
    }
    expected = law(**given)
    assert isinstance(expected, Material)
    assert parse(f"{name}({', '.join(map(str, given.values()))})") == expected
    assert parse(f"{name}({', '.join(f'{key}={value}' for key, value in given.items())})") == expected
    assert {key: getattr(expected, key) for key in given} == given


@pytest.mark.parametrize("name", LAWS)
def test_every_law_is_described(name):
    takes = signature(LAWS[name]).parameters
    assert takes.keys() <= PARAMETERS.keys()
    assert usage(name).startswith(f"{name}(")
    assert all(f"{key} [" in usage(name) for key in takes)
    assert summary(name).endswith(".")
    assert not summary(name).startswith(f"{LAWS[name].__name__}(")  # which Python writes where there is no docstring


def test_no_law_is_forgotten():
    """All but the two that hold a Python function, the one that holds others, the arm that takes the elastic part of
    its material along, and a base; parameters have units."""
    unnamed = {elastic.StrainEnergy, viscous.Viscosity, Viscoelastic, materials.TotalRelaxation, Arm}
    here = {
        law
        for module in (elastic, viscous, materials)
        for law in vars(module).values()
        if is_dataclass(law) and law.__module__ == module.__name__
    }
    assert {law for law in here if law.__name__[0] != "_"} - unnamed == set(LAWS.values())
    assert {field.name for law in LAWS.values() for field in fields(law)} <= PARAMETERS.keys()


@pytest.mark.parametrize(
    ("text", "code", "named"),
    [
        ("", "laws.empty", EXAMPLE),
        ("glass(1)", "laws.unknown", "'glass'; known: linear, neo-hookean, "),
        ("gnet(1, 2)", "laws.unknown", "gent?"),
        ("Carreau-Yasuda(1, 1, 1, 1)", "laws.unknown", "carreau-yasuda?"),
        ("gent", "laws.parameters", "gent(shear_modulus [Pa], limit [-])"),
        ("gent()", "laws.parameters", "'shear_modulus'"),
        ("gent(2e3, 40, stiffening=1)", "laws.parameters", "'stiffening'"),
        ("gent(2e3, 40, limit=40)", "laws.parameters", "'limit'"),
        ("gent(*(2e3, 40), 40)", "laws.number", "*(2000.0, 40)"),
        ("gent(2e3, soft)", "laws.number", "gent: limit"),
        ("gent(2e3, '40')", "laws.number", "'40'"),
        ("gent(2e3, 4*10)", "laws.number", "4 * 10"),
        ("gent(2e3, __import__('os').getpid())", "laws.number", "__import__('os').getpid()"),
        ("gent(1" + 400 * "0" + ", 40)", "laws.number", "shear_modulus"),
        ("ogden((2e3, 'a'), (2, 2))", "laws.number", "ogden: moduli"),
        ("ogden((2e3, 1), 2)", "physics.terms", "ogden"),
        ("gent(-1, 40)", "physics.shear_modulus", "-1.0"),
        ("gent(2e3, 40", "laws.syntax", "'gent(2e3, 40'"),
        ("gent(2e3, 40) +", "laws.syntax", EXAMPLE),
        ("gent(2e3, 40)\0", "laws.syntax", EXAMPLE),
        ("2 * gent(2e3, 40)", "laws.no_law", "'2 * gent(2000.0, 40)'"),
        ("gent(2e3, 40) - newtonian(1)", "laws.no_law", EXAMPLE),
        ("os.getpid()", "laws.no_law", "'os.getpid()'"),
        ("gent(2e3, 40) + linear(2)", "laws.elastic_twice", "gent and linear"),
        ("newtonian(1) + cross(1, 1, 1)", "laws.viscous_twice", "newtonian and cross"),
        ("gent(1, 1) + newtonian(1) + qkv(1, 1, 1)", "laws.elastic_twice", "gent and qkv"),
    ],
)
def test_every_mistake_is_named(text, code, named):
    with refused(code, named):
        parse(text)


# --- materials, media, bubbles, drivings and simulations that cannot be


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
