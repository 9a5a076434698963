"""A folder at the bench: each recording is answered when its file is complete, and once, whatever ends the run.

A file counts as complete when its size and time have not changed for LOOK and it can be read. `watched/` in the folder
of the results holds each answer by its key (workflow/store.py), and what was read of each file; the documents are made
of these. So a run that is killed at any moment loses only what it was computing.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, field
from importlib.metadata import version
from pathlib import Path

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference.analysis import Analysis
from cavirheo.io.files import file_label, header_of, measurements, pixels_of
from cavirheo.io.option_tables import is_size, listed, read_column, with_given_values, with_size
from cavirheo.io.shots import CurveSet, read_shots, samples_of
from cavirheo.parallel import cores
from cavirheo.posterior import Posterior
from cavirheo.reporting import DOCUMENTS, html, table
from cavirheo.reporting.answer import CurveRecord, curve_record
from cavirheo.reporting.record import Result, result_of
from cavirheo.workflow.analyse import analyse, of_file
from cavirheo.workflow.store import Store
from cavirheo.writing.document import Outputs, write_json
from cavirheo.writing.packing import key_of

LOOK = 0.4  # s between two looks at the folder; a file that did not change from one to the next may be complete
PATIENCE = 10.0  # s for which a file that cannot be read may still be in the making
PACE = 4.0  # times as long as it took to write the documents, they are not written again
State = tuple[int, ...]  # bytes, time of the last change in ns; of a film's header, too


@dataclass(eq=False)
class WatchedFile:
    """One file as it was when it was read.

    order: ns, when it was first complete: rows stand in this order. curves: of each recording in it that is in no other
    file. twins: files that hold the others. unreadable: it gave up no curve. answers, rows: of each curve; None is yet
    to be found.
    """

    path: str
    state: State
    order: int
    curves: list[RadiusCurve]
    remarks: list[str] = field(default_factory=list)
    twins: list[str] = field(default_factory=list)
    unreadable: bool = False
    answers: list[Posterior | None] = field(default_factory=list)
    rows: list[CurveRecord | None] = field(default_factory=list)


@dataclass
class Trial:
    """A file that could not be read: since when (s), and when it is tried again."""

    state: State
    since: float
    again: float


@dataclass(eq=False, repr=False)
class Watch:
    """The recordings of one folder, their answers and their documents in `out`.

    analysis: how curves are answered. read: the curves of one file. reading: all that `read` depends on besides the
    medium. group: as in `read_shots`. column: a table as of `read_column`, which may grow while shots arrive, or the
    word R_max. half_width: as for `html.live_page`. say: told one line of what goes wrong. show: told each row as it is
    found.
    """

    folder: Path
    out: Path
    analysis: Analysis
    read: Callable[[Path], CurveSet]
    reading: object = None
    _: KW_ONLY
    group: str = "auto"
    column: Path | None = None
    command: str = ""
    date: str | None = None
    say: Callable[[str], None] = lambda _: None
    show: Callable[[CurveRecord], None] = lambda _: None
    patience: float = PATIENCE
    half_width: float = html.HALF_WIDTH

    def __post_init__(self) -> None:
        self.sizes = self.column is not None and is_size(self.column)
        if self.sizes:
            self.column = None
        self._column_then = _state(self.column)
        self.outputs, self.page = Outputs(self.out, *DOCUMENTS), Outputs(self.out, html.LIVE)
        self.store = Store(self.out / "watched", most=0)
        how = key_of([version("cavirheo"), self.reading, self.analysis.medium])[:16]  # read otherwise, other curves
        self.records = Store(self.out / "watched" / how, most=0)
        self.files: dict[str, WatchedFile] = {}
        self.owner: dict[bytes, str] = {}  # the file of each recording
        self._seen: dict[Path, tuple[State, float]] = {}
        self._trials: dict[Path, Trial] = {}
        self._latest: Posterior | None = None
        self._told: set[str] = set()
        self._unwritten, self._due = False, 0.0  # whether the documents lack anything, and from when on they may follow
        for record in self.records.values(dict):
            self._own(WatchedFile(**record))

    def answered(self) -> tuple[list[tuple[RadiusCurve, Posterior]], list[str]]:
        """Every curve, named and grouped among all, with its answer, in the order of the files; and what is to be said
        of the files and of the scales and constants of their curves."""
        files = self._in_order()
        named, _, again, hints = read_shots([curve for one in files for curve in one.curves], group=self.group)
        remarks = [remark for one in files for remark in one.remarks]
        named = self._with_column(named, remarks)
        answers = [answer for one in files for answer in one.answers]
        pairs = [(curve, answer) for curve, answer in zip(named, answers, strict=True) if answer]
        return pairs, remarks + again + hints

    @property
    def unreadable(self) -> int:
        return sum(one.unreadable for one in self.files.values())

    def pause(self) -> bool:
        """Wait until the next look. Whether anything is still to come: a file in the making, or documents."""
        time.sleep(LOOK)
        moving = any(self._is_news(path, state) for path, (state, _) in self._seen.items())
        return moving or bool(self._trials) or self._unwritten

    def once(self) -> bool:
        """Answer the next files that are complete, as many at once as keep all cores busy. Whether there were any."""
        found = 0
        for path, state in self._complete():
            if one := self._read(path, state):
                known = self.files.get(one.path)
                self.records.put(key_of(one.path), vars(one))
                self._own(one)
                found += 1
                if known and known.curves and None in one.answers:
                    self._say_once(f"{path.name} has changed: its recordings are answered anew")
            if sum(one.answers.count(None) for one in self.files.values()) >= 2 * cores():
                break
        left = [(one, k) for one in self._in_order() for k, answer in enumerate(one.answers) if answer is None]
        self._unwritten |= found > 0 or _state(self.column) != self._column_then
        for place, answer in analyse([one.curves[k] for one, k in left], self.analysis, self.store):
            one, k = left[place]
            row = curve_record(one.curves[k], answer)
            one.answers[k], one.rows[k], self._latest, self._unwritten = answer, row, answer, True
            self.show(row)
            self._write_if_due()
        self._write_if_due()
        return found > 0 or bool(left)

    def _write_if_due(self) -> None:
        """The documents, where they lack anything. They take a part of the time at most, however many shots there are:
        each is rewritten as a whole."""
        if self._unwritten and time.monotonic() >= self._due:
            self.write()

    def write(self) -> Result:
        """result.json, result.csv and the page on the wall, of all that is answered."""
        began = time.monotonic()
        self._column_then, self._unwritten = _state(self.column), False
        (pairs, notes), keys = self.answered(), ("name", "group", "group_source", "column")
        made = [row for one in self._in_order() for row in one.rows if row]
        named = [{key: getattr(curve, key) for key in keys} for curve, _ in pairs]
        rows = [row.model_copy(update=about) for row, about in zip(made, named, strict=True)]
        result = result_of(rows, self.command, [answer for _, answer in pairs], date=self.date, notes=notes)
        if pairs or not self.outputs.holds("result.json"):  # earlier answers stay until there are others
            self.outputs.write("result.json", write_json, result)
            self.outputs.write("result.csv", table.write_csv, result)
        latest = next((k for k, (_, answer) in enumerate(pairs) if answer is self._latest), len(pairs) - 1)
        curve, answer = pairs[latest] if pairs else (None, None)
        page = html.live_page(result, latest, curve, answer, self.half_width)
        self.page.write(html.LIVE, Path.write_text, page, encoding="utf-8")
        now = time.monotonic()
        self._due = now + PACE * (now - began)
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
        found, unknown, without = with_given_values(curves, title, values)
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
            del self.files[one.path]  # a header whose pixels came later than was waited for
            self.records.remove([key_of(one.path)])
            self._disown(set(map(samples_of, one.curves)), one.path)
        stable = [(path, state) for path, (state, since) in self._seen.items() if now - since >= LOOK]
        return sorted((one for one in stable if self._is_news(*one)), key=lambda one: (one[1][1], one[0]))

    def _is_news(self, path: Path, state: State) -> bool:
        known, trial = self.files.get(str(path)), self._trials.get(path)
        waits = trial is not None and trial.state == state and time.monotonic() < trial.again
        return not waits and (known is None or known.state != state)

    def _read(self, path: Path, state: State) -> WatchedFile | None:
        """What is in a file; None if it is to be tried again. One that stays as it is and cannot be read is a curve
        that says why."""
        try:
            curves, problems, remarks, _ = self.read(path)  # hints are said once, of all curves
        except InputError as error:  # a setting that is wrong for this file
            curves, problems, remarks, _ = CurveSet([], [f"{path}: {error}"], [], [])
        if _state(path) != state:
            return None  # it is being written
        known = self.files.get(str(path))
        one = WatchedFile(str(path), state, known.order if known else state[1], [])
        if problems:
            now, trial = time.monotonic(), self._trials.get(path)
            if trial is None or trial.state != state:
                trial = self._trials[path] = Trial(state, now, now)
                self._say_once(f"{problems[0]}; it is tried again for {self.patience:g} s, and whenever it changes")
            trial.again = now + max(LOOK, now - trial.since)
            if now - trial.since < self.patience:
                trial.again = min(trial.again, trial.since + self.patience)
                return None
            stem = {"name": path.stem, "group": path.stem, "source": file_label(path)}
            curves, one.unreadable = [RadiusCurve([], [], meta=stem, unusable=problems[0])], True  # type: ignore[arg-type]
        self._trials.pop(path, None)
        one.remarks = list(remarks)
        for curve in curves:
            owner = self.owner.get(samples_of(curve), one.path)
            if owner == one.path:
                one.curves.append(curve)
            else:
                one.twins.append(owner)
                one.remarks.append(f"{path.name}: {curve.name} is the same recording as in {owner}: counted once")
                self._say_once(one.remarks[-1])
        return one

    def _own(self, one: WatchedFile) -> None:
        """Count a file, instead of what it was before; the twins of recordings that are gone from it are read again."""
        before, self.files[one.path] = self.files.get(one.path), one
        known = [self.store.get(self.analysis.key(curve)) for curve in one.curves]
        one.answers = [answer and of_file(answer, curve) for curve, answer in zip(one.curves, known, strict=True)]
        pairs = zip(one.curves, one.answers, strict=True)
        one.rows = [curve_record(curve, answer) if answer else None for curve, answer in pairs]
        mine = dict.fromkeys(map(samples_of, one.curves), one.path)
        gone = {samples_of(curve) for curve in before.curves} - {*mine} if before else set()
        self._disown(gone, one.path)
        self.owner |= mine

    def _disown(self, recordings: set[bytes], path: str) -> None:
        """These are no longer in this file: those that are its twins are read again."""
        for samples in recordings:
            self.owner.pop(samples, None)
        if recordings:
            self.files = {name: one for name, one in self.files.items() if path not in one.twins}

    def _in_order(self) -> list[WatchedFile]:
        return sorted(self.files.values(), key=lambda one: (one.order, one.path))

    def _say_once(self, text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            self.say(text)


def _state(path: Path | None) -> State | None:
    """Of a file that may not be there, and of the header that belongs to it."""
    try:
        states = [] if path is None else [path.stat()]
    except FileNotFoundError:
        return None
    if path and (header := header_of(path)):
        with suppress(FileNotFoundError):
            states.append(header.stat())
    return tuple(number for state in states for number in (state.st_size, state.st_mtime_ns)) or None
