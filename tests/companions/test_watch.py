"""`cavirheo watch`: each recording of a folder is answered once, when its file is complete, whatever ends the run."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from answers import answer, unanswered
from conftest import ANSWER, BDT, EXAMPLE, refusal

from cavirheo import load

LINES = EXAMPLE.read_text(encoding="utf-8").splitlines(keepends=True)


def shots(*kept: int) -> str:
    """The example with these of its five shots."""
    return "".join(line for line in LINES if not line[:1].isdigit() or int(line[0]) in kept)


def write(folder: Path, *numbers: int) -> Path:
    """shot1.csv, ..., shot5.csv: recordings that differ from each other; the last one's path."""
    for k in numbers:
        (folder / f"shot{k}.csv").write_text(shots(k), encoding="utf-8")
    return folder / f"shot{numbers[-1]}.csv"


IN, OUT = Path("in"), Path("out")


@pytest.fixture
def bench(run, monkeypatch):
    """Watches the folder `in` with answers that take no time, does one thing after the other, each after so many looks
    at `rest`, and ends it. Returns name and verdict of each row, and what stood on stderr; `asked` names the curves
    that were answered."""
    IN.mkdir()
    asked: list[str] = []

    def known(_, curve, *given, **how):
        asked.append(curve.name)
        return unanswered(curve.unusable) if curve.unusable else answer(curve)

    def watch(*actions: Callable[[], object], rest=8, more=()) -> tuple[list[tuple[str, str]], str]:
        looks = iter([None] * rest + [step for action in actions for step in (action, *[None] * rest)])

        def pause(_: float) -> None:
            try:
                action = next(looks)
            except StopIteration:
                raise KeyboardInterrupt from None  # the usual end
            if action:
                action()

        with monkeypatch.context() as patched:
            patched.setattr("time.sleep", pause)
            _, _, err = run("watch", IN, "-o", OUT, *more)
        written = load(OUT).curves if (OUT / "result.json").exists() else []
        return [(row.name, row.verdict) for row in written], err

    monkeypatch.setattr(ANSWER, known)
    monkeypatch.setattr("cavirheo.physics.simulate.load_solver", lambda: None)
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")  # other processes would answer themselves
    watch.asked = asked
    return watch


def test_each_file_is_answered_once_also_after_a_restart_and_stays_when_it_is_moved(bench):
    write(IN, 1, 2)
    rows, _ = bench(lambda: (IN / "shot1.csv").rename("shot1.csv"), lambda: write(IN, 3))
    assert rows == [(name, "ok") for name in bench.asked]
    Path("shot1.csv").rename(IN / "shot1.csv")
    rows, _ = bench()
    assert rows == [(name, "ok") for name in bench.asked]
    assert bench.asked == ["shot1", "shot2", "shot3"]
    (group,) = load(OUT).groups
    assert group.n_counted == 3  # a folder of single shots is one material, as for infer
    report = (OUT / "report.html").read_text()
    assert all('<path class="measured"' in part for part in report.split("<article")[1:])
    assert report.count("<article") == 3
    bench(more=("--seed", 1, "--replace"))  # other settings are other answers
    assert bench.asked[3:] == ["shot1", "shot2", "shot3"]


def test_a_file_is_left_alone_while_it_grows_and_answered_when_it_is_whole(bench):
    growing, early = IN / "shot2.csv", []

    def grow(k: int) -> Callable[[], None]:
        return lambda: (growing.write_text(shots(2)[: 40 * k]), early.extend(bench.asked))

    last = [lambda: growing.write_text(LINES[0][:10]), *[lambda: None] * 8]
    rows, err = bench(*map(grow, range(1, 20)), *last, rest=0)
    assert (early, rows) == ([], [("shot2", "failed")])
    assert sum("shot2.csv" in line for line in err.splitlines()) == 1
    assert bench(lambda: write(IN, 2))[0] == [("shot2", "ok")]


def test_a_damaged_file_becomes_a_failed_row_and_is_mended_by_a_new_one(bench):
    (IN / "bad.mat").write_bytes(b"no MATLAB file" * 20)
    write(IN, 1)
    for _ in range(2):
        assert sorted(bench()[0]) == [("bad", "failed"), ("shot1", "ok")]
    assert sorted(bench.asked) == ["bad", "shot1"]  # not tried again as it is
    rows, _ = bench(lambda: shutil.copy(EXAMPLE.with_name("stiff_gel.mat"), IN / "bad.mat"))
    assert [verdict for _, verdict in rows] == ["ok"] * 6


def test_doubled_files_are_counted_once_and_named_and_shots_are_added_to_a_file(bench):
    first = write(IN, 1)
    rows, _ = bench(lambda: shutil.copy(first, IN / "again.csv"), lambda: os.utime(first))
    assert (rows, bench.asked) == ([("shot1", "ok")], ["shot1"])
    bench()
    assert "again.csv" in str(load(OUT).notes)  # and is remembered
    gel = IN / "gel.csv"
    rows, _ = bench(lambda: gel.write_text(shots(2, 3, 4)), lambda: gel.write_text(shots(2, 3, 4, 5)))
    assert len(bench.asked) == len(set(bench.asked)) == len(rows) == 5


def test_the_command_answers_as_infer_does(run, tmp_path):
    (tmp_path / "in").mkdir()
    refusal(run("watch", "in", "--once", "-o", "c", "--quiet"), "in holds no measurement")
    write(tmp_path / "in", 1, 2)
    how = (*BDT, "--no-pictures", "--quiet")
    assert run("infer", "in", "-o", "a", *how)[0] == run("watch", "in", "--once", "-o", "b", *how)[0] == 0
    one, other = (json.loads((tmp_path / name / "result.json").read_text()) for name in "ab")
    for document in (one, other):
        del document["command"], document["date"]
        for row in document["curves"]:
            del row["seconds"]
    assert one == other
    (tmp_path / "in" / "bad.csv").write_text("nothing\n")
    assert run("watch", "in", "--once", "-o", "b", *how)[0] == 2
    assert run("watch", "nowhere", *how)[0] == 2
