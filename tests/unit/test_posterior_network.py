"""The posterior network: slots, cells, draws and their density; what `infer` makes of them by simulations."""

import json
from dataclasses import replace

import numpy as np
import pytest
from answers import simulated
from conftest import ROOT, done, refused

import cavirheo
from cavirheo import NeoHookeanKelvinVoigt, Newtonian, RadiusCurve
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.latent import CAMERA, COORDINATES, damping, damping_to_latent
from cavirheo.inference.law import Family
from cavirheo.inference.network_answer import Networked
from cavirheo.inference.options import FREE, Options
from cavirheo.inference.posterior_network import network_of
from cavirheo.inference.verify import Verification, adaptive_sampling, verify_many
from cavirheo.inference.verify.adaptive_sampling import AdaptiveSampling
from cavirheo.inference.verify.mode import Target
from cavirheo.inference.verify.model_average import Part
from cavirheo.inference.verify.sampler import Mixture
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.inference.verify.verification import Estimation
from cavirheo.physics.bubble import FIELD, REAL, Bubble
from cavirheo.physics.media import WATER

NHKV = {"material": "nhkv", "trust_input": True}


def shot(*given, **settings) -> RadiusCurve:
    settings = {"noise": 0.01, "frames": 100, "max_radius": 245e-6, "stretch": 6.5, "seed": 5, **settings}
    return simulated(*given, **settings)


def experiment(curve, law="nhkv", bubble=FIELD, **given):
    options = Options(free=tuple(FREE), bubble=bubble, **given)
    return Experiment(curve, Family(law), options=options)


@pytest.mark.parametrize("integrated", [False, True])
@pytest.mark.parametrize(
    ("law", "bubble", "given"),
    [
        ("nhkv", FIELD, {}), ("power-law", REAL, {}), ("nhkv", REAL, {"stretch": 5.0}),
        ("nhkv", Bubble("kinetic", 0.07), {}), ("nhkv", Bubble("kinetic", confinement_damping=0.2), {}),
    ],
)  # fmt: skip
def test_the_density_of_a_proposal_is_normalised(law, bubble, given, integrated):
    """Its integral over a mixture through its draws, by importance sampling, is 1: also where parameters are given, and
    without the camera's, which come last."""
    here = experiment(shot(noise=0.03), law, bubble, **given)
    prior = here.prior()
    prior = prior.of([name for name in prior.names if name not in CAMERA]) if integrated else prior
    proposal = network_of().proposal(here, prior, True)
    rng = np.random.default_rng(3)
    u = proposal.draw(3000, rng)
    assert u.shape == (3000, len(prior.names))
    about = Mixture.through(u, np.zeros(len(u)), 8, rng).widened(0.3, 2.0)
    v = about.draw(6000, rng)
    ratio = np.exp(proposal.log_density(v) - about.log_density(v))
    assert np.mean(ratio) == pytest.approx(1.0, abs=max(0.1, 4 * np.std(ratio) / np.sqrt(len(v))))
    assert np.std(ratio) / np.mean(ratio) / np.sqrt(len(v)) < 0.15


@pytest.mark.slow
@pytest.mark.parametrize(("noise", "seed"), [(0.01, 1), (0.003, 2)])
def test_the_default_answer_agrees_with_more_draws(noise, seed):
    curve = shot(noise=noise, seed=seed)
    few, full = (cavirheo.infer(curve, bubble="field", verify=level, **NHKV) for level in ("auto", "full"))
    assert few.diagnostics.simulations < full.diagnostics.simulations
    assert few.evidence.log == pytest.approx(full.evidence.log, abs=0.4)
    for name in ("shear_modulus", "viscosity"):
        widths = [np.log(answer.interval(name)[1] / answer.interval(name)[0]) for answer in (few, full)]
        assert 0.7 < widths[0] / widths[1] < 1.4


def test_the_default_answer_holds_the_truth_and_depends_on_its_curve_alone():
    one, other = cavirheo.infer_many([shot(noise=0.01, seed=1), shot(noise=0.003, seed=2)], bubble="field", **NHKV)
    for answer in (one, other):
        assert (answer.method, answer.checks.verdict) == ("verified", "ok")
        assert answer.diagnostics.effective_sample_size >= TUNING.effective_fewest
        for name, truth in (("shear_modulus", 8e3), ("viscosity", 0.05)):
            low, high = answer.interval(name, 0.98)
            assert low < truth < high
    assert np.array_equal(one.theta, cavirheo.infer(shot(noise=0.01, seed=1), bubble="field", **NHKV).theta)


def test_an_answer_says_how_a_wrong_scale_would_move_it():
    """Per cent of R_max, against answers of the curve that is enlarged."""
    curve = shot(NeoHookeanKelvinVoigt(6e3, 0.05), stretch=7.0)
    answer = cavirheo.infer(curve, **NHKV)
    larger = cavirheo.infer(curve.with_max_radius(1.03 * curve.max_radius), **NHKV)
    found = (larger.median("shear_modulus") / answer.median("shear_modulus") - 1.0) / 0.03
    assert answer.diagnostics.modulus_over_scale == pytest.approx(found, rel=0.4)
    assert found > 5.0


def test_the_networks_own_answer_says_that_it_is_not_verified():
    answer = cavirheo.infer(shot(), bubble="field", verify="none", **NHKV)
    assert answer.method == "amortised"
    assert "not verified" in answer.checks.message
    assert answer.checks.verdict == "unverified"
    low, high = answer.interval("viscosity")
    assert low < 0.05 < high


@pytest.mark.parametrize(
    ("given", "constants"),
    [
        ({"max_radius": 900e-6, "frame": 4e-6}, {}),
        ({"max_radius": 600e-6, "frame": 12e-6, "frames": 40}, {}),
        ({}, {"density": 1300.0}),
        ({}, {"pressure": 2e5}),
        ({}, {"surface_tension": 0.03}),
        ({}, {"sound_speed": 900.0}),
        ({}, {"sound_speed": np.inf}),
        ({}, {"temperature": 318.15}),
    ],
)
def test_what_is_outside_the_training_is_not_sent_through_the_network(given, constants):
    curve, medium = shot(**given), replace(WATER, **constants)
    here = Experiment(curve, Family("nhkv"), medium, Options(free=tuple(FREE)))
    with refused("network.outside"):
        network_of().proposal(here, here.prior(), True)
    assert cavirheo.infer(curve, medium=medium, verify="none", **NHKV).checks.verdict == "failed"
    medium = replace(WATER, temperature=293.15, sound_speed=1450.0, surface_tension=0.07)  # this is within
    assert not network_of().outside(Experiment(shot(), Family("nhkv"), medium, Options()))


def planted(network):
    """The posterior of a shot weighed with a network that answers wrongly."""
    here = experiment(shot())
    target = Target(here, here.prior(), here.noise(True), 2)
    sampling = AdaptiveSampling(target, network(target), lambda: [target.start(TRUE)], list, seed=1)
    while sampling.short(1.0):
        sampling.weigh(1.0)
    return sampling.weighted


TRUE = np.array([np.log10(8e3), np.log10(0.05), np.log10(6.5), 0.0, 0.0, 0.0])  # x of `shot`, of the field's bubble


class Wrong:
    """A network whose draws are those of a mixture, and whose log density is too large by `more`."""

    def __init__(self, mixture, more=0.0):
        self.mixture, self.more, self.draw = mixture, more, mixture.draw

    def log_density(self, u):
        return self.mixture.log_density(u) + self.more


def narrow(target):
    """The network's draws, a twentieth as wide, about a place three standard deviations off."""
    u = network_of().proposal(target.experiment, target.prior, True).draw(300, np.random.default_rng(2))
    spread = np.cov(u.T)
    return Wrong(Mixture(np.ones(1), (np.mean(u, axis=0) + 3 * np.sqrt(np.diag(spread)))[None], spread[None] / 400))


@pytest.mark.slow
def test_an_over_confident_network_does_not_narrow_the_answer():
    right = planted(lambda target: network_of().proposal(target.experiment, target.prior, True))
    moments = []
    for found in (right, planted(narrow)):
        weight = np.exp(found.sample.log_weight - found.sample.log_weight.max())
        mean = np.average(found.sample.u, axis=0, weights=weight)
        moments.append((mean, np.sqrt(np.average((found.sample.u - mean) ** 2, axis=0, weights=weight))))
    (mean, sd), (other_mean, other_sd) = moments
    assert np.all(np.abs(mean - other_mean)[:3] < 0.6 * sd[:3])
    assert np.all(other_sd[:3] > 0.6 * sd[:3])


def test_evidences_that_disagree_are_not_signed():
    """A density that is too small by e^3 everywhere, as of a network with another prior, gives another evidence."""

    def of_another_prior(target):
        (mode,) = adaptive_sampling.modes(target, [target.start(TRUE)])
        return Wrong(Mixture(np.ones(1), mode.u[None], mode.covariance[None]), -3.0)

    found = planted(of_another_prior)
    assert found.evidence_gap > TUNING.agree


def test_a_law_is_looked_at_where_a_better_one_is_best():
    """A law that contains another one follows the same frames there, wherever the search for it went."""
    curve, network, parts = shot(Newtonian(0.05)), network_of(), []
    for law in ("newtonian", "nhkv"):
        start = Networked(network, law, FIELD, checked=False, trust_input=True).infer(curve)
        settings = Verification(network=network, level="auto")
        parts.append(Part(Estimation(settings, curve, start), 0.0))
    lost, best = parts
    explorer = lost.sampling.explorer
    explorer.modes = [replace(mode, u=mode.u + 1.5, log_posterior=mode.log_posterior - 50.0) for mode in explorer.modes]
    explorer.value -= 50.0
    lost.look_where(best)
    assert explorer.height > best.sampling.explorer.height - TUNING.other_law


def test_a_network_whose_draws_all_fail_is_no_exception(monkeypatch):
    simulated = Target.residuals

    def residuals(self, u, accuracy):
        return np.where(u[:, :1] > 4.0, np.nan, simulated(self, np.minimum(u, 4.0), accuracy))

    def far(target):
        d = len(target.prior.names)
        return Mixture(np.ones(1), np.full((1, d), 20.0), 0.1 * np.eye(d)[None])

    monkeypatch.setattr(Target, "residuals", residuals)
    assert planted(far).sample.ess > 20


def test_no_answer_is_ok_without_an_interval(monkeypatch):
    monkeypatch.setattr(adaptive_sampling, "TUNING", replace(TUNING, draws=40, emulated_worst=0.0))
    curve, network = shot(), network_of()
    start = Networked(network, bubble=FIELD, checked=False, trust_input=True).infer(curve)
    (answer,) = verify_many([curve], [start], level="full", network=network)
    assert answer.checks.verdict == "no_interval"
    assert answer.interval("shear_modulus") is None
    assert "not to be trusted" in answer.checks.message


@pytest.mark.slow
@pytest.mark.train
def test_generate_and_train_a_small_network(tmp_path, run):
    pytest.importorskip("torch")
    small = (ROOT / "recipes/posterior.toml").read_text("utf-8")
    for old, new in (("n = 120000", "n = 120"), ("13107200", "512"), ("width = 384", "width = 16"),
                     ("depth = 5", "depth = 1"), ("hidden = 64", "hidden = 8"), ("batch = 256", "batch = 64"),
                     ('name = "posterior"', 'name = "small"')):  # fmt: skip
        assert old in small
        small = small.replace(old, new)
    (tmp_path / "small.toml").write_text(small, encoding="utf-8")
    assert run("generate", "small.toml", "-o", "data", "--workers", 1)[0] == 0
    first = (tmp_path / "data" / "curves-00000.h5").read_bytes()
    (tmp_path / "data" / "curves-00000.h5").unlink()
    assert run("generate", "small.toml", "-o", "data", "--workers", 2)[0] == 0
    assert (tmp_path / "data" / "curves-00000.h5").read_bytes() == first
    done(run("train", "small.toml", "data", "-o", "run", "--threads", 1))
    card = json.loads((tmp_path / "run" / "small.json").read_text("utf-8"))
    assert card["kind"] == "posterior"
    assert set(card["coverage"]["by_slot"]) == set(COORDINATES)
    assert network_of(str(tmp_path / "run" / "small.onnx")).name == "small"


def test_a_misfit_that_the_real_bubble_explains_is_said():
    true = Bubble("kinetic", accommodation=0.07)
    curve = shot(NeoHookeanKelvinVoigt(3e3, 0.02), stretch=9.0, noise=0.003, seed=1, within=true)
    answer = cavirheo.infer(curve, bubble="field", **NHKV)
    (other,) = (one for one in answer.others if one.bubble == REAL)
    assert other.evidence.log > answer.evidence.log + 8
    low, _, high = other.intervals["accommodation"]
    assert 0.8 * low < 0.07 < 1.25 * high  # at a glance
    assert answer.checks.verdict == "other_model_preferred"
    assert answer.checks.messages[0].code == "model.rejected"


def test_the_slot_of_the_damping_has_its_prior():
    z = np.linspace(-2.5, 3.5, 9)
    assert np.allclose([damping_to_latent(float(one)) for one in damping(z)], np.minimum(z, 3.0), atol=1e-6)
    values = damping(np.random.default_rng(1).standard_normal(20_000))
    assert 0 <= values.min() < values.max() <= 1.0
    assert np.sqrt(np.mean(values**2)) == pytest.approx(0.3, rel=0.02)
    assert damping_to_latent(0.0) == -3.0
