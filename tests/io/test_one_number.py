"""One answer, said alike everywhere: screen, result.json, result.csv, report, app, comparison, citation."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from answers import COMMAND, FLAT, NAMES, Page, answer, bubble
from conftest import done, rows_of

from cavirheo import load, population
from cavirheo.app import words
from cavirheo.app.session import Answers
from cavirheo.parameters import parameter_of, units
from cavirheo.reporting import result, write_report
from cavirheo.reporting.advice import answer_lines
from cavirheo.reporting.citation import methods_paragraph
from cavirheo.reporting.comparison import comparison_table
from cavirheo.reporting.screen import print_result
from cavirheo.writing import digits

UPPER = 10.0 ** FLAT[NAMES[1]][0]  # lower end of the range of a viscosity, Pa s


@pytest.fixture
def pairs():
    """Two groups of five shots: of the second the recordings bound the viscosity from above alone."""
    rng, pairs = np.random.default_rng(2), []
    for name in ("known", "bounded"):
        for k in range(5):
            curve = bubble(f"{name}[{k}]", name, f"{name}.csv", top=2e-4 + 1e-5 * rng.standard_normal())
            made = answer(curve, 5e3 * np.exp(0.1 * rng.standard_normal()), 0.03, draws=400)
            theta = made.theta + np.array([0.0, 0.05 * rng.standard_normal()])
            if name == "bounded":
                theta[:, 1] = np.log10(UPPER) + rng.uniform(0.0, 1.5, len(theta))
            made = replace(made, theta=theta, prior=FLAT, method="verified", curve=curve)
            verdict = "bound" if name == "bounded" else "ok"
            pairs.append((curve, replace(made, checks=replace(made.checks, verdict=verdict))))
    return pairs


def test_all_outputs_of_a_run_say_the_same_number_and_a_bound_has_none(pairs, run, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    document = result(pairs, COMMAND)
    write_report(tmp_path / "out", pairs, document)
    read = load(tmp_path / "out")
    print_result(document)
    screen = capsys.readouterr().out
    page = " ".join(Page((tmp_path / "out" / "report.html").read_text(encoding="utf-8")).text)
    answered = Answers(pairs, document, [], {})
    app = " ".join(Page(words.answers(SimpleNamespace(answers=answered, run=None, stale=False))).text)
    cited, _ = methods_paragraph(read)
    table = "set,method,quantity,mean\nknown,IMR,G_kPa,5\nbounded,IMR,G_kPa,5\n"
    (tmp_path / "values.csv").write_text(table)
    done(run("compare", "out", "--references", "values.csv", "-o", "compared"))
    _, rows = comparison_table(load(tmp_path / "compared"))
    compared = {(group, quantity): words for group, quantity, method, words, _ in rows if method == "cavirheo"}
    for group, of in zip(read.groups, (pairs[:5], pairs[5:]), strict=True):
        material = population([made for _, made in of])
        for name, symbol, unit, factor in (("shear_modulus", "G", "kPa", 1e-3), ("viscosity", "µ", "Pa s", 1.0)):
            value = group.value(name)
            assert value == material.quantity(name)
            bounded = (group.name, name) == ("bounded", "viscosity")
            assert (value.bound, value.median is None) == (("upper", True) if bounded else (None, False))
            assert compared[group.name, f"{symbol}, {unit}"] == digits.quantity(value, factor)
            middle, interval = digits.value_parts(value, factor)
            line = rf"{symbol}\s+{re.escape(f'{interval} {unit}' if bounded else f'{middle} {unit}')}"
            texts = {"screen": screen, "page": page, "app": app}
            plain = {where: text.replace(digits.NO_BREAK, " ") for where, text in texts.items()}
            assert [where for where, text in plain.items() if not re.search(line, text)] == []
            assert (interval if bounded else f"{middle} {unit} (90 %: {interval})") in cited
    for row, (_, made) in zip(rows_of(tmp_path / "out" / "result.csv"), pairs, strict=True):
        for column, name in (("shear_modulus_Pa", "G"), ("viscosity_Pa_s", "mu")):
            assert row[column] == ("" if made.bound(name) else repr(made.median(name)))
            assert row[f"{column}_bound"] == (made.bound(name) or "")
            assert float(row[f"{column}_q95"]) == made.interval(name)[1]


@pytest.mark.parametrize("law", ["power-law", "herschel-bulkley"])
def test_an_asked_for_law_shows_each_of_its_parameters_once(law):
    truth = {"exponent": -0.4, "reference_viscosity": -1.7, **({"yield_stress": 1.0} if law != "power-law" else {})}
    rng, pairs, names = np.random.default_rng(4), [], tuple(f"log10_{name}" for name in truth)
    ranges = dict.fromkeys(names, (-4.0, 3.0))
    for k in range(5):
        curve = bubble(f"gel[{k}]", "gel", "gel.csv", top=2e-4 + 1e-5 * rng.standard_normal())
        made = answer(curve, draws=400, material=law)
        theta = np.array([*truth.values()]) + 0.03 * rng.standard_normal((400, len(truth)))
        made = replace(made, names=names, units=units(names), theta=theta, prior=ranges, method="verified", curve=curve)
        pairs.append((curve, made))
    document = result(pairs, COMMAND)
    (group, shots), *_ = document.rows_by_group()
    lines = [line for line in answer_lines(document, group, shots) if line[0] not in ("use", "check", "next")]
    assert sorted(label for label, _ in lines) == sorted(parameter_of(name).symbol for name in truth)
    for name, value in truth.items():
        assert float(dict(lines)[parameter_of(name).symbol][0].split()[0]) == pytest.approx(10.0**value, rel=0.05)
