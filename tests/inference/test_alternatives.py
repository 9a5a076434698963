"""Which model is chosen, and what is said where other models, or other modes of the same model, answer otherwise."""

from dataclasses import replace

import numpy as np
import pytest
from answers import NAMES, seen, simulated
from cavirheo.inference.verify import verify
from conftest import messages

import cavirheo
from cavirheo import InputError, Newtonian, population, simulate
from cavirheo.inference.alternatives import averaged_over_laws, contenders, judged, rival_messages
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.assumptions import Family
from cavirheo.messages import Message
from cavirheo.parameters import natural_name
from cavirheo.physics.accuracy import DEFAULT
from cavirheo.posterior import Bubble, Checks, Evidence, OtherAnswer, Posterior

FIELD, KINETIC = Bubble(), Bubble("kinetic")
DRAWS = np.random.default_rng(0).standard_normal((2000, 2))


def posterior(*others, G=5000.0, mu=0.04, evidence=-10.0, material="nhkv", **fields) -> Posterior:
    theta = np.column_stack([np.log10([G, mu]) + 0.05 * DRAWS, np.full(2000, 8.0)])
    about = {"evidence": Evidence(evidence, 0.1), "others": others} | fields
    return Posterior((*NAMES, "stretch"), ("Pa", "Pa s", "1"), theta, Checks("ok"), material, "least_squares", **about)


def other(
    G=5000.0, mu=0.04, log=-10.0, *, error=0.1, bubble=KINETIC, material="nhkv", width=1.2, stretch=8.0
) -> OtherAnswer:
    values = {"shear_modulus": G, "viscosity": mu, "stretch": stretch}
    values |= {"accommodation": 0.07} if bubble.contents == "kinetic" else {}
    intervals = {name: (value / width, value, value * width) for name, value in values.items() if value}
    return OtherAnswer(material, bubble, values, intervals, None if log is None else Evidence(log, error), 0.01)


@pytest.mark.parametrize(
    ("others", "sentences"),
    [
        ((), 0),
        ((other(),), 0),  # agrees, and its evidence is the same
        ((other(log=-6.0),), 1),  # preferred
        ((other(mu=0.01),), 1),  # beyond both intervals
        ((other(mu=0.01, log=-99.0),), 0),  # rejected
        ((other(mu=0.01, log=None),), 1),
        ((other(mu=0.01, width=6.0),), 0),  # its interval holds the answer's
        ((other(G=1000.0),), 1),
        ((other(mu=0.01, log=-6.0, bubble=FIELD, material="qkv"),), 1),
        ((other(mu=0.01, log=-6.0), other(mu=0.01, log=-5.0, material="zener")), 1),  # the better one alone
        ((other(log=-10.0), other(mu=0.001, log=-15.0)), 0),  # a worse mode of the other model
        ((other(G=20e3, stretch=5.0, bubble=FIELD),), 1),  # a mode of the same model
        ((other(G=20e3, stretch=5.0, bubble=FIELD, log=-13.5),), 0),
        ((other(stretch=2.0, bubble=FIELD),), 0),  # another stretch, but G and mu that meet those of the answer
        ((replace(other(G=20e3, bubble=FIELD), intervals={}),), 1),  # a value without an interval, beyond the answer's
        ((other(G=20e3, stretch=5.0, bubble=FIELD), other(mu=0.01)), 2),
    ],
)  # fmt: skip
def test_a_sentence_for_each_thing_that_matters(others, sentences):
    said = rival_messages(posterior(*others))
    assert len(said) == sentences
    assert len({one.text for one in said}) == len(said)


@pytest.mark.parametrize(
    ("rival", "verdict"),
    [
        (other(log=-6.0), "other_model_preferred"),
        (other(log=-6.0, error=5.0), "ok"),  # at a glance: not sure enough
        (other(log=-1.0, error=5.0), "other_model_preferred"),
        (other(log=-2.5, error=None), "ok"),  # as uncertain as where a model is chosen
        (other(mu=0.01), "ok"),  # another value, not preferred
        (other(log=-6.0, bubble=FIELD), "ok"),  # another solution of the same model
    ],
)
def test_an_answer_whose_model_the_evidence_rejects_is_not_ok(rival, verdict):
    answer = posterior(rival)
    assert judged(answer).verdict == verdict
    unsure = replace(answer, checks=Checks("undetermined", messages("said before")))
    found = judged(unsure)
    assert found.verdict == ("undetermined" if verdict == "ok" else verdict)
    assert (found.messages[0].code == "model.rejected") == (verdict != "ok")  # it is said first
    assert judged(replace(answer, checks=Checks("model_does_not_fit"))).verdict == "model_does_not_fit"


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
    liquid = simulated(Newtonian(0.03), stretch=8.0, noise=0.01, frames=100)
    way = {"bubble": "field", "verify": "none", "trust_input": True}
    candidates = [cavirheo.infer(liquid, material=law, **way) for law in ("nhkv", "newtonian")]
    odd = replace(candidates[warned].checks, verdict="check_input", messages=(Message("check_input.no_rebound"),))
    candidates[warned] = replace(candidates[warned], checks=odd)
    found = verify(liquid, candidates, level="map")
    assert found.material == "newtonian"
    assert (found.checks.verdict == "check_input") == ("no rebound" in found.checks.message) == (warned == 1)


def both(gain: float, *, seed: int = 0):
    """The answers of a shot by two laws; log evidence prefers the gel by `gain`."""
    field = replace(other(bubble=FIELD), weight=0.5)  # of the answer by the gel
    gel = seen([3.8, -1.4], 0.05, seed=seed, evidence=Evidence(10.0 + gain, 0.1), others=(field,))
    liquid = seen([-1.2], 0.05, seed=seed + 1, names=NAMES[1:], evidence=Evidence(10.0, 0.1))
    return gel, liquid


@pytest.mark.parametrize("gain", [-1.5, 0.0, 2.0])
def test_each_law_has_the_share_of_its_evidence(gain):
    """And a parameter that a law lacks is where the likeliest law becomes it: no modulus, the end of its range."""
    answer = averaged_over_laws(both(gain))
    share = 1.0 / (1.0 + np.exp(-gain))  # of the gel
    assert set(answer.laws) == {"nhkv", "newtonian"}
    assert answer.weights[answer.draws("shear_modulus") > 100.0].sum() == pytest.approx(share, abs=1e-9)
    assert answer.weights[answer.draws("viscosity") > 10**-1.3].sum() == pytest.approx(1.0 - share, abs=0.05)
    weights = [0.5 * share, 1.0 - share] if gain >= 0 else [share]
    assert [model.weight for model in answer.others] == pytest.approx(weights)


def test_what_the_average_bounds_is_said_and_decides_the_verdict():
    answer = averaged_over_laws(both(-0.5))
    found = answer.material, answer.bound("shear_modulus"), answer.checks.verdict
    assert found == ("newtonian", "upper", "undetermined")
    assert [one.code for one in answer.checks.messages] == ["bound.shear_modulus.upper", "model.averaged"]
    alone = averaged_over_laws(both(20.0))  # the evidence rejects the liquid, which has no part
    assert list(alone.laws) == ["nhkv"]
    assert alone.interval("shear_modulus") == pytest.approx(both(20.0)[0].interval("shear_modulus"), rel=0.01)


def test_averages_count_in_a_material_by_the_law_of_all_shots_together():
    """Two shots prefer a liquid by e^1, the third a gel by e^6: together they are of a gel. Any iterable will do."""
    shots = [averaged_over_laws(both(gain, seed=2 * i)) for i, gain in enumerate((-1.0, -1.0, 6.0))]
    assert [shot.material for shot in shots] == ["newtonian", "newtonian", "nhkv"]
    found = population(shot for shot in shots)
    assert (found.material, len(found.shots), dict(found.left_out)) == ("nhkv", 3, {})
    assert found.interval("shear_modulus")[1] == pytest.approx(10**3.8, rel=0.1)


def failing(monkeypatch, which):
    """Default simulations of the materials for which `which` is true fail, after those that lead to a maximum."""

    def run(material, *, accuracy=DEFAULT, **shot):
        if accuracy is DEFAULT and which(material):
            raise InputError("no such material", "test")
        return simulate(material, accuracy=accuracy, **shot)

    monkeypatch.setattr("cavirheo.inference.experiment.simulate", run)


def test_draws_are_where_the_law_has_a_material():
    curve = simulated(frames=34, noise=0.01)
    (found,) = Analysis("search", material="carreau-yasuda", verify="map", seed=1).run([curve])
    names = [name for name in found.names if natural_name(name) in Family("carreau-yasuda").parameters]
    assert 100 < len(found.theta) < 1800  # some of the Gaussian's were not
    assert np.all(Family("carreau-yasuda").holds(found.theta[:, [found.names.index(name) for name in names]]))


def test_a_failed_answer_has_no_draws(monkeypatch):
    failing(monkeypatch, lambda _: True)
    found = cavirheo.infer(simulated(frames=34, noise=0.01), material="nhkv")
    assert found.checks.verdict == "failed"
    assert (len(found.theta), found.evidence, found.best, found.log_weight) == (0, None, {}, None)
    assert found.checks.messages
