"""What is written: no file of the user's is replaced, no answer is lost, nothing is half-written."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from answers import fit, same, unanswered, with_evidence, written
from conftest import ANSWER, BDT, EXAMPLE, ROOT, code_of, contents, refusal, until
from files import write_curve

from cavirheo import Posterior, RadiusCurve, infer_many, load, read_curves
from cavirheo.inference.analysis import Analysis
from cavirheo.parallel import on_threads
from cavirheo.workflow import Store, analyse_all
from cavirheo.writing.document import LIST_FILE, LOCK_FILE, Claim, Outputs, locked_folder

VERBS = {  # what each writes first, and a call that is complete but for -o
    "result.csv": "infer shot.csv --model bdt-viscoelastic",
    "result.json": "fit shot.csv",
    "report.html": "which-law shot.csv",
    "shots.csv": "collapse-time shot.csv",
    "rheometer.json": f"rheometer {ROOT / 'examples' / 'soft_gel_strain_sweep.csv'}",
    "simulation.csv": "simulate --material newtonian(0.1) --rmax-um 100 --stretch 5 --duration-us 5",
}
CLAIM = Claim("cavirheo infer", {})
ONE = partial(on_threads, workers=1)


def stopped(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


@pytest.fixture
def inputs(tmp_path, monkeypatch):
    """shot.csv; nothing may be computed."""
    write_curve(tmp_path / "shot.csv", read_curves(EXAMPLE)[1])
    untried = "the outputs were not tried before"
    monkeypatch.setattr("cavirheo.physics.simulate.load_solver", lambda *_, **__: pytest.fail(untried))
    return tmp_path


def leaves_all(folder: Path, run, name: str, out: str, *named: str) -> None:
    """A verb ends with status 2 and one line that names these, and no file of the folder has changed."""
    before = contents(folder)
    refusal(run(*VERBS[name].split(), "-o", out), *named)
    assert contents(folder) == before


@pytest.mark.parametrize("name", VERBS)
def test_what_is_not_this_runs_is_not_replaced(run, inputs, name):
    """A file of the user's, a link, the answers of another run, and a folder that another run holds."""
    out = inputs / "out"
    out.mkdir()
    (out / name).write_text("measured with care")
    leaves_all(inputs, run, name, "out", f"out/{name}")
    (out / name).unlink()
    (out / name).symlink_to(inputs / "nowhere")
    leaves_all(inputs, run, name, "out", f"out/{name}")
    (out / name).unlink()
    with locked_folder(out):
        leaves_all(inputs, run, name, "out", "in use by another run")
    yesterday = Claim("cavirheo of yesterday", {"verb": "another"})
    Outputs(yesterday, out, name).write(name, Path.write_text, "answers")
    leaves_all(inputs, run, name, "out", "cavirheo of yesterday", "-o", "--replace")


@pytest.mark.parametrize("call", ["generate recipe.toml -n 2", "train recipe.toml d"])
def test_training_needs_a_folder_without_answers(run, inputs, call):
    Outputs(CLAIM, inputs / "out", "result.json").write("result.json", Path.write_text, "answers")
    before = contents(inputs)
    refusal(run(*call.split(), "-o", "out"), "out holds the answers of another run", "another folder")
    assert contents(inputs) == before


@pytest.mark.parametrize("out", ["/dev/full", "shot.csv/y", "a" * 300, "/proc/x", ""])
@pytest.mark.parametrize("name", VERBS)
def test_a_place_that_cannot_be_written_is_refused_at_once(run, inputs, name, out):
    leaves_all(inputs, run, name, out)


def test_a_run_knows_its_own_answers_again_and_leaves_those_of_others(run, tmp_path, monkeypatch):
    for name, curve in zip(("a.csv", "b.csv"), read_curves(EXAMPLE), strict=False):
        write_curve(tmp_path / name, curve)
    words = ["--model", "bdt-viscoelastic", "--no-pictures", "--quiet"]
    assert run("infer", "a.csv", *words)[0] == 0
    before = contents(tmp_path)
    for other in (["b.csv"], ["a.csv", "--density", 1050], ["a.csv", "b.csv"]):
        assert run("infer", *other, *words)[0] == 2
    with monkeypatch.context() as interrupted:
        interrupted.setattr(ANSWER, stopped)
        for more in ([], ["--seed", 1, "--replace"]):
            status, _, err = run("infer", "a.csv", *words[:-1], *more)
            assert (status, "earlier answers stay" in err) == (130, True)
    assert contents(tmp_path) == before
    assert run("infer", tmp_path / "a.csv", *words, "--all")[0] == 0
    assert run("infer", "b.csv", *words, "--replace")[0] == 0
    assert load(tmp_path / "cavirheo-result" / "result.json").curves[0].name == "b"


def test_what_is_read_is_not_replaced_even_if_it_is_ours(tmp_path):
    Outputs(CLAIM, tmp_path, "a.csv").write("a.csv", Path.write_text, "ours")
    assert code_of(Outputs, CLAIM, tmp_path, "a.csv", inputs=[tmp_path / "." / "a.csv"]) == "document.input"
    later = Outputs(Claim("another", {"verb": "another"}, replace=True), tmp_path, "a.csv", "b.csv")
    later.write("b.csv", Path.write_text, "b")
    assert (tmp_path / "a.csv").exists()
    later.finish()
    assert not (tmp_path / "a.csv").exists()


LINKS = [Path.symlink_to, Path.hardlink_to, lambda path, _: os.mkfifo(path)]


@pytest.mark.parametrize("link", LINKS, ids=["link", "hard link", "pipe"])
@pytest.mark.parametrize("name", [LIST_FILE, LOCK_FILE, ".part-result.json"])
def test_nothing_is_written_through_a_link_of_somebody_else(tmp_path, name, link):
    out, theirs = tmp_path / "out", tmp_path / "theirs"
    out.mkdir()
    theirs.write_text("measured with care")
    link(out / name, theirs)
    with locked_folder(out):
        Outputs(CLAIM, out, "result.json").write("result.json", Path.write_text, "answers")
    assert (out / "result.json").read_text() == "answers"
    assert theirs.read_text() == "measured with care"


def test_answers_are_kept_in_no_folder_of_somebody_else(tmp_path):
    (tmp_path / "theirs").mkdir()
    (tmp_path / "unfinished").symlink_to(tmp_path / "theirs")
    assert code_of(Store, tmp_path / "unfinished") == "document.folder"


@pytest.mark.parametrize("line", ["{", "[]", '{"kind": "r", "name": "../secret", "sha256": "%s"}', "\xff"])
def test_a_strange_list_does_no_harm(tmp_path, line):
    (tmp_path / "secret").write_text("x")
    (tmp_path / "out").mkdir()
    content = line.replace("%s", hashlib.sha256(b"x").hexdigest()) + '\n{"kind"'
    (tmp_path / "out" / LIST_FILE).write_text(content, encoding="utf-8")
    outputs = Outputs(CLAIM, tmp_path / "out", "r")
    outputs.write("r", Path.write_text, "new")
    outputs.finish()
    assert (tmp_path / "secret").read_text() == "x"
    Outputs(CLAIM, tmp_path / "out", "r")


def test_another_report_or_an_interruption_while_a_page_is_written_leaves_the_old_one(tmp_path, monkeypatch, solved):
    written(tmp_path, solved[:1], "first")
    before = contents(tmp_path)
    for pairs, command in ((solved[:1], "second"), (solved[1:], "first")):
        assert code_of(written, tmp_path, pairs, command) == "document.other_run"
    assert contents(tmp_path) == before
    monkeypatch.setattr("cavirheo.reporting.write_page", stopped)
    with pytest.raises(KeyboardInterrupt):
        written(tmp_path, solved[:1], "second", replace=True)
    after = contents(tmp_path)
    assert after["report.html"] == before["report.html"]
    assert "second" in after["result.json"].decode()
    assert set(after) == set(before)


@pytest.fixture(scope="module")
def solved() -> list[tuple[RadiusCurve, Posterior]]:
    return [(curve, fit(curve, window=1)) for curve in read_curves(EXAMPLE)[:2]]


@pytest.fixture
def answer(solved) -> Posterior:
    _, found = solved[1]
    more = {"nothing": None, "infinite": float("inf"), "pair": (1, 2.5), "list": [True, "µ"], 3: {"x": {}}}
    weights = np.linspace(-3, 0, len(found.theta))
    return with_evidence(replace(found, provenance=found.provenance | more, log_weight=weights), 1.25)


def test_a_kept_answer_comes_back_to_the_last_bit(tmp_path, answer):
    Store(tmp_path).put("a", answer)
    assert same(Store(tmp_path).get("a"), answer)
    content = (tmp_path / "a.npz").read_bytes()
    for cut in (b"", b"PK", content[: len(content) // 2], bytes(len(content))):
        (tmp_path / "a.npz").write_bytes(cut)
        assert Store(tmp_path).get("a") is None
    assert Store(tmp_path).get("nothing") is None


def test_an_interrupted_run_goes_on_where_it_was(tmp_path, answer, monkeypatch):
    curves, asked, most = read_curves(EXAMPLE), [], 2

    def of(_, curve, **__):
        if len(asked) == most:
            raise KeyboardInterrupt
        asked.append(curve.name[-2])
        return replace(answer, seconds=float(curve.name[-2]))

    def answers(curves, seed=0):
        store = Store(tmp_path / "unfinished")
        return store, analyse_all(curves, {"": Analysis(seed=seed)}, store, ONE)[""]

    monkeypatch.setattr(ANSWER, of)
    _, found = answers(curves)
    assert list(found) == [0, 1]
    most = 99
    store, found = answers(curves[::-1])  # in any order
    assert [one.seconds for one in found.values()] == [5.0, 4.0, 3.0, 2.0, 1.0]
    assert asked == ["1", "2", "5", "4", "3"]
    answers([curve.labelled(name=f"{curve.name} (2)", group="gel", source="elsewhere.csv") for curve in curves])
    assert len(asked) == 5  # the name of a curve is no part of it
    other, _ = answers(curves, seed=1)
    assert len(asked) == 10  # another setting
    third, _ = answers([replace(curves[0], radius=curves[0].radius * 1.001), curves[0].labelled(exposure_s=1e-7)])
    assert len(asked) == 12  # other curves
    (tmp_path / "unfinished" / "notes.txt").write_text("mine")
    before = len(contents(tmp_path))
    store.remove_used()
    assert len(contents(tmp_path)) == before - 5  # what the other runs kept is theirs
    other.remove_used()
    third.remove_used()
    assert contents(tmp_path) == {"unfinished/notes.txt": b"mine"}


def test_a_failed_answer_is_asked_for_again(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(ANSWER, lambda _, curve, **__: asked.append(curve.name) or unanswered("too little memory"))
    for _ in range(2):
        analyse_all(read_curves(EXAMPLE)[:1], {"": Analysis()}, Store(tmp_path), ONE)
    assert len(asked) == 2


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_writes_what_was_answered(tmp_path, number):
    curve = read_curves(EXAMPLE)[0]
    for k in range(40):
        write_curve(tmp_path / f"shot{k:02d}.csv", replace(curve, radius=curve.radius * (1 + 4e-3 * k)))
    words = [sys.executable, "-m", "cavirheo", "infer", *BDT, ".", "-o", "out"]
    how = {"cwd": tmp_path, "text": True, "stderr": subprocess.PIPE, "stdout": subprocess.PIPE}
    call = subprocess.Popen(words, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL), **how)
    out = tmp_path / "out"
    until(lambda: call.poll() is not None or len(list(out.glob("unfinished/[!.]*.npz"))) >= 2, 120.0)
    call.send_signal(number)
    before = time.perf_counter()
    _, err = call.communicate(timeout=60)
    assert call.returncode == 130, err
    assert time.perf_counter() - before < 5  # 1 s where nothing else runs
    assert "Traceback" not in err
    written = json.loads((out / "result.json").read_text())
    kept = len(list(out.glob("unfinished/[!.]*.npz")))
    assert 1 <= len(written["curves"]) <= kept + 1 < 40  # one may be interrupted while it is kept, or before it counts
    assert f"{len(written['curves'])} of 40" in written["notes"][0]
    assert {path.name for path in out.iterdir()} == {"result.json", "result.csv", LIST_FILE, "unfinished"}


TWICE = """
import contextlib, os, signal, time, cavirheo.reporting
from cavirheo.__main__ import entry
def interrupted(*_, **__):
    for _ in range(2):
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(9)
cavirheo.reporting.write_documents = interrupted
entry()
"""


def test_a_second_ctrl_c_while_documents_are_written_is_said(tmp_path):
    words = [sys.executable, "-c", TWICE, "infer", str(EXAMPLE), "--shots", "1", *BDT]
    called = subprocess.run(words, cwd=tmp_path, text=True, capture_output=True, timeout=60, check=False)
    assert (called.returncode, called.stderr) == (130, "interrupted\n")


def test_an_interrupted_run_says_nothing_of_a_report_that_it_does_not_write(run, monkeypatch):
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")
    monkeypatch.setattr("cavirheo.reporting.MAX_PICTURES", 1)
    found = iter([unanswered(), unanswered()])
    monkeypatch.setattr(ANSWER, lambda *_, **__: next(found, None) or stopped())
    assert run("infer", EXAMPLE, "-o", "out")[0] == 130
    (note,) = load("out").notes
    assert note.startswith("interrupted: 2 of 5 answered")


def test_ctrl_c_in_compiled_code_fails_no_curve(monkeypatch):
    def interrupted(*_, **__):
        raise SystemError("a result with an exception set") from KeyboardInterrupt()

    monkeypatch.setattr("cavirheo.inference.analysis.Experiment", interrupted)
    with pytest.raises(KeyboardInterrupt):
        infer_many(read_curves(EXAMPLE)[:1], workers=1)
