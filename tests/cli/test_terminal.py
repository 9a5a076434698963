"""Tables lose nothing on a narrow terminal, no file can abuse a terminal, and `show` prints every document."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from answers import NAMES, answer, bubble, document_of, with_verdict, written
from conftest import ANSWER, BDT, EXAMPLE, ROOT, done, refusal, rows_of
from files import write_curve

from cavirheo import CommonErrors, load, read_curves
from cavirheo.messages import Message

LONG = "gelatine_of_the_third_batch_at_37_degrees"  # 41 letters
EVIL = "gel\x1b[31m\x1b]0;title\x07\u202e\x9b2J\udcff"
COMMANDS = {  # of each kind of document
    "infer": f"infer {EXAMPLE} {' '.join(BDT)} --no-pictures",
    "compare": "compare infer --references published.csv",
    "rheometer": f"rheometer {' '.join(map(str, sorted(EXAMPLE.parent.glob('soft_gel_*_sweep.csv'))))}",
    "collapse-time": "collapse-time soft_gel_times.csv",
}


def answers(names, verdict="ok", message=""):
    """(curve, its answer) with an interval, of each name."""
    theta = np.array([3.8, -1.55, 8.7]) + [0.03, 0.02, 0.4] * np.random.default_rng(0).standard_normal((200, 3))
    more = {"theta": theta, "method": "least_squares", "names": (*NAMES, "stretch"), "units": ("Pa", "Pa s", "1")}
    curves = [bubble(name, f"{name}_group", "a.csv") for name in names]
    return [(one, replace(answer(one, verdict=verdict, message=message), **more)) for one in curves]


def result_of(verb: str, run) -> str:
    """What the command prints that writes into a folder of its name."""
    shutil.copy(ROOT / "tests" / "cases" / "times.csv", "soft_gel_times.csv")
    rows = ("G_kPa,6.44,1.21", "mu_Pa_s,0.023,")
    Path("published.csv").write_text("\n".join(["set,method,quantity,mean,std", *(f"gel,IMR,{row}" for row in rows)]))
    if verb == "compare":
        result_of("infer", run)
    status, out, err = run(*COMMANDS[verb].split(), "-o", verb)
    assert status in (0, 1), err
    return out


@pytest.mark.parametrize(("count", "most"), [(1, 10), (5, 14), (20, 21), (45, 29)])
def test_a_group_has_at_most_ten_lines_beside_its_shots(count, most, run, monkeypatch):
    """With the line of the report on stderr, one more. No line is broken in a word, or is too long."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")  # other processes would answer themselves
    rng, asked = np.random.default_rng(1), []

    def known(_, curve, *given, **how):
        asked.append(curve)
        ((_, made),) = answers([curve.name])
        made = replace(made, theta=made.theta + [0.02, 0.02, 0.1] * rng.standard_normal(3))
        return with_verdict(made, "check_input") if len(asked) == 1 else made

    monkeypatch.setattr(ANSWER, known)
    Path(LONG).mkdir()
    for k in range(count):
        write_curve(Path(LONG, f"{LONG}_{k:02}.csv"), bubble(top=2e-4 + 1e-6 * k))
    status, out, _ = run("infer", LONG, "--no-pictures", "-o", "r")
    lines = out.splitlines()
    assert (status, len(asked)) == (1, count)
    assert len(lines) <= most
    assert max(map(len, lines)) <= 80
    assert lines[-1].startswith("next")


def test_the_line_of_a_single_shot_has_the_errors_of_scale_rate_density_and_pressure():
    """ln G changes by 20 times that of the scale, so that 1 % of the scale gives it a deviation of 20 %."""
    ((curve, made),) = answers([LONG])
    made = replace(made, diagnostics=replace(made.diagnostics, modulus_over_scale=20.0))
    both = (document_of([(curve, made)], errors=CommonErrors(scale, 0.0, 0.0, 0.0)) for scale in (0.0, 0.01))
    exact, usual = (one.groups[0].population.shear_modulus_Pa for one in both)
    assert (exact.q05, exact.q95) == pytest.approx(made.interval("G"))
    alone, common = np.abs(np.log([[one.q05, one.q95] for one in (exact, usual)]) - np.log(exact.median))
    assert common == pytest.approx(np.hypot(alone, 1.645 * 0.2), rel=1e-3)


def clean(text: str) -> bool:
    return not re.search("[\0-\x08\x0b-\x1f\x7f-\x9f\u202e\ud800-\udfff]", text)


@pytest.mark.parametrize("verb", COMMANDS)
def test_show_prints_a_document_as_its_verb_did_whole_on_any_terminal_and_clean(verb, run, monkeypatch):
    printed = result_of(verb, run)
    (path,) = Path(verb).glob("*.json")
    document = load(path)
    out = done(run("show", verb))
    assert out.endswith(printed)
    head = out.removesuffix(printed)
    assert [part for part in (document.command, document.date, document.version) if part not in head] == []
    monkeypatch.setenv("COLUMNS", "60")
    assert {*re.findall(r"\w*\d[\w.]*", out)} <= {*re.findall(r"\w*\d[\w.]*", done(run("show", verb)))}
    refusal(run("fit", path, "-o", "x"), f"`cavirheo show {path}`")
    evil = path.read_text("utf-8").replace("gel", json.dumps(EVIL[:-1])[1:-1])  # as somebody else may write it
    path.write_text(evil, "utf-8")
    out = done(run("show", path))
    assert (clean(out), "gel" in out) == (True, True)


def test_no_control_character_of_a_name_reaches_the_terminal_or_a_file(run, recwarn):
    assert clean(refusal(run("show", EVIL), "gel"))
    pairs = [*answers([EVIL, "other"]), *answers([EVIL], verdict="failed", message=EVIL)]
    written("r", pairs, EVIL, notes=[EVIL])
    paths = [path for path in Path("r").iterdir() if path.suffix in (".json", ".csv", ".html")]
    assert len(paths) == 3
    assert [path.name for path in paths if not clean(path.read_text(encoding="utf-8"))] == []
    assert not recwarn.list
    assert rows_of("r/result.csv")[0]["name"].startswith("gel")


def test_show_a_measurement(run, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    curve = read_curves(EXAMPLE)[0]
    write_curve(tmp_path / "shot.csv", curve)
    write_curve(tmp_path / "pixels.csv", curve.with_max_radius(2.7 * curve.max_radius))
    out = done(run("show", "shot.csv"))
    assert [part for part in ("shot", "267", "131 of 160", "1000", " 4\n") if part not in out] == []
    assert "check input: pixels: " in done(run("show", "pixels.csv"))


def test_names_that_look_alike_when_shortened_show_where_they_differ(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    names = [f"2E6_Ag_05_of_the_third_batch_at_37_degrees_{k:03}_RofTdata_0" for k in (1, 2)]
    pairs = answers(names, "check_input")
    written("r", [(curve.with_group("gel", "a.csv"), made) for curve, made in pairs], draw=False)
    first, second = (line for line in done(run("show", "r")).splitlines() if line.endswith("check input: test"))
    assert ("001" in first, "002" in second, len(second) <= 80) == (True, True, True)


def test_two_shots_need_more_of_their_material_and_shots_alone_have_the_lines_of_their_answers(run):
    pairs = answers(["a", "b"])
    written("alone", pairs, draw=False)
    written("two", [(curve.with_group("gel", "a.csv"), made) for curve, made in pairs], draw=False)
    assert "\nuse   G and µ with interval\nnext " in done(run("show", "alone"))
    written("doubt", [*answers(["c"], "bound"), *answers(["d"], "check_input")], draw=False)
    assert "\nnext  the same command with " in done(run("show", "doubt"))
    doubt = Message("check_input.density", {"density": 998.0, "rate": 4.93e5, "usual": 5e5, "meant": 1026.5})
    written("dense", [(bubble(), with_verdict(pairs[0][1], "check_input", doubt))], draw=False)
    assert "\nnext  the same command with --density " in done(run("show", "dense"))
    assert "\nnext  more shots of this material in the same command " in done(run("show", "two"))
