"""One answer, said alike everywhere: screen, result.json, result.csv, report, app, comparison, citation."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from answers import FLAT, NAMES, Page, answer, bubble, document_of, written
from conftest import done, rows_of

from cavirheo import population
from cavirheo.app import words
from cavirheo.app.session import Answers

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


SHOWN = r"^(?:G|µ) +(?:([\d.]+ k?Pa(?: s)?) +90 % sure: ([\d.]+ to [\d.]+)|(below [\d.]+ Pa s) +\(95 % sure\))"


def spaced(text: str) -> str:
    return " ".join(text.split())  # also at spaces that do not break


def test_all_outputs_of_a_run_say_the_same_number_and_a_bound_has_none(pairs, run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    read = written("out", pairs)
    Path("values.csv").write_text("set,method,quantity,mean\nknown,IMR,G_kPa,5\nbounded,IMR,G_kPa,5\n", "utf-8")
    compared = done(run("compare", "out", "--references", "values.csv", "-o", "compared"))
    cited = done(run("cite", "out"))
    page = spaced(" ".join(Page(Path("out/report.html").read_text("utf-8")).text))
    session = SimpleNamespace(answers=Answers(pairs, document_of(pairs), [], {}), run=None, stale=False)
    app = spaced(" ".join(Page(words.answers(session)).text))
    screen = re.findall(SHOWN, done(run("show", "out")), re.MULTILINE)
    places = [(group, name) for group in read.groups for name in ("shear_modulus", "viscosity")]
    for (group, name), (middle, interval, bound) in zip(places, screen, strict=True):
        value = group.value(name)
        members = pairs[:5] if group.name == "known" else pairs[5:]
        assert value == population([made for _, made in members]).quantity(name)
        bounded = (group.name, name) == ("bounded", "viscosity")
        assert (value.bound, value.median is None, bool(bound)) == ("upper" if bounded else None, bounded, bounded)
        symbol, factor = ("G", 1e-3) if name == "shear_modulus" else ("µ", 1.0)
        numbers = [float(one) for one in re.findall(r"[\d.]+", f"{middle} {interval} {bound}")]
        exact = [value.q95] if bounded else [value.median, value.q05, value.q95]
        assert numbers == pytest.approx([factor * one for one in exact], rel=0.02)
        for text in (page, app):
            assert f"{symbol} {bound or middle}" in text
            assert interval in text
        assert (bound or f"{middle} (90 %: {interval})") in cited
        assert (bound.removesuffix(" Pa s") or f" {middle.split()[0]} ({interval})") in compared
    for row, (_, made) in zip(rows_of("out/result.csv"), pairs, strict=True):
        for column, name in (("shear_modulus_Pa", "G"), ("viscosity_Pa_s", "mu")):
            assert row[column] == ("" if made.bound(name) else repr(made.median(name)))
            assert row[f"{column}_bound"] == (made.bound(name) or "")
            assert float(row[f"{column}_q95"]) == made.interval(name)[1]


LAWS = {"power-law": ("1", "Pa s"), "herschel-bulkley": ("1", "Pa s", "Pa")}  # units of the parameters
SYMBOLS = {"exponent": "n", "viscosity": "µ", "reference_viscosity": "µ_ref", "yield_stress": "tau_y"}


@pytest.mark.parametrize("law", LAWS)
def test_an_asked_for_law_shows_each_of_its_parameters_once(law, run):
    thins = law == "power-law"
    truth = {"exponent": -0.4, "viscosity" if thins else "reference_viscosity": -1.7}
    truth |= {} if thins else {"yield_stress": 1.0}
    rng, pairs, names = np.random.default_rng(4), [], tuple(f"log10_{name}" for name in truth)
    ranges = dict.fromkeys(names, (-4.0, 3.0))
    for k in range(5):
        curve = bubble(f"gel[{k}]", "gel", "gel.csv", top=2e-4 + 1e-5 * rng.standard_normal())
        made = answer(curve, draws=400, material=law)
        theta = np.array([*truth.values()]) + 0.03 * rng.standard_normal((400, len(truth)))
        made = replace(made, names=names, units=LAWS[law], theta=theta, prior=ranges, method="verified", curve=curve)
        pairs.append((curve, made))
    written("out", pairs, draw=False)
    shown = re.findall(r"^(\S+) +([\d.]+) .*90 % sure: ", done(run("show", "out")), re.MULTILINE)
    expected = {SYMBOLS[name]: 10.0**value for name, value in truth.items()}
    expected |= {} if thins else {"µ": expected["µ_ref"] + expected["tau_y"] / 1e5}  # derived, at 1e5 1/s
    assert sorted(symbol for symbol, _ in shown) == sorted(expected)
    assert {symbol: float(value) for symbol, value in shown} == pytest.approx(expected, rel=0.05)


def test_a_shot_alone_among_groups_has_one_interval_everywhere_and_its_answer_beside_its_picture(pairs, run):
    alone = [(curve.with_group(f"{k}", f"{k}.csv"), made) for k, (curve, made) in enumerate(pairs[3:5])]
    read = written("out", [*pairs[:3], *alone])
    shown = [(group.population, rows[0]) for group, rows in read.rows_by_group()]
    assert [row.shear_modulus_Pa == answer.shear_modulus_Pa for answer, row in shown] == [False, True, True]
    _, interval = read.shown("shear_modulus").parts(shown[1][0].shear_modulus_Pa)
    assert interval in done(run("show", "out"))
    after = Path("out/report.html").read_text("utf-8").partition('<article id="curve-3"')[2]
    article = after.partition("</article>")[0]
    assert f"90 % sure: {interval}" in spaced(" ".join(Page(f"<article{article}</article>").text))
