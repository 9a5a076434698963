"""The reporting room: what is written must be what was found, and nothing that a file says may break the page."""

import csv
import io
import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from conftest import messages

from cavirheo import population, reporting
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import infer_many
from cavirheo.inference.analysis import Analysis
from cavirheo.io.column import read_column
from cavirheo.messages import Message, value_in_words
from cavirheo.physics.bubble import REAL
from cavirheo.posterior import Checks, Diagnostics, Evidence, OtherAnswer, Posterior, WindowAnswer
from cavirheo.reporting import figures, group, html, read_json, result, svg, table, write_report
from cavirheo.reporting.answer import curve_record
from cavirheo.reporting.curve_lines import Axis, answer_lines, curve_lines, preview_lines, thinned
from cavirheo.reporting.group_lines import group_lines
from cavirheo.reporting.input_remarks import next_step
from cavirheo.reporting.record import Answered, result_of
from cavirheo.writing import digits, document, style, terminal
from cavirheo.writing.document import Quantity, Spread, write_json

NAMES = ("log10_shear_modulus", "log10_viscosity")
COMMAND = "cavirheo infer shots.mat -o out"


def bubble(name="shot[1]", group="shots", source="data/shots.mat", top=2.6e-4, frames=160, **meta) -> RadiusCurve:
    """A history of the right look: growth, three collapses, a plateau; with three frames missing."""
    t_c = top * np.sqrt(998.0 / 101325.0)
    t = np.linspace(-0.7, 6.0, frames)
    wave = np.abs(np.cos(np.pi * t / 1.9)) ** 0.7
    radius = top * (0.12 + 0.88 * np.exp(-np.maximum(t, 0.0) / 0.9) * wave)
    radius[[50, 51, 52]] = np.nan
    meta = {
        "name": name,
        "group": group,
        "source": source,
        "notes": ("3 of 160 frames without a radius (NaN)",),
        **meta,
    }
    return RadiusCurve(t * t_c + 1e-4, radius, meta=meta)


def answer(curve, G=6100.0, mu=0.021, *, draws=1, verdict="ok", message="", material="nhkv", stretch=9.1) -> Posterior:
    rng = np.random.default_rng(0)
    after = (curve.time >= curve.time_of_max) & np.isfinite(curve.radius)
    time = curve.time[after][:60]
    residual = 0.01 * np.sin(np.arange(len(time)))
    line = np.linspace(time[0], time[-1], 200)
    said = messages(message, code="check_input.test" if verdict == "check_input" else "test")
    checks = Checks(
        verdict, said, rmse_over_rmax=float(np.sqrt(np.mean(residual**2))),
        mae_over_rmax=float(np.mean(np.abs(residual))), max_difference_over_rmax=float(np.max(np.abs(residual))),
        collapses=2, t_star_end=2.6, compared_time=time, residual_over_rmax=residual, reconstruction_time=line,
        reconstruction_radius=np.interp(line, time, curve.radius[after][:60]),
        time_scale=curve.max_radius * np.sqrt(998.0 / 101325.0),
    )  # fmt: skip
    names = NAMES if material == "nhkv" else NAMES[1:]
    centre = np.log10([G, mu])[-len(names) :]
    theta = centre + (0.05 * rng.standard_normal((draws, len(names))) if draws > 1 else 0.0) * np.ones((draws, 1))
    return Posterior(
        names, ("Pa", "Pa s")[-len(names) :], theta, checks, material, "bdt", {"model": "bdt-viscoelastic"},
        seconds=0.4, stretch=stretch, diagnostics=Diagnostics(stretch_source="fitted"),
    )  # fmt: skip


def unanswered(message="cell 3 of 5 is empty") -> Posterior:
    return Posterior(NAMES, ("Pa", "Pa s"), np.empty((0, 2)), Checks("failed", messages(message)), "nhkv", "bdt")


def empty(name="shot[3]", group="shots", source="data/shots.mat") -> RadiusCurve:
    meta = {"name": name, "group": group, "source": source}
    return RadiusCurve(np.empty(0), np.empty(0), meta=meta, unusable="cell 3 of 5 is empty")


@pytest.fixture
def pairs():
    one, two = bubble(), bubble("shot[2]", top=3.1e-4)
    return [(one, answer(one)), (two, answer(two, 8100.0, 0.035)), (empty(), unanswered())]


def strictly(text: str) -> dict:
    """JSON without NaN or Infinity, which Python would otherwise read."""

    def refuse(constant):
        raise AssertionError(f"{constant} in the JSON")

    return json.loads(text, parse_constant=refuse)


# --- result.json -----------------------------------------------------------------------------------------------------


def test_json_keeps_the_contract(pairs, tmp_path):
    write_json(tmp_path / "result.json", result(pairs, COMMAND))
    document = strictly((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert document["schema"] == 1
    assert document["command"] == COMMAND
    assert document["version"]
    row = document["curves"][0]
    wanted = {
        "name", "source", "max_radius_m", "stretch", "material", "method", "shear_modulus_Pa", "viscosity_Pa_s",
        "rmse_over_rmax", "window", "verdict", "messages", "seconds", "provenance",
    }  # fmt: skip
    assert wanted <= row.keys()
    assert row["name"] == "shot[1]"
    assert row["max_radius_m"] == pytest.approx(2.6e-4, rel=0.02)
    assert row["shear_modulus_Pa"] == {"median": pytest.approx(6100.0), "q05": None, "q95": None, "bound": None}
    assert row["viscosity_Pa_s"] == {"median": pytest.approx(0.021), "q05": None, "q95": None, "bound": None}
    assert row["stretch"] == {"median": 9.1, "q05": None, "q95": None, "bound": None}
    assert row["window"] == {"collapses": 2, "t_star_end": 2.6}
    (group,) = document["groups"]
    assert group["name"] == "shots"
    assert {"n", "n_trusted", "shear_modulus_Pa", "viscosity_Pa_s"} <= group.keys()


def test_group_takes_mean_and_sample_deviation(pairs):
    (group,) = result(pairs, COMMAND).groups
    assert (group.n, group.n_trusted, group.n_failed) == (2, 2, 1)
    assert group.verdicts == {"ok": 2, "failed": 1}
    assert group.shear_modulus_Pa.mean == pytest.approx(7100.0)
    assert group.shear_modulus_Pa.std == pytest.approx(2000.0 / np.sqrt(2.0))  # n - 1, not n
    assert group.viscosity_Pa_s.median == pytest.approx(0.028)


@pytest.mark.parametrize(
    ("doubtful", "mean", "basis"),
    [
        ((), 7.0e3, ""),
        ((1,), 6.5e3, "2 of 3 shots count"),
        ((0, 1, 2), None, "0 of 3 shots count"),
    ],
)
def test_only_trusted_answers_are_averaged_and_the_rest_is_counted(doubtful, mean, basis, tmp_path):
    verdicts = ["model_does_not_fit" if k in doubtful else "ok" for k in range(3)]
    curves = [bubble(f"s{k}", top=(2.6 + 0.1 * k) * 1e-4) for k in range(3)]
    moduli = (6e3, 8e3, 7e3)
    pairs = [(c, answer(c, G, verdict=v)) for c, G, v in zip(curves, moduli, verdicts, strict=True)]
    document = write_report(tmp_path, pairs, COMMAND, ())
    (group,) = document.groups
    assert (group.n, group.n_trusted) == (3, 3 - len(doubtful))
    assert group.shear_modulus_Pa.mean == (None if mean is None else pytest.approx(mean))
    assert (group.viscosity_Pa_s.mean is None) == (mean is None)
    assert group.basis == basis
    page = " ".join((tmp_path / "report.html").read_text(encoding="utf-8").split())
    drawn = lines_of_group(pairs, document)
    for said in (page, " ".join(printed(document, 80).split()), drawn.said):
        assert all(word in said for word in basis.split())
    assert (~drawn.trusted).sum() == len(doubtful)
    assert ("does not count" in svg.group_svg(drawn)) == bool(doubtful)


@pytest.mark.parametrize("verdict", ["unverified", "other_model_preferred"])
def test_what_no_simulation_weighed_counts_in_nothing_and_a_rejected_model_is_said_first(verdict, tmp_path):
    """One count for the headline, the row of the group and the page; a rejected model counts, after a warning."""
    curves = [bubble(f"s{k}", top=(2.6 + 0.1 * k) * 1e-4) for k in range(5)]
    answers = [answer(c, 6e3 + 100 * k, draws=400, verdict=verdict if k < 2 else "ok") for k, c in enumerate(curves)]
    there = OtherAnswer("nhkv", REAL, {"viscosity": 0.03}, {}, Evidence(20.0), 0.01)
    answers = [replace(one, evidence=Evidence(0.0, 0.1), others=(there,)) for one in answers]
    document = write_report(tmp_path, list(zip(curves, answers, strict=True)), COMMAND, (), draw=False)
    (group,), count = document.groups, 3 if verdict == "unverified" else 5
    assert group.n_trusted == group.population.n == group.shear_modulus_Pa.n == count
    assert f"{count} of 5 shots count" in group.headline
    assert group.basis == ("3 of 5 shots count" if count == 3 else "")
    text = " ".join(printed(document, 120).split())
    first = "the evidence prefers another model in 2 of 5 shots: nhkv, real bubble"
    assert group.headline.startswith(first) == text.startswith(f"shots: {first}") == (count == 5)
    page = " ".join((tmp_path / "report.html").read_text(encoding="utf-8").split())
    assert (first in page) == (count == 5)
    assert page.count(digits.VERDICTS[verdict]) > 2
    assert len(population(answers, only_trusted=False).shots) == 5  # if it is asked for


def test_twenty_shots_that_do_not_fit_say_what_to_do_in_ten_lines():
    curves, shots = [bubble(f"s{k}") for k in range(20)], []
    for k, curve in enumerate(curves):
        shot = answer(curve, verdict="model_does_not_fit")
        said = [m for c in "abcdefghijkl"[: 12 - k % 12] for m in messages(f"cause {c}: {k} % of R_max", code=c)]
        shots.append(replace(shot, checks=replace(shot.checks, messages=tuple(said))))
    document = result(list(zip(curves, shots, strict=True)), "cavirheo infer a.mat --material nhkv -o out")
    lines = [line for line in printed(document, 200).split("\n") if "cause" in line]
    assert lines[0] == "• 20 of 20 curves: cause a: 0 to 19 % of R_max"
    assert len(lines) == table.MOST
    assert "2 more remarks in the report" in printed(document, 200)
    asked = Analysis(material="nhkv")
    step = next_step(document, asked, Path("out"))
    assert step.startswith("next: ")
    assert "20 of 20 shots" in step
    assert step.endswith("cavirheo infer a.mat --material auto -o out-auto")
    assert next_step(document, replace(asked, material="auto"), Path("out")) == ""
    assert next_step(document, Analysis(model="bdt-viscous"), Path("out")) == ""
    for row in document.curves[:10]:
        row.verdict = "ok"
    assert next_step(document, asked, Path("out")) == ""


@pytest.mark.parametrize(
    "how", [{"frames_left_out": 2}, {"at_bound": ("radius_scale",)}, {"at_bound": ("max_radius_factor",)}]
)
def test_where_the_recording_is_at_fault_no_other_law_is_proposed(how):
    asked, command = Analysis(material="nhkv"), "cavirheo infer a.mat --material nhkv -o out"
    shots = [(curve := bubble(f"s{k}"), answer(curve, verdict="model_does_not_fit")) for k in range(4)]
    faulty = [(curve, replace(one, diagnostics=Diagnostics(**how))) for curve, one in shots]
    step = next_step(result(faulty, command), asked, Path("out"))
    assert "look at the recording" in step
    assert "s0, s1, s2 and 1 more" in step
    assert "--material auto" not in step
    assert "--material auto" in next_step(result(faulty[:1] + shots[1:], command), asked, Path("out"))


def test_lines_of_several_groups_stay_apart():
    curves = [bubble(f"s{k}", group=name, source=name) for name in ("soft", "stiff") for k in range(2)]
    model = group.GroupModel(material="nhkv", bubble="field", n=2, shear_modulus_Pa=Spread(), viscosity_Pa_s=Spread())
    document = result([(c, answer(c)) for c in curves], COMMAND)
    for one, G in zip(document.groups, (5830.0, 30480.0), strict=True):
        one.other_models = [model.model_copy(update={"shear_modulus_Pa": Spread(mean=G, std=600.0)})]
    text = printed(document, 140)
    assert "soft: with nhkv, field's bubble: G 5.83 ± 0.60 kPa" in text
    assert "stiff: with nhkv, field's bubble: G 30.48 ± 0.60 kPa" in text


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        ((1.0, 3.0), "µ rises as"),
        ((-0.5, 0.9), "no change of µ"),
        ((-24.7, 12.7), "whether µ changes"),
        ((-3.0, -1.0), "µ falls"),
    ],
)
def test_a_slope_that_tells_nothing_is_not_called_none(ends, said):
    one = group.Slope(median=sum(ends) / 2, q05=ends[0], q95=ends[1], n=9, n_trusted=9)
    assert group.in_words({"viscosity": one}).startswith(said)


def test_group_of_one_has_no_deviation(pairs):
    (group,) = result(pairs[:1], COMMAND).groups
    spread = group.shear_modulus_Pa
    assert (spread.mean, spread.std) == (pytest.approx(6100.0), None)


def test_files_of_one_name_are_two_groups():
    curves = [bubble(source="a/shots.mat"), bubble(source="b/shots.mat"), bubble(group="other", source="b/other.mat")]
    groups = result([(curve, answer(curve)) for curve in curves], COMMAND).groups
    assert [group.name for group in groups] == ["a/shots.mat", "b/shots.mat", "other"]
    assert [group.n for group in groups] == [1, 1, 1]


def test_interval_is_that_of_the_posterior():
    curve = bubble()
    posterior = answer(curve, draws=500)
    posterior = replace(posterior, log_weight=np.linspace(-3.0, 0.0, 500))
    row = result([(curve, posterior)], COMMAND).curves[0]
    assert (row.shear_modulus_Pa.q05, row.shear_modulus_Pa.q95) == posterior.interval("shear_modulus")
    assert row.shear_modulus_Pa.q05 < row.shear_modulus_Pa.median < row.shear_modulus_Pa.q95
    assert row.stretch.q05 is None  # not among the draws: no width is made up


def test_inferred_stretch_and_further_parameters_come_from_the_draws():
    curve = bubble()
    posterior = answer(curve, draws=300)
    more = np.random.default_rng(1).normal([8.0, 1e-7], [0.1, 1e-8], (300, 2))
    posterior = replace(
        posterior,
        names=(*NAMES, "stretch", "t0"),
        units=("Pa", "Pa s", "1", "s"),
        theta=np.hstack([posterior.theta, more]),
    )
    row = result([(curve, posterior)], COMMAND).curves[0]
    assert row.stretch.median == pytest.approx(8.0, abs=0.05)
    assert row.stretch.q05 is not None
    assert row.other_parameters.keys() == {"t0"}
    assert row.other_parameters["t0"].median == pytest.approx(1e-7, rel=0.05)


def test_what_the_answer_rests_on_is_read_from_its_fields_and_not_from_its_provenance(tmp_path):
    curve = bubble()
    about = Diagnostics(
        stretch_source="given", free={"time_origin": 1.5e-7}, correlations={"shear_modulus, viscosity": -0.31},
        frames=60, frames_per_independent_residual=np.float64(2.0), at_bound=("stretch",), draws=500,
        effective_sample_size=321.0, predictive={"p_value": np.float64(0.04)}, systematic_misfit_over_rmax=0.01,
    )  # fmt: skip
    windows = {"1": WindowAnswer({"shear_modulus": 6440.0, "viscosity": 0.0295}, 1.0, 0.01, ("viscosity",))}
    other = {
        "stretch": 99.0, "stretch_source": "other", "frames": 7, "medium": {"density": 1.0, "pressure": 1.0},
        "windows": {"2": {"shear_modulus": 1.0}}, "free": {"time_origin": 9.0},
        "correlations": {"shear_modulus, viscosity": 0.99},
    }  # fmt: skip
    posterior = replace(
        answer(curve), method="least_squares", diagnostics=about, windows=windows, provenance=other,
        evidence=Evidence(-12.5, 0.1),
    )  # fmt: skip
    written = write_report(tmp_path, [(curve, posterior)], COMMAND, ())
    row = strictly((tmp_path / "result.json").read_text(encoding="utf-8"))["curves"][0]
    assert row["stretch"]["median"] == 9.1
    assert row["evidence"] == {"log": -12.5, "error": 0.1}
    assert row["windows"]["1"]["best"] == {"shear_modulus": 6440.0, "viscosity": 0.0295}
    assert read_json(tmp_path / "result.json") == written
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    shown = " ".join("".join(page.text).split('{ "source"')[0].split())
    for part in ("given", "6.44, 0.0295*", "t_0 = 1.5e-07", "-0.31", "worth 30 independent", "321", "p = 0.04"):
        assert part in shown
    assert "t*" in words(svg.curve_svg(lines_of(curve, posterior)))


def test_numbers_that_are_none_do_not_break_the_report(tmp_path):
    curve = bubble()
    about = Diagnostics(correlations={"shear_modulus, viscosity": float("nan")}, predictive={"p_value": float("nan")})
    posterior = replace(answer(curve), method="least_squares", diagnostics=about)
    write_report(tmp_path, [(curve, posterior)], COMMAND, ())
    strictly((tmp_path / "result.json").read_text(encoding="utf-8"))


def test_the_maximum_of_the_posterior_is_no_least_squares(tmp_path):
    curve = bubble()
    written = write_report(tmp_path, [(curve, replace(answer(curve, draws=300), method="laplace"))], COMMAND, ())
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Laplace" in page
    assert "least squares" not in page
    assert written.curves[0].shear_modulus_Pa.q05 is not None
    assert "[" in printed(written, 140).split("shot")[1]


def test_newtonian_has_no_modulus():
    curve = bubble()
    document = result([(curve, answer(curve, material="newtonian"))], COMMAND)
    assert document.curves[0].shear_modulus_Pa == Quantity()
    assert document.curves[0].viscosity_Pa_s.median == pytest.approx(0.021)
    assert document.groups[0].shear_modulus_Pa == Spread()


def test_failed_row_has_a_reason_and_no_numbers(pairs):
    row = result(pairs, COMMAND).curves[2]
    assert row.verdict == "failed"
    assert row.message == "cell 3 of 5 is empty"
    numbers = (row.max_radius_m, row.time_of_max_s, row.rmse_over_rmax, row.stretch.median, row.window.t_star_end)
    assert numbers == (None,) * 5
    assert row.shear_modulus_Pa == row.viscosity_Pa_s == Quantity()


def test_message_does_not_repeat_the_name():
    curve = bubble()
    (posterior,) = infer_many([replace(curve, radius=np.full(len(curve.time), np.nan))])
    (row,) = result([(curve, posterior)], COMMAND).curves
    assert (row.verdict, curve.name in row.message) == ("failed", False)
    assert [one.code for one in row.messages] == ["curve.few_frames"]


@pytest.mark.parametrize("theta", [np.empty((0, 2)), np.array([[3.8, np.nan]]), np.array([[np.inf, -2.0]])])
def test_an_answer_that_is_none_does_not_pass(theta, tmp_path):
    curve = bubble()
    posterior = replace(answer(curve), theta=theta)
    document = result([(curve, posterior)], COMMAND)
    assert document.curves[0].verdict == "failed"
    assert document.curves[0].message
    assert document.curves[0].viscosity_Pa_s.median is None
    assert document.groups[0].n_failed == 1
    write_json(tmp_path / "r.json", document)
    strictly((tmp_path / "r.json").read_text(encoding="utf-8"))


def test_provenance_becomes_plain_json(tmp_path):
    curve = bubble()
    odd = {
        "array": np.arange(3),
        "nan": float("nan"),
        "deep": {"x": [np.float64("inf"), np.int64(2)]},
        "p": Path("a"),
        1: (),
    }
    posterior = replace(answer(curve), provenance=odd)
    posterior = replace(posterior, checks=replace(posterior.checks, mae_over_rmax=float("nan")))
    write_json(tmp_path / "r.json", result([(curve, posterior)], COMMAND))
    row = strictly((tmp_path / "r.json").read_text(encoding="utf-8"))["curves"][0]
    assert row["provenance"] == {"array": [0, 1, 2], "nan": None, "deep": {"x": [None, 2]}, "p": "a", "1": []}
    assert row["mae_over_rmax"] is None


def test_json_comes_back_equal(pairs, tmp_path):
    document = result(pairs, COMMAND, date="2025-01-02", notes=["a note"])
    write_json(tmp_path / "r.json", document)
    assert read_json(tmp_path / "r.json") == document


@pytest.mark.parametrize(
    "text", [None, "not json", "{}", '{"schema": 2, "version": "", "command": "", "curves": [], "groups": []}']
)
def test_what_is_not_a_result_is_refused(text, tmp_path):
    path = tmp_path / "r.json"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read_json(path)
    assert refused.value.code == ("files.unreadable" if text is None else "document.other")
    assert path.name in str(refused.value)


# --- words and the table ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "text"),
    [(6.4412, "6.44"), (0.0201, "0.0201"), (9.996, "10.0"), (274.3, "274"), (2e-6, "2.00e-06"), (0.0, "0")],
)
def test_digits(value, text):
    assert digits.significant(value) == text


def test_quantity_shows_the_digits_that_the_interval_leaves():
    assert digits.quantity(Quantity(median=6100.0, q05=5400.0, q95=6900.0), 1e-3) == "6.1 [5.4, 6.9]"
    assert digits.quantity(Quantity(median=9.91, q05=9.60, q95=10.19)) == "9.91 [9.60, 10.19]"
    assert digits.quantity(Quantity(median=0.02, q05=0.0005, q95=0.3)) == "0.020 [0.00050, 0.300]"
    assert digits.quantity(Quantity(median=1e-4, q05=1e-4, q95=27.81032)) == "0.00010 [0.00010, 28]"
    assert digits.quantity(Quantity(median=6440.0), 1e-3) == "6.44"
    assert digits.quantity(Quantity()) == digits.MISSING


def test_spread_shows_two_digits_of_the_deviation():
    assert digits.spread(Spread(mean=6440.0, std=1640.0), 1e-3) == "6.4 ± 1.6"
    assert digits.spread(Spread(mean=0.02, std=0.009)) == "0.0200 ± 0.0090"
    assert digits.spread(Spread(mean=0.02)) == "0.0200"
    assert digits.spread(Spread(mean=0.02, std=0.0)) == "0.0200 ± 0"
    assert digits.spread(Spread(mean=0.02, std=1e-7)) == "0.0200 ± 1e-07"


def test_identical_shots_leave_room_for_their_names():
    value = 0.1 + 0.2  # their standard deviation is that of rounding
    curves = [bubble(f"a_name_of_some_length_{k}") for k in range(3)]
    document = result([(c, answer(c, 6e3 * value, value)) for c in curves], COMMAND)
    document.groups[0].viscosity_Pa_s.std = 5.6e-17
    text = printed(document, 80)
    assert "± 0" in text
    assert "± 0.0" not in text
    assert all(curve.name in text for curve in curves)


def test_elided_names_keep_both_ends():
    short = digits.elide("Rt_nondim_exp_PAAm[12]", 14)
    assert len(short) == 14
    assert short.startswith("Rt_no")
    assert short.endswith("[12]")
    assert digits.elide("short", 14) == "short"


def printed(document, width) -> str:
    console = terminal.console(width=width, file=io.StringIO(), force_terminal=False)
    table.print_table(document, console)
    return console.file.getvalue()


@pytest.mark.parametrize("width", [80, 100, 140])
@pytest.mark.parametrize("draws", [1, 400])
def test_table_fits_its_terminal(width, draws):
    long = "Rt_nondim_exp_PAAm_Alginate_0p3perc_v2"
    curves = [bubble(f"{long}[{k}]", long) for k in (1, 2)]
    pairs = [
        (c, answer(c, draws=draws, verdict=v)) for c, v in zip(curves, ("ok", "outside_training_range"), strict=True)
    ]
    pairs.append((empty(f"{long}[3]", long), unanswered("too short: " + "words " * 30)))
    lines = printed(result(pairs, COMMAND), width).splitlines()
    assert max(map(len, lines)) <= width
    text = "\n".join(lines)
    first = "".join(line.split(" ")[0] for line in text.split("RMSE:")[0].splitlines())
    assert all(first.count(f"{long}[{k}]") == 1 for k in (1, 2, 3)), text  # folded, not cut
    assert "1 of 3" in text
    assert "failed" in text
    assert " ".join(text.split()).count("words") == 30  # the message stands below in full
    assert (text.split("RMSE:")[0].count("[") > 3) == (draws > 1)  # intervals, beside the names, where there are any


def bounding(curve, top=-2.0) -> Posterior:
    """G as ever, and a viscosity that is anything below 10**top."""
    made, rng = answer(curve, draws=800, verdict="undetermined"), np.random.default_rng(1)
    return replace(made, theta=np.column_stack([made.theta[:, 0], rng.uniform(-4.0, top, 800)]))


@pytest.mark.parametrize("width", [80, 140])
def test_a_bound_is_said_as_a_bound_and_counts(tmp_path, width):
    """Of five shots that count three determine mu: one count for the table, the group and the material."""
    curves = [bubble(f"shot[{k}]") for k in range(5)]
    pairs = [
        (c, answer(c, G=6e3 + 50 * k, draws=800) if k < 3 else bounding(c, -2.0 - 0.01 * k))
        for k, c in enumerate(curves)
    ]
    write_report(tmp_path, pairs, COMMAND, draw=False)
    document = read_json(tmp_path / "result.json")
    (group,), rows = document.groups, document.curves
    assert [row.viscosity_Pa_s.bound for row in rows] == [None] * 3 + ["upper"] * 2
    assert [row.shear_modulus_Pa.bound for row in rows] == [None] * 5
    assert rows[3].viscosity_Pa_s.q95 == pytest.approx(0.93 * 10**-2.03, rel=0.2)
    assert all(row.trusted for row in rows)
    assert group.n_trusted == group.population.n == 5
    assert (group.shear_modulus_Pa.n, group.viscosity_Pa_s.n) == (5, 3)
    assert group.viscosity_Pa_s.mean == pytest.approx(np.mean([row.viscosity_Pa_s.median for row in rows[:3]]))
    assert "5 of 5 shots count" in group.headline
    text = " ".join(printed(document, width).split())
    assert "below 0.00" in text
    assert "undetermined" in text
    assert "(n = 3)" in text
    assert group.basis == ""  # all count
    assert "µ below 0.00" in table.line(rows[3])
    assert "Pa s (95 %)" in table.line(rows[3])
    page = "".join(Page((tmp_path / "report.html").read_text(encoding="utf-8")).text)
    assert page.count("below 0.00") >= 4  # table and article, of two shots
    with (tmp_path / "result.csv").open(encoding="utf-8") as file:
        assert [row["viscosity_Pa_s_bound"] for row in csv.DictReader(file)] == [""] * 3 + ["upper"] * 2


def test_a_parameter_at_its_bound_without_an_interval_is_in_no_mean():
    curves = [bubble(f"shot[{k}]") for k in range(3)]
    stuck = replace(
        answer(curves[2], mu=1e-4, verdict="undetermined"), diagnostics=Diagnostics(at_bound=("viscosity",))
    )
    (group,) = result([*((c, answer(c)) for c in curves[:2]), (curves[2], stuck)], COMMAND).groups
    assert (group.n_trusted, group.shear_modulus_Pa.n, group.viscosity_Pa_s.n) == (3, 3, 2)
    assert group.viscosity_Pa_s.mean == pytest.approx(0.021)


@pytest.mark.parametrize(
    ("ends", "bound", "said"),
    [
        ((1.2e-4, 1e-3, 0.03), "upper", "an upper limit of µ alone: any value below 0.030 Pa s follows it as well"),
        ((0.03, 1.0, 9.0), "lower", "a lower limit of µ alone: any value above 0.030 Pa s follows it as well"),
        ((1.2e-4, 0.1, 9.0), "undetermined", "does not determine µ"),
    ],
)
def test_what_is_not_bounded_is_said_in_plain_words(ends, bound, said):
    value = Quantity(q05=ends[0], median=ends[1], q95=ends[2], bound=bound)
    known = {"name": "viscosity", **value.model_dump()}
    assert said in Message(f"bound.viscosity.{bound}", known).text
    assert value.determined is None
    words = {"upper": "µ below 0.030 Pa s (95 %)", "lower": "µ above 0.030 Pa s (95 %)"}
    assert value_in_words("viscosity", ends) == words.get(bound, "µ undetermined")


def test_table_tells_apart_names_that_differ_in_the_middle():
    curves = [bubble(f"a_very_long_beginning_{k}_and_a_very_long_end_of_the_name") for k in "xy"]
    text = printed(result([(c, answer(c)) for c in curves], COMMAND), 80)
    rows = [line for line in text.splitlines() if line.startswith("a_")]
    assert len(set(rows)) >= 2
    assert "…" not in "".join(rows)


def test_table_chooses_one_unit():
    curve = bubble()
    soft = result([(curve, answer(curve, 310.0)), (curve, answer(curve, 95.0))], COMMAND)
    assert soft.modulus_unit == (1.0, "Pa")
    assert result([(curve, answer(curve, 310.0)), (curve, answer(curve, 5e3))], COMMAND).modulus_unit == (
        1e-3,
        "kPa",
    )
    assert "310" in printed(soft, 80)


def test_table_prints_markup_as_it_stands(pairs):
    curve = bubble("[red]x[/red]")
    assert "[red]x[/red]" in printed(result([(curve, answer(curve))], COMMAND), 80)


def test_csv_has_a_line_per_curve(pairs, tmp_path):
    table.write_csv(tmp_path / "r.csv", result(pairs, COMMAND))
    with (tmp_path / "r.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == ["shot[1]", "shot[2]", "shot[3]"]
    assert float(rows[0]["shear_modulus_Pa"]) == pytest.approx(6100.0)
    assert rows[0]["shear_modulus_Pa_q05"] == ""
    assert rows[0]["collapses"] == "2"
    assert rows[2]["shear_modulus_Pa"] == ""
    assert rows[2]["verdict"] == "failed"


# --- pictures --------------------------------------------------------------------------------------------------------

KILOPASCAL = (1e-3, "kPa")


def lines_of(curve, posterior):
    return answer_lines(curve, posterior.checks, curve_record(curve, posterior))


def lines_of_group(pairs, document, index=0):
    about, members = document.members()[index]
    shots = [(pairs[i][0], pairs[i][1].checks, document.curves[i]) for i in members if document.curves[i].answered]
    return group_lines(shots, about, KILOPASCAL)


def figure(curve, posterior, look=figures.SCREEN):
    head = figures.heading(curve_record(curve, posterior), KILOPASCAL)
    return figures.curve_figure(lines_of(curve, posterior), look, head)


def words(drawing) -> list[str]:
    """All that is written on a picture or a figure, numbers at ticks included."""
    if isinstance(drawing, str):
        return [text for part in ET.fromstring(drawing).iter() if (text := (part.text or "").strip())]
    drawing.draw_without_rendering()
    return [
        text.get_text() for text in drawing.findobj(lambda one: hasattr(one, "get_text")) if text.get_text().strip()
    ]


def paths(picture) -> dict[str, list[tuple[float, float]]]:
    """(x, y) in pixels of each layer of a picture by its class: every place that its path goes to."""
    found: dict[str, list[tuple[float, float]]] = {}
    for part in ET.fromstring(picture).iter("path"):
        at, places = np.zeros(2), []
        for step in re.finditer(r"([MmlhvHVz])?\s*(-?\d+)?(?:\s*(-?\d+))?", part.get("d")):
            kind, first, second = step.groups()
            if first is not None and second is not None:
                here = np.array([int(first), int(second)])
                at = here if kind == "M" else at + here
                places.append(tuple(at / svg.UNITS))
        found[part.get("class")] = places
    return found


def test_lines_are_the_measurement_the_simulation_and_the_residual(pairs):
    curve, posterior = pairs[0]
    found = lines_of(curve, posterior)
    after = 1e6 * (curve.time - curve.time_of_max)
    assert found.compared.sum() == 60
    at = np.searchsorted(after, found.time - 1e-9)
    assert found.radius == pytest.approx(1e6 * curve.radius[at])
    assert found.simulated_radius == pytest.approx(1e6 * posterior.checks.reconstruction_radius)
    assert found.simulated_time[0] == pytest.approx(1e6 * (posterior.checks.reconstruction_time[0] - curve.time_of_max))
    assert found.residual == pytest.approx(100.0 * posterior.checks.residual_over_rmax)
    axis = found.t_star_axis
    assert np.array([axis.low, axis.high]) * posterior.checks.time_scale * 1e6 == pytest.approx(
        [found.x.low, found.x.high]
    )
    assert found.simulated_as == "simulation: answer"


@pytest.mark.parametrize("brief", [False, True])
@pytest.mark.parametrize(("width", "height"), [(480, 300), (340, 215), (900, 500)])
def test_points_and_line_are_in_the_picture_where_they_belong(pairs, width, height, brief):
    """At every size, to a pixel; the dots of the brief one are thinned, and its line keeps each collapse."""
    curve, posterior = pairs[0]
    found = lines_of(curve, posterior)
    drawn = svg.curve_svg(found, width, height, points=60 if brief else svg.POINTS, brief=brief)
    layers, view = paths(drawn), [int(one) / svg.UNITS for one in ET.fromstring(drawn).get("viewBox").split()]
    assert view == [0.0, 0.0, width, height / 2 if brief else height]
    for places in layers.values():
        assert all(0 <= x <= view[2] and 0 <= y <= view[3] for x, y in places)
    measured = np.array(layers["measured"])
    known = np.column_stack([found.time, found.radius])[found.compared]
    assert len(known) == len(measured) if not brief else 5 < len(measured) < 30
    kept = known[:: -(-len(known) // len(measured))]
    for axis in (0, 1):  # a straight relation between numbers and places, for dots and line alike
        slope, start = np.polyfit(kept[:, axis], measured[:, axis], 1)
        assert measured[:, axis] == pytest.approx(slope * kept[:, axis] + start, abs=0.51)
        line = np.array(layers["simulated"])[:, axis]
        values = slope * (found.simulated_time, found.simulated_radius)[axis] + start
        assert [line.min(), line.max()] == pytest.approx([values.min(), values.max()], abs=1.0)
    assert ("residual" in layers) == (not brief)


def test_the_picture_names_what_it_shows(pairs):
    said = " ".join(words(svg.curve_svg(lines_of(*pairs[0]))))
    for part in ("measured", "not compared", "simulation: answer", "t*", "R (µm)", "time after", "band: ± RMSE = 0.7"):
        assert part in said


def test_a_failed_curve_has_points_and_says_so_and_has_no_line():
    for brief in (False, True):
        drawn = svg.curve_svg(lines_of(bubble(), unanswered("the recording is too short")), brief=brief)
        assert {"measured"} == paths(drawn).keys() - {"axes"}
        assert "no answer" in " ".join(words(drawn))
    assert "no measured radius" in words(svg.curve_svg(lines_of(empty(), unanswered())))


def test_without_a_scale_there_are_no_micrometres():
    drawn = svg.curve_svg(lines_of(replace(bubble(), unscaled="in pixels", time_unscaled=True), unanswered("no scale")))
    assert len(paths(drawn)["measured"]) > 100
    assert "µ" not in "".join(words(drawn))


def test_what_is_compared_shows_before_there_is_an_answer():
    curve = bubble()
    radius = curve.radius.copy()
    radius[39] = 0.8 * curve.max_radius
    curve = replace(curve, radius=radius)
    found = preview_lines(curve, curve.window(1))
    assert 0 < found.compared.sum() < len(found.compared)
    assert len(found.outliers) == 1
    assert found.outliers[0, 1] == pytest.approx(1e6 * radius[39])
    assert len(found.missing) == 3
    said = " ".join(words(svg.curve_svg(found)))
    assert "stands out" in said
    assert "no radius" in said
    assert "no answer" not in said


@pytest.mark.parametrize(
    ("ends", "most", "ticks"),
    [
        ((0.0, 273.0), 6, [0, 50, 100, 150, 200, 250]),
        ((-1.2, 1.2), 3, [-1, 0, 1]),
        ((0.0, 0.0), 5, []),
        ((0, 1e-7), 2, [0, 5e-8, 1e-7]),
    ],
)
def test_ticks_are_round_and_few(ends, most, ticks):
    assert Axis("", *ends).ticks(most) == pytest.approx(ticks)


def test_a_thinned_line_keeps_its_turns():
    x = np.linspace(0.0, 1.0, 5000)
    y = np.abs(np.cos(9.0 * x))
    kept = thinned(x, y, 60)
    assert len(kept) < 70
    turns = np.flatnonzero(np.diff(np.sign(np.diff(y)))) + 1
    assert {*turns} <= {*kept}


def test_a_simulation_of_another_length_is_an_error():
    checks = replace(answer(bubble()).checks, reconstruction_radius=np.ones(3))
    with pytest.raises(ValueError, match="3 values at 200 times"):
        curve_lines(bubble(), checks)


def test_lines_of_a_group_hold_each_answered_shot(pairs):
    document = result(pairs, COMMAND)
    found = lines_of_group(pairs, document)
    assert [shot.name for shot in found.shots] == ["shot[1]", "shot[2]"]
    assert [shot.size for shot in found.shots] == [0.0, 1.0]
    assert np.nanmax(found.shots[0].radius) == pytest.approx(1.0, abs=0.02)
    (mean,) = found.answers[0].marks
    assert (mean.name, mean.x[1], mean.y[1]) == ("mean ± std", pytest.approx(7.1), pytest.approx(0.028))
    assert [found.smallest, found.largest] == pytest.approx([1e6 * curve.max_radius for curve, _ in pairs[:2]])
    assert found.title == "shots: 2 shots, 1 failed"


def test_the_group_of_a_fluid_has_no_modulus():
    curves = [bubble(top=2e-4), bubble("shot[2]", top=3e-4)]
    pairs = [(c, answer(c, mu=m, material="newtonian")) for c, m in zip(curves, (0.04, 0.05), strict=True)]
    said = " ".join(words(f"<p>{svg.group_svg(lines_of_group(pairs, result(pairs, COMMAND)))}</p>"))
    assert "G (" not in said
    assert "mean ± std" in said


@pytest.mark.needs("matplotlib")
def test_figures_show_what_the_picture_shows(pairs):
    for look in (figures.SCREEN, figures.PAPER):
        drawn = figure(*pairs[0], look)
        found = {line.get_label(): line.get_xydata() for line in drawn.axes[0].lines}
        lines = lines_of(*pairs[0])
        assert found["measured"] == pytest.approx(np.column_stack([lines.time, lines.radius])[lines.compared])
        assert found["simulation: answer"][:, 1] == pytest.approx(lines.simulated_radius)
    said = " ".join(words(figure(*pairs[0]))).replace("\u00a0", " ")
    for part in ("shot[1]", "G = 6.10 kPa", "µ = 0.0210 Pa s", "λ = 9.10", "ok", "t*", "simulation: answer"):
        assert part in said


@pytest.mark.needs("matplotlib")
def test_the_figure_of_a_failed_curve_says_why():
    drawn = figure(bubble(), unanswered("the recording is too short"))
    assert {line.get_label() for axes in drawn.axes for line in axes.lines} == {"measured"}
    assert "the recording is too short" in words(drawn)
    assert sum("words" in text for text in words(figure(bubble(), unanswered("words " * 99)))) == 3
    assert "no measured radius" in words(figure(empty(), unanswered()))


@pytest.mark.needs("matplotlib")
@pytest.mark.parametrize(("G", "width"), [(123456.0, 0.3), (5800.0, 0.04), (5800.0, 0.4)])
def test_the_answer_stays_inside_the_figure(G, width):
    """Whatever its length."""
    curve = bubble(top=2.67e-4)
    posterior = answer(curve, G, 0.0285, draws=400)
    posterior = replace(
        posterior, names=(*NAMES, "stretch"), units=("Pa", "Pa s", "1"),
        theta=np.hstack([posterior.theta, np.random.default_rng(1).normal(8.735, width, (400, 1))]),
    )  # fmt: skip
    drawn = figure(curve, posterior)
    style.drawn(drawn)
    assert all(text.get_window_extent().x1 < drawn.bbox.x1 for text in drawn.texts)


@pytest.mark.needs("matplotlib")
def test_files_are_written_where_they_are_asked_for(pairs, tmp_path):
    write_report(tmp_path, pairs[:1], COMMAND, ("png", "svg", "pdf"))
    image = pytest.importorskip("PIL.Image")
    with image.open(tmp_path / "shot_1.png") as read:
        assert read.size == (1080, 679)
    drawn = (tmp_path / "shot_1.svg").read_text(encoding="utf-8")
    ET.fromstring(drawn)
    assert ">shot[1]<" in drawn  # text stays text
    assert (tmp_path / "shot_1.pdf").read_bytes().startswith(b"%PDF")
    write_report(tmp_path / "again", pairs[:1], COMMAND, ("png", "svg", "pdf"))
    for kind in ("png", "svg", "pdf"):
        assert (tmp_path / "again" / f"shot_1.{kind}").read_bytes() == (tmp_path / f"shot_1.{kind}").read_bytes()


@pytest.mark.needs("matplotlib")
def test_names_are_never_read_as_mathematics(tmp_path):
    curve = bubble(r"$x_{$ \frac <b> & [red]", group="$y_{$")
    pairs = [(curve, answer(curve, message="$a$")), (curve, unanswered("$a_{$"))]
    assert write_report(tmp_path, pairs, COMMAND, ("png", "svg")).notes == []


# --- the report ------------------------------------------------------------------------------------------------------


class Page(HTMLParser):
    """Collects ids, tags and text, and holds that tags close in order."""

    VOID = ("meta", "br", "img")

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.tags, self.attributes, self.text = [], [], set(), [], []
        self.feed(text)
        assert not self.open, f"left open: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes += attrs
        self.ids += [value for key, value in attrs if key == "id"]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def test_report_is_one_sound_file_that_asks_for_nothing(pairs, tmp_path):
    write_report(tmp_path, pairs, COMMAND)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert len(page.ids) == len(set(page.ids))
    assert not page.tags & {"script", "link", "iframe", "object", "img"}
    targets = [value for key, value in page.attributes if key in ("src", "href", "xlink:href")]
    assert all(target.startswith(("#", "data:")) for target in targets)
    assert {target[1:] for target in targets if target.startswith("#")} <= set(page.ids)
    assert "url(http" not in text
    assert "@import" not in text
    shown = " ".join(" ".join(page.text).split())
    for part in (COMMAND, "7.1 ± 1.4", "6.10", "0.0210", "does not fit", "cell 3 of 5 is empty", "no interval"):
        assert part in shown
    assert text.count("<svg") == 5  # the group's shots and answers, and the curves
    for curve in re.findall(r"<svg.*?</svg>", text, re.DOTALL):
        ET.fromstring(curve)


def test_report_escapes_everything_from_outside(tmp_path):
    evil = '"><script>alert(1)</script><img src=x onerror=y>&{0}'
    curve = bubble(evil, group=evil, source=evil, notes=(evil,))
    posterior = replace(
        answer(curve, verdict="model_does_not_fit", message=evil, material=evil), provenance={evil: evil}
    )
    posterior = replace(posterior, names=(*NAMES[1:], evil), units=("Pa s", "1"), theta=np.array([[-2.0, 1.0]]))
    write_report(tmp_path, [(curve, posterior), (empty(evil, evil, evil), unanswered(evil))], evil, date=evil)
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "script" not in page.tags
    assert "img" not in page.tags
    assert evil in "".join(page.text)
    assert not [key for key, _ in page.attributes if key.startswith("on")]


def test_report_states_intervals_only_where_they_are(tmp_path):
    curve = bubble()
    write_report(tmp_path, [(curve, answer(curve, draws=400))], COMMAND, ())
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "central 90 %" in text
    assert "none is shown" not in text


def test_write_report_names_files_safely_and_apart(tmp_path):
    names = ["../../etc/x[1]", "..", "a b", "A b", "report"]
    pairs = [(c := bubble(name), answer(c)) for name in names]
    written = write_report(tmp_path / "new" / "out", pairs, COMMAND, ("png",), date="2025-01-02")
    files = {path.name for path in (tmp_path / "new" / "out").iterdir()}
    assert files == {
        "result.json", "result.csv", "report.html", "etc_x_1.png", "curve.png", "a_b.png", "A_b-2.png", "report-2.png",
        "group-shots.png", ".cavirheo",
    }  # fmt: skip
    assert read_json(tmp_path / "new" / "out" / "result.json") == written
    assert list(tmp_path.iterdir()) == [tmp_path / "new"]


def test_long_names_of_any_script_become_files(tmp_path):
    names = ["漢" * 82, "漢" * 82 + "b", "é" * 120, "=" + "x" * 240]
    pairs = [(c := bubble(name), answer(c)) for name in names]
    write_report(tmp_path, pairs, COMMAND, ("png", "svg"))
    assert len(list(tmp_path.glob("*.png"))) == len(list(tmp_path.glob("*.svg"))) == len(names) + 1  # the group's
    assert [row.name for row in read_json(tmp_path / "result.json").curves] == names
    longest = tmp_path / ("漢" * 83 + ".csv")
    with document.whole(longest) as part:
        part.write_text("x")
    assert longest.read_text() == "x"


def largest(value, keys=()):
    """The content of a document with the largest numbers there are, below these keys alone."""
    if isinstance(value, dict):
        return {key: item if key == "schema" else largest(item, (*keys, key)) for key, item in value.items()}
    if isinstance(value, list):
        return [largest(item, keys) for item in value]
    return 1e308 if isinstance(value, float) and keys[-1] in ("q95", "std", "rmse_over_rmax", "max_radius_m") else value


def test_numbers_near_the_largest_are_shown(run, tmp_path):
    curve = bubble()
    write_report(tmp_path, [(curve, answer(curve, draws=400))] * 3, COMMAND, ())
    file = tmp_path / "result.json"
    file.write_text(json.dumps(largest(json.loads(file.read_text(encoding="utf-8")))), encoding="utf-8")
    status, out, err = run("show", file)
    assert (status, err) == (0, "")
    assert "e+308" in out


def test_no_cell_of_a_table_is_a_formula(tmp_path):
    names = ["=1+1", "+a", "-a", "@a", "＝1", "'=1", "'a", "-1.5", "a"]
    document.write_rows(tmp_path / "a.csv", ["shot", "=n"], [{"shot": name, "=n": -1.5} for name in names])
    with (tmp_path / "a.csv").open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert not any(cell.startswith(tuple("=+@＝")) for cell in (*head, *(row[0] for row in rows)))
    assert [row[0] for row in rows if row[0].startswith("-")] == ["-1.5"]
    assert {row[1] for row in rows} == {"-1.5"}
    assert list(read_column(tmp_path / "a.csv")[1]) == names


def test_without_matplotlib_the_report_is_complete_and_the_notes_say_what_is_left_out(pairs, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "available", lambda: False)
    assert write_report(tmp_path, pairs, COMMAND).notes == []
    assert "<svg" in (tmp_path / "report.html").read_text(encoding="utf-8")
    written = write_report(tmp_path, pairs, COMMAND, ("png",))
    assert {path.name for path in tmp_path.iterdir()} == {"result.json", "result.csv", "report.html", ".cavirheo"}
    assert 'pip install "cavirheo[plot]"' in written.notes[0]
    assert "cavirheo[plot]" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "cavirheo[plot]" in printed(written, 100)
    with pytest.raises(InputError) as refused:
        figure(*pairs[0])
    assert refused.value.code == "style.no_matplotlib"


def test_a_report_needs_no_matplotlib(tmp_path):
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); from test_reporting import answer, bubble; "
        "from cavirheo.reporting import write_report; curves = [bubble(), bubble('b', top=3e-4)]; "
        f"write_report({str(tmp_path)!r}, [(c, answer(c)) for c in curves], 'x'); print('matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_write_report_refuses_what_it_cannot_do(pairs, tmp_path):
    (tmp_path / "file").write_text("x")
    for folder, kinds, code in (
        (tmp_path, ("gif",), "reporting.figures"),
        (tmp_path / "file", (), "document.folder"),
    ):
        with pytest.raises(InputError) as refused:
            write_report(folder, pairs, COMMAND, kinds)
        assert refused.value.code == code


def test_a_run_without_curves_is_a_page_too(tmp_path):
    html.write(tmp_path / "r.html", result([], COMMAND))
    Page((tmp_path / "r.html").read_text(encoding="utf-8"))


def test_parts_of_the_page_stand_alone(pairs):
    """As the browser app shows them."""
    document = result(pairs, COMMAND)
    unit = document.modulus_unit
    parts = [
        html.groups_table(document.groups, *unit),
        html.curves_table(document.curves, *unit, title="A & B", linked=False),
        html.article(document.curves[0], *unit),
    ]
    page = Page("".join(parts))
    assert page.tags.isdisjoint({"a", "img", "figure"})
    assert not page.ids
    assert "A & B" in page.text


@pytest.mark.parametrize(
    ("module", "heavy"),
    [("cavirheo.reporting", ("matplotlib", "rich", "scipy", "numba")), ("cavirheo.verbs", ("numpy", "pydantic"))],
)
def test_importing_is_cheap(module, heavy):
    code = f"import sys, {module}; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.needs("matplotlib")
def test_a_picture_that_fails_costs_nothing_but_itself(pairs, tmp_path):
    (curve, posterior), *others = pairs
    broken = replace(posterior, checks=replace(posterior.checks, reconstruction_radius=np.ones(3)))  # of other length
    done: list[int] = []
    written = write_report(tmp_path, [(curve, broken), *others], COMMAND, ("png", "svg"), done=lambda: done.append(1))
    drawn = {path.name for path in tmp_path.iterdir() if path.suffix in (".png", ".svg")}
    assert drawn == {f"{stem}.{kind}" for stem in ("shot_2", "shot_3", "group-shots") for kind in ("png", "svg")}
    assert len(done) == 4
    assert all("ValueError" in note for note in written.notes)
    assert [note.split()[:3] for note in written.notes] == [[what, "of", "shot[1]"] for what in ("picture", "figure")]
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "ValueError" in "".join(page.text)
    assert read_json(tmp_path / "result.json") == written


def test_the_same_bytes_each_time(pairs, tmp_path):
    for folder in "ab":
        write_report(tmp_path / folder, pairs, COMMAND, date="2025-01-02")
    one, two = ({path.name: path.read_bytes() for path in (tmp_path / k).iterdir()} for k in "ab")
    assert one == two


@pytest.mark.parametrize(("counts", "most"), [((2, 11), 13_000), ((520, 530), 1_150)])
def test_the_page_stays_small(tmp_path, counts, most):
    """Bytes of each further curve: 11 curves are to be below 150 kB, 5,000 below 6 MB."""
    curve, sizes = bubble(), []
    one = answer(curve, draws=400)
    document = result([(curve, one)], COMMAND)
    row = document.curves[0]
    for n in counts:
        rows = [row.model_copy(update={"name": f"shot[{k}]"}) for k in range(n)]
        page = result_of(rows, COMMAND)
        points = min(svg.POINTS, reporting.PAGE_POINTS // max(n, 1)) if n < 500 else reporting.PAGE_POINTS // 5000
        picture = svg.curve_svg(lines_of(curve, one), points=points, brief=n > html.DETAILED)
        html.write(tmp_path / "report.html", page, [picture] * n)
        sizes.append((tmp_path / "report.html").stat().st_size)
    assert (sizes[1] - sizes[0]) / (counts[1] - counts[0]) < most
    assert sizes[0] < 150_000 or counts[0] > 11


def test_what_is_to_be_checked_stands_in_the_row_and_heads_the_article(pairs, tmp_path):
    (curve, posterior), *others = pairs
    doubt = "the radius may be a diameter"
    warning = messages(doubt, code="check_input.test")
    doubted = replace(posterior, checks=replace(posterior.checks, verdict="check_input", messages=warning))
    write_report(tmp_path, [(curve, doubted), *others], COMMAND, ())
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    Page(text)
    table, article = text.split("<h2>Curves</h2>")[1].split('<article id="curve-0">')
    assert table.index("check input") < table.index(doubt) < table.index("shot[2]")
    assert article.index(doubt) < article.index("shear modulus G")


def test_of_very_many_curves_each_has_row_message_and_picture_and_a_parquet_table_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr("cavirheo.reporting.MANY", 3)
    monkeypatch.setattr(html, "DETAILED", 3)
    curves = [bubble(f"shot[{k}]") for k in range(6)]
    verdicts = ["ok", "ok", "model_does_not_fit", "ok", "outside_training_range", "ok"]
    pairs = [
        (curve, answer(curve, draws=20, verdict=verdict, message=f"said of {curve.name}"))
        for curve, verdict in zip(curves, verdicts, strict=True)
    ]
    document = write_report(tmp_path, pairs, COMMAND)
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert [("class", "measured") in page.attributes, page.attributes.count(("class", "measured"))] == [True, 6]
    assert all(f"said of shot[{k}]" in page.text for k in range(6))
    assert "".join(page.text).count("neo-Hookean Kelvin-Voigt") < 6  # said once
    assert read_json(tmp_path / "result.json").notes == document.notes
    parquet = pytest.importorskip("pyarrow.parquet")
    found = parquet.read_table(tmp_path / "result.parquet")
    with (tmp_path / "result.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert found.column_names == list(rows[0])
    assert [str(value) for value in found.column("shear_modulus_Pa_q05").to_pylist()] == [
        row["shear_modulus_Pa_q05"] for row in rows
    ]
    write_report(tmp_path, pairs[:3], COMMAND, replace=True)  # no more than three: none of it is left
    assert not (tmp_path / "result.parquet").exists()


def test_answers_are_read_one_group_after_the_other(tmp_path):
    """No more than those of a group are in memory at once, and the documents are the same."""
    curves = [bubble(f"shot[{k}]", group=f"g{k // 2}", source=f"g{k // 2}.csv") for k in range(6)]
    held = [answer(curve, draws=40) for curve in curves]
    read = []

    class Lazy(list):
        def __getitem__(self, k):
            read.append(k)
            return super().__getitem__(k)

    lazy = write_report(tmp_path / "a", Answered(curves, Lazy(held)), COMMAND, (), date="d", draw=False)
    assert read == list(range(6))
    whole = write_report(tmp_path / "b", list(zip(curves, held, strict=True)), COMMAND, (), date="d", draw=False)
    assert lazy == whole


def test_without_pyarrow_very_many_curves_have_all_else(tmp_path, monkeypatch):
    monkeypatch.setattr("cavirheo.reporting.MANY", 1)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    document = write_report(tmp_path, [(bubble(), answer(bubble())), (bubble("shot[2]"), answer(bubble()))], COMMAND)
    assert any("cavirheo[cluster]" in note for note in document.notes)
    assert {path.name for path in tmp_path.glob("re*")} == {"result.json", "result.csv", "report.html"}


def test_a_slope_of_thousands_of_shots_needs_no_table_of_all_pairs():
    rng = np.random.default_rng(0)
    radius = 1e-4 * np.exp(rng.normal(0.0, 0.3, 5000))
    values = 0.05 * (radius / 1e-4) ** 0.7 * np.exp(rng.normal(0.0, 0.1, 5000))
    found = group.slope(radius.tolist(), values.tolist(), trusted=5000)
    assert found.n == found.n_trusted == 1000
    assert found.q05 < 0.7 < found.q95
    assert found.q95 - found.q05 < 0.1
    few = group.slope(radius[:900].tolist(), values[:900].tolist())
    assert few.n == 900
