"""Which model is chosen, and what is said where other models answer otherwise."""

import numpy as np
import pytest
from answers import bubble

from cavirheo import Posterior
from cavirheo.inference.which_law import choose_answers, ranked
from cavirheo.posterior import Checks, Evidence


def weighed(law="", log=None, error=0.1, **more) -> Posterior:
    """An answer of a law that has nothing but its log evidence."""
    known = None if log is None else Evidence(log, error)
    about = {"checks": Checks("ok"), "log_weight": np.zeros(1), "evidence": known, **more}
    return Posterior((), (), np.zeros((1, 0)), material=law, method="verified", **about)


def test_the_law_of_the_group_explains_each_of_its_shots():
    """Also one that prefers another law by itself; one without a group has its own."""
    logs = {"newtonian": [-90.0, -10.0, -10.0, None], "nhkv": [-40.0, -20.0, -20.0, None]}
    answers = {law: [weighed(law, log) for log in found] for law, found in logs.items()}
    curves = [bubble("a", "gel"), bubble("b", "gel"), bubble("c", "c"), bubble("d", "d")]
    found = choose_answers(*ranked(curves, answers))
    assert [one.material for one in found] == ["nhkv", "nhkv", "newtonian", "newtonian"]
    assert [one.checks.verdict for one in found] == ["ok"] * 4


def test_evidence_of_a_group_is_the_sum_of_the_shots_that_all_laws_have():
    liquid = [weighed("newtonian", log, error) for log, error in ((-90.0, 0.3), (-80.0, 0.1), (-10.0, 0.1))]
    gel = [weighed("nhkv", -40.0, 0.4), weighed("nhkv", -42.0), weighed("nhkv")]
    curves = [bubble(name) for name in "abc"]
    singles, (group,) = ranked(curves, {"newtonian": liquid, "nhkv": gel})
    assert [one.chosen for one in singles] == ["nhkv", "nhkv", "newtonian"]
    assert singles[2].probability == {"newtonian": 1.0}
    assert (group.shots, group.evidence["newtonian"].log, group.evidence["nhkv"].log) == (2, -170.0, -82.0)
    assert group.evidence["nhkv"].error == pytest.approx(np.hypot(0.4, 0.1))
    (pair,) = group.pairs
    assert (pair.first, pair.second, pair.difference, pair.shots) == ("nhkv", "newtonian", 88.0, (2, 0))
    assert pair.error == pytest.approx(2**0.5 * np.std([50.0, 38.0], ddof=1))
    by_chance = [weighed("nhkv", -90.5, 3.0), weighed("nhkv", -83.0), weighed("nhkv", -9.0)]
    assert ranked(curves, {"newtonian": liquid, "nhkv": by_chance})[1][0].contenders == ["newtonian", "nhkv"]
    none = [weighed("zener") for _ in curves]  # a law that failed everywhere
    _, (group,) = ranked(curves, {"newtonian": liquid, "zener": none, "nhkv": by_chance})
    assert (group.shots, group.chosen, group.evidence["zener"]) == (3, "newtonian", None)
