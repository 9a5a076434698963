"""What weights, evidence and the choice of a model rest on: each of these was wrong once."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from test_posterior import PLACES, mended, two_modes
from test_posterior_network import TRUE, experiment, shot

import cavirheo
from cavirheo import InputError, Newtonian
from cavirheo.inference.alternatives import contenders
from cavirheo.inference.budget import Budget
from cavirheo.inference.model import shipped
from cavirheo.inference.posterior_network import load_posterior
from cavirheo.inference.verify import adaptive_sampling, model_average, verify_many
from cavirheo.inference.verify import mode as mode_of
from cavirheo.inference.verify.adaptive_sampling import AdaptiveSampling, TwoFidelityTarget
from cavirheo.inference.verify.mode import Target, climb
from cavirheo.inference.verify.proposals import SurrogateProposal
from cavirheo.inference.verify.sampler import Mixture, Sample, sample
from cavirheo.inference.verify.surrogate import Surrogate
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.messages import Message
from cavirheo.physics.accuracy import DEFAULT, ROUGH
from cavirheo.posterior import Evidence
from cavirheo.prior import log_normal


@pytest.mark.parametrize("most", [2, 12])
@pytest.mark.parametrize("held", [None, np.array([4.0, 3.0])])
def test_a_climb_ends_with_the_slopes_of_where_it_ends(held, most, monkeypatch):
    """Also where its last step gains so little that it ends."""
    monkeypatch.setattr(mode_of, "TUNING", replace(TUNING, climb_gain=5.0))
    target, _ = two_modes()
    for start in np.random.default_rng(0).uniform(-2.5, 2.5, (200, 2)):
        mode = climb(target, start, ROUGH, held=held, most=most)
        assert np.array_equal(mode.jacobian, target.jacobian(mode.u, mode.residual, ROUGH))


def test_where_rough_simulations_are_refused_what_was_known_is_simulated_anew():
    """Draws of a network, which came before, kept the weights of rough simulations."""
    near = mended(lambda x: 0.5 * x[0] * np.ones(20), PLACES)
    assert not near.rough
    rough = near.exact.residuals(PLACES, adaptive_sampling.BRISK)
    again = near.again(PLACES, rough)
    fine = near.exact.residuals(PLACES, DEFAULT)
    assert np.array_equal(again.value, near.exact.log_posterior(PLACES, fine))
    assert not np.allclose(again.value, near.exact.log_posterior(PLACES, rough), atol=0.1)


def test_a_network_whose_draws_all_fail_is_no_exception(monkeypatch):
    here = experiment(shot())
    target, simulated = Target(here, here.prior(), here.noise(True), 1), Target.residuals

    def residuals(self, u, accuracy):
        return np.where(u[:, :1] > 4.0, np.nan, simulated(self, np.minimum(u, 4.0), accuracy))

    monkeypatch.setattr(Target, "residuals", residuals)
    d = len(target.prior.names)
    far = Mixture(np.ones(1), np.full((1, d), 20.0), 0.1 * np.eye(d)[None])
    sampling = AdaptiveSampling(target, far, lambda: [target.start(TRUE)], list, seed=1)
    assert sampling.weigh(100.0, Budget(draws=200)).ess > 20


def test_the_check_of_a_correction_uses_draws_that_did_not_teach_it(monkeypatch):
    target, exact = two_modes()
    rng = np.random.default_rng(0)
    u = 0.1 * rng.standard_normal((40, 2)) + [0.3, 0.1]
    drawn = Sample(u, exact(u) + 0.05 * rng.standard_normal(40), exact(u))
    near, asked, simulated = TwoFidelityTarget(target), [], Target.residuals
    near.learnt = u[: 40 - TUNING.mended_checked - 1]
    monkeypatch.setattr(Target, "residuals", lambda self, u, accuracy: asked.append(u) or simulated(self, u, accuracy))
    found, error = near.checked(drawn, 0)
    assert len(np.concatenate(asked)) == len(np.unique(np.concatenate(asked), axis=0)) == TUNING.mended_checked
    assert not any(np.all(row == near.learnt, axis=1).any() for row in np.concatenate(asked))
    # and what the mean of a few leaves open is part of the error of the evidence
    assert 0 < error <= TUNING.mended_enough
    scatter = drawn.log_evidence[1]
    assert found.log_evidence[1] == pytest.approx(np.hypot(scatter, error / np.sqrt(TUNING.mended_checked)), rel=1e-6)


def test_the_norm_of_a_surrogate_has_the_error_that_it_states():
    target, exact = two_modes()
    shown = 0.7 * np.random.default_rng(0).standard_normal((150, 2))
    known = Surrogate(target, shown, target.residuals(shown, ROUGH), exact(shown))
    mixture = Mixture.about([np.array([0.3, 0.1])], [0.25 * np.eye(2)], [0.0])
    found = []
    for seed in range(60):
        pool = mixture.draw(500, np.random.default_rng([seed, 1]))
        one = SurrogateProposal(known, mixture, pool, known(pool))
        found.append((one.log_norm + one.log_cut, one.log_norm_error))
    norms, errors = np.array(found).T
    assert np.mean(errors) == pytest.approx(np.std(norms, ddof=1), rel=0.3)


def test_the_error_of_a_norm_is_part_of_that_of_the_evidence():
    class Normal:
        log_norm_error = 0.2

        def draw(self, count, rng):
            return rng.standard_normal((count, 2))

        def log_density(self, u):
            return log_normal(u)

    found = sample(log_normal, lambda rng, now: Normal(), seed=0, each=100, most=400, enough=100)
    assert found.log_evidence == pytest.approx((0.0, 0.2))


@pytest.mark.parametrize(
    ("evidence", "sizes", "within"),
    [
        ([(0.0, 0.1), (-2.9, 0.1)], [4, 3], [1, 0]),  # within a factor of 20: the simplest first
        ([(0.0, 0.1), (-3.3, 0.1)], [4, 3], [0]),
        ([(0.0, 0.1), (-3.3, 0.4)], [4, 3], [1, 0]),  # or within the error of the difference
        ([(0.0, None), (-9.9, None)], [4, 3], [1, 0]),  # of Laplace's integrals, 5 each
        ([(0.0, None), (-10.2, None)], [4, 3], [0]),
        ([(-1.0, 0.1), None, (0.0, 0.1)], [3, 1, 3], [2, 0]),  # as many parameters: the larger evidence
        ([None, (-np.inf, np.inf)], [3, 3], []),
    ],
)
def test_one_rule_chooses_models(evidence, sizes, within):
    assert contenders([one and Evidence(*one) for one in evidence], sizes) == within


@pytest.mark.parametrize("warned", [0, 1])
def test_warnings_are_those_of_the_law_that_is_chosen(warned):
    """A liquid without a rebound was `ok` where a gel came first among the candidates."""
    liquid = shot(Newtonian(0.03), stretch=8.0)
    laws = ("nhkv", "newtonian")
    candidates = [cavirheo.infer(liquid, material=law, bubble="field", verify="none", trust_input=True) for law in laws]
    odd = replace(candidates[warned].checks, verdict="check_input", messages=(Message("check_input.no_rebound"),))
    candidates[warned] = replace(candidates[warned], checks=odd)
    (found,) = verify_many([liquid], [candidates], level="map")
    assert found.material == "newtonian"
    assert (found.checks.verdict == "check_input") == ("no rebound" in found.checks.message) == (warned == 1)


def test_a_network_whose_file_changed_is_read_anew(tmp_path):
    for suffix in (".onnx", ".json"):
        shutil.copy(shipped()["posterior"].with_suffix(suffix), tmp_path / f"mine{suffix}")
    path = tmp_path / "mine.onnx"
    first = load_posterior(str(path))
    assert load_posterior(str(path)) is first
    path.write_bytes(path.read_bytes() + b"more")
    with pytest.raises(InputError) as error:
        load_posterior(str(path))
    assert error.value.code == "model.changed"


def test_a_fit_gives_no_interval_from_draws_that_are_worth_too_little(monkeypatch):
    monkeypatch.setattr(model_average, "TUNING", replace(TUNING, effective_fewest=1e4))
    answer = cavirheo.fit(shot(), bubble="field", others=False, workers=1, trust_input=True)
    assert answer.interval("shear_modulus") is None
    assert answer.checks.verdict == "no_interval"
