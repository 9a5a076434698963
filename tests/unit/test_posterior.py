"""The verified posterior and its network: likelihood, sampling, what catches a wrong width or a wrong law."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from answers import GEL, bubble, fit, simulated
from cavirheo.inference.posterior_network import CAMERA, COORDINATES, damping, damping_to_latent, network_of
from cavirheo.inference.verify import Verification, adaptive_sampling, evidence, verification
from cavirheo.inference.verify.mode import Simulated, Target, climb
from cavirheo.inference.verify.sampler import Coordinates, Mixture, Sample, markov_sample
from cavirheo.inference.verify.surrogate import AdaptiveProposal, climb_by_surrogates
from cavirheo.inference.verify.tuning import TUNING
from conftest import ROOT, done, messages, refused
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.stats import multivariate_t, norm

import cavirheo
from cavirheo import NeoHookeanKelvinVoigt, Newtonian, RadiusCurve, infer, simulate
from cavirheo.inference import camera, verify
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.assumptions import FREE, Family, Options
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.frames import MOST_FRAMES, compared_frames
from cavirheo.inference.noise import GAMMA_A, Noise
from cavirheo.physics.accuracy import DEFAULT, ROUGH
from cavirheo.physics.bubble import FIELD, REAL, Bubble
from cavirheo.physics.materials import Zener
from cavirheo.physics.media import WATER
from cavirheo.posterior import Checks, Evidence, OtherAnswer, Posterior, weighted_quantile
from cavirheo.prior import Prior, log_normal
from validation.claims import calibration

R_MAX = 250e-6
TRUTH = {"shear_modulus": 8e3, "viscosity": 0.05, "stretch": 7.0}


def shot(law=GEL, noise=0.01, **given) -> RadiusCurve:
    return simulated(law, max_radius=R_MAX, stretch=TRUTH["stretch"], noise=noise, maximum=(0.0, R_MAX), **given)


def experiment(curve, law="nhkv", bubble=FIELD, exposure=0.0, **given) -> Experiment:
    curve = replace(curve, meta={**curve.meta, "exposure_s": exposure})
    return Experiment(curve, Family(law), options=Options(free=tuple(FREE), bubble=bubble, **given))


def target_of(here: Experiment, discrepancy=False, kind=Target) -> Target:
    return kind(here, here.prior(), here.noise(discrepancy))


@pytest.fixture(scope="module")
def fitted():
    """A shot with its least-squares answer."""
    curve = shot()
    return curve, fit(curve)


@pytest.mark.parametrize("discrepancy", [False, True])
def test_variance_and_discrepancy_of_the_noise_are_integrated_out(discrepancy):
    """Against dense matrices, at irregular times: the variance is of an inverse gamma distribution."""
    rng = np.random.default_rng(1)
    time, deviation, residual = np.sort(rng.uniform(0, 4, 15)), rng.uniform(0.5, 2, 15), rng.standard_normal(15)
    velocity = rng.standard_normal(15)
    noise = Noise(deviation, time, 2.0, discrepancy, velocity)
    total = 0.0
    for (ratio, clock, tau), log_prior in zip(noise.grid, noise.log_prior, strict=True):
        kernel = np.exp(-np.abs(time[:, None] - time) / tau)
        late = 2.0 * clock * velocity
        C = np.diag(deviation**2) + np.median(deviation) ** 2 * kernel * (ratio**2 + np.outer(late, late))
        total += np.exp(log_prior) * multivariate_t.pdf(residual, shape=C, df=2 * GAMMA_A)
    assert np.sum(np.exp(noise.log_prior)) == pytest.approx(1.0)
    assert noise.log_density(residual[None])[0] == pytest.approx(np.log(total), abs=1e-6)


@pytest.mark.parametrize("discrepancy", [False, True])
def test_newton_is_the_derivative_of_the_density(discrepancy):
    rng = np.random.default_rng(2)
    noise = Noise(np.full(20, 0.01), np.arange(20.0), 5.0, discrepancy)
    residual, J = 0.02 * rng.standard_normal(20), rng.standard_normal((20, 2))
    gradient, curvature = noise.newton(residual, J)
    step = 1e-6
    moved = [(-noise.log_density((residual - s * step * J[:, 0])[None])[0]) for s in (1, -1)]
    assert gradient[0] == pytest.approx((moved[0] - moved[1]) / (2 * step), rel=1e-4)
    assert np.all(np.linalg.eigvalsh(curvature) > 0)


def test_what_goes_with_time_is_scaled_with_the_bubble():
    """A bubble that is 2 % larger moves alike on its own clock if viscosity and relaxation time are 2 % larger."""
    names, x = ("shear_modulus", "viscosity", "relaxation_time"), np.log10([[8e3, 0.08, 3e-6]])
    law = 10.0 ** camera.rescaled(names, x, np.array([1.02]))[0]
    assert law == pytest.approx([8e3, 0.08 * 1.02, 3e-6 * 1.02])
    time = np.arange(0.0, 80e-6, 1e-6)
    one, larger, unscaled = (
        simulate(Zener(*values), max_radius=size * R_MAX, stretch=7.0, time=size * time).radius / (size * R_MAX)
        for values, size in ((10.0 ** x[0], 1.0), (law, 1.02), (10.0 ** x[0], 1.02))
    )
    assert np.std(larger - one) < 0.5 * np.std(unscaled - one)


def test_exposure_is_the_mean_over_the_shutter():
    there = experiment(shot(noise=0.0), exposure=0.4e-6)
    x = np.append(np.log10(list(TRUTH.values())), [0.5, 0.0, 0.0])  # the clock is late by a quarter of a frame
    seen = there.predict(x, DEFAULT).radius
    around = np.linspace(-0.5, 0.5, 402)[1:-1]
    instants = np.abs(there.time_since_max[:, None] - 0.25e-6 + 0.4e-6 * around).ravel()
    ordered, places = np.unique(instants, return_inverse=True)
    radius = simulate(GEL, max_radius=R_MAX, stretch=7.0, time=ordered).radius[places] / R_MAX
    brute = radius.reshape(-1, 400).mean(axis=1)
    sharp = experiment(shot(noise=0.0)).predict(x, DEFAULT).radius
    assert np.max(np.abs(seen - brute)) < 2e-3
    assert np.max(np.abs(sharp - brute)) > 10 * np.max(np.abs(seen - brute))
    for exposure in (-1.0, 2e-6):  # no time; longer than a frame
        with refused("experiment.exposure"):
            experiment(shot(), exposure=exposure)


def test_priors_are_normalised_and_their_coordinates_normal():
    u = np.array([0.7])
    for low, high, mean, std in ((1.0, 3.0, 0.0, np.inf), (-1.0, 1.0, 0.2, 0.5)):
        one = Prior(("a",), [low], [high], [mean], [std])
        assert quad(lambda x, one=one: np.exp(one.log_density(np.array([x]))), low, high)[0] == pytest.approx(1.0)
        slope = (one.to_x(u + 1e-6) - one.to_x(u - 1e-6)) / 2e-6
        assert one.slope(u) == pytest.approx(slope, rel=1e-5)
        assert np.exp(one.log_density(one.to_x(u))) * slope == pytest.approx(norm.pdf(u), rel=1e-5)
        assert one.to_u(one.to_x(u)) == pytest.approx(u, abs=1e-6)


class TwoModes(Target):
    """Of bubbles of a small stretch those of a large one: each hill has a mirror image."""

    middle = -np.inf  # u of the stretch

    def residuals(self, u, accuracy):
        stretch = self.middle + np.hypot(u[:, 2] - self.middle, 0.01)
        return super().residuals(np.column_stack([u[:, :2], stretch]), accuracy)


def test_frames_of_a_shape_follow_the_size_of_the_bubble():
    """A bubble that is larger than the measured one by scale and factor, against its own simulation."""
    curve = shot(within=Bubble("kinetic", 0.1, confinement_damping=0.2))
    real = experiment(curve, bubble=REAL)
    target = target_of(real)
    x = real.from_best(TRUTH | {"accommodation": 0.1, "confinement_damping": 0.2})
    u, z = target.start(x)[None], np.array([[0.0, 2.0, 2.0]])
    exact = real.difference(target.with_camera(u, z)[0], DEFAULT)[real.counted]
    errors = []
    for _ in range(2):
        residual = target.residuals(u, DEFAULT)
        frames = target.noise.split(target.extended(target.noise.shapes(residual), z))[0][0]
        errors.append(np.sqrt(np.mean((frames - exact) ** 2)))
        near = u + 0.1
        target.adapt_shapes(near[0], target.residuals(near, DEFAULT)[0])
    by_shape = target.camera.shape_error(real.solve_on_grid(x, target.camera), z[0])
    assert errors[1] < 0.3 * errors[0] + np.sqrt(np.mean(by_shape**2))
    assert np.sqrt(np.mean(by_shape**2)) < 0.3 * errors[0]


class Straight(Coordinates):
    """A parabola to_straight, and the exponential of a coordinate."""

    def to_straight(self, u):
        return np.column_stack([u[:, 0], u[:, 1] + 0.3 * u[:, 0] ** 2, np.exp(u[:, 2]), u[:, 3]]), u[:, 2]

    def from_straight(self, v):
        logs = np.log(np.where(v[:, 2] > 0, v[:, 2], np.nan))
        return np.column_stack([v[:, 0], v[:, 1] - 0.3 * v[:, 0] ** 2, logs, v[:, 3]])


@pytest.mark.parametrize(("width", "how"), [(3.0, Straight()), (0.3, Straight()), (1.0, None), (0.3, None)])
def test_markov_chains_draw_a_density_wherever_they_begin(width, how):
    """A curved density in four dimensions of known evidence; from far away and from its middle alone."""

    def density(u):
        from_straight = np.column_stack([u[:, 0] / 2.0, u[:, 1] + 0.3 * u[:, 0] ** 2 - 1.2, u[:, 2] / 0.3, u[:, 3]])
        return log_normal(from_straight) - np.log(2.0 * 0.3) + 5.0

    found = []
    for rng in map(np.random.default_rng, range(12)):
        start = width * rng.standard_normal((200, 4))
        found.append(markov_sample(density, start, lambda u: None, rng, 1000, how)[0])
    assert min(one.ess for one in found) >= 300.0
    assert np.mean([one.log_evidence[0] for one in found]) == pytest.approx(5.0, abs=0.05)
    assert np.std([one.log_evidence[0] for one in found]) < 0.2
    for i, scale in ((0, 2.0), (2, 0.3)):
        ends = [weighted_quantile(one.u[:, i], np.array([0.05, 0.95]), one.log_weight) for one in found]
        assert np.mean(ends, axis=0) == pytest.approx(scale * norm.ppf([0.05, 0.95]), rel=0.1)


def test_coordinates_of_steps_have_their_slope():
    target = target_of(experiment(shot(), bubble=REAL))
    w = np.random.default_rng(0).standard_normal((4, len(target.prior.names) + len(target.camera.free)))
    v, log_slope = target.to_straight(w)
    assert target.from_straight(v) == pytest.approx(w)
    sides = [
        np.array([target.to_straight(w + step)[0] for step in side * np.eye(w.shape[1])]) for side in (-1e-5, 1e-5)
    ]
    slopes = np.moveaxis(sides[1] - sides[0], 0, -1) / 2e-5
    assert np.linalg.slogdet(slopes)[1] == pytest.approx(log_slope, abs=1e-6)


def test_a_mode_that_no_start_led_to_is_climbed_into():
    target = target_of(experiment(shot()))
    right = climb(target, target.start(target.experiment.from_best(TRUTH)), ROUGH)
    wrong = replace(right, u=right.u + 1.0, log_posterior=right.log_posterior - 300.0)
    proposal = AdaptiveProposal(target, [wrong])
    proposal(right.u + np.random.default_rng(0).uniform(-0.2, 0.2, (12, len(right.u))))
    assert (
        wrong.log_posterior + TUNING.other_mode_height
        < proposal.height
        < right.log_posterior - TUNING.other_mode_height
    )
    proposal.climb_higher()
    assert proposal.height == pytest.approx(right.log_posterior, abs=TUNING.climb_tolerance)


def test_a_mode_is_climbed_to_beside_a_higher_one():
    here, rng = experiment(shot(noise=0.02)), np.random.default_rng(1)
    target, known = target_of(here, True, TwoModes), climb(target_of(here, True), np.zeros(3), ROUGH)
    target.middle = known.u[2] - 0.8
    spread = rng.standard_normal((42, 3)) * np.sqrt(np.diag(known.covariance))
    u = known.u + np.concatenate([1.5 * spread[:30], 3.0 * spread[30:] - [0.0, 0.0, 1.6]])
    simulated = Simulated.at(target, u, ROUGH)
    found, _ = climb_by_surrogates(target, simulated, u[30 + np.argmax(simulated.value[30:])], [known])
    assert found.u == pytest.approx(known.u - [0.0, 0.0, 1.6], abs=0.1)


def test_a_proposal_that_is_too_narrow_shows_in_size_and_tail():
    """A heavy tail counts where it weighs something: not beside weights that are nearly equal."""
    for factor, trusted in ((1.0, True), (0.2, False), (0.5, False)):
        u = factor * np.random.default_rng(0).standard_normal((2000, 4))
        log_weight = log_normal(u) - (log_normal(u / factor) - 4 * np.log(factor))
        found = Sample(u, log_weight, np.zeros(len(u)))
        assert (found.ess > 100 and found.reliable) is trusted, factor
    excess = 0.002 * (np.random.default_rng(0).uniform(size=1800) ** -0.85 - 1.0)
    light, heavy = (Sample(np.zeros((1800, 1)), np.log(body + excess), np.zeros(1800)) for body in (1.0, 1e-6))
    assert light.tail[0] == pytest.approx(heavy.tail[0])
    assert light.tail[0] > 0.7
    assert (light.reliable, heavy.reliable) == (True, False)


def test_weights_are_posterior_over_proposal_in_the_answers_parameters(fitted):
    curve, answer = fitted
    settings = {"free": (), "discrepancy": False, "seed": 2}
    found = verify.verify(curve, answer, **settings)
    target = verification.Estimation(Verification(**settings), curve, answer).target
    expectations = found.log_q + found.log_weight
    for i in np.argsort(-expectations)[:5]:
        row, expected = found.theta[i], expectations[i]
        x = np.array([row[0], row[1], np.log10(row[2])])
        residual = target.experiment.difference(x, DEFAULT)
        density = target.noise.frames.log_density(residual[None])[0] + target.prior.log_density(x)
        assert density - np.log(row[2] * np.log(10.0)) == pytest.approx(expected, abs=0.1)


@pytest.mark.slow
def test_map_is_the_maximum_with_laplaces_interval(fitted):
    curve, answer = fitted
    full = verify.verify(curve, answer, discrepancy=False, seed=1)
    rival = OtherAnswer("nhkv", Bubble("kinetic"), answer.best, {}, Evidence(999.0), 0.01)
    peak = verify.verify(curve, replace(answer, others=(rival,)), level="map", discrepancy=False)
    assert (peak.method, peak.log_weight) == ("laplace", None)
    assert peak.others == (replace(rival, evidence=None),)  # its evidence is not that of an exact law
    assert (full.method, full.checks.verdict) == ("verified", "ok")
    assert full.provenance["noise_over_assumed"] * curve.noise / R_MAX == pytest.approx(0.01, rel=0.2)
    for name, true in TRUTH.items():
        low, high = full.interval(name, 0.99)
        assert low < true < high
        width = np.diff(full.interval(name))[0]
        assert peak.median(name) == pytest.approx(full.median(name), abs=0.25 * width)
        assert np.diff(peak.interval(name))[0] == pytest.approx(width, rel=0.3)
    assert peak.evidence.log == pytest.approx(full.evidence.log, abs=0.5)


@pytest.mark.parametrize("low", [-4.0, -2.0])
def test_a_bound_from_above_does_not_depend_on_how_far_down_the_prior_reaches(low):
    """Frames that follow any viscosity below 0.1 Pa s, and none above."""
    logs = np.random.default_rng(0).uniform(low, -1.0, (20_000, 1))
    prior = {"log10_viscosity": (low, 1.0)}
    found = Posterior(("log10_viscosity",), ("Pa s",), logs, Checks("ok"), "newtonian", "verified", prior=prior)
    assert found.bound("viscosity") == "upper"
    assert found.interval("viscosity")[1] == pytest.approx(0.095, rel=0.02)


def test_predictive_check_rejects_at_its_nominal_rate():
    rng = np.random.default_rng(0)
    J = np.column_stack([np.linspace(0, 1, 90), np.sin(np.arange(90) / 7.0), np.ones(90)])
    project = np.eye(90) - J @ np.linalg.pinv(J)
    p = []
    for i in range(200):
        residual = project @ rng.standard_normal(90)
        p.append(verification.predictive_check(residual, J, np.full(90, 0.5), seed=i)["p"])
    for name in ("level", "correlation"):
        assert np.mean([one[name] < 0.1 for one in p]) == pytest.approx(0.1, abs=0.05)
    wave = project @ (rng.standard_normal(90) + 1.5 * np.sin(np.arange(90) / 3.0))
    assert verification.predictive_check(wave, J, np.ones(90), seed=0)["p_value"] < TUNING.p_rejected
    assert verification.predictive_check(wave[:5], J[:5], np.ones(5), seed=0) is None


def test_what_cannot_be_verified_keeps_its_answer(fitted, monkeypatch):
    curve, answer = fitted
    one = {"names": answer.names[1:2], "units": answer.units[1:2], "theta": answer.theta[:, 1:2]}
    pointless = replace(answer, **one, best={}, stretch=None, windows={})
    found = verify.verify(curve, pointless)
    assert "not verified: the answer that is to be verified must give shear_modulus" in found.checks.message
    failed = replace(answer, theta=answer.theta[:0], checks=Checks("failed", messages("why")))
    assert verify.verify(curve, failed).checks.message == "why"

    def singular(*_):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(verification, "modes", singular)
    broken = verify.verify(curve, answer, level="map")
    assert "Singular matrix" in broken.checks.message
    assert broken.median("viscosity") == answer.median("viscosity")
    for settings, code in (({"level": "some"}, "option.verify"), ({"free": ("gravity",)}, "option.free")):
        with refused(code):
            verify.verify(curve, answer, **settings)


def weighed(law="", log=None, error=0.1, **more) -> Posterior:
    """An answer of a law that has nothing but its log evidence."""
    known = None if log is None else Evidence(log, error)
    about = {"checks": Checks("ok"), "log_weight": np.zeros(1), "evidence": known, **more}
    return Posterior((), (), np.zeros((1, 0)), material=law, method="verified", **about)


def test_the_law_of_the_group_explains_each_of_its_shots():
    """A shot that prefers another law by itself says so, once; one without a group has its own."""
    logs = {"newtonian": [-90.0, -10.0, -10.0, None], "nhkv": [-40.0, -20.0, -20.0, None]}
    answers = {law: [weighed(law, log) for log in found] for law, found in logs.items()}
    curves = [bubble("a", "gel"), bubble("b", "gel"), bubble("c", "c"), bubble("d", "d")]
    found = a, b, c, d = evidence.choose_answers(*evidence.ranked(curves, answers))
    assert [one.material for one in found] == ["nhkv", "nhkv", "newtonian", "newtonian"]
    assert [one.checks.verdict for one in found] == ["ok", "other_model_preferred", "ok", "ok"]
    assert d.checks.messages == ()
    assert [[other.material for other in one.others] for one in (a, c)] == [["newtonian"], ["nhkv"]]
    again = {law: [replace(one, checks=b.checks) for one in found] for law, found in answers.items()}
    told = evidence.choose_answers(*evidence.ranked(curves, again))[1].checks.messages
    assert [one.code for one in told].count("model.rejected") == 1


def test_evidence_of_a_group_is_the_sum_of_the_shots_that_all_laws_have():
    liquid = [weighed("newtonian", log, error) for log, error in ((-90.0, 0.3), (-80.0, 0.1), (-10.0, 0.1))]
    gel = [weighed("nhkv", -40.0, 0.4), weighed("nhkv", -42.0), weighed("nhkv")]
    curves = [bubble(name) for name in "abc"]
    singles, (group,) = evidence.ranked(curves, {"newtonian": liquid, "nhkv": gel})
    assert [one.chosen for one in singles] == ["nhkv", "nhkv", "newtonian"]
    assert singles[2].probability == {"newtonian": 1.0}
    assert (group.shots, group.evidence["newtonian"].log, group.evidence["nhkv"].log) == (2, -170.0, -82.0)
    assert group.evidence["nhkv"].error == pytest.approx(np.hypot(0.4, 0.1))
    (pair,) = group.pairs
    assert (pair.first, pair.second, pair.difference, pair.shots) == ("nhkv", "newtonian", 88.0, (2, 0))
    assert pair.error == pytest.approx(2**0.5 * np.std([50.0, 38.0], ddof=1))
    by_chance = [weighed("nhkv", -90.5, 3.0), weighed("nhkv", -83.0), weighed("nhkv", -9.0)]
    assert evidence.ranked(curves, {"newtonian": liquid, "nhkv": by_chance})[1][0].contenders == ["newtonian", "nhkv"]
    none = [weighed("zener") for _ in curves]  # a law that failed everywhere
    _, (group,) = evidence.ranked(curves, {"newtonian": liquid, "zener": none, "nhkv": by_chance})
    assert (group.shots, group.chosen, group.evidence["zener"]) == (3, "newtonian", None)


@pytest.mark.slow
def test_a_law_that_the_network_knows_is_weighed_as_by_infer():
    curve = shot()
    ((found,), _) = evidence.rank_laws([curve], ["nhkv", "newtonian"], bubble="field", seed=3)
    assert found.answers["nhkv"].evidence == infer(curve, material="nhkv", bubble="field", seed=3).evidence
    assert found.chosen == "nhkv"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 4, 7])
def test_against_emcee(seed):
    """An affine-invariant ensemble of these simulations finds the same means and widths within 3.5 standard errors."""
    emcee = pytest.importorskip("emcee")
    _, curve = calibration.shot(seed)
    settings = {"discrepancy": False, "free": "none", "ranges": calibration.RANGES, "seed": seed}
    answer = fit(curve, window="all")
    found = verify.verify(curve, answer, **settings)
    job = verification.Estimation(Verification(**settings), curve, answer)
    target, rng = job.target, np.random.default_rng(seed)
    best = climb(target, job.starts()[0], ROUGH)
    d = len(best.u)
    walkers = best.u + rng.standard_normal((4 * d, d)) @ np.linalg.cholesky(best.covariance).T
    moves = [(emcee.moves.DEMove(), 0.5), (emcee.moves.StretchMove(), 0.5)]

    def log_posterior(u):
        return target.log_posterior(u, target.residuals(u, DEFAULT))

    sampler = emcee.EnsembleSampler(4 * d, d, log_posterior, vectorize=True, moves=moves)
    sampler._random.seed(seed)
    sampler.run_mcmc(walkers, 3000)
    tau = float(np.max(sampler.get_autocorr_time(tol=0)))
    assert len(sampler.get_chain()) > 20 * tau
    x = target.prior.to_x(sampler.get_chain(discard=int(4 * tau), flat=True))
    scatter = 3.5 / np.sqrt(found.diagnostics.effective_sample_size)
    for i, name in enumerate(("shear_modulus", "viscosity", "stretch")):
        sd, ours = np.std(x[:, i]), np.log10(found.draws(name))
        assert np.average(ours, weights=found.weights) == pytest.approx(np.mean(x[:, i]), abs=scatter * sd)
        assert np.sqrt(np.cov(ours, aweights=found.weights)) == pytest.approx(sd, rel=scatter / 2**0.5)


NHKV = {"material": "nhkv", "trust_input": True}


def recorded(*given, **settings) -> RadiusCurve:
    about = {"noise": 0.01, "frames": 100, "max_radius": 245e-6, "stretch": 6.5, "seed": 5}
    return simulated(*given, **about | settings)


@pytest.mark.parametrize("integrated", [False, True])
@pytest.mark.parametrize(
    ("law", "bubble", "given"),
    [
        ("nhkv", FIELD, {}), ("power-law", REAL, {}), ("nhkv", REAL, {"stretch": 5.0}),
        ("nhkv", Bubble("kinetic", 0.07), {}), ("nhkv", Bubble("kinetic", confinement_damping=0.2), {}),
    ],
)  # fmt: skip
def test_the_density_of_a_proposal_is_normalised(law, bubble, given, integrated):
    """Its integral by importance sampling is 1, also with known parameters and without the camera's."""
    here = experiment(recorded(noise=0.03), law, bubble, **given)
    prior = here.prior()
    prior = prior.marginal([name for name in prior.names if name not in CAMERA]) if integrated else prior
    proposal = network_of().proposal(here, prior, True)
    rng = np.random.default_rng(3)
    u = proposal.draw(3000, rng)
    assert u.shape == (3000, len(prior.names))
    about = Mixture.through(u, np.zeros(len(u)), 8, rng).widened(0.3, 2.0)
    v = about.draw(6000, rng)
    ratio = np.exp(proposal.log_density(v) - about.log_density(v))
    assert np.mean(ratio) == pytest.approx(1.0, abs=max(0.1, 4 * np.std(ratio) / np.sqrt(len(v))))
    assert np.std(ratio) / np.mean(ratio) / np.sqrt(len(v)) < 0.15


def test_the_default_answer_holds_the_truth_and_depends_on_its_curve_alone():
    one, other = cavirheo.infer_many([recorded(seed=1), recorded(noise=0.003, seed=2)], bubble="field", **NHKV)
    for answer in (one, other):
        assert (answer.method, answer.checks.verdict) == ("verified", "ok")
        assert answer.diagnostics.effective_sample_size >= TUNING.effective_fewest
        for name, truth in (("shear_modulus", 8e3), ("viscosity", 0.05)):
            low, high = answer.interval(name, 0.98)
            assert low < truth < high
    assert np.array_equal(one.theta, infer(recorded(seed=1), bubble="field", **NHKV).theta)


def test_an_answer_says_how_a_wrong_scale_would_move_it():
    """Per cent of R_max, against answers of the curve that is enlarged."""
    curve = recorded(NeoHookeanKelvinVoigt(6e3, 0.05), stretch=7.0)
    curves = curve, curve.with_max_radius(1.03 * curve.max_radius)
    answer, larger = (infer(one, bubble="field", **NHKV) for one in curves)
    found = (larger.median("shear_modulus") / answer.median("shear_modulus") - 1.0) / 0.03
    assert answer.diagnostics.modulus_over_scale == pytest.approx(found, rel=0.2)
    assert found > 5.0


OUTSIDE = {"density": 1300.0, "pressure": 2e5, "surface_tension": 0.03, "sound_speed": np.inf, "temperature": 318.15}


def test_what_is_outside_the_training_is_not_sent_through_the_network_whose_own_answer_is_not_verified():
    large, rare = {"max_radius": 900e-6, "frame": 4e-6}, {"max_radius": 600e-6, "frame": 12e-6, "frames": 40}
    cases = [(given, {}) for given in (large, rare)]
    cases += [({}, {name: value}) for name, value in [*OUTSIDE.items(), ("sound_speed", 900.0)]]
    for given, constants in cases:
        answer = infer(recorded(**given), medium=replace(WATER, **constants), verify="none", **NHKV)
        assert [one.code for one in answer.checks.messages] == ["network.outside"]
    within = replace(WATER, temperature=293.15, sound_speed=1450.0, surface_tension=0.07)
    answer = infer(recorded(), medium=within, bubble="field", verify="none", **NHKV)
    assert (answer.method, answer.checks.verdict) == ("amortised", "unverified")
    low, high = answer.interval("viscosity")
    assert low < 0.05 < high


def planted(network):
    """The posterior of a shot weighed with a network that answers wrongly."""
    target = target_of(experiment(recorded()), discrepancy=True)
    sampling = adaptive_sampling.AdaptiveSampling(target, network(target), lambda: [target.start(TRUE)], list, seed=1)
    while sampling.needs_draws(1.0):
        sampling.weigh(1.0)
    return sampling


TRUE = np.array([np.log10(8e3), np.log10(0.05), np.log10(6.5), 0.0, 0.0, 0.0])  # x of `shot`, of the field's bubble


def narrow(target):
    """The network's draws, a twentieth as wide, about a place three standard deviations off."""
    u = network_of().proposal(target.experiment, target.prior, True).draw(300, np.random.default_rng(2))
    spread = np.cov(u.T)
    return Mixture(np.ones(1), (np.mean(u, axis=0) + 3 * np.sqrt(np.diag(spread)))[None], spread[None] / 400)


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
    def of_another_prior(target):
        (mode,) = adaptive_sampling.modes(target, [target.start(TRUE)])
        right = Mixture(np.ones(1), mode.u[None], mode.covariance[None])
        return SimpleNamespace(draw=right.draw, log_density=lambda u: right.log_density(u) - 3.0)

    found = planted(of_another_prior)
    assert found.evidence_gap > TUNING.network_agreement


def test_a_law_is_looked_at_where_a_better_one_is_best():
    """A law that contains another one follows the same frames there, wherever the search for it went."""
    curve, network, parts = recorded(Newtonian(0.05)), network_of(), []
    for law in ("newtonian", "nhkv"):
        (start,) = Analysis(material=law, bubble=FIELD, trust_input=True).starts(curve)
        settings = Verification(network=network, level="auto")
        parts.append(verification.Estimation(settings, curve, start))
    lost, best = parts
    proposal = lost.sampling.proposal
    proposal.modes = [replace(mode, u=mode.u + 1.5, log_posterior=mode.log_posterior - 50.0) for mode in proposal.modes]
    known = proposal.simulated = proposal.simulated._replace(value=proposal.simulated.value - 50.0)
    lost.sampling.sample = Sample(known.u, known.value, np.zeros(len(known.u)))
    lost.climb_where_best(best)
    assert proposal.height > best.sampling.proposal.height - TUNING.other_model_height
    assert lost.sampling.needs_draws(0.0)  # what was drawn before


def test_a_network_whose_draws_all_fail_is_no_exception(monkeypatch):
    def residuals(self, u, accuracy, simulated=Target.residuals):
        return np.where(u[:, :1] > 4.0, np.nan, simulated(self, np.minimum(u, 4.0), accuracy))

    monkeypatch.setattr(Target, "residuals", residuals)
    far = Mixture(np.ones(1), np.full((1, 3), 20.0), 0.1 * np.eye(3)[None])
    assert planted(lambda target: far).sample.ess > 20


@pytest.mark.slow
def test_no_answer_is_ok_without_an_interval(monkeypatch):
    monkeypatch.setattr(Sample, "ess", 40.0)  # whatever its draws are worth
    answer = infer(recorded(), bubble="field", **NHKV)
    assert answer.checks.verdict == "no_interval"
    assert answer.interval("shear_modulus") is None
    assert "not to be trusted" in answer.checks.message


@pytest.mark.slow
@pytest.mark.train
def test_generate_and_train_a_small_network(tmp_path, run):
    pytest.importorskip("torch")
    small = (ROOT / "recipes/posterior.toml").read_text("utf-8")
    sizes = {"n": 120, "samples": 512, "width": 16, "depth": 1, "hidden": 8, "batch": 64, "name": '"small"'}
    for name, size in sizes.items():
        small, changes = re.subn(rf"(?m)^{name} = \S+", f"{name} = {size}", small)
        assert changes == 1, name
    (tmp_path / "small.toml").write_text(small, encoding="utf-8")
    done(run("generate", "small.toml", "-o", "data"))
    done(run("train", "small.toml", "data", "-o", "run", "--threads", 1))
    card = json.loads((tmp_path / "run" / "small.json").read_text("utf-8"))
    assert card["kind"] == "posterior"
    assert set(card["coverage"]["by_slot"]) == set(COORDINATES)
    assert network_of(str(tmp_path / "run" / "small.onnx")).name == "small"


@pytest.mark.slow
def test_a_misfit_that_the_real_bubble_explains_is_said():
    true = Bubble("kinetic", accommodation=0.07)
    curve = recorded(NeoHookeanKelvinVoigt(3e3, 0.02), stretch=9.0, noise=0.003, seed=1, within=true)
    answer = infer(curve, bubble="field", **NHKV)
    (other,) = (one for one in answer.others if one.bubble == REAL)
    assert other.evidence.log > answer.evidence.log + 8
    low, _, high = other.intervals["accommodation"]
    assert 0.8 * low < 0.07 < 1.25 * high  # at a glance
    assert (answer.checks.verdict, answer.checks.messages[0].code) == ("other_model_preferred", "model.rejected")


def test_the_slot_of_the_damping_has_its_prior():
    z = np.linspace(-2.5, 3.5, 9)
    assert np.allclose([damping_to_latent(float(one)) for one in damping(z)], np.minimum(z, 3.0), atol=1e-6)
    values = damping(np.random.default_rng(1).standard_normal(20_000))
    assert 0 <= values.min() < values.max() <= 1.0
    assert np.sqrt(np.mean(values**2)) == pytest.approx(0.3, rel=0.02)
    assert damping_to_latent(0.0) == -3.0


DENSE = {  # frames far denser than the motion needs: a gel, a liquid, a stiff gel, clean radii
    "gel": (GEL, 7.0, 0.006), "liquid": (Newtonian(0.003), 11.0, 0.003),
    "stiff": (NeoHookeanKelvinVoigt(2e5, 0.05), 2.5, 0.01), "clean": (GEL, 7.0, 0.0002),
}  # fmt: skip


@pytest.mark.parametrize("shot", DENSE)
def test_means_of_dense_frames_are_on_the_motion(shot):
    """Each mean has the noise of its frames and nothing else, and a recording of the usual rate stays as it is."""
    material, stretch, noise = DENSE[shot]
    about: dict = {"stretch": stretch, "frames": 2500, "frame": 4e-8}
    measured, true = simulated(material, noise=noise, **about), simulated(material, **about)
    window = measured.window(min(3, len(measured.collapse_times())))
    frames = compared_frames(window)
    assert len(frames.time) <= MOST_FRAMES < len(window.time) == np.sum(frames.averaged)
    root, scale = np.sqrt(frames.averaged), noise * true.max_radius
    missed = root * (frames.radius - CubicSpline(true.time, true.radius)(frames.time)) / scale
    assert np.sqrt(np.mean(missed**2)) < 1.3
    assert abs(np.mean(missed)) < 4.0 / np.sqrt(len(missed))
    collapse = np.argmin(np.abs(frames.time - true.collapse_times()[0]))
    assert frames.averaged[collapse] < 0.2 * np.max(frames.averaged)
    usual = simulated(material, noise=noise, frames=100, stretch=stretch)
    assert np.array_equal(compared_frames(usual).radius, usual.radius)


def test_an_experiment_compares_means_and_says_so():
    curve = simulated(noise=0.005, frames=2000, frame=5e-8, radius_std=np.full(2000, 1e-6))
    spiked = curve.radius.copy()
    spiked[700] *= 1.5
    curve = replace(curve, radius=spiked)
    there = Experiment(curve, Family("nhkv"))
    assert len(there.measured) <= MOST_FRAMES + 2
    assert np.sum(there.averaged) == len(there.usable) == len(there.view.normalised)
    assert there.averaged[~there.counted].tolist() == [1.0]
    assert there.sigma[there.counted] == pytest.approx(1e-6 / there.max_radius / np.sqrt(there.averaged[there.counted]))
    assert "frames.averaged" in [message.code for message in there.messages]
    first = there.cut_to(1)
    assert np.array_equal(first.measured, there.measured[: len(first.measured)])
