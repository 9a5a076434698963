"""Every answer names its model, other models stand beside it, and a constant that changes with the size is said."""

import csv
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import messages
from scipy.stats import binom
from test_reporting import COMMAND, KILOPASCAL, Page, answer, bubble, figure, lines_of_group, printed, words

from cavirheo.inference.analysis import Analysis
from cavirheo.physics.bubble import Bubble
from cavirheo.posterior import Evidence, OtherAnswer, Posterior
from cavirheo.reporting import read_json, result, table, write_report
from cavirheo.reporting.comparison import markdown
from cavirheo.reporting.group import PublishedValue, slope, theil_sen
from cavirheo.reporting.html import groups_table
from cavirheo.writing import terminal
from cavirheo.writing.document import Quantity

pytestmark = pytest.mark.needs("matplotlib")  # most documents have pictures
EXAMPLES = Path(__file__).parent.parent / "examples"
RADII = np.linspace(1.2e-4, 3.2e-4, 7)
PLAIN_KINETIC = Bubble("kinetic")
KINETIC = Bubble("kinetic", damage="first-rebound", confinement_inertia="free")


def shots(radii=RADII):
    return [bubble(f"shot[{k}]", top=top) for k, top in enumerate(radii)]


def with_parameters(posterior: Posterior, material="power-law", **values: float) -> Posterior:
    """The answer of another law: 300 draws about these values, by their names in a posterior."""
    centre = np.array([np.log10(v) if name.startswith("log10") else v for name, v in values.items()])
    theta = centre + 0.01 * np.random.default_rng(1).standard_normal((300, len(centre)))
    best = {name.removeprefix("log10_"): value for name, value in values.items()}
    names = tuple(values)
    return replace(
        posterior, names=names, units=("1",) * len(names), theta=theta, material=material, best=best,
        method="least_squares",
    )  # fmt: skip


def thinning(posterior: Posterior, **more: float) -> Posterior:
    return with_parameters(posterior, log10_reference_viscosity=98.0 * 1e5**-0.57, log10_exponent=0.43, **more)


def beside(mu=0.003, log=-3.0, bubble=PLAIN_KINETIC, material="nhkv", G=5000.0) -> OtherAnswer:
    best = {"shear_modulus": G, "viscosity": mu, "stretch": 8.0, "accommodation": 0.07}
    intervals = {name: (0.8 * value, value, 1.2 * value) for name, value in best.items() if name != "accommodation"}
    return OtherAnswer(material, bubble, best, intervals, Evidence(log), 0.004)


# --- the model of an answer ------------------------------------------------------------------------------------------


def test_the_model_stands_in_table_page_picture_and_csv(tmp_path):
    curve = bubble()
    posterior = with_parameters(
        replace(answer(curve), bubble=KINETIC), "nhkv", log10_shear_modulus=5e3, log10_viscosity=0.01,
        accommodation=0.07, damage_modulus=0.15, damage_radius=2.1, confinement_inertia=0.2,
    )  # fmt: skip
    document = write_report(tmp_path, [(curve, posterior)], COMMAND, ())
    row = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["curves"][0]
    assert (row["bubble"]["contents"], row["bubble"]["damage"]) == ("kinetic", "first-rebound")
    assert row["other_parameters"]["accommodation"]["median"] == pytest.approx(0.07, abs=0.005)
    assert KINETIC.sentence in " ".join(printed(document, 80).split())
    assert "nhkv, bubble wi" in " ".join(words(figure(curve, posterior)))
    page = " ".join("".join(Page((tmp_path / "report.html").read_text(encoding="utf-8")).text).split())
    assert KINETIC.sentence in page
    assert "condenses at a finite rate" in page
    for said in (" ".join(printed(document, 80).split()), page):  # what the columns are
        assert "accommodation (no unit; share of the vapour" in said
        assert "accommodation and β: of bubble and vessel, no property of the material" in said
    with (tmp_path / "result.csv").open(newline="", encoding="utf-8") as file:
        (line,) = csv.DictReader(file)
    assert line["bubble"] == KINETIC.name
    for name in ("accommodation", "damage_modulus", "damage_radius", "confinement_inertia"):
        assert float(line[f"{name}_q05"]) < float(line[name]) < float(line[f"{name}_q95"])
        assert float(line[name]) == row["other_parameters"][name]["median"]


def test_what_is_given_of_the_bubble_is_recorded_without_an_interval(tmp_path):
    curve = bubble()
    given = replace(
        answer(curve), bubble=Bubble("kinetic", 0.5), best={"accommodation": 0.5, "confinement_inertia": 0.0}
    )
    (row,) = result([(curve, given)], COMMAND).curves
    assert row.other_parameters == {"accommodation": Quantity(median=0.5)}
    (plain,) = result([(curve, answer(curve))], COMMAND).curves
    assert plain.other_parameters == {}


@pytest.mark.parametrize("width", [80, 100])
def test_the_rows_name_what_a_run_mixes(width):
    one, two = shots()[:2]
    kinetic = replace(answer(two, draws=300), bubble=Bubble("kinetic"))
    alike = printed(result([(one, answer(one)), (two, answer(two))], COMMAND), width).split("RMSE:")[0]
    contents = printed(result([(one, answer(one)), (two, kinetic)], COMMAND), width)
    laws = printed(result([(one, thinning(answer(one))), (two, answer(two, draws=300))], COMMAND), width)
    assert "nhkv" not in alike
    assert "kinetic" in contents.split("RMSE:")[0]
    assert "nhkv" not in contents.split("RMSE:")[0]
    assert "power-law" in laws.split("RMSE:")[0]
    assert "field" not in laws.split("RMSE:")[0]
    assert max(map(len, (contents + laws).splitlines())) <= width


# --- other models beside it ------------------------------------------------------------------------------------------


def test_all_answers_of_a_curve_stand_side_by_side(tmp_path):
    curve = bubble()
    mode = beside(0.02, -16.0, Bubble(), G=20e3)
    others = beside(), beside(log=-30.0, material="qkv"), mode
    posterior = replace(answer(curve, draws=300), evidence=Evidence(-15.0), others=others)
    document = write_report(tmp_path, [(curve, posterior)], COMMAND, ())
    assert read_json(tmp_path / "result.json") == document
    row = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["curves"][0]
    assert row["evidence"] == {"log": -15.0, "error": None}
    kinetic, _, second = row["other_models"]
    assert (kinetic["material"], kinetic["bubble"]["contents"], kinetic["log_evidence"]) == ("nhkv", "kinetic", -3.0)
    assert kinetic["viscosity_Pa_s"].pop("bound") is None
    assert kinetic["viscosity_Pa_s"] == pytest.approx({"median": 0.003, "q05": 0.0024, "q95": 0.0036})
    assert kinetic["other_parameters"]["accommodation"]["median"] == 0.07
    assert (second["material"], second["bubble"]) == (row["material"], row["bubble"])
    rows = table.model_rows(document.curves[0], 1e-3)
    assert [cells[0] for cells in rows] == [
        "nhkv, field", "nhkv, kinetic", "nhkv, field", "qkv, kinetic"
    ]  # fmt: skip
    assert [cells[-1] for cells in rows] == ["0", "+12.0", "-1.0", "-15.0"]
    console = terminal.console(width=80, file=io.StringIO(), force_terminal=False)
    console.print(table.models_table(document.curves[0], *KILOPASCAL))
    page = "".join(Page((tmp_path / "report.html").read_text(encoding="utf-8")).text)
    for shown in (console.file.getvalue(), page):
        assert "0.0030" in shown
        assert "+12.0" in shown


def test_an_answer_without_evidence_and_a_law_without_moduli_can_stand_beside_others():
    curve = bubble()
    thin = OtherAnswer(
        "power-law", Bubble(), {"reference_viscosity": 98.0 * 1e5**-0.57, "exponent": 0.43}, {}, None, None
    )
    (row,) = result([(curve, replace(answer(curve), others=(thin,)))], COMMAND).curves
    (other,) = row.other_models
    assert other.shear_modulus_Pa == other.viscosity_Pa_s == Quantity()
    assert other.log_evidence is None
    assert table.model_rows(row, 1e-3)[1][2] == "0.138"  # at 1e5 1/s


# --- laws without a modulus or a viscosity ---------------------------------------------------------------------------


def test_the_viscosity_of_a_law_that_thins_is_given_at_a_rate():
    curve = bubble()
    (row,) = result([(curve, thinning(answer(curve)))], COMMAND).curves
    assert row.viscosity_Pa_s == Quantity()
    assert row.viscosity.median == pytest.approx(98.0 * 1e5**-0.57, rel=0.1)
    assert row.viscosity.q05 < row.viscosity.median < row.viscosity.q95
    (other,) = result([(curve, answer(curve))], COMMAND).curves
    assert other.other_parameters == {}


@pytest.mark.parametrize(
    ("material", "values"),
    [
        ("power-law", {"log10_reference_viscosity": 98.0 * 1e5**-0.57, "log10_exponent": 0.43}),
        ("powell-eyring", {"log10_zero_rate": 1.0, "log10_infinite_rate": 0.001, "log10_time": 1e-5}),
        ("gent", {"log10_shear_modulus": 5e3, "log10_limit": 1e4}),
        ("mooney-rivlin", {"log10_C1": 5e3, "log10_C2": 1e2}),
        ("gent + power-law", {"log10_shear_modulus": 5e3, "log10_reference_viscosity": 0.14, "log10_exponent": 0.43}),
    ],
)  # fmt: skip
def test_the_shots_of_any_law_have_a_picture(material, values):
    pairs = [(curve, with_parameters(answer(curve), material, **values)) for curve in shots()[:2]]
    document = result(pairs, COMMAND)
    panels = lines_of_group(pairs, document).answers
    assert panels
    assert all(np.isfinite([one.across, one.up]).all() and len(one.up) == 2 for one in panels)
    assert max(map(len, printed(document, 80).splitlines())) <= 80


def test_the_report_of_a_law_that_thins_is_whole(tmp_path):
    pairs = [(curve, thinning(answer(curve))) for curve in shots()[:5]]
    document = write_report(tmp_path, pairs, COMMAND, ())
    assert document.notes == []  # of a picture that could not be drawn
    assert {"reference_viscosity", "exponent", "viscosity_at_1e5_per_s"} <= document.groups[0].other_parameters.keys()
    page = "".join(Page((tmp_path / "report.html").read_text(encoding="utf-8")).text)
    assert "viscosity at 1e5 per s" in page


def test_a_law_that_thins_and_one_that_does_not_are_drawn_together():
    curves = shots()[:4]
    made = [thinning(answer(c)) if k % 2 else answer(c, draws=300) for k, c in enumerate(curves)]
    pairs = list(zip(curves, made, strict=True))
    document = result(pairs, COMMAND)
    assert document.groups[0].models == {"nhkv, field": 2, "power-law, field": 2}
    over_size = lines_of_group(pairs, document).answers[-1]
    assert np.isfinite([over_size.across, over_size.up]).all()
    assert "different models" in printed(document, 100)


# --- constants that change with the size -----------------------------------------------------------------------------


def group(power=0.0, *, count=7, verdict="ok", others=(), scatter=0.05):
    rng = np.random.default_rng(4)
    pairs = []
    for curve in shots(np.linspace(1.2e-4, 3.2e-4, count)):
        mu = 0.02 * (curve.max_radius / 2e-4) ** power * np.exp(scatter * rng.standard_normal())
        made = answer(curve, 5e3 * np.exp(scatter * rng.standard_normal()), mu, draws=200, verdict=verdict)
        pairs.append((curve, replace(made, others=tuple(replace(one) for one in others))))
    return pairs


def test_a_viscosity_that_grows_with_the_bubble_is_said():
    pairs = group(2.4)
    document = result(pairs, COMMAND)
    (about,) = document.groups
    found = about.slopes["viscosity"]
    assert found.n == 7
    assert 1.8 < found.q05 < 2.4 < found.q95 < 3.0
    assert found.sign == 1
    assert about.slopes["shear_modulus"].sign == 0
    said = " ".join(printed(document, 80).split())
    assert f"µ rises as R_max^{found.words}" in said
    assert "doubt the law" in said
    steady = " ".join(printed(result(group(0.0), COMMAND), 80).split())
    assert "no change of" in steady
    assert "doubt the law" not in steady
    over_size = lines_of_group(pairs, document).answers[1]
    assert found.words in over_size.slope_words
    x, y = over_size.slope.T
    assert np.polyfit(np.log(x), np.log(y), 1)[0] == pytest.approx(found.median)


def test_where_few_shots_are_trusted_the_slope_is_of_those_that_the_model_misses_too():
    """For there it is looked for."""
    pairs = group(2.4, verdict="model_does_not_fit")
    pairs[0] = pairs[0][0], replace(pairs[0][1], checks=replace(pairs[0][1].checks, verdict="ok"))
    (about,) = result(pairs, COMMAND).groups
    assert (about.slopes["viscosity"].n, about.slopes["viscosity"].n_trusted) == (7, 1)
    assert "1 of them trusted" in " ".join(about.remarks)
    pairs[0] = pairs[1]  # none is trusted
    document = result(pairs, COMMAND)
    assert np.isfinite(lines_of_group(pairs, document).answers[1].slope).all()
    assert 1.8 < about.slopes["viscosity"].median < 3.0
    (trusted,) = result(group(2.4), COMMAND).groups
    assert trusted.slopes["viscosity"].n_trusted == 7


@pytest.mark.parametrize("pairs", [group(2.4, count=4), group(2.4, verdict="check_input"), group(2.4)[:4]])
def test_few_or_doubtful_shots_have_no_slope(pairs):
    (about,) = result(pairs, COMMAND).groups
    assert about.slopes == {}
    assert about.remarks == []


def test_a_slope_is_that_of_theil_and_sen_with_ties_too():
    from scipy.stats import theilslopes

    rng = np.random.default_rng(7)
    for count, places in ((5, 9), (12, 9), (30, 1), (30, 0)):
        x, y = np.round(rng.normal(size=(2, count)), places)
        median, _, low, high = theilslopes(y, x, 0.9)
        assert theil_sen(x, y) == (median, low, high)


def test_one_value_or_one_size_has_no_slope():
    assert slope(RADII, [0.02] * 7) is None  # a joint fit
    assert slope([2e-4] * 7, np.linspace(1.0, 2.0, 7)) is None
    assert slope([*RADII, None], [None, 0.1, 0.2, 0.3, 0.1, None, None, 0.2]) is None


def test_models_that_all_shots_have_get_their_slopes_too(tmp_path):
    pairs = group(2.4, others=(beside(), beside(0.5, -40.0), beside(material="qkv")))
    pairs[0] = pairs[0][0], replace(pairs[0][1], others=pairs[0][1].others[:2])  # without the law qkv
    mu = iter(np.linspace(0.003, 0.004, len(pairs)))
    for k, (curve, made) in enumerate(pairs):
        first, *rest = made.others
        low, _, high = first.intervals["viscosity"]
        changed = replace(first, intervals=dict(first.intervals) | {"viscosity": (low, next(mu), high)})
        pairs[k] = curve, replace(made, others=(changed, *rest))
    document = write_report(tmp_path, pairs, COMMAND, ())
    (about,) = document.groups
    other, law = about.other_models
    assert (other.material, other.bubble, other.n) == ("nhkv", "kinetic", len(pairs))
    assert other.viscosity_Pa_s.mean == pytest.approx(0.0035, abs=1e-4)
    assert other.log_evidence is None  # the answers have none
    assert (law.material, law.n, law.slopes) == ("qkv", len(pairs) - 1, {})
    assert 0.1 < other.slopes["viscosity"].median < 0.5  # of the mode with the larger evidence
    assert "with nhkv, bubble with kinetic contents: G 5.00 ± 0 kPa" in " ".join(printed(document, 80).split())
    assert "R_max^" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert read_json(tmp_path / "result.json") == document


@pytest.mark.parametrize("count", [5, 8, 20])
def test_the_interval_of_a_slope_holds_what_it_says(count):
    """Zero is inside in about 90 % of groups without a trend, be the scatter even, heavy-tailed or one-sided."""
    rng, inside, groups = np.random.default_rng(2), 0, 360
    for k in range(groups):
        scatter = 0.2 * rng.standard_normal(count)
        if k % 3 == 1:
            scatter = 0.1 * rng.standard_t(2, count)
        if k % 3 == 2:  # one in ten in a false mode
            scatter -= 2.0 * (rng.random(count) < 0.1)
        found = slope(rng.uniform(1.2e-4, 3.3e-4, count), 0.02 * np.exp(scatter))
        inside += found.sign == 0
    assert binom.ppf(1e-4, groups, 0.90) <= inside <= binom.ppf(1 - 1e-4, groups, 0.95)


# --- the command line and the other tables ---------------------------------------------------------------------------


@pytest.mark.parametrize("words", [("--material", "auto"), ("--bubble", "auto")])
def test_fit_leaves_the_choice_of_a_model_to_the_fit(words, run, monkeypatch):
    asked = []

    def answered(analysis, curve, *_, **__):
        asked.append(analysis)
        return replace(answer(curve), bubble=Bubble("kinetic"))

    monkeypatch.setattr(Analysis, "answer", answered)
    status, _, said = run("fit", EXAMPLES / "soft_gel.csv", "--shots", 1, "--no-pictures", "-o", "out", *words)
    assert status == 0, said
    assert (asked[0].material == "auto") == ("--material" in words)
    assert (len(asked[0].bubbles) == 2) == ("--bubble" in words)


def test_warnings_of_a_group_are_said_once_whatever_else_is_said_of_its_shots():
    pairs = []
    for k, curve in enumerate(shots()[:3]):
        warning = messages("check the scale", code="check_input.test")
        said = (*warning, *messages(f"{'abc'[k]} is at its bound", code="abc"[k]))
        made = answer(curve, verdict="check_input")
        pairs.append((curve, replace(made, checks=replace(made.checks, messages=said))))
    said = printed(result(pairs, COMMAND), 100)
    assert said.count("check the scale") == 1
    assert all(f"{word} is at its bound" in said for word in "abc")


def test_tables_beside_the_answers_name_the_bubble(tmp_path):
    curve = bubble()
    document = result([(curve, replace(answer(curve), bubble=Bubble("kinetic")))], COMMAND)
    document.put_beside({"gel": {"IMR": {"viscosity": PublishedValue(mean=0.02)}}})
    assert "kinetic" in markdown(document)


@pytest.mark.parametrize(("each", "said"), [(1.0, False), (6.0, True)])
def test_evidence_that_no_shot_shows_alone_is_said_first_of_all_together(each, said):
    """Seven shots with e^6 each for another bubble: none is rejected by itself."""
    pairs = [
        (curve, replace(made, evidence=Evidence(0.0, 0.1), others=(beside(log=each),))) for curve, made in group(2.4)
    ]
    document = result(pairs, COMMAND)
    about = document.groups[0]
    assert not about.preferred
    assert ("all shots together" in about.warning) == said
    assert about.headline.startswith(about.warning)
    ((look, words),) = about.badges  # nor is the group ok at its badge
    assert (look, "other model preferred" in words) == (("other_model_preferred", True) if said else ("ok", False))
    (badge,) = re.findall(r'<span class="badge (\w+)"', groups_table(document.groups, 1.0, "Pa"))
    assert badge == look
    assert ("all together" in printed(document, 120)) == said


def test_evidence_that_tells_nothing_is_said_to_be_equal():
    pairs = [(curve, replace(made, others=(beside(log=0.1),))) for curve, made in group(2.4)[:2]]
    pairs = [(curve, replace(made, evidence=Evidence(0.0, 0.1))) for curve, made in pairs]
    (other,) = result(pairs, COMMAND).groups[0].other_models
    assert "as likely as the answer" in other.words
    assert "e^" not in other.words
