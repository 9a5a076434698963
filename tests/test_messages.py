"""Messages of an answer: programs read codes, people read sentences, and both survive what keeps and sends them."""

from __future__ import annotations

import json
import threading
from dataclasses import replace

import numpy as np
import pytest
from conftest import messages
from test_reporting import COMMAND, answer, bubble, printed
from threadpoolctl import threadpool_info

from cavirheo import InputError, infer, infer_many, load, parallel
from cavirheo.inference.input_checks import warned
from cavirheo.inference.network_answer import Networked
from cavirheo.messages import Message, of_error
from cavirheo.posterior import Checks, Posterior
from cavirheo.reporting import result
from cavirheo.workflow.store import keep, read_kept
from cavirheo.writing.document import write_json

RMS = [Message("misfit.rms", {"rms": rms, "limit": 0.03}) for rms in (0.04, 0.05)]
WARNING = Message("check_input.late_start", {"frames": 3.2})


def with_messages(*given):
    curve = bubble()
    made = answer(curve, verdict="model_does_not_fit")
    return curve, Posterior(**{**vars(made), "checks": Checks("model_does_not_fit", given)})


def test_an_input_warning_decides_the_verdict_and_comes_first():
    checks = warned(Checks("ok", (RMS[0],)), [WARNING], trust_input=False)
    assert (checks.verdict, checks.messages, checks.warnings) == ("check_input", (WARNING, RMS[0]), (WARNING,))
    assert warned(Checks("ok", (RMS[0],)), [WARNING], trust_input=True).verdict == "ok"
    assert "3.2 frames after R_max" in checks.message


def test_a_kept_answer_has_its_messages(tmp_path):
    _, made = with_messages(WARNING, *RMS)
    keep(tmp_path / "one.npz", made)
    assert read_kept(tmp_path / "one.npz", Posterior).checks.messages == made.checks.messages


def test_the_document_has_code_and_text_of_each(tmp_path):
    curve, made = with_messages(WARNING, RMS[0])
    write_json(tmp_path / "result.json", result([(curve, made)], COMMAND))
    (row,) = json.loads((tmp_path / "result.json").read_text())["curves"]
    assert row["messages"] == [{"code": one.code, "text": one.text} for one in (WARNING, RMS[0])]
    (again,) = load(tmp_path / "result.json").curves
    assert [one.code for one in again.messages] == ["check_input.late_start", "misfit.rms"]


def test_messages_of_one_code_are_one_line_under_the_table():
    """Whatever their values; where all say the same, the whole sentence."""
    pairs = [with_messages(one) for one in (*RMS, *RMS)]
    said = printed(result(pairs, COMMAND), 200)
    assert "4 of 4 curves: the simulation misses the measurement\n" in said
    alike = printed(result([with_messages(RMS[0]) for _ in range(4)], COMMAND), 200)
    assert "by 4 % of R_max RMS" in alike


def test_why_a_curve_has_no_answer_is_the_code_of_the_error_and_the_log_has_its_traceback(caplog):
    curve = bubble()
    with caplog.at_level("DEBUG", "cavirheo"):
        failed = infer(type(curve)(curve.time, np.full(len(curve.time), np.nan)))
    assert [one.code for one in failed.checks.messages] == ["curve.few_frames"]
    assert any(one.exc_info and one.exc_info[0] is InputError for one in caplog.records)
    error = InputError("no file", "reading.missing", "a.csv")
    assert (str(error.within("folder")), of_error(error).text) == ("folder: a.csv: no file", "no file")


def test_a_message_without_a_sentence_here_brings_its_own():
    (mine,) = messages("a sentence of mine", code="mine.first")
    assert (mine.text, mine.input_warning) == ("a sentence of mine", False)


def blas_threads():
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


@pytest.mark.parametrize("workers", [1, 2])
def test_blas_has_one_thread_while_others_work_and_its_own_again_after_the_last(workers):
    before, inside, began, go = blas_threads(), [], threading.Event(), threading.Event()

    def nested(_):
        inside.append(blas_threads())
        parallel.each(abs, range(3), workers)
        inside.append(blas_threads())

    def waits(_):
        began.set()
        go.wait(60)

    other = threading.Thread(target=lambda: parallel.each(waits, range(2), workers))
    other.start()
    began.wait(60)
    parallel.each(nested, range(3), workers)
    assert inside == [{1}] * 6
    assert blas_threads() == {1}  # the other goes on
    go.set()
    other.join()
    assert blas_threads() == before


def test_a_defect_costs_the_answer_of_its_curve_alone(monkeypatch, caplog):
    """Also what no error of ours is: a row without an answer that names it, and its traceback in the log."""
    good, bad = bubble(), replace(bubble(), meta={"name": "bad"})

    def broken(self, curve):
        if curve.name == "bad":
            raise RuntimeError("the network could not be run")
        return one(self, curve)

    one = Networked.infer
    monkeypatch.setattr(Networked, "infer", broken)
    answers = infer_many([bad, good], verify="none")
    assert [answer.checks.verdict == "failed" for answer in answers] == [True, False]
    assert "RuntimeError: the network could not be run" in answers[0].checks.message
    assert any(one.exc_info and one.exc_info[0] is RuntimeError for one in caplog.records)
