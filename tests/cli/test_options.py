"""Odd calls of the command line are refused in one line at status 2; options that all verbs read alike."""

import json
import re
import sys
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from answers import answer
from conftest import ANSWER, BDT, EXAMPLE, FIELD, REAL, ROOT, refusal
from recordings import write_mraw

from cavirheo import Bubble
from cavirheo.verbs import app

COMMANDS = typer.main.get_command(app).commands
GOOD = {  # a call that would compute, without the option that is tried
    "measure": "film.mraw",
    "infer": "shot.csv", "fit": "shot.csv", "which-law": "shot.csv", "compare": "result.json --references refs.csv",
    "collapse-time": "times.csv", "rheometer": "sweep.csv", "generate": "recipe.toml -o d",
    "simulate": "-o o --rmax-um 100 --stretch 5 --material nhkv(1e3,0.1)",
    "train": "recipe.toml d -o r", "app": "", "models": "", "laws": "", "show": "shot.csv",
    "cite": "result.json", "watch": ". --once -o w", "design": "-o e",
}  # fmt: skip
FREE = {"--out", "--host", "--device"}  # options that take any text
NUMBERS = ["nan", "inf", "-1", "-inf", "1e400", "", "word", "\x1b[31mred", "ü 漢 \u202e", "a\0b", "9" * 5000]
WORDS = ["word", "nan", "\x1b]0;title\x07", "漢" * 30, "-1"]


def odd_values() -> list[tuple[str, str, str]]:
    """(verb, option, value): one for every option that takes a value, in turn."""
    found, turn = [], count()
    for verb, command in COMMANDS.items():
        context = command.make_context(verb, [], resilient_parsing=True)
        for option in command.params:
            if option.param_type_name == "option" and not option.is_flag and option.opts[-1] not in FREE:
                number = re.search("float|int|NUMBER|FLOAT", option.get_help_record(context)[0])
                values = NUMBERS if number else WORDS
                found.append((verb, option.opts[-1], values[next(turn) % len(values)]))
    return found


ODD = """ a call | what its refusal must name
nothing
infer
infer shot.csv --windo 3
infer nowhere.csv
which-law shot.csv --bubble real,field | '--bubble': 'real,field' is not one of
design --noise-percent 60 | up to 49, got '60'
fit shot.csv --window-us -5 | '--window-us': the value must be a number above 0, got '-5'
infer missing.csv --rmax-um -5 | got '-5'
fit shot.csv --free clock
fit shot.csv --free none,t0 | got ('none', 't0')
infer shot.csv --surface-tension 0,07 | use a decimal point
infer shot.csv --scale-error 1 --scale-error=50 | from 0 to 20, got '50'
design --rmax-um 400 50 | got 400 to 50 um
simulate -o o --rmax-um 90 --stretch 1 --material newtonian(1) --pulse 100 -1 1 | MHz of --pulse must be above 0, got -1
simulate -o o --rmax-um 1e6 --stretch 5 --material newtonian(1) | from 0.01 to 50000, got '1e6'
compare . --references refs.csv
show nothing | does not exist
show other.json
show empty | no measurement in this folder
generate nowhere.toml -o d
generate recipe.toml -n 2 -o d --scheduler http://a:1
generate recipe.toml -n 2 -o d --scheduler tcp://a:1 --slurm 2
infer shot.csv --model nobody.onnx
infer shot.csv --model bdt-viscoelastic --exact-law | do not depend on --exact-law
infer shot.csv -o | see cavirheo infer --help
measure film.mraw
measure film.mraw --roi 0,0,99,99
which-law missing.csv --laws nhkv,foo | foo
which-law shot.csv --laws nhkv | nhkv
simulate -o o --rmax-um 90 --stretch 5 --material nhkv(2e3) | viscosity
simulate -o o --rmax-um 90 --stretch 5 --material gent | gent(shear_modulus [Pa], limit [-])
simulate -o o --rmax-um 90 --stretch 5 | --material
simulate -o o --rmax-um 90 --stretch 5 --material newtonian(1) --fps 1e15 | frames
simulate -o o --rmax-um 90 --stretch 5 --material newtonian(1) --polytropic 1 --contents kinetic | --polytropic
simulate -o o --rmax-um 90 --stretch 5 --material newtonian(1) --polytropic 0.5 | must be from 1 to 10
simulate -o o --rmax-um 90 --stretch 5 --material newtonian(1) --accommodation 0.1 | --contents kinetic
""".splitlines()[1:]


@pytest.fixture
def lab(run, tmp_path, monkeypatch):
    """`run` in a folder with a file of each kind, and where nothing is computed: a test that wants to fails."""
    monkeypatch.setattr("cavirheo.physics.simulate.load_solver", lambda *_: None)
    for name in ("physics.simulate.simulate_many", "inference.analysis.Analysis.answer"):
        monkeypatch.setattr(f"cavirheo.{name}", lambda *_, **__: pytest.fail("it computes"))
    (tmp_path / "empty").mkdir()
    (tmp_path / "other.json").write_text('{"a": 1}')
    lines = EXAMPLE.read_text(encoding="utf-8").splitlines()
    (tmp_path / "shot.csv").write_text("\n".join(line for line in lines if line[:1] in "#s1") + "\n")
    write_mraw(tmp_path / "film.mraw", np.zeros((3, 16, 16)), 8)
    (tmp_path / "refs.csv").write_text("set,method,quantity,mean\nshot.csv,IMR,G_Pa,1000\n")
    (tmp_path / "recipe.toml").write_text((ROOT / "recipes" / "laptop.toml").read_text())
    (tmp_path / "times.csv").write_text((ROOT / "tests" / "cases" / "times.csv").read_text())
    sweep = "strain (%),G' (Pa),G'' (Pa)\n0.1,100,10\n0.3,100,10\n1,100,10\n3,99,10\n10,80,10\n100,20,30\n"
    (tmp_path / "sweep.csv").write_text(sweep)
    return run


def refused_cleanly(called: tuple[int, str, str], named: str = "") -> None:
    """At status 2, with one short line without control characters."""
    err = refusal(called, named)
    assert called[1] == ""
    assert err.startswith("error: ")
    assert len(err) < 500
    assert not re.search(r"[\0-\x08\x0b-\x1f\x7f-\x9f\u202e]", err)


@pytest.mark.parametrize(("verb", "option", "value"), odd_values())
def test_an_odd_value_is_refused_in_one_line(lab, verb, option, value):
    nargs = next(o.nargs for o in COMMANDS[verb].params if option in o.opts)
    refused_cleanly(lab(verb, *GOOD[verb].split(), option, *[value] * nargs))


@pytest.mark.parametrize("call", ODD)
def test_an_odd_call_is_refused_in_one_line_and_leaves_nothing(lab, tmp_path, call):
    words, _, named = call.partition(" | ")
    before = sorted(tmp_path.rglob("*"))
    refused_cleanly(lab(*words.split()), named)
    assert sorted(tmp_path.rglob("*")) == before


NEEDED = [
    ("cavirheo[app]", "gradio", "app --no-browser"),
    ("cavirheo[video]", "av", f"measure {EXAMPLE.with_name('bubble.mp4')} --fps 5e5"),
    ("cavirheo[cluster]", "distributed", "generate recipe.toml -n 2 -o d --scheduler tcp://127.0.0.1:1"),
    ("cavirheo[train]", "torch", "train recipe.toml d -o r"),
]


@pytest.mark.parametrize(("named", "library", "call"), NEEDED)
def test_without_an_extra_a_command_says_what_to_install(lab, monkeypatch, named, library, call):
    monkeypatch.setitem(sys.modules, library, None)
    for loaded in ("app.server", "training.train", "training.networks"):
        monkeypatch.delitem(sys.modules, f"cavirheo.{loaded}", raising=False)
        monkeypatch.delattr(f"cavirheo.{loaded}", raising=False)
    status, out, said = lab(*call.split())
    refused_cleanly((status, out, said.removeprefix("cavirheo app: starting, a few seconds ...\n")), named)


# --- options that every verb reads alike ------------------------------------------------------------------------------


def test_quiet_says_errors_alone(lab):
    words = ("collapse-time", "times.csv")
    assert lab(*words, "--quiet", "-o", "q") == (0, "", "")
    assert Path("q", "collapse-time.json").exists()
    refused_cleanly(lab(*words, "nowhere.csv", "--quiet", "-o", "t"), "nowhere.csv")


def test_what_is_asked_reaches_the_answers_and_without_pictures_none_are_drawn(run, lab_answers, monkeypatch):
    monkeypatch.setattr("cavirheo.reporting.pictures.picture", lambda *_, **__: pytest.fail("it draws"))
    words = ("infer", "shot.csv", *BDT, "--no-pictures", "--replace", "-o", "r")
    more = ("--seed", 7, "--trust-input", "--group", "folder", "--medium", "zhu2025", "--stretch", 9, "--window", 1)
    for given in ((), (*more, "--density", 1040, "--rmax-um", 200)):
        assert run(*words, *given)[0] == 0
    assert run("fit", "shot.csv", "--free", "t0", "--no-pictures", "-o", "f")[0] == 0
    plain, asked, fitted = lab_answers
    assert (fitted.method, fitted.free) == ("fit", ("t0",))
    assert (plain.seed, plain.trust_input, plain.medium.density, plain.window) == (0, False, 998.0, None)
    assert (asked.seed, asked.trust_input, asked.medium.density, asked.window) == (7, True, 1040.0, 1)
    assert (asked.medium.name.partition(",")[0], asked.stretch) == ("zhu2025", 9)
    assert {path.name for path in Path("r").glob("[!.]*")} == {"result.json", "result.csv", "report.html"}
    document = json.loads(Path("r", "result.json").read_text())
    assert document["groups"][0]["name"] == Path.cwd().name
    assert document["curves"][0]["max_radius_m"] == pytest.approx(200e-6)
    assert "R_max set to 200 um" in str(document["curves"][0]["notes"])


BUBBLES = {  # options, and the bubble that they ask for
    "": REAL,
    "--bubble field": FIELD,
    "--accommodation 0.1": replace(REAL, accommodation=0.1),
    "--confinement-damping 0": replace(REAL, confinement_damping=0.0),
    "--contents equilibrium": Bubble(confinement_inertia="free", confinement_damping="free"),
    "--bubble field --confinement-inertia free": Bubble(confinement_inertia="free"),
    "--wall-distance-um 900": replace(REAL, wall_distance=9e-4, confinement_inertia=0.0),
    "--vapour-excess 2000 --damage strain": replace(REAL, vapour_excess=2e3, damage="strain"),
}
ASKED = [*(("infer", words, bubble) for words, bubble in BUBBLES.items()), ("which-law", "--bubble field", FIELD)]
ASKED += [("which-law", "--damage strain", replace(REAL, damage="strain"))]  # its usual laws without a spring stay away


@pytest.mark.parametrize(("verb", "words", "asked"), ASKED)
def test_the_options_of_the_bubble_are_a_bubble(lab, monkeypatch, verb, words, asked):
    calls = []

    def stop(analysis, *_, **__):
        calls.append(analysis.bubble)
        raise KeyboardInterrupt

    monkeypatch.setattr("cavirheo.inference.analysis.Analysis.answer", stop)
    assert lab(verb, "shot.csv", *words.split(), "--no-pictures", "-o", "r")[0] == 130
    assert calls[0] == asked


@pytest.fixture
def lab_answers(lab, monkeypatch) -> list[Any]:
    """Known answers instead of inference; returns what was asked."""
    calls = []

    def answered(analysis, curve, *_, **__):
        calls.append(analysis)
        return answer(curve)

    monkeypatch.setattr(ANSWER, answered)
    return calls
