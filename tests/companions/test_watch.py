"""`cavirheo watch`: each recording of a folder is answered once, when its file is complete, whatever ends the run."""

import json
import os
import re
import shutil
import time
from dataclasses import replace
from pathlib import Path

import pytest
from answers import KnownAnalysis, answer, unanswered
from conftest import BDT, EXAMPLE
from recordings import SCALE, film, write_mraw

from cavirheo import RadiusCurve, read_curves, watch
from cavirheo.io import write_csv
from cavirheo.io.shots import read_shots
from cavirheo.parallel import Threads
from cavirheo.reporting import read_json
from cavirheo.reporting.html import LIVE
from cavirheo.reporting.record import Result
from cavirheo.watch import Watch


@pytest.fixture(scope="module")
def curve() -> RadiusCurve:
    return read_curves(EXAMPLE)[0]


def write(folder: Path, curve: RadiusCurve, *numbers: int) -> None:
    """shot07.csv, ...: recordings that differ from each other."""
    for k in numbers:
        write_csv(folder / f"shot{k:03d}.csv", replace(curve, radius=curve.radius * (1 + 1e-4 * k)))


class Bench:
    """A folder that is watched with answers that take no time; `asked` names the curves that were answered."""

    def __init__(self, place: Path, **how: object) -> None:
        self.folder, self.out, self.how = place / "in", place / "out", how
        self.folder.mkdir(parents=True, exist_ok=True)
        self.seed = 0
        self.asked: list[str] = []
        self.said: list[str] = []
        self.start()

    def start(self) -> None:
        analysis = KnownAnalysis(of=self.answer, seed=self.seed)
        read = lambda path: read_shots([path], um_per_px=SCALE)  # noqa: E731
        self.watch = Watch(self.folder, self.out, analysis, read, say=self.said.append, **self.how)

    def answer(self, one):
        self.asked.append(one.name)
        return unanswered(one.unusable) if one.unusable else answer(one)

    def settle(self) -> None:
        """Until nothing is left to be answered."""
        while self.watch.once() or self.watch.pause():
            pass

    @property
    def result(self) -> Result:
        return read_json(self.out / "result.json")

    @property
    def rows(self) -> list[tuple[str, str]]:
        return [(row.name, row.verdict) for row in self.result.curves]


@pytest.fixture
def bench(tmp_path, monkeypatch) -> Bench:
    monkeypatch.setattr(watch, "LOOK", 0.02)
    return Bench(tmp_path, patience=0.2)


def test_each_file_is_answered_once_also_after_a_restart_and_stays_when_it_is_moved(bench, curve):
    for new in ((1, 2), (3,)):
        write(bench.folder, curve, *new)
        bench.settle()
    (bench.folder / "shot001.csv").unlink()
    bench.start()
    bench.settle()
    assert bench.asked == ["shot001", "shot002", "shot003"]
    assert bench.rows == [(name, "ok") for name in bench.asked]
    (group,) = bench.result.groups
    assert group.n_trusted == 3  # a folder of single shots is one material, as for infer
    page = (bench.out / LIVE).read_text()
    assert "<h1>shot003</h1>" in page
    assert not re.search("https?://|<script", page)
    bench.seed = 1  # other settings are other answers
    bench.start()
    bench.settle()
    assert bench.asked[3:] == ["shot001", "shot002", "shot003"]


def test_a_file_that_still_grows_is_left_alone(bench, curve):
    write(bench.folder, curve, 1)
    whole = (bench.folder / "shot001.csv").read_text()
    growing = bench.folder / "shot002.csv"
    for k in range(1, 20):
        growing.write_text(whole[: 40 * k])
        bench.watch.once()
        time.sleep(0.01)
    assert set(bench.asked) <= {"shot001"}


def test_half_a_file_is_said_once_and_answered_when_it_is_whole(bench, curve):
    write(bench.folder, curve, 1)
    path = bench.folder / "shot001.csv"
    whole = path.read_bytes()
    path.write_bytes(whole[:10])
    for _ in range(4):
        bench.watch.once()
        bench.watch.pause()
    assert bench.asked == []
    assert sum("shot001.csv" in line for line in bench.said) == 1
    path.write_bytes(whole)
    bench.settle()
    assert bench.rows == [("shot001", "ok")]


def test_a_damaged_file_becomes_a_failed_row_and_is_mended_by_a_new_one(bench, curve):
    (bench.folder / "bad.mat").write_bytes(b"no MATLAB file" * 20)
    write(bench.folder, curve, 1)
    bench.settle()
    assert sorted(bench.rows) == [("bad", "failed"), ("shot001", "ok")]
    assert bench.watch.unreadable == 1
    bench.start()
    bench.settle()
    assert sorted(bench.asked) == ["bad", "shot001"]  # not tried again as it is
    shutil.copy(EXAMPLE.with_name("stiff_gel.mat"), bench.folder / "bad.mat")
    bench.settle()
    assert len(bench.rows) == 6
    assert {verdict for _, verdict in bench.rows} == {"ok"}


def test_doubled_files_are_counted_once_and_named(bench, curve):
    write(bench.folder, curve, 1)
    bench.settle()
    shutil.copy(bench.folder / "shot001.csv", bench.folder / "again.csv")
    bench.settle()
    os.utime(bench.folder / "shot001.csv")
    bench.settle()
    assert bench.asked == ["shot001"]
    assert bench.rows == [("shot001", "ok")]
    assert "again.csv" in str(bench.result.notes)
    bench.start()
    bench.settle()
    assert "again.csv" in str(bench.result.notes)  # and is remembered


def test_shots_added_to_a_file_leave_its_others_as_they_are(bench):
    lines = EXAMPLE.read_text().splitlines(keepends=True)
    shots = list(dict.fromkeys(line.split(",")[0] for line in lines if re.match(r"\d", line)))
    first = "".join(line for line in lines if not line.startswith(f"{shots[-1]},"))
    (bench.folder / "gel.csv").write_text(first)
    bench.settle()
    (bench.folder / "gel.csv").write_text("".join(lines))
    bench.settle()
    assert len(bench.asked) == len(set(bench.asked)) == len(bench.rows) == len(shots)


def test_no_answer_of_a_file_is_lost_when_it_is_stopped_in_the_middle(bench, monkeypatch):
    shutil.copy(EXAMPLE, bench.folder / "gel.csv")
    monkeypatch.setattr(watch.analyse, "__defaults__", (Threads(1),))
    real = bench.answer

    def stopped(one):
        if len(bench.asked) == 3:
            raise KeyboardInterrupt
        return real(one)

    bench.answer = stopped
    bench.start()
    with pytest.raises(KeyboardInterrupt):
        bench.settle()
    bench.watch.write()
    assert len(bench.rows) == 3
    bench.asked.append("stopped")
    bench.start()
    bench.settle()
    assert len(bench.rows) == len(set(bench.asked)) - 1 == 5


def test_the_command_answers_as_infer_does(run, tmp_path, curve):
    (tmp_path / "in").mkdir()
    write(tmp_path / "in", curve, 1, 2)
    how = (*BDT, "--no-pictures", "--quiet")
    assert run("infer", "in", "-o", "a", *how)[0] == run("watch", "in", "--once", "-o", "b", *how)[0] == 0
    one, other = (json.loads((tmp_path / name / "result.json").read_text()) for name in "ab")
    for document in (one, other):
        del document["command"], document["date"]
        for row in document["curves"]:
            del row["seconds"]
    assert one == other
    (tmp_path / "in" / "bad.csv").write_text("nothing\n")
    assert run("watch", "in", "--once", "--patience", 0, "-o", "b", *how)[0] == 2
    assert run("watch", "nowhere", *how)[0] == 2


@pytest.mark.needs("av")
@pytest.mark.parametrize("late", [".mraw", ".cihx"])
def test_a_film_of_two_files_is_one_recording_and_either_may_come_late(bench, tmp_path, late):
    files = {path.suffix: path for path in (bench.folder / "a.mraw", bench.folder / "a.cihx")}
    write_mraw(files[".mraw"], film(bits=12).frames, 12)
    content = files[late].read_bytes()
    files[late].unlink()
    bench.settle()
    assert (bench.rows, bench.watch.unreadable) == ([("a", "failed")], 1)
    files[late].write_bytes(content)
    bench.settle()
    assert (bench.rows, bench.watch.unreadable) == ([("a", "ok")], 0)
    bench.start()
    bench.settle()
    assert (bench.rows, bench.asked) == ([("a", "ok")], ["a", "a"])  # the first is the failure
    files[".mraw"].unlink()
    bench.settle()
    assert (bench.rows, bench.watch.unreadable) == ([("a", "ok")], 0)  # though the header is still there


def test_a_column_may_grow_while_shots_arrive(bench, curve):
    table = bench.folder / "share.csv"  # in the folder itself, and no recording
    bench.how = {"column": table}
    write(bench.folder, curve, 1, 2)
    for text, second, note in (
        ("shot,share\nshot001,0.5\nshot009,2\n", {}, "names shot009, which is not here"),
        ("shot,share\nshot001,0.5\nshot002,0.7\n", {"share": 0.7}, ""),  # no new recording: the table alone changed
    ):
        table.write_text(text)
        if not bench.asked:
            bench.start()
        bench.settle()
        assert [row.column for row in bench.result.curves] == [{"share": 0.5}, second]
        assert note in str(bench.result.notes)
    assert bench.asked == ["shot001", "shot002"]
    table.write_text("shot,share\nshot001,half\n")
    write(bench.folder, curve, 3)
    bench.settle()
    assert bench.asked[-1] == "shot003"
    assert "'half' is not a number" in str(bench.result.notes)
    assert sum("'half' is not a number" in said for said in bench.said) == 1
