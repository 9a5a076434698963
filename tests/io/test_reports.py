"""What is written of answers: documents, tables, pages and pictures say what was found, whatever is in a file."""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import pytest
from answers import COMMAND, NAMES, Page, answer, bubble, document_of, empty, unanswered, with_verdict, written
from conftest import ANSWER, refused, rows_of

from cavirheo import Bubble, infer_many, population


@pytest.fixture
def pairs():
    one, two = bubble(), bubble("shot[2]", top=3.1e-4)
    return [(one, answer(one)), (two, answer(two, 8100.0, 0.035)), (empty(), unanswered())]


def growing(power=0.0, *, count=7, verdict="ok", draws=200):
    """Shots of one group, of growing size; the viscosity goes with this power of it."""
    rng, pairs = np.random.default_rng(4), []
    for k, top in enumerate(np.linspace(1.2e-4, 3.2e-4, count)):
        curve = bubble(f"shot[{k}]", top=top)
        mu = 0.02 * (curve.max_radius / 2e-4) ** power * np.exp(0.05 * rng.standard_normal())
        G = 5e3 * np.exp(0.05 * rng.standard_normal())
        pairs.append((curve, answer(curve, G, mu, draws=draws, verdict=verdict)))
    return pairs


def strictly(path: Path) -> dict:
    """JSON without NaN or Infinity, which Python would otherwise read."""
    return json.loads(path.read_text(encoding="utf-8"), parse_constant=pytest.fail)


def page_of(folder: Path) -> Page:
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def test_a_document_comes_back_equal_and_makes_up_no_interval(pairs, tmp_path):
    none = float("nan")
    odd = {"array": np.arange(3), "nan": none, "x": [np.float64("inf"), np.int64(2)], "p": Path("a"), 1: ()}
    curve, one = pairs[0]
    about = replace(one.diagnostics, modulus_over_scale=none, p_value=none)
    one = replace(one, provenance=odd, diagnostics=about, checks=replace(one.checks, rmse_over_rmax=none))
    pairs[0] = curve, one
    how = {"date": "2025-01-02", "notes": ["a note"]}
    assert written(tmp_path, pairs, **how) == document_of(pairs, **how)
    found = strictly(tmp_path / "result.json")
    assert (found["schema"], found["command"], bool(found["version"])) == (1, COMMAND, True)
    row, failed = found["curves"][0], found["curves"][2]
    no_interval = {"q05": None, "q95": None, "bound": None}
    assert row["shear_modulus_Pa"] == {"median": pytest.approx(6100.0), **no_interval}
    assert row["stretch"] == {"median": 9.1, **no_interval}
    assert row["window"] == {"collapses": 2, "t_star_end": 2.6}
    assert row["provenance"] == {"array": [0, 1, 2], "nan": None, "x": [None, 2], "p": "a", "1": []}
    assert (row["name"], row["rmse_over_rmax"]) == ("shot[1]", None)
    assert row["max_radius_m"] == pytest.approx(2.6e-4, rel=0.02)
    assert (failed["verdict"], failed["messages"]) == ("failed", [{"code": "test", "text": "cell 3 of 5 is empty"}])
    assert failed["max_radius_m"] is failed["rmse_over_rmax"] is failed["viscosity_Pa_s"]["median"] is None
    first, _, last = rows_of(tmp_path / "result.csv")
    assert float(first["shear_modulus_Pa"]) == pytest.approx(6100.0)
    assert (first["shear_modulus_Pa_q05"], first["collapses"], last["shear_modulus_Pa"]) == ("", "2", "")
    assert (first["message"], last["message"]) == ("", "cell 3 of 5 is empty")


@pytest.mark.parametrize("theta", [np.empty((0, 2)), np.array([[3.8, np.nan]]), np.array([[np.inf, -2.0]])])
def test_an_answer_that_is_none_does_not_pass(theta):
    made = document_of([(bubble(), replace(answer(bubble()), theta=theta))])
    assert (made.curves[0].verdict, made.groups[0].verdicts) == ("failed", {"failed": 1})
    assert made.curves[0].viscosity_Pa_s.median is None


def test_parameters_and_models_of_any_law_are_in_json_and_csv(tmp_path):
    """A liquid has no modulus; a law that thins has its viscosity at 1e5 1/s; what is given has no interval."""
    curve, rng = bubble(), np.random.default_rng(1)
    law = {"names": ("log10_viscosity", "log10_exponent"), "units": ("Pa s", "1"), "material": "power-law"}
    theta = np.log10([98.0 * 1e5**-0.57, 0.43]) + 0.01 * rng.standard_normal((300, 2))
    thins = replace(answer(curve), theta=theta, **law)
    fixed = replace(answer(curve), bubble=Bubble("kinetic", 0.5), best={"accommodation": 0.5})
    pairs = [(curve, answer(curve, material="newtonian")), (curve, thins), (curve, fixed)]
    liquid, power, kinetic = written(tmp_path, pairs).curves
    assert not liquid.shear_modulus_Pa.known
    assert liquid.viscosity_Pa_s.median == pytest.approx(0.021)
    assert power.viscosity_Pa_s.q05 < 98.0 * 1e5**-0.57 < power.viscosity_Pa_s.q95
    ((name, given),) = kinetic.other_parameters.items()
    assert (name, given.median, given.q05, given.q95) == ("accommodation", 0.5, None, None)
    rows = rows_of(tmp_path / "result.csv")
    assert [row["bubble"] for row in rows] == ["field", "field", "kinetic"]
    assert float(rows[1]["exponent_q05"]) < 0.43 < float(rows[1]["exponent_q95"])


def test_groups_are_those_of_files(pairs):
    (one,) = document_of(pairs).groups
    assert (one.n, one.n_counted, one.verdicts) == (2, 2, {"ok": 2, "failed": 1})
    curves = [bubble(source="a/shots.mat"), bubble(source="b/shots.mat"), bubble(group="other", source="b/other.mat")]
    laws = ("nhkv", "nhkv", "newtonian")
    groups = document_of([(c, answer(c, material=law)) for c, law in zip(curves, laws, strict=True)]).groups
    assert [one.name for one in groups] == ["a/shots.mat", "b/shots.mat", "other"]
    assert groups[0].value("shear_modulus").median == pytest.approx(6100.0)  # of its only shot
    assert not groups[2].value("shear_modulus").known


COUNTED = {"does_not_fit": 3, "check_input": 3, "bound": 5}  # of five, two with this verdict


@pytest.mark.parametrize(("verdict", "count"), COUNTED.items())
def test_only_what_is_trusted_counts_in_materials(verdict, count):
    pairs = growing(count=5)
    for k, (curve, one) in enumerate(pairs):
        pairs[k] = curve, with_verdict(one, verdict if k < 2 else "ok")
    made = document_of(pairs)
    (one,) = made.groups
    assert one.n_counted == one.population.n == count
    counted = [row.shear_modulus_Pa.median for row in made.curves[5 - count :]]
    assert min(counted) < one.value("shear_modulus").median < max(counted)
    assert len(population([one for _, one in pairs], only_trusted=False).shots) == 5


def test_a_group_with_many_misfits_is_doubted_and_still_has_its_values():
    for misfits, count, verdict in ((1, 8, "ok"), (1, 5, "does_not_fit")):
        pairs = growing(0.0, count=count)
        pairs[:misfits] = [(curve, with_verdict(one, "does_not_fit")) for curve, one in pairs[:misfits]]
        (one,) = document_of(pairs).groups
        assert one.verdict == verdict
        assert one.value("shear_modulus").known


def test_shots_that_scatter_are_a_doubt():
    """One batch of a gel does not scatter by a factor of two."""
    steps = np.random.default_rng(5).standard_normal(7)
    for size, verdict in ((0.02, "ok"), (0.3, "check_input")):
        pairs = [
            (curve, replace(made, theta=made.theta + np.array([0.0, size * step])))
            for (curve, made), step in zip(growing(), steps, strict=True)
        ]
        (one,) = document_of(pairs).groups
        assert one.verdict == verdict
        assert [message.code for message in one.doubts] == ["group.doubt.scatter"] * (verdict != "ok")


def test_a_viscosity_that_grows_with_the_bubble_is_said():
    """Also of answers whose model does not fit, for there it is looked for; of four shots or of odd ones it is not."""
    for power, count, verdict, trends in (
        (2.4, 7, "ok", ["µ rises"]),
        (-2.4, 7, "does_not_fit", ["µ falls"]),
        (2.4, 7, "check_input", None),
        (2.4, 4, "ok", None),
    ):
        (one,) = document_of(growing(power, count=count, verdict=verdict)).groups
        said = [message.text for message in one.messages if message.code == "group.doubt.trend"]
        assert [trend in text for text in said for trend in trends or []] == [True] * bool(trends)


def test_no_cell_of_a_table_is_a_formula(tmp_path):
    names = ["=1+1", "+a", "-a", "@a", "＝1", "'=1", "'a", "-1.5", "a"]
    one = replace(answer(bubble()), names=(NAMES[1], "=n"), units=("Pa s", "1"))
    written(tmp_path, [(bubble(name), one) for name in names], draw=False)
    rows = rows_of(tmp_path / "result.csv")
    cells = {cell for row in rows for cell in (*row, *row.values()) if re.match("[-=+@＝]", cell)}
    assert {cell for cell in cells if not re.fullmatch(r"-[\d.e-]+", cell)} == set()
    assert ("-1.5" in cells, len({row["name"] for row in rows})) == (True, len(names))


MEDIUM = ANSWER.replace("answer", "medium_for")


def test_a_defect_costs_the_answer_of_its_curve_alone(monkeypatch, caplog):
    """Also what no error of ours is: a row without an answer that names it, and its traceback in the log."""
    good, bad = bubble(), replace(bubble(), meta={"name": "bad"})
    medium_for = resolve_name(MEDIUM)

    def broken(self, curve):
        if curve.name == "bad":
            raise RuntimeError("the network could not be run")
        return medium_for(self, curve)

    monkeypatch.setattr(MEDIUM, broken)
    answers = infer_many([bad, good], model="bdt-viscoelastic", workers=1)
    assert [answer.checks.verdict == "failed" for answer in answers] == [True, False]
    assert "RuntimeError: the network could not be run" in answers[0].checks.message
    assert any(one.exc_info and one.exc_info[0] is RuntimeError for one in caplog.records)


def test_a_picture_that_fails_costs_nothing_but_itself(pairs, tmp_path):
    (curve, posterior), *others = pairs
    broken = replace(posterior, checks=replace(posterior.checks, residual_over_rmax=np.ones(3)))  # of other length
    (note,) = written(tmp_path, [(curve, broken), *others]).notes
    assert ("shot[1]" in note, "ValueError" in note) == (True, True)
    assert (tmp_path / "report.html").read_text(encoding="utf-8").count('<path class="simulated"') == 1


def test_report_is_one_sound_file_that_asks_for_nothing_and_has_a_picture_of_every_curve(pairs, tmp_path):
    pairs += [(bubble("short"), unanswered("too short"))]
    pairs += [(replace(bubble("px"), unscaled="in pixels"), unanswered("no scale"))]
    assert written(tmp_path, pairs).notes == []
    page, text = page_of(tmp_path), (tmp_path / "report.html").read_text(encoding="utf-8")
    assert [text.count(f'<path class="{look}"') for look in ("measured", "simulated")] == [4, 2]
    assert len(page.ids) == len(set(page.ids))
    assert not page.tags & {"script", "link", "iframe", "object", "img"}
    targets = [value for key, value in page.attributes if key in ("src", "href", "xlink:href")]
    assert all(target.startswith(("#", "data:")) for target in targets)
    assert {target[1:] for target in targets if target.startswith("#")} <= set(page.ids)
    assert re.search(r"url\(http|@import", text) is None
    assert "cell 3 of 5 is empty" in "".join(page.text)
    written(tmp_path / "none", [])
    page_of(tmp_path / "none")  # a run without curves is a page, too


def test_report_escapes_everything_from_outside(tmp_path):
    evil = '"><script>alert(1)</script><img src=x onerror=y>&{0}'
    curve = bubble(evil, group=evil, source=evil, notes=(evil,))
    made = answer(curve, verdict="does_not_fit", message=evil, material=evil)
    theta, names = np.array([[-2.0, 1.0]]), (*NAMES[1:], evil)
    made = replace(made, provenance={evil: evil}, names=names, units=("Pa s", "1"), theta=theta)
    pairs = [(curve, made), (empty(evil, evil, evil), unanswered(evil))]
    written(tmp_path, pairs, evil, date=evil)
    page = page_of(tmp_path)
    assert page.tags.isdisjoint({"script", "img"})
    assert evil in "".join(page.text)
    assert not [key for key, _ in page.attributes if key.startswith("on")]


def test_write_report_refuses_what_it_cannot_do_and_is_complete_without_matplotlib(pairs, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("x")
    with refused("document.folder"):
        written(tmp_path / "file", pairs)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    out = tmp_path / "out"
    assert written(out, pairs).notes == []
    assert "<svg" in (out / "report.html").read_text(encoding="utf-8")
    assert {path.name for path in out.iterdir()} == {"result.json", "result.csv", "report.html", ".cavirheo"}
