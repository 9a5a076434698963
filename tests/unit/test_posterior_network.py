"""The posterior network: slots, cells, draws and their density; what `infer` makes of them by simulations."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT

import cavirheo
from cavirheo import InputError, NeoHookeanKelvinVoigt, RadiusCurve, simulate
from cavirheo.inference.bins import BINS, CHANNELS, SCALARS, SIZE, binned
from cavirheo.inference.budget import Budget
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.latent import CAMERA, SLOTS, damping, damping_to_slot, from_slots, slot, to_slots, used
from cavirheo.inference.law import Family
from cavirheo.inference.network_answer import Networked
from cavirheo.inference.options import FREE, Options
from cavirheo.inference.posterior_network import load_posterior
from cavirheo.inference.verify import adaptive_sampling, verify_many
from cavirheo.inference.verify.adaptive_sampling import AdaptiveSampling
from cavirheo.inference.verify.mode import Target
from cavirheo.inference.verify.sampler import Mixture
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.bubble import FIELD, REAL, Bubble
from cavirheo.physics.media import WATER
from cavirheo.prior import log_normal

LAWS = ("newtonian", "power-law", "nhkv", "fung + newtonian")


def shot(material=None, *, noise=0.01, frames=100, frame=1e-6, radius=245e-6, stretch=6.5, seed=5, **about):
    run = simulate(
        material or NeoHookeanKelvinVoigt(8e3, 0.05), max_radius=radius, stretch=stretch, time=frame * np.arange(frames)
    )
    scatter = noise * radius * np.random.default_rng(seed).standard_normal(frames)
    return RadiusCurve(run.time, run.radius + scatter, meta={"name": "shot"}, **about)


def experiment(curve, law="nhkv", bubble=FIELD, **given):
    options = Options(free=tuple(FREE), bubble=bubble, **given)
    return Experiment(curve, Family(law), options=options)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("bubble", ["field", "real"])
def test_slots_are_a_change_of_coordinates(law, bubble):
    names = (*Family(law).parameters, "stretch", *(["accommodation"] if bubble == "real" else []))
    bounds = np.array([PARAMETERS[name].searched for name in names])
    rng = np.random.default_rng(1)
    log10 = bounds[:, 0] + rng.uniform(0.02, 0.98, (20, len(names))) * (bounds[:, 1] - bounds[:, 0])
    z = to_slots(names, log10)
    back, log_jacobian = from_slots(names, z)
    assert np.allclose(back, log10)
    places = [k for k in used(law, bubble) if SLOTS[k] not in (*CAMERA, "confinement_damping")]
    assert len(places) == len(names)
    for row in range(3):
        step, columns = 1e-5, []
        for i in range(len(names)):
            moved = log10[row].copy()
            moved[i] += step
            columns.append((to_slots(names, moved[None])[0, places] - z[row, places]) / step)
        assert np.log(abs(np.linalg.det(columns))) == pytest.approx(-log_jacobian[row] * -1, abs=1e-3)


def test_cells_hold_the_frames_whatever_their_rate():
    known_of = {"max_radius": 1e-4, "frame": 0.05, "exposure": 0.0, "noise": 0.01, "discrepancy": 0.0, "late": 0.0}
    about = {name: np.array([value]) for name, value in known_of.items()}
    time = np.arange(0.0, 3.0, 0.05)
    read = binned(np.zeros(len(time), int), time, 1.0 - 0.2 * time, **about)
    assert read.shape == (1, SIZE) == (1, BINS * CHANNELS + SCALARS)
    line, _, known, within = read[0, : 4 * BINS].reshape(4, BINS)
    assert known.sum() == len(time)
    middle = (np.arange(BINS) + 0.5) * 6.0 / BINS
    inside = (within > 0) & (known == 0)  # passed by a straight line
    assert np.allclose(line[inside], 2.0 * (1.0 - 0.2 * middle[inside]) - 1.0, atol=1e-6)
    two = binned(np.repeat([0, 1], len(time)), np.tile(time, 2), np.tile(1.0 - 0.2 * time, 2),
                **{name: np.repeat(value, 2) for name, value in about.items()})  # fmt: skip
    assert np.array_equal(two[0], two[1])
    assert np.array_equal(two[:1], read)


@pytest.mark.parametrize("integrated", [False, True])
@pytest.mark.parametrize(
    ("law", "bubble", "given"),
    [
        ("nhkv", FIELD, {}), ("power-law", REAL, {}), ("nhkv", REAL, {"stretch": 5.0}),
        ("nhkv", Bubble("kinetic", 0.07), {}), ("nhkv", Bubble("kinetic", confinement_damping=0.2), {}),
    ],
)  # fmt: skip
def test_the_density_of_a_proposal_is_normalised(law, bubble, given, integrated):
    """Its integral over a Gaussian about its draws, by importance sampling, is 1: also where parameters are given, and
    without the camera's, which come last."""
    here = experiment(shot(noise=0.03), law, bubble, **given)
    prior = here.prior()
    prior = prior.of([name for name in prior.names if name not in CAMERA]) if integrated else prior
    proposal = load_posterior().proposal(here, prior, True)
    rng = np.random.default_rng(3)
    u = proposal.draw(3000, rng)
    assert u.shape == (3000, len(prior.names))
    about = Mixture(np.ones(1), np.mean(u, axis=0)[None], 1.5 * np.cov(u.T)[None])
    v = about.draw(6000, rng)
    ratio = np.exp(proposal.log_density(v) - about.log_density(v))
    assert np.mean(ratio) == pytest.approx(1.0, abs=max(0.1, 4 * np.std(ratio) / np.sqrt(len(v))))
    assert np.std(ratio) / np.mean(ratio) / np.sqrt(len(v)) < 0.15


def test_the_default_answer_holds_the_truth_and_agrees_with_more_draws():
    curve = shot()
    answer = cavirheo.infer(curve, bubble="field", trust_input=True)
    assert answer.method == "verified"
    assert answer.checks.verdict == "ok"
    assert answer.interval("shear_modulus")[0] < 8e3 < answer.interval("shear_modulus")[1]
    assert answer.interval("viscosity")[0] < 0.05 < answer.interval("viscosity")[1]
    assert answer.diagnostics.effective_sample_size >= TUNING.effective_fewest
    assert answer.provenance["few_simulations"]
    assert answer.diagnostics.simulations <= 560
    (again,) = cavirheo.infer_many([curve], bubble="field", trust_input=True, workers=1)
    assert np.array_equal(again.theta, answer.theta)


def test_the_default_answer_agrees_with_full():
    for noise, seed in ((0.01, 1), (0.003, 2), (0.02, 3)):
        curve = shot(noise=noise, seed=seed)
        few, full = (
            cavirheo.infer(curve, bubble="field", verify=level, trust_input=True) for level in ("auto", "full")
        )
        assert few.evidence.log == pytest.approx(full.evidence.log, abs=0.4)
        for name in ("shear_modulus", "viscosity"):
            widths = [np.log(answer.interval(name)[1] / answer.interval(name)[0]) for answer in (few, full)]
            assert 0.7 < widths[0] / widths[1] < 1.4


def test_an_answer_says_how_a_wrong_scale_would_move_it():
    """Per cent of R_max, against answers of the curve that is enlarged."""
    curve = shot(NeoHookeanKelvinVoigt(6e3, 0.05), stretch=7.0)
    answer = cavirheo.infer(curve, trust_input=True)
    larger = cavirheo.infer(curve.with_max_radius(1.03 * curve.max_radius), trust_input=True)
    found = (larger.median("shear_modulus") / answer.median("shear_modulus") - 1.0) / 0.03
    assert answer.diagnostics.modulus_over_scale == pytest.approx(found, rel=0.4)
    assert found > 5.0


def test_the_networks_own_answer_says_that_it_is_not_verified():
    answer = cavirheo.infer(shot(), bubble="field", verify="none", trust_input=True)
    assert answer.method == "amortised"
    assert "not verified" in answer.checks.message
    assert answer.checks.verdict == "unverified"
    low, high = answer.interval("viscosity")
    assert low < 0.05 < high


@pytest.mark.parametrize(
    ("curve", "what"),
    [
        (shot(radius=900e-6, frame=4e-6), "R_max of 894.9 um"),
        (shot(frame=12e-6, radius=600e-6, frames=40), "12 us between frames"),
    ],
)
def test_what_is_outside_the_training_is_not_sent_through_the_network(curve, what):
    here = experiment(curve)
    assert what in load_posterior().outside(here)
    with pytest.raises(InputError) as error:
        load_posterior().proposal(here, here.prior(), True)
    assert error.value.code == "network.outside"
    assert cavirheo.infer(curve, verify="none").checks.verdict == "failed"


@pytest.mark.parametrize(
    ("constants", "what"),
    [
        ({"density": 1300.0}, "a density of 1300"),
        ({"pressure": 2e5}, "a pressure of 2e+05"),
        ({"surface_tension": 0.03}, "surface_tension = 0.03"),
        ({"sound_speed": 900.0}, "sound_speed = 900"),
        ({"sound_speed": np.inf}, "sound_speed = inf"),
        ({"temperature": 318.15}, "a vapour pressure of"),
        ({"temperature": 293.15, "sound_speed": 1450.0, "surface_tension": 0.07}, ""),
    ],
)
def test_a_medium_that_it_does_not_know_is_not_sent_through_the_network(constants, what):
    medium = replace(WATER, **constants)
    said = load_posterior().outside(Experiment(shot(), Family("nhkv"), medium, Options()))
    assert said.startswith(what)
    assert bool(said) == bool(what)


def planted(network, draws=400):
    """The posterior of a shot weighed with a network that answers wrongly."""
    here = experiment(shot())
    target = Target(here, here.prior(), here.noise(True), 2)
    sampling = AdaptiveSampling(target, network(target), lambda: [target.start(TRUE)], list, seed=1)
    sampling.weigh(100.0, Budget(draws=draws))
    return sampling.weighted


TRUE = np.array([np.log10(8e3), np.log10(0.05), np.log10(6.5), 0.0, 0.0, 0.0])  # x of `shot`, of the field's bubble


class Narrow:
    """Over-confident: the network's draws, a twentieth as wide, about a place three standard deviations off."""

    def __init__(self, target):
        own = load_posterior().proposal(target.experiment, target.prior, True)
        u = own.draw(300, np.random.default_rng(2))
        spread = np.cov(u.T)
        self.mixture = Mixture(
            np.ones(1), (np.mean(u, axis=0) + 3 * np.sqrt(np.diag(spread)))[None], spread[None] / 400
        )

    def draw(self, count, rng):
        return self.mixture.draw(count, rng)

    def log_density(self, u):
        return self.mixture.log_density(u)


@pytest.mark.slow
def test_an_over_confident_network_does_not_narrow_the_answer():
    right = planted(lambda target: load_posterior().proposal(target.experiment, target.prior, True))
    wrong = planted(Narrow)
    spreads = []
    for found in (right, wrong):
        weight = np.exp(found.drawn.log_weight - found.drawn.log_weight.max())
        mean = np.average(found.drawn.u, axis=0, weights=weight)
        spreads.append((mean, np.sqrt(np.average((found.drawn.u - mean) ** 2, axis=0, weights=weight))))
    assert np.all(np.abs(spreads[0][0] - spreads[1][0])[:3] < 0.6 * spreads[0][1][:3])
    assert np.all(spreads[1][1][:3] > 0.6 * spreads[0][1][:3])


def test_evidences_that_disagree_are_not_signed():
    """A density that is too small by e^3 everywhere, as of a network with another prior, gives another evidence."""

    class Wrong:
        def __init__(self, target):
            (mode,) = adaptive_sampling.modes(target, [target.start(TRUE)])
            self.mixture = Mixture(np.ones(1), mode.u[None], mode.covariance[None])

        def draw(self, count, rng):
            return self.mixture.draw(count, rng)

        def log_density(self, u):
            return self.mixture.log_density(u) - 3.0

    found = planted(Wrong, draws=120)
    assert found.apart is not None
    assert found.apart > TUNING.agree
    assert not found.few


def test_no_answer_is_ok_without_an_interval():
    curve, network = shot(), load_posterior()
    start = Networked(network, bubble=FIELD, checked=False, trust_input=True).infer(curve)
    (answer,) = verify_many([curve], [start], level="auto", network=network, budget=Budget(draws=40))
    assert answer.checks.verdict == "no_interval"
    assert answer.interval("shear_modulus") is None
    assert "not to be trusted" in answer.checks.message


def test_wrong_calls_are_refused_at_once():
    curve = shot()
    for settings, code in (
        ({"material": "honey"}, "law.not_fittable"), ({"material": "auto", "verify": "none"}, "option.auto"),
        ({"material": "newtonian", "model": "bdt-viscoelastic"}, "option.material"), ({"window": "x"}, "option.window"),
    ):  # fmt: skip
        with pytest.raises(InputError) as error:
            cavirheo.infer(curve, **settings)
        assert error.value.code == code


def test_a_density_over_u_has_the_prior_as_its_measure():
    here = experiment(shot())
    prior = here.prior()
    u = np.random.default_rng(1).standard_normal((5, len(prior.names)))
    x = prior.to_x(u)
    names, theta = here.answer(x)
    moved = 1e-6
    for i in range(len(names)):
        there = u.copy()
        there[:, i] += moved
        slope = (here.answer(prior.to_x(there))[1] - theta)[:, i] / moved
        assert np.all(slope > 0)
    whole = np.sum([np.log((here.answer(prior.to_x(u + moved * np.eye(len(names))[i]))[1] - theta)[:, i] / moved)
                    for i in range(len(names))], axis=0)  # fmt: skip
    assert np.allclose(whole, log_normal(u) - prior.log_density(x) + here.log_stretched(theta), atol=1e-3)


@pytest.mark.slow
@pytest.mark.train
def test_generate_and_train_a_small_network(tmp_path, run):
    pytest.importorskip("torch")
    text = ROOT / "recipes/posterior.toml"
    small = text.read_text("utf-8")
    for old, new in (("n = 120000", "n = 120"), ("13107200", "512"), ("width = 384", "width = 16"),
                     ("depth = 5", "depth = 1"), ("hidden = 64", "hidden = 8"), ("batch = 256", "batch = 64"),
                     ('name = "posterior"', 'name = "small"')):  # fmt: skip
        assert old in small
        small = small.replace(old, new)
    (tmp_path / "small.toml").write_text(small, encoding="utf-8")
    status, _, err = run("generate", "small.toml", "-o", "data", "--workers", 1)
    assert status == 0, err
    first = (tmp_path / "data" / "curves-00000.h5").read_bytes()
    (tmp_path / "data" / "curves-00000.h5").unlink()
    assert run("generate", "small.toml", "-o", "data", "--workers", 2)[0] == 0
    assert (tmp_path / "data" / "curves-00000.h5").read_bytes() == first
    status, _, err = run("train", "small.toml", "data", "-o", "run", "--threads", 1)
    assert status == 0, err
    card = json.loads((tmp_path / "run" / "small.json").read_text("utf-8"))
    assert card["kind"] == "posterior"
    assert len(card["kinds"]) == 8
    assert set(card["coverage"]["by_slot"]) == set(SLOTS)
    assert load_posterior(str(tmp_path / "run" / "small.onnx")).name == "small"
    (tmp_path / "other.toml").write_text(small.replace("seed = 7", "seed = 8"), encoding="utf-8")
    status, _, err = run("generate", "other.toml", "-o", "data")
    assert status == 2
    assert "another seed" in err
    (tmp_path / "wrong.toml").write_text(small.replace("nhkv = 0.4", "zener = 0.4"), encoding="utf-8")
    status, _, err = run("generate", "wrong.toml", "-o", "new")
    assert status == 2
    assert "zener" in err


def test_a_misfit_that_the_real_bubble_explains_is_said():
    law, frame = NeoHookeanKelvinVoigt(3e3, 0.02), 1e-6
    bubble = Bubble("kinetic", accommodation=0.07)
    run = simulate(law, max_radius=245e-6, stretch=9.0, time=frame * np.arange(100), bubble=bubble)
    scatter = 0.003 * 245e-6 * np.random.default_rng(1).standard_normal(100)
    curve = RadiusCurve(run.time, run.radius + scatter, meta={"name": "shot"})
    answer = cavirheo.infer(curve, bubble="field", trust_input=True)
    (other,) = (one for one in answer.others if one.bubble == REAL)
    assert other.evidence.log > answer.evidence.log + 8
    low, _, high = other.intervals["accommodation"]
    assert 0.8 * low < 0.07 < 1.25 * high  # at a glance
    assert re.match(
        r"the evidence prefers another model by a factor of about e\^\d+: real bubble", answer.checks.message
    )
    assert answer.checks.verdict == "other_model_preferred"


def test_the_slot_of_the_damping_has_its_prior():
    z = np.linspace(-2.5, 3.5, 9)
    assert np.allclose([damping_to_slot(float(one)) for one in damping(z)], np.minimum(z, 3.0), atol=1e-6)
    values = damping(np.random.default_rng(1).standard_normal(20_000))
    assert values.min() >= 0
    assert values.max() <= 1.0
    assert np.sqrt(np.mean(values**2)) == pytest.approx(0.3, rel=0.02)
    assert damping_to_slot(0.0) == -3.0
    assert slot("confinement_damping") == SLOTS.index("confinement_damping")


def test_a_recording_that_begins_at_its_maximum_has_a_clock_of_a_frame():
    """It is an ordinary recording: R_max may lie a frame from the first one, and twelve gels count."""
    assert experiment(shot(frame=2e-6)).free["time_origin"][1] == pytest.approx(2e-6)
    grown = shot(frame=2e-6)
    before = RadiusCurve(
        np.append(-2e-6 * np.arange(20, 0, -1), grown.time),
        np.append(245e-6 * np.linspace(0.3, 0.98, 20), grown.radius),
    )
    assert experiment(before).free["time_origin"][1] == pytest.approx(1e-6, rel=0.01)
