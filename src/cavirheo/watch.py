"""A folder at the bench: each recording is answered when its file is complete, and once, whatever ends the run.

A file counts as complete when its size and time have not changed for LOOK and it can be read. `watched/` in the folder
of the results holds what was found for each file, its curves and their answers, in a file that is never seen
half-written; result.json is made of these. So a run that is killed at any moment loses only what it was computing.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from cavirheo.answer_store import keep, key_of, read_kept
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.parallel import Step, cores
from cavirheo.posterior import Posterior
from cavirheo.reading.column import given, is_size, listed, read_column, with_size
from cavirheo.reading.files import header_of, measurements, pixels_of, shown
from cavirheo.reading.shots import Recordings, read_shots
from cavirheo.reporting import DOCUMENTS, table, wall_page
from cavirheo.reporting.answer import CurveRecord, curve_record
from cavirheo.reporting.record import Result, result_of
from cavirheo.writing.document import Outputs, into, write_json

LOOK = 0.4  # s between two looks at the folder; a file that did not change from one to the next may be complete
PATIENCE = 10.0  # s for which a file that cannot be read may still be in the making
State = tuple[int, ...]  # bytes, time of the last change in ns; of a film's header, too


@dataclass(eq=False)
class Watched:
    """One file as it was when it was read.

    order: ns, when it was first complete: rows stand in this order. curves, answers: of each recording in it that is in
    no other file; None is yet to be answered. twins: files that hold the others. unreadable: it gave up no curve.
    """

    path: str
    state: State
    order: int
    curves: list[RadiusCurve]
    answers: list[Posterior | None]
    remarks: list[str] = field(default_factory=list)
    twins: list[str] = field(default_factory=list)
    unreadable: bool = False


@dataclass
class Trial:
    """A file that could not be read: since when (s), and when it is tried again."""

    state: State
    since: float
    again: float


class Watch:
    """The recordings of one folder, their answers and their documents in `out`.

    step: how curves are answered. read: the curves of one file. reading: all that `read` depends on. group: as in
    `read_shots`. column: a table as of `read_column`, which may grow while shots arrive, or the word R_max. wanted: as
    for `live.page`. say: told one line of what goes wrong. show: told each row as it is found.
    """

    def __init__(
        self, folder: Path, out: Path, step: Step, read: Callable[[Path], Recordings], reading: object = None, *,
        group: str = "auto", column: Path | None = None, command: str = "", date: str | None = None,
        say: Callable[[str], None] = lambda _: None, show: Callable[[CurveRecord], None] = lambda _: None,
        patience: float = PATIENCE, wanted: float = wall_page.WANTED,
    ) -> None:  # fmt: skip
        self.folder, self.step, self.read, self.group, self.patience = folder, step, read, group, patience
        self.sizes = column is not None and is_size(column)
        self.column = None if self.sizes else column
        self._column_then = _state(self.column)
        self.say, self.show, self.command, self.date, self.wanted = say, show, command, date, wanted
        self.outputs, self.page = Outputs(out, *DOCUMENTS), Outputs(out, wall_page.PAGE)
        self.kept = out / "watched" / key_of([step.identity, reading])[:16]  # other settings, other answers
        self.files: dict[str, Watched] = {}
        self.owner: dict[bytes, str] = {}  # the file of each recording
        self._rows: dict[str, dict[int, CurveRecord]] = {}  # of each file, by the number of the curve
        self._seen: dict[Path, tuple[State, float]] = {}
        self._trials: dict[Path, Trial] = {}
        self._latest: Watched | None = None
        self._told: set[str] = set()
        for place in sorted(self.kept.glob("*.npz")):
            if about := read_kept(place, dict):
                self._own(Watched(**about))

    def answered(self) -> tuple[list[tuple[RadiusCurve, Posterior]], list[str]]:
        """Every curve, named and grouped among all, with its answer, in the order of the files; and what is to be said
        of the files and of the scales and constants of their curves."""
        pairs = [pair for one in self._in_order() for pair in zip(one.curves, one.answers, strict=True)]
        named, _, again, hints = read_shots([curve for curve, _ in pairs], group=self.group)
        remarks = [said for one in self._in_order() for said in one.remarks]
        named = self._with_column(named, remarks)
        return [
            (curve, answer) for curve, (_, answer) in zip(named, pairs, strict=True) if answer
        ], remarks + again + hints

    @property
    def unreadable(self) -> int:
        return sum(one.unreadable for one in self.files.values())

    def pause(self) -> bool:
        """Wait until the next look. Whether any file is still in the making."""
        time.sleep(LOOK)
        moving = any(self._is_news(path, state) for path, (state, _) in self._seen.items())
        return moving or bool(self._trials)

    def once(self) -> bool:
        """Answer the next files that are complete, as many at once as keep all cores busy. Whether there were any."""
        files: list[Watched] = []
        for path, state in self._complete():
            if one := self._read(path, state):
                files.append(one)
                self.owner |= {_samples(curve): one.path for curve in one.curves}
            if sum(answer is None for one in files for answer in one.answers) >= 2 * cores():
                break
        if not files:
            if _state(self.column) != self._column_then:
                self.write()
            return False
        todo = [(one, k) for one in files for k, answer in enumerate(one.answers) if answer is None]
        for one in files:
            if None not in one.answers:
                self._finish(one)

        found: dict[str, dict[int, CurveRecord]] = {one.path: {} for one in files}

        def done(index: int, answer: Posterior) -> None:
            one, k = todo[index]
            one.answers[k] = answer
            row = found[one.path][k] = curve_record(one.curves[k], answer)
            self.show(row)
            if None not in one.answers:
                self._finish(one, found[one.path])

        if todo:
            self.step.verb([one.curves[k] for one, k in todo], done=done, **self.step.settings)
        self.write()
        return True

    def write(self) -> Result:
        """result.json, result.csv and the page on the wall, of all that is answered."""
        self._column_then = _state(self.column)
        (pairs, notes), keys = self.answered(), ("name", "group", "group_source", "column")
        made = [self._rows[one.path][k] for one in self._in_order() for k in range(len(one.curves))]
        named = [{key: getattr(curve, key) for key in keys} for curve, _ in pairs]
        rows = [row.model_copy(update=about) for row, about in zip(made, named, strict=True)]
        result = result_of(rows, self.command, [answer for _, answer in pairs], date=self.date, notes=notes)
        if pairs or not self.outputs.holds("result.json"):  # earlier answers stay until there are others
            self.outputs.write("result.json", write_json, result)
            self.outputs.write("result.csv", table.write_csv, result)
        newest = self._latest.answers[-1] if self._latest and self._latest.answers else None
        latest = next((k for k, (_, answer) in enumerate(pairs) if answer is newest), len(pairs) - 1)
        self.page.write(
            wall_page.PAGE, wall_page.write, result, latest, *(pairs[latest] if pairs else ()), wanted=self.wanted
        )
        return result

    def _with_column(self, curves: list[RadiusCurve], remarks: list[str]) -> list[RadiusCurve]:
        """With what the column says of them so far; what it does not say becomes a remark."""
        if self.column is None:
            return with_size(curves) if self.sizes else curves
        try:
            title, values = read_column(self.column)
        except InputError as error:  # it is being written, or has a mistake: shots are answered all the same
            self._say_once(f"{error}; {self.column.name} does not count until this is mended")
            remarks.append(str(error))
            return curves
        found, unknown, without = given(curves, title, values)
        if without:
            remarks.append(f"{self.column.name} has no value of {title} for {listed(without)}: no part of a slope")
        if unknown:
            remarks.append(f"{self.column.name} names {listed(unknown)}, which is not here")
        return found

    def _complete(self) -> list[tuple[Path, State]]:
        """Files that are new and did not change for a while, the oldest first."""
        now, found = time.monotonic(), {}
        try:
            for path in measurements(self.folder)[0]:
                if self.column is not None and path.resolve() == self.column.resolve():
                    continue
                moved = str(pixels_of(path)) in self.files  # a header alone, whose film was answered
                if not moved and (state := _state(path)):
                    found[path] = state
        except OSError as error:  # a file that is gone again, a share that is away for a moment
            self._say_once(f"{self.folder} cannot be looked at ({error.strerror}): waiting")
        before, self._seen = self._seen, {}
        for path, state in found.items():
            same = path in before and before[path][0] == state
            self._seen[path] = before[path] if same else (state, now)
        self._trials = {path: trial for path, trial in self._trials.items() if path in found}
        for one in [one for one in self.files.values() if one.unreadable and pixels_of(Path(one.path)) in found]:
            self._disown(one.path)  # a header whose pixels came later than was waited for
        news = [
            (path, state) for path, (state, since) in self._seen.items()
            if now - since >= LOOK and self._is_news(path, state)
        ]  # fmt: skip
        return sorted(news, key=lambda one: (one[1][1], one[0]))

    def _is_news(self, path: Path, state: State) -> bool:
        known, trial = self.files.get(str(path)), self._trials.get(path)
        waits = trial is not None and trial.state == state and time.monotonic() < trial.again
        return not waits and (known is None or known.state != state)

    def _read(self, path: Path, state: State) -> Watched | None:
        """What is in a file; None if it is to be tried again. One that stays as it is and cannot be read is a curve
        that says why."""
        try:
            curves, problems, remarks, _ = self.read(path)  # hints are said once, of all curves
        except InputError as error:  # a setting that is wrong for this file
            curves, problems, remarks, _ = Recordings([], [f"{path}: {error}"], [], [])
        if _state(path) != state:
            return None  # it is being written
        known = self.files.get(str(path))
        one = Watched(str(path), state, known.order if known else state[1], [], [])
        if problems:
            now, trial = time.monotonic(), self._trials.get(path)
            if trial is None or trial.state != state:
                trial = self._trials[path] = Trial(state, now, now)
                self._say_once(f"{problems[0]}; it is tried again for {self.patience:g} s, and whenever it changes")
            trial.again = now + max(LOOK, now - trial.since)
            if now - trial.since < self.patience:
                trial.again = min(trial.again, trial.since + self.patience)
                return None
            stem = {"name": path.stem, "group": path.stem, "source": shown(path)}
            curves, one.unreadable = [RadiusCurve([], [], meta=stem, unusable=problems[0])], True  # type: ignore[arg-type]
        self._trials.pop(path, None)
        one.remarks = list(remarks)
        answers = {_samples(c): a for c, a in zip(known.curves, known.answers, strict=True)} if known else {}
        for curve in curves:
            owner = self.owner.get(_samples(curve), one.path)
            if owner == one.path:
                one.curves.append(curve)
                one.answers.append(answers.get(_samples(curve)))
            else:
                one.twins.append(owner)
                one.remarks.append(f"{path.name}: {curve.name} is the same recording as in {owner}: counted once")
                self._say_once(one.remarks[-1])
        if known and any(answer is None for answer in one.answers) and known.curves:
            self._say_once(f"{path.name} has changed: its recordings are answered anew")
        return one

    def _finish(self, one: Watched, rows: Mapping[int, CurveRecord] = MappingProxyType({})) -> None:
        with into(self.kept):
            keep(self._place(one.path), vars(one))
        self._own(one, rows)
        self._latest = one if one.curves else self._latest

    def _place(self, path: str) -> Path:
        """Where a file's curves and answers are kept."""
        return self.kept / f"{hashlib.sha256(path.encode()).hexdigest()}.npz"

    def _own(self, one: Watched, rows: Mapping[int, CurveRecord] = MappingProxyType({})) -> None:
        """Count a file, instead of what it was before; the twins of recordings that are gone from it are read again."""
        self.files[one.path] = one
        pairs = enumerate(zip(one.curves, one.answers, strict=True))
        self._rows[one.path] = {k: rows.get(k) or curve_record(curve, answer) for k, (curve, answer) in pairs if answer}
        mine = {_samples(curve): one.path for curve in one.curves}
        gone = [samples for samples, path in self.owner.items() if path == one.path and samples not in mine]
        for samples in gone:
            del self.owner[samples]
        self.owner |= mine
        self._read_again(one.path if gone else None)

    def _disown(self, path: str) -> None:
        """Forget a file, and its row."""
        self._place(path).unlink(missing_ok=True)
        del self.files[path], self._rows[path]
        self.owner = {samples: owner for samples, owner in self.owner.items() if owner != path}
        self._read_again(path)

    def _read_again(self, owner: str | None) -> None:
        """The twins of recordings that this file no longer holds."""
        for path in [path for path, other in self.files.items() if owner in other.twins]:
            del self.files[path]

    def _in_order(self) -> list[Watched]:
        return sorted(self.files.values(), key=lambda one: (one.order, one.path))

    def _say_once(self, text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            self.say(text)


def _state(path: Path | None) -> State | None:
    """Of a file that may not be there, and of the header that belongs to it."""
    if path is None or not path.exists():
        return None
    seen = [each.stat() for each in (path, header_of(path)) if each and each.exists()]
    return tuple(number for about in seen for number in (about.st_size, about.st_mtime_ns))


def _samples(curve: RadiusCurve) -> bytes:
    """By which a recording is known again in whichever file; without samples, one is like no other."""
    known = curve.time.tobytes() + curve.radius.tobytes() or f"{curve.source}: {curve.unusable}".encode()
    return hashlib.sha256(known).digest()
