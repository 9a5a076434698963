"""`cavirheo watch`: each recording of a folder is answered once, when its file is complete, whatever ends the run."""

import json
import os
import shutil
import time
from functools import partial
from pathlib import Path

import pytest
from answers import KnownAnalysis, answer, unanswered
from conftest import BDT, EXAMPLE
from recordings import SCALE

from cavirheo import load
from cavirheo.io.shots import read_shots
from cavirheo.parallel import Threads
from cavirheo.watch import Watch
from cavirheo.writing.document import Claim, Outputs

LINES = EXAMPLE.read_text(encoding="utf-8").splitlines(keepends=True)


def shots(*kept: int) -> str:
    """The example with these of its five shots."""
    return "".join(line for line in LINES if not line[:1].isdigit() or int(line[0]) in kept)


def write(folder: Path, *numbers: int) -> Path:
    """shot1.csv, ..., shot5.csv: recordings that differ from each other; the last one's path."""
    for k in numbers:
        (folder / f"shot{k}.csv").write_text(shots(k), encoding="utf-8")
    return folder / f"shot{numbers[-1]}.csv"


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
        read = partial(read_shots, um_per_px=SCALE)
        outputs = Outputs(Claim("cavirheo watch", {}), self.out)
        self.watch = Watch(self.folder, outputs, analysis, read, notify=self.said.append, **self.how)

    def answer(self, one):
        self.asked.append(one.name)
        return unanswered(one.unusable) if one.unusable else answer(one)

    def settle(self) -> list[tuple[str, str]]:
        """Name and verdict of each row, when nothing is left to be answered."""
        while self.watch.step():
            time.sleep(0.02)
        written = (self.out / "result.json").exists()
        return [(row.name, row.verdict) for row in self.result.curves] if written else []

    @property
    def result(self):
        return load(self.out / "result.json")


@pytest.fixture
def bench(tmp_path) -> Bench:
    return Bench(tmp_path, executor=Threads())


def test_each_file_is_answered_once_also_after_a_restart_and_stays_when_it_is_moved(bench):
    write(bench.folder, 1, 2)
    bench.settle()
    (bench.folder / "shot1.csv").rename(bench.folder.parent / "shot1.csv")
    write(bench.folder, 3)
    assert bench.settle() == [(name, "ok") for name in bench.asked]
    (bench.folder.parent / "shot1.csv").rename(bench.folder / "shot1.csv")
    bench.start()
    assert bench.settle() == [(name, "ok") for name in bench.asked]
    assert bench.asked == ["shot1", "shot2", "shot3"]
    (group,) = bench.result.groups
    assert group.n_counted == 3  # a folder of single shots is one material, as for infer
    report = (bench.out / "report.html").read_text()
    assert all('<path class="measured"' in part for part in report.split("<article")[1:])
    assert report.count("<article") == 3
    bench.seed = 1  # other settings are other answers
    bench.start()
    bench.settle()
    assert bench.asked[3:] == ["shot1", "shot2", "shot3"]


def test_a_file_is_left_alone_while_it_grows_and_answered_when_it_is_whole(bench):
    growing = bench.folder / "shot2.csv"
    for k in range(1, 20):
        growing.write_text(shots(2)[: 40 * k])
        bench.watch.step()
        time.sleep(0.01)
    assert bench.asked == []
    growing.write_text(LINES[0][:10])
    assert bench.settle() == [("shot2", "failed")]
    assert sum("shot2.csv" in line for line in bench.said) == 1
    write(bench.folder, 2)
    assert bench.settle() == [("shot2", "ok")]


def test_a_damaged_file_becomes_a_failed_row_and_is_mended_by_a_new_one(bench):
    (bench.folder / "bad.mat").write_bytes(b"no MATLAB file" * 20)
    write(bench.folder, 1)
    assert sorted(bench.settle()) == [("bad", "failed"), ("shot1", "ok")]
    assert bench.watch.unreadable == 1
    bench.start()
    bench.settle()
    assert sorted(bench.asked) == ["bad", "shot1"]  # not tried again as it is
    shutil.copy(EXAMPLE.with_name("stiff_gel.mat"), bench.folder / "bad.mat")
    assert [verdict for _, verdict in bench.settle()] == ["ok"] * 6


def test_doubled_files_are_counted_once_and_named_and_shots_are_added_to_a_file(bench):
    first = write(bench.folder, 1)
    bench.settle()
    shutil.copy(first, bench.folder / "again.csv")
    bench.settle()
    os.utime(first)
    assert bench.settle() == [("shot1", "ok")]
    assert bench.asked == ["shot1"]
    bench.start()
    bench.settle()
    assert "again.csv" in str(bench.result.notes)  # and is remembered
    for kept in ((2, 3, 4), (2, 3, 4, 5)):
        (bench.folder / "gel.csv").write_text(shots(*kept))
        rows = bench.settle()
    assert len(bench.asked) == len(set(bench.asked)) == len(rows) == 5


def test_the_command_answers_as_infer_does(run, tmp_path):
    (tmp_path / "in").mkdir()
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
