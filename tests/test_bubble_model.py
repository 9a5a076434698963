"""Contents, damage, walls and vapour in the inference: what was simulated is found again, and says what it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fits import fit, fit_many

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import infer
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.law import Family
from cavirheo.inference.options import Options
from cavirheo.inference.verify import verify
from cavirheo.inference.verify.evidence import models, rank_laws
from cavirheo.physics.damage import Damage
from cavirheo.physics.materials import NeoHookeanKelvinVoigt
from cavirheo.physics.simulate import simulate
from cavirheo.posterior import Bubble, Posterior
from cavirheo.reporting.answer import curve_record
from cavirheo.unfinished import keep, read_kept

TIME = np.arange(90) * 1e-6
GEL, SHOT = NeoHookeanKelvinVoigt(5e3, 0.01), dict(max_radius=250e-6, stretch=6.0)
QUICKLY = dict(windows=False, trust_input=True)
ALL_FREE = Bubble("kinetic", "free", "first-rebound", "free", None, "free", "free")


def shot(seed=0, noise=1e-6, **way):
    radius = simulate(GEL, time=TIME, **SHOT, **way).radius
    radius = radius + noise * np.random.default_rng(seed).normal(size=radius.size)
    return replace(RadiusCurve(time=TIME, radius=radius), maximum=(0.0, 250e-6))


@pytest.mark.parametrize(
    ("true", "fitted", "expected"),
    [
        (dict(contents="kinetic"), dict(contents="kinetic"), dict(accommodation=0.07)),
        (dict(confinement_inertia=0.2), dict(confinement_inertia="free"), dict(confinement_inertia=0.2)),
        (dict(confinement_damping=0.3), dict(confinement_damping="free"), dict(confinement_damping=0.3)),
        pytest.param(
            dict(vapour_excess=3e3), dict(vapour_excess="free"), dict(vapour_excess=3e3), marks=pytest.mark.slow
        ),
        pytest.param(
            dict(damage=Damage(0.2, 2.0), contents="kinetic"),
            dict(damage="first-rebound", contents="kinetic", accommodation=0.07),
            dict(damage_modulus=0.2, damage_radius=2.0),
            marks=pytest.mark.slow,
        ),
        pytest.param(
            dict(damage=Damage(0.4, 1.5, "strain")),
            dict(damage="strain"),
            dict(damage_modulus=0.4, damage_radius=1.5),
            marks=pytest.mark.slow,
        ),
    ],
    ids=str,
)
def test_a_fit_finds_what_was_simulated(true, fitted, expected):
    answer = fit(shot(noise=0.1e-6, **true), **fitted, **QUICKLY)
    assert answer.best["shear_modulus"] == pytest.approx(5e3, rel=0.1)
    for name, value in expected.items():
        assert answer.best[name] == pytest.approx(value, rel=0.15), answer
        assert name in answer.parameters
    assert answer.bubble.contents == true.get("contents", "equilibrium")


def test_what_is_given_is_not_inferred():
    answer = fit(shot(contents="kinetic"), contents="kinetic", accommodation=0.05, wall_distance=2e-3, **QUICKLY)
    assert not {"accommodation", "confinement_inertia"} & set(answer.parameters)
    assert answer.best["accommodation"] == 0.05
    assert answer.best["confinement_inertia"] == pytest.approx(250e-6 / 4e-3)


def test_the_answer_carries_its_model(tmp_path):
    """Into verification, result.json and what an unfinished run keeps."""
    curve = shot(seed=1, contents="kinetic")
    answer = fit(curve, contents="kinetic", **QUICKLY)
    verified = verify(curve, answer, level="map")
    assert verified.bubble == answer.bubble == Bubble("kinetic")
    assert verified.best["accommodation"] == pytest.approx(0.07, rel=0.2)
    low, high = verified.interval("accommodation")
    assert low < 0.07 < high
    assert curve_record(curve, verified).contents == "kinetic"
    assert curve_record(curve, verified).other_parameters["accommodation"].median == pytest.approx(0.07, rel=0.2)
    keep(tmp_path / "a.npz", verified)
    assert read_kept(tmp_path / "a.npz", Posterior).bubble == verified.bubble


def test_every_free_parameter_has_a_proper_prior():
    """Walls and vapour: half of a normal, from nothing up."""
    experiment = Experiment(shot(), Family("nhkv"), options=Options(bubble=ALL_FREE))
    prior = experiment.prior()
    x = prior.to_x(np.random.default_rng(1).normal(size=(20_000, len(prior.names))))
    natural = experiment.natural(x.T)
    for name, deviation in (("confinement_inertia", 0.3), ("confinement_damping", 0.3), ("vapour_excess", 3039.75)):
        assert natural[name].min() >= 0
        assert np.sqrt(np.mean(natural[name] ** 2)) == pytest.approx(deviation, rel=0.03)
    assert natural["accommodation"].min() >= 0.01
    assert natural["accommodation"].max() <= 1
    assert np.median(natural["accommodation"]) == pytest.approx(0.1, rel=0.1)
    assert natural["damage_modulus"].max() <= 1 <= natural["damage_radius"].min()
    assert experiment.predict(x[0]) is not None


def test_the_default_is_the_model_of_the_field():
    experiment = Experiment(shot(), Family("nhkv"))
    assert experiment.names == ("shear_modulus", "viscosity", "stretch", "time_origin", "max_radius_factor")
    assert experiment.simulated(experiment.natural(np.zeros(3))) == {"contents": "equilibrium"}


@pytest.mark.slow
def test_the_evidence_tells_the_contents_apart():
    curve = shot(contents="kinetic", noise=2e-6)
    (single,), _ = rank_laws([curve], ["nhkv"], contents=["equilibrium", "kinetic"], trust_input=True)
    assert single.log_evidence["nhkv, kinetic"] > single.log_evidence["nhkv, equilibrium"]


def test_models_of_a_ranking():
    found = models(["nhkv", "newtonian"], ["equilibrium", "kinetic"], ["none", "first-rebound"])
    assert list(found) == [
        "nhkv, equilibrium", "nhkv, equilibrium, damage", "nhkv, kinetic", "nhkv, kinetic, damage",
        "newtonian, equilibrium", "newtonian, kinetic",
    ]  # fmt: skip
    assert list(models(["nhkv", "newtonian"])) == ["nhkv", "newtonian"]
    assert len(models(["nhkv"], damage=["none", "first-rebound", "strain"])) == 3
    assert models(["nhkv"], ["equilibrium", "kinetic"])["nhkv, kinetic"]["contents"] == "kinetic"
    for few in ((["nhkv"],), (["newtonian"], ["kinetic"], ["none", "first-rebound"]), (["nhkv", "nhkv"],)):
        with pytest.raises(InputError):
            models(*few)


@pytest.mark.parametrize(
    ("way", "code"),
    [
        (dict(contents="dry"), "option.contents"),
        (dict(accommodation=0.07), "option.idle"),
        (dict(contents="kinetic", accommodation=11.0), "physics.accommodation"),
        (dict(contents="kinetic", accommodation="some"), "physics.accommodation"),
        (dict(confinement_inertia=9.0), "physics.confinement_inertia"),
        (dict(confinement_inertia="free", wall_distance=1e-3), "physics.two_walls"),
        (dict(vapour_excess=-1.0), "physics.vapour_excess"),
        (dict(damage="always"), "option.damage"),
        (dict(material="newtonian", damage="first-rebound"), "physics.damage_without_elasticity"),
    ],
    ids=str,
)
def test_bad_input(way, code):
    with pytest.raises(InputError) as raised:
        fit(shot(), **way)
    assert raised.value.code == code


def test_a_wall_within_the_bubble():
    """It fails the curve; where it does so to all, nothing is begun."""
    large = shot()
    small = replace(large, radius=large.radius / 2, maximum=(0.0, 125e-6))
    answers = fit_many([large, small], wall_distance=200e-6, **QUICKLY)
    assert [answer.checks.verdict == "failed" for answer in answers] == [True, False]
    assert "wall_distance" in answers[0].checks.message
    with pytest.raises(InputError) as raised:
        fit_many([large, large], wall_distance=200e-6)
    assert raised.value.code == "physics.wall_too_near"


@pytest.mark.parametrize(
    ("way", "code"),
    [
        (dict(accommodation=0.07), "option.idle"),
        (dict(damage="strain", material="newtonian"), "physics.damage_without_elasticity"),
        (dict(damage="strain", model="bdt-viscoelastic"), "option.bubble"),
        (dict(confinement_inertia=0.2, verify="none"), "option.bubble"),
        (dict(confinement_inertia=0.2, wall_distance=1e-3), "physics.two_walls"),
        (dict(confinement_damping=-1.0), "physics.confinement_damping"),
    ],
)
def test_infer_refuses_a_bubble_that_cannot_be(way, code):
    with pytest.raises(InputError) as error:
        infer(shot(), **way)
    assert error.value.code == code


def test_infer_searches_where_the_network_does_not_know_the_bubble():
    """A wall beside the bubble: without it G is wrong."""
    curve = shot(confinement_inertia=0.25, noise=1e-6)
    beside = infer(curve, confinement_inertia=0.25, trust_input=True)
    assert "began all over the ranges" in beside.checks.message
    assert beside.bubble == Bubble(confinement_inertia=0.25)
    for name, true in (("shear_modulus", 5e3), ("viscosity", 0.01)):
        low, high = beside.interval(name)
        assert low < true < high
    low, high = infer(curve, trust_input=True).interval("shear_modulus")
    assert not low < 5e3 < high


def test_a_given_accommodation_is_of_kinetic_contents_alone():
    given = Bubble("auto", 0.1, confinement_inertia=0.2)
    assert given.with_contents("kinetic") == Bubble("kinetic", 0.1, confinement_inertia=0.2)
    assert given.with_contents("equilibrium") == Bubble(confinement_inertia=0.2)
    assert Bubble(accommodation=0.1).with_contents("equilibrium").accommodation == 0.1  # which is refused
