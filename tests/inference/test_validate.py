"""`make validate` writes each number of a claim with what is needed to judge and to repeat it, and pages have these."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cavirheo.posterior import Checks, Posterior
from validation import __main__ as validate
from validation import numbers, pages
from validation.claims import calibration
from validation.numbers import Run


def test_numbers_are_written_with_their_errors_and_others_are_kept(tmp_path, monkeypatch):
    out = tmp_path / "validate.json"
    out.write_text('{"earlier": {"numbers": {}}}')
    values = np.arange(100.0)
    monkeypatch.setattr(validate, "measured", lambda name: lambda run: [numbers.statistic("middle", values, "m")])
    monkeypatch.setattr("sys.argv", ["validate", "solver", "--full", "-o", str(out)])
    validate.main()
    found = json.loads(out.read_text())
    assert found["earlier"] == {"numbers": {}}
    assert {"commit", "date", "processor", "full", "seconds"} < set(found["solver"])
    number = found["solver"]["numbers"]["middle"]
    assert (number["value"], number["n"], number["unit"], number["seed"]) == (49.5, 100, "m", numbers.SEED)
    assert number["standard_error"] == pytest.approx(1.2533 * np.std(values) / 10, rel=0.5)  # that of a normal sample


def test_a_claim_that_does_not_exist_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["validate", "nothing", "-o", str(tmp_path / "out.json")])
    with pytest.raises(SystemExit, match="2"):
        validate.main()


def squared(job: tuple[int]) -> dict:
    return {"square": job[0] ** 2}


def test_cases_are_kept_and_an_interrupted_run_goes_on(tmp_path):
    run = Run(workers=1, kept=tmp_path)
    run.rows("squares", squared, [(1,), (3,)])
    kept = (tmp_path / "squares.jsonl").read_text().replace("9", "10")
    (tmp_path / "squares.jsonl").write_text(kept)
    assert [row["square"] for row in run.rows("squares", squared, [(3,), (2,)])] == [10, 4]


def test_shares_and_their_standard_errors():
    number = numbers.coverage("held", [True] * 45 + [False] * 5, 0.9)
    assert (number.value, number.n) == (0.9, 50)
    assert number.standard_error == pytest.approx(0.0424, abs=1e-4)
    assert 0.0 < numbers.share("all", [True] * 5).standard_error < 0.15
    assert numbers.share("none", []).n == 0
    assert np.isnan(numbers.statistic("one", [2.0], "s").standard_error)


def test_overconfident_intervals_are_seen():
    rng = np.random.default_rng(0)
    held = {}
    for factor in (1.0, 0.6):
        truth = rng.standard_normal(300)
        centre = truth + rng.standard_normal(300)  # what is seen; flat prior: the posterior is N(centre, 1)
        draws = [(c + factor * rng.standard_normal(1000))[:, None] for c in centre]
        answers = [Posterior(("a",), ("1",), theta, Checks("ok"), "", "") for theta in draws]
        ranks = np.array([calibration.rank(one, "a", t) for one, t in zip(answers, truth, strict=True)])
        held[factor] = numbers.coverage("a", np.abs(ranks - 0.5) <= 0.45, 0.9)
    assert held[1.0].value == pytest.approx(0.9, abs=3 * held[1.0].standard_error)
    assert held[0.6].value < 0.9 - 3 * held[0.6].standard_error


RESULTS = {"solver": {"numbers": {"error": {"value": 1.84e-5, "standard_error": 2.2e-6, "n": 12}}}}


@pytest.mark.parametrize(
    ("marked", "filled"),
    [("error:.1e", "1.8e-5"), ("error:.4%", "0.0018"), ("error:se.0e", "2e-6"), ("error:n", "12")],
)
def test_numbers_between_markers_are_filled(marked, filled):
    text = f"| it is <!--solver.{marked}-->9<!--/--> |"
    assert pages.filled(text, RESULTS) == f"| it is <!--solver.{marked}-->{filled}<!--/--> |"


def test_a_marker_of_an_unknown_number_is_refused():
    with pytest.raises(ValueError, match="no number"):
        pages.filled("of <!--solver.nothing:n-->1<!--/-->", RESULTS)
