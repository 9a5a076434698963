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
from cavirheo.physics.bubble import ACCOMMODATION, BUBBLES, FIELD, REAL, Bubble, Damage, bubbles_of
from cavirheo.physics.materials import NeoHookeanKelvinVoigt
from cavirheo.physics.simulate import simulate
from cavirheo.posterior import Posterior
from cavirheo.reporting.answer import curve_record
from cavirheo.workflow.store import keep, read_kept

TIME = np.arange(90) * 1e-6
GEL, SHOT = NeoHookeanKelvinVoigt(5e3, 0.01), dict(max_radius=250e-6, stretch=6.0)
QUICKLY = dict(trust_input=True)
ALL_FREE = Bubble("kinetic", "free", "first-rebound", "free", None, "free", "free")


def shot(seed=0, noise=1e-6, accommodation=ACCOMMODATION, **values):
    bubble = Bubble(accommodation=accommodation, **values)
    radius = simulate(GEL, time=TIME, bubble=bubble, **SHOT).radius
    radius = radius + noise * np.random.default_rng(seed).normal(size=radius.size)
    return replace(RadiusCurve(time=TIME, radius=radius), maximum=(0.0, 250e-6))


@pytest.mark.parametrize(
    ("true", "fitted", "expected"),
    [
        (dict(contents="kinetic"), Bubble("kinetic"), dict(accommodation=0.07)),
        (dict(confinement_inertia=0.2), Bubble(confinement_inertia="free"), dict(confinement_inertia=0.2)),
        (dict(confinement_damping=0.3), Bubble(confinement_damping="free"), dict(confinement_damping=0.3)),
        pytest.param(
            dict(vapour_excess=3e3), Bubble(vapour_excess="free"), dict(vapour_excess=3e3), marks=pytest.mark.slow
        ),
        pytest.param(
            dict(damage=Damage(0.2, 2.0), contents="kinetic"),
            Bubble("kinetic", 0.07, "first-rebound"),
            dict(damage_modulus=0.2, damage_radius=2.0),
            marks=pytest.mark.slow,
        ),
        pytest.param(
            dict(damage=Damage(0.4, 1.5, "strain")),
            Bubble(damage="strain"),
            dict(damage_modulus=0.4, damage_radius=1.5),
            marks=pytest.mark.slow,
        ),
    ],
    ids=str,
)
def test_a_fit_finds_what_was_simulated(true, fitted, expected):
    answer = fit(shot(noise=0.1e-6, **true), bubble=fitted, **QUICKLY)
    assert answer.best["shear_modulus"] == pytest.approx(5e3, rel=0.1)
    for name, value in expected.items():
        assert answer.best[name] == pytest.approx(value, rel=0.15), answer
        assert name in answer.parameters
    assert answer.bubble.contents == true.get("contents", "equilibrium")


def test_what_is_given_is_not_inferred():
    given = Bubble("kinetic", 0.05, wall_distance=2e-3)
    answer = fit(shot(contents="kinetic"), bubble=given, **QUICKLY)
    assert not {"accommodation", "confinement_inertia"} & set(answer.parameters)
    assert answer.best["accommodation"] == 0.05
    assert answer.best["confinement_inertia"] == pytest.approx(250e-6 / 4e-3)


def test_the_answer_carries_its_model(tmp_path):
    """Into verification, result.json and what an unfinished run keeps."""
    curve = shot(seed=1, contents="kinetic")
    answer = fit(curve, bubble=Bubble("kinetic"), **QUICKLY)
    verified = verify(curve, answer, level="map")
    assert verified.bubble == answer.bubble == Bubble("kinetic")
    assert verified.best["accommodation"] == pytest.approx(0.07, rel=0.2)
    low, high = verified.interval("accommodation")
    assert low < 0.07 < high
    assert curve_record(curve, verified).bubble == Bubble("kinetic")
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


@pytest.mark.slow
def test_the_evidence_tells_the_contents_apart():
    curve = shot(contents="kinetic", noise=2e-6)
    (single,), _ = rank_laws([curve], ["nhkv"], bubble="auto", trust_input=True)
    assert single.log_evidence["nhkv, real"] > single.log_evidence["nhkv, field"]


def test_models_of_a_ranking():
    softening = replace(REAL, damage="first-rebound")
    found = models(["nhkv", "newtonian"], [FIELD, REAL, softening])
    assert list(found) == [
        "nhkv, field", "nhkv, real", "nhkv, real, damage", "newtonian, field", "newtonian, real",
    ]  # fmt: skip
    assert found["nhkv, real, damage"] == ("nhkv", softening)
    assert models(["nhkv", "newtonian"]) == {"nhkv": ("nhkv", REAL), "newtonian": ("newtonian", REAL)}
    for few in ((["nhkv"],), (["newtonian"], [REAL, softening]), (["nhkv", "nhkv"],), (["nhkv"], [REAL, REAL])):
        with pytest.raises(InputError):
            models(*few)


@pytest.mark.parametrize(
    ("way", "code"),
    [
        (dict(bubble="dry"), "option.bubble"),
        (dict(bubble=Bubble(accommodation=0.07)), "option.idle"),
        (dict(bubble=Bubble(damage=Damage(0.5))), "option.damage"),
        (dict(material="newtonian", bubble=Bubble(damage="first-rebound")), "physics.damage_without_elasticity"),
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
    answers = fit_many([large, small], bubble=Bubble(wall_distance=200e-6), **QUICKLY)
    assert [answer.checks.verdict == "failed" for answer in answers] == [True, False]
    assert "wall_distance" in answers[0].checks.message
    with pytest.raises(InputError) as raised:
        fit_many([large, large], bubble=Bubble(wall_distance=200e-6))
    assert raised.value.code == "physics.wall_too_near"


@pytest.mark.parametrize(
    ("way", "code"),
    [
        (dict(bubble=Bubble(accommodation=0.07)), "option.idle"),
        (dict(bubble=Bubble(damage="strain"), material="newtonian"), "physics.damage_without_elasticity"),
        (dict(bubble=Bubble(damage="strain"), model="bdt-viscoelastic"), "option.bubble"),
        (dict(bubble=REAL, model="bdt-viscoelastic"), "option.bubble"),
        (dict(bubble=Bubble(confinement_inertia=0.2), verify="none"), "option.bubble"),
        (dict(bubble=Bubble(motion="gilmore"), verify="none"), "option.bubble"),
        (dict(bubble=Bubble(damage=Damage(0.5))), "option.damage"),
    ],
)
def test_infer_refuses_a_bubble_that_cannot_be(way, code):
    with pytest.raises(InputError) as error:
        infer(shot(), **way)
    assert error.value.code == code


def test_infer_searches_where_the_network_does_not_know_the_bubble():
    """A wall beside the bubble: without it G is wrong."""
    curve = shot(confinement_inertia=0.25, noise=1e-6)
    beside = infer(curve, bubble=Bubble(confinement_inertia=0.25), trust_input=True)
    assert "began all over the ranges" in beside.checks.message
    assert beside.bubble == Bubble(confinement_inertia=0.25)
    for name, true in (("shear_modulus", 5e3), ("viscosity", 0.01)):
        low, high = beside.interval(name)
        assert low < true < high
    low, high = infer(curve, bubble="field", trust_input=True).interval("shear_modulus")
    assert not low < 5e3 < high


@pytest.mark.parametrize(
    ("numbers", "code"),
    [
        (dict(contents="dry"), "physics.contents"),
        (dict(contents="kinetic", accommodation="some"), "physics.accommodation"),
        (dict(damage="always"), "option.damage"),
        (dict(confinement_damping=None), "physics.confinement_damping"),
        (dict(confinement_damping=-1.0), "physics.confinement_damping"),
        (dict(contents="kinetic", accommodation=11.0), "physics.accommodation"),
        (dict(confinement_inertia=9.0), "physics.confinement_inertia"),
        (dict(confinement_inertia="free", wall_distance=1e-3), "physics.two_walls"),
        (dict(vapour_excess=-1.0), "physics.vapour_excess"),
        (dict(motion="keller"), "physics.motion"),
        (dict(exponent=14.0), "physics.exponent"),
        (dict(vapour_excess="free", exponent=1.4), "physics.contents_twice"),
    ],
    ids=str,
)
def test_a_bubble_that_cannot_be_is_refused_where_it_is_made(numbers, code):
    with pytest.raises(InputError) as raised:
        Bubble(**numbers)
    assert raised.value.code == code


def test_bubbles_by_their_names():
    assert {name: bubbles_of(name) for name in BUBBLES} == {"real": (REAL,), "field": (FIELD,)}
    assert bubbles_of("auto") == (FIELD, REAL)
    assert bubbles_of([REAL, FIELD, REAL]) == (REAL, FIELD)
    assert [one.name for one in (REAL, FIELD, Bubble("kinetic"))] == ["real", "field", "kinetic"]
    assert replace(REAL, damage="strain").name == "real, damage by strain"
    assert Bubble(confinement_damping=0.2, wall_distance=1e-3).name == "field, confinement damping, confinement inertia"
    assert Bubble(motion="gilmore", exponent=1.4).title == "field's bubble, gilmore, polytropic"
    assert Bubble(damage=Damage(0.5, by="strain")).name == "field, damage by strain"
    for wrong in ("moon", [], [REAL, "field"], None, 3):
        with pytest.raises(InputError) as error:
            bubbles_of(wrong)
        assert error.value.code == "option.bubble"


def test_the_field_stands_beside_the_real_bubble_and_the_other_way_round():
    """Its values are those of an answer with it alone, so that tables of papers can be compared."""
    curve = shot(contents="kinetic", noise=1e-6)
    answers = {kind: infer(curve, bubble=kind, trust_input=True) for kind in (REAL, FIELD)}
    for ask, other in ((REAL, FIELD), (FIELD, REAL)):
        (beside,) = [one for one in answers[ask].others if one.bubble == other]
        alone = answers[other]
        low, _, high = beside.intervals["shear_modulus"]
        assert low < alone.median("shear_modulus") < high
        assert abs(beside.evidence.log - alone.evidence.log) < 8
    assert infer(curve, bubble="auto", trust_input=True).bubble in (FIELD, REAL)


def test_the_real_bubble_finds_what_it_was_and_nothing_where_there_is_none():
    real = shot(seed=3, contents="kinetic", confinement_damping=0.4, noise=1e-6)
    answer = infer(real, trust_input=True)
    assert answer.bubble == REAL
    for name, true in (
        ("shear_modulus", 5e3),
        ("viscosity", 0.01),
        ("accommodation", 0.07),
        ("confinement_damping", 0.4),
    ):
        low, high = answer.interval(name)
        assert low < true < high, name
    undamped = infer(shot(contents="kinetic", noise=1e-6), trust_input=True)
    assert undamped.interval("confinement_damping")[0] < 0.02


def test_a_gel_that_breaks_is_answered_with_damage_and_one_that_does_not_without():
    """As agarose of 2.5 % does: nothing but damage explains it, and the modulus is that before."""
    gel = NeoHookeanKelvinVoigt(1e5, 0.05)
    whole = Bubble("kinetic", 0.3, confinement_damping=0.3)
    noise = 1e-6 * np.random.default_rng(2).normal(size=TIME.size)
    for damage in (Damage(0.3, 1.7, "strain"), None):
        radius = simulate(gel, time=TIME, bubble=replace(whole, damage=damage or "none"), **SHOT).radius
        curve = RadiusCurve(TIME, radius + noise, maximum=(0.0, 250e-6))
        answer = infer(curve, trust_input=True)
        low, high = answer.interval("shear_modulus")
        assert (answer.bubble.name, low < 1e5 < high) == ("real, damage by strain" if damage else "real", True)
        assert answer.checks.verdict == "ok"
        assert ("rejected: real bubble" in answer.checks.message) == bool(damage)
