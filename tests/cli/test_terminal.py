"""Tables lose nothing on a narrow terminal, no file can abuse a terminal, and `show` prints every document."""

import re
from dataclasses import replace

import numpy as np
import pytest
from answers import NAMES, answer, bubble, sweeps_of, times_of, with_verdict
from conftest import EXAMPLE, done, refusal, rows_of
from files import write_curve

from cavirheo import CommonErrors, loading, read_curves
from cavirheo.companions import collapse_times, rheometer
from cavirheo.reporting import result, screen, write_report
from cavirheo.reporting.record import PublishedValue
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import as_json, write_json

LONG = "gelatine_of_the_third_batch_at_37_degrees_{:02}"  # 45 letters
EVIL = "gel\x1b[31m\x1b]0;title\x07\u202e\x9b2J\udcff"


def answers(names, method="least_squares", verdict="ok", message=""):
    """(curve, its answer) with an interval, of each name."""
    theta = np.array([3.8, -1.55, 8.7]) + [0.03, 0.02, 0.4] * np.random.default_rng(0).standard_normal((200, 3))
    more = {"theta": theta, "method": method}
    more |= {"names": (*NAMES, "stretch"), "units": ("Pa", "Pa s", "1")}
    curves = [bubble(name, f"{name}_group", "a.csv") for name in names]
    return [(one, replace(answer(one, verdict=verdict, message=message), **more)) for one in curves]


def of_comparison(names):
    made = result(answers(names, "bdt"), "")
    values = {"shear_modulus": PublishedValue(mean=6.44e3, std=1.21e3), "viscosity": PublishedValue(mean=0.023)}
    made.add_published({group.name: {"IMR": values, "rheometer": values} for group in made.groups})
    return made


TABLES = {
    "infer": (lambda names: result(answers(names), ""), screen.print_result),
    "compare": (of_comparison, screen.print_all),
    "rheometer": (sweeps_of, rheometer.print_rheometry),
    "collapse-time": (times_of, collapse_times.print_table),
}


def one_group(count, **more):
    """A result of so many shots of one file, whose answers differ."""
    rng, pairs = np.random.default_rng(1), []
    for curve, made in answers([f"{LONG.format(1)}[{k}]" for k in range(1, count + 1)], **more):
        theta = made.theta + [0.02, 0.02, 0.1] * rng.standard_normal(3)
        pairs.append((curve.with_group(LONG.format(1), "a.csv"), replace(made, theta=theta)))
    return pairs


@pytest.mark.parametrize(("count", "most"), [(1, 10), (5, 14), (12, 21), (20, 21), (45, 29)])
def test_a_group_has_at_most_ten_lines_beside_its_shots(count, most, monkeypatch, capsys):
    """With the line of the report on stderr, one more. No line is broken in a word, or is too long."""
    monkeypatch.setenv("COLUMNS", "80")
    pairs = one_group(count)
    pairs[0] = pairs[0][0], with_verdict(pairs[0][1], "check_input")
    document = result(pairs, "")
    screen.print_result(document)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= most
    assert max(map(len, lines)) <= 80
    assert lines[-1].startswith("next")


def test_the_line_of_a_single_shot_has_the_errors_of_scale_rate_density_and_pressure():
    """ln G changes by 20 times that of the scale, so that 1 % of the scale gives it a deviation of 20 %."""
    ((curve, made),) = one_group(1)
    made = replace(made, diagnostics=replace(made.diagnostics, modulus_over_scale=20.0))
    made_with = (result([(curve, made)], "", errors=CommonErrors(scale, 0.0, 0.0, 0.0)) for scale in (0.0, 0.01))
    exact, usual = (one.groups[0].population.shear_modulus_Pa for one in made_with)
    assert (exact.q05, exact.q95) == pytest.approx(made.interval("G"))
    alone, common = np.abs(np.log([[one.q05, one.q95] for one in (exact, usual)]) - np.log(exact.median))
    assert common == pytest.approx(np.hypot(alone, 1.645 * 0.2), rel=1e-3)


def clean(text: str) -> bool:
    return not re.search("[\0-\x08\x0b-\x1f\x7f-\x9f\u202e\ud800-\udfff]", text)


@pytest.mark.parametrize("verb", TABLES)
def test_no_control_character_reaches_the_terminal(verb, monkeypatch, capsys):
    make, show = TABLES[verb]
    monkeypatch.setenv("NO_COLOR", "1")
    document = make([EVIL])
    document.notes.append(EVIL)
    for part in (*getattr(document, "groups", ()), *getattr(document, "curves", ())):  # as somebody else may write it
        part.name = EVIL
    show(document)
    terminal.say(f"error: {EVIL}\n{EVIL}")
    captured = capsys.readouterr()
    assert "gel" in captured.out
    assert [clean(text) for text in (captured.out, captured.err, as_json(document))] == [True] * 3
    assert captured.err.count("\n") == 1


def test_no_control_character_reaches_a_file(tmp_path, recwarn):
    pairs = [*answers([EVIL, "other"]), *answers([EVIL], verdict="failed", message=EVIL)]
    write_report(tmp_path, pairs, result(pairs, EVIL, notes=[EVIL]))
    paths = [path for path in tmp_path.iterdir() if path.suffix in (".json", ".csv", ".html")]
    assert len(paths) == 3
    assert [path.name for path in paths if not clean(path.read_text(encoding="utf-8"))] == []
    assert not recwarn.list
    assert rows_of(tmp_path / "result.csv")[0]["name"] == digits.printable(EVIL)


@pytest.mark.parametrize("verb", TABLES)
def test_show_prints_a_document_as_its_verb_did(verb, run, tmp_path, capsys):
    make, show = TABLES[verb]
    document = make(["gel"])
    document.command, document.date = f"cavirheo {verb} gel.csv", "2025-01-02 10:00 CET"
    write_json(tmp_path / "any.json", document)
    assert as_json(loading.load(tmp_path / "any.json")) == as_json(document)
    show(loading.load(tmp_path / "any.json"))
    printed = capsys.readouterr().out
    out = done(run("show", "any.json"))
    assert out.endswith(printed)
    head = out.removesuffix(printed)
    assert [part for part in (document.command, document.date, document.version) if part not in head] == []


def test_show_a_measurement(run, tmp_path):
    curve = read_curves(EXAMPLE)[0]
    write_curve(tmp_path / "shot.csv", curve)
    write_curve(tmp_path / "pixels.csv", curve.with_max_radius(2.7 * curve.max_radius))
    out = done(run("show", "shot.csv"))
    assert [part for part in ("shot", "267", "131 of 160", "1000") if part not in out] == []
    assert "check input: pixels: " in done(run("show", "pixels.csv"))


@pytest.mark.parametrize("name", ["nothing", "other.json", "empty"])
def test_show_refuses_in_one_line(run, tmp_path, name):
    (tmp_path / "empty").mkdir()
    (tmp_path / "other.json").write_text('{"a": 1}')
    refusal(run("show", name), *{"nothing": ["does not exist"], "empty": ["no measurement"]}.get(name, []))


def test_a_table_that_is_too_wide_for_the_terminal_loses_nothing(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "60")
    rows = [["gel 1", *["0.069 (0.056 to 0.090)"] * 4], ["gel 2", *["below 0.0096"] * 4]]
    terminal.print_table(["shot", "a", "b", "c", "d"], rows)
    printed = [line.split("  ") for line in capsys.readouterr().out.splitlines()]
    cells = [[cell.strip() for cell in line if cell.strip()] for line in printed]
    assert rows[0] in cells
    assert rows[1] in cells


def test_names_that_look_alike_when_shortened_show_where_they_differ():
    names = ["2E6_Ag_05_001_RofTdata_0", "2E6_Ag_05_002_RofTdata_0", "other[1]"]
    assert digits.short_names(names, digits.SHORT_NAME) == ["001", "002", "other[1]"]
