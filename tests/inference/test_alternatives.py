"""What is said where other models, or other modes of the same model, answer otherwise."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import messages

from cavirheo.inference.alternatives import compared, judged
from cavirheo.posterior import Bubble, Checks, Evidence, OtherAnswer, Posterior

FIELD, KINETIC = Bubble(), Bubble("kinetic")
DRAWS = np.random.default_rng(0).standard_normal((2000, 2))


def posterior(*others, G=5000.0, mu=0.04, evidence=-10.0, material="nhkv", **fields) -> Posterior:
    theta = np.column_stack([np.log10([G, mu]) + 0.05 * DRAWS, np.full(2000, 8.0)])
    names, units = ("log10_shear_modulus", "log10_viscosity", "stretch"), ("Pa", "Pa s", "1")
    about = {"evidence": None if evidence is None else Evidence(evidence, 0.1), "others": others} | fields
    return Posterior(names, units, theta, Checks("ok"), material, "least_squares", **about)


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
        ((other(log=-8.0),), 0),
        ((other(log=-6.0),), 1),  # preferred
        ((other(mu=0.01),), 1),  # beyond both intervals
        ((other(mu=0.01, log=-99.0),), 0),  # rejected
        ((other(mu=0.01, log=None),), 1),
        ((other(mu=0.01, width=6.0),), 0),  # its interval holds the answer's
        ((other(G=1000.0),), 1),
        ((other(mu=0.01, log=-30.0, bubble=FIELD, material="qkv"),), 0),  # another law, rejected
        ((other(mu=0.01, log=-6.0, bubble=FIELD, material="qkv"),), 1),
        ((other(mu=0.01, log=-6.0), other(mu=0.01, log=-5.0, material="zener")), 1),  # the better one alone
        ((other(log=-10.0), other(mu=0.001, log=-15.0)), 0),  # a worse mode of the other model
        ((other(G=20e3, stretch=5.0, bubble=FIELD),), 1),  # a mode of the same model
        ((other(G=20e3, stretch=5.0, bubble=FIELD, log=-13.5),), 0),
        ((other(stretch=2.0, bubble=FIELD),), 0),  # another stretch, but G and mu that meet those of the answer
        ((replace(other(G=20e3, bubble=FIELD), intervals={}),), 1),  # a value without an interval, beyond the answer's
        ((replace(other(bubble=FIELD), intervals={}),), 0),
        ((other(G=20e3, stretch=5.0, bubble=FIELD), other(mu=0.01)), 2),
    ],
)  # fmt: skip
def test_a_sentence_for_each_thing_that_matters(others, sentences):
    said = compared(posterior(*others))
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


def test_an_answer_without_draws_has_nothing_to_compare():
    failed = replace(posterior(evidence=None), theta=np.empty((0, 3)))
    assert compared(failed) == []
