"""An answer that is an average over laws: shares by evidence, values in one set of parameters, bounds, groups."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from answers import NAMES, seen

from cavirheo import population
from cavirheo.inference.law_average import averaged_over_laws, comparable
from cavirheo.posterior import Evidence

GEL, LIQUID = np.array([3.8, -1.4]), np.array([-1.2])  # log10 of Pa and Pa s


def both(of_gel: float, of_liquid: float, *, seed: int = 0):
    """The answers of a shot by two laws with these log evidences."""
    gel = seen(GEL, 0.05, seed=seed, evidence=Evidence(of_gel, 0.1))
    liquid = seen(LIQUID, 0.05, seed=seed + 1, names=NAMES[1:], evidence=Evidence(of_liquid, 0.1))
    return gel, liquid


@pytest.mark.parametrize("gain", [-1.5, 0.0, 2.0])
def test_each_law_has_the_share_of_its_evidence(gain):
    """And a parameter that a law lacks is where the likeliest law becomes it: no modulus, the end of its range."""
    answer = averaged_over_laws(both(10.0 + gain, 10.0))
    share = 1.0 / (1.0 + np.exp(-gain))  # of the gel
    assert set(answer.laws) == {"nhkv", "newtonian"}
    assert answer.weights[answer.draws("shear_modulus") > 100.0].sum() == pytest.approx(share, abs=1e-9)
    assert answer.weights[answer.draws("viscosity") > 10**-1.3].sum() == pytest.approx(1.0 - share, abs=0.05)
    (other,) = answer.others
    assert other.weight == pytest.approx(1.0 - share if gain >= 0 else share)


def test_what_the_average_bounds_is_said_and_decides_the_verdict():
    gel, liquid = both(10.0, 10.5)
    assert (gel.bound("shear_modulus"), gel.checks.verdict) == (None, "ok")
    answer = averaged_over_laws((gel, liquid))
    assert answer.material == "newtonian"
    assert (answer.bound("shear_modulus"), answer.checks.verdict) == ("upper", "undetermined")
    assert [one.code for one in answer.checks.messages] == ["bound.shear_modulus.upper", "model.averaged"]


def test_a_law_that_the_evidence_rejects_has_no_part():
    answer = averaged_over_laws(both(30.0, 10.0))
    assert list(answer.laws) == ["nhkv"]
    alone = both(30.0, 10.0)[0].interval("shear_modulus")
    assert answer.interval("shear_modulus") == pytest.approx(alone, rel=0.01)


def test_answers_without_an_error_of_their_evidence_or_of_one_law_are_not_averaged():
    gel, liquid = both(10.0, 10.0)
    assert comparable([gel, liquid])
    assert not comparable([gel, gel])
    assert not comparable([gel, replace(liquid, evidence=Evidence(10.0))])


def test_averages_count_in_a_material_by_the_law_of_all_shots_together():
    """Two shots prefer a liquid by e^1, the third a gel by e^6: together they are of a gel. Any iterable will do."""
    gains = (-1.0, -1.0, 6.0)
    shots = [averaged_over_laws(both(10.0 + gain, 10.0, seed=2 * i)) for i, gain in enumerate(gains)]
    assert [shot.material for shot in shots] == ["newtonian", "newtonian", "nhkv"]
    found = population(shot for shot in shots)
    assert (found.material, len(found.shots), dict(found.left_out)) == ("nhkv", 3, {})
    assert found.interval("shear_modulus")[1] == pytest.approx(10 ** GEL[0], rel=0.1)
