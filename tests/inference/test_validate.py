"""`make validate` writes each number of a claim with what is needed to judge and to repeat it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from validation import __main__ as validate


def test_numbers_are_written_with_their_errors_and_others_are_kept(tmp_path, monkeypatch):
    out = tmp_path / "validate.json"
    out.write_text('{"earlier": {"numbers": []}}')
    values = np.arange(100.0)
    monkeypatch.setitem(validate.CLAIMS, "mean", lambda full: [validate.median("middle", values, "m")] * (1 + full))
    monkeypatch.setattr("sys.argv", ["validate", "mean", "--full", "-o", str(out)])
    validate.main()
    found = json.loads(out.read_text())
    assert found["earlier"] == {"numbers": []}
    assert {"commit", "processor", "full", "seconds"} < set(found["mean"])
    number, again = found["mean"]["numbers"]
    assert number == again
    assert (number["value"], number["n"], number["unit"], number["seed"]) == (49.5, 100, "m", validate.SEED)
    assert number["standard_error"] == pytest.approx(1.2533 * np.std(values) / 10, rel=0.5)  # that of a normal sample


def test_a_claim_that_does_not_exist_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["validate", "nothing", "-o", str(tmp_path / "out.json")])
    with pytest.raises(SystemExit, match="2"):
        validate.main()
    assert "unknown claims nothing; known: solver, challenge" in capsys.readouterr().err


def test_share_of_intervals():
    number = validate.share("held", 45, 50)
    assert (number.value, number.n) == (0.9, 50)
    assert number.standard_error == pytest.approx(0.0424, abs=1e-4)
