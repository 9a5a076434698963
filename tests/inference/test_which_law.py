"""`which-law`: which model is chosen for a group, and what its evidence is, from answers whose evidence is known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from answers import answer, bubble, unanswered, with_evidence
from conftest import ANSWER, done
from files import write_curve

from cavirheo import load


@pytest.fixture
def chosen(run, monkeypatch):
    """The document of shots gel/a.csv, gel/b.csv, ... (and alone/c.csv) whose logs of the evidence are these by law;
    None for an answer without one, or with its standard error."""

    def of(*alone: str, **logs: list):
        def known(analysis, curve, *_, **__):
            log = logs[analysis.material]["abcd".index(curve.name)]
            one = replace(answer(curve, material=analysis.material, draws=40), log_weight=np.zeros(40))
            return unanswered() if log is None else with_evidence(one, *np.atleast_1d(log))

        monkeypatch.setattr(ANSWER, known)
        monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")  # other processes would answer themselves
        names = "abcd"[: len(next(iter(logs.values())))]
        for k, name in enumerate(names):
            place = Path("alone" if name in alone else "gel")
            place.mkdir(exist_ok=True)
            write_curve(place / f"{name}.csv", bubble(top=2e-4 + 1e-6 * k))
        places = ["gel", *(f"alone/{name}.csv" for name in alone)]
        run("which-law", *places, "--laws", ",".join(logs), "--no-pictures", "--replace", "-o", "r")
        return load("r")

    return of


def test_the_law_of_the_group_explains_each_of_its_shots(chosen):
    """Also one that prefers another law by itself; one without a group has its own."""
    made = chosen("c", newtonian=[-90.0, -10.0, -10.0], nhkv=[-40.0, -20.0, -20.0])
    assert [(one.name, one.material) for one in made.curves] == [("a", "nhkv"), ("b", "nhkv"), ("c", "newtonian")]


def test_evidence_of_a_group_is_the_sum_of_the_shots_that_all_laws_have(chosen):
    liquid = [(-90.0, 0.3), (-80.0, 0.1), (-10.0, 0.1)]
    (group,) = chosen(newtonian=liquid, nhkv=[(-40.0, 0.4), -42.0, None]).groups
    assert (group.laws.chosen, group.laws.shots, group.laws.contenders) == ("nhkv", 2, ["nhkv"])
    found = group.laws.laws
    assert (found["newtonian"].log_evidence, found["nhkv"].log_evidence) == (-170.0, -82.0)
    assert found["nhkv"].standard_error == pytest.approx(np.hypot(0.4, 0.1))
    assert found["nhkv"].probability + found["newtonian"].probability == pytest.approx(1.0)
    (pair,) = group.laws.pairs
    assert (pair.first, pair.second, pair.difference, list(pair.shots)) == ("nhkv", "newtonian", 88.0, [2, 0])
    assert pair.error == pytest.approx(2**0.5 * np.std([50.0, 38.0], ddof=1))
    by_chance = [(-90.5, 3.0), -83.0, -9.0]
    (group,) = chosen(newtonian=liquid, nhkv=by_chance).groups
    assert group.laws.contenders == ["newtonian", "nhkv"]
    (group,) = chosen(newtonian=liquid, zener=[None] * 3, nhkv=by_chance).groups  # a law that failed everywhere
    assert (group.laws.shots, group.laws.chosen, group.laws.laws["zener"].log_evidence) == (3, "newtonian", None)


def test_the_screen_gives_the_material_by_each_law_that_cannot_be_told_from_the_best(chosen, run):
    (group,) = chosen(nhkv=[5.0, 5.0, 5.0], qkv=[5.5, 5.0, 5.2], newtonian=[-50.0, -50.0, -50.0]).groups
    (other,) = {*group.laws.contenders} - {group.laws.chosen}
    screen = " ".join(done(run("show", "r")).split())
    checked = screen.partition(" use ")[2]
    assert group.laws.laws[other].material.partition(";")[0] in checked
    assert "newtonian" not in checked
