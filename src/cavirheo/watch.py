"""Watching a folder during an experiment: each recording is answered once, when its file is complete.

A file counts as complete when its size and time have not changed for POLL_INTERVAL and it can be read. `watched/` in
the folder of the results holds each answer by its key (workflow/store.py), and the content of each file; the documents
are made from these. So a run that is killed at any moment loses only the answers that it was computing.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, printable
from cavirheo.inference.analysis import Analysis
from cavirheo.io.curves import unusable_curve
from cavirheo.io.files import header_of, measurement_files, pixels_of
from cavirheo.io.shots import CurveSet, read_shots, sample_hash
from cavirheo.parallel import Executor, cores
from cavirheo.posterior import Posterior
from cavirheo.reporting import DOCUMENTS, result, write_report
from cavirheo.reporting.answer import CurveRecord, curve_record
from cavirheo.reporting.record import Result
from cavirheo.workflow.store import Store, analyse, with_source_of
from cavirheo.writing.document import Outputs
from cavirheo.writing.packing import content_hash

if TYPE_CHECKING:
    from cavirheo.inference.population import CommonErrors

POLL_INTERVAL = 0.4  # s between two looks at the folder; a file that did not change in between may be complete
READ_TIMEOUT = 10.0  # s for which an unreadable file counts as incomplete
PAUSE_FACTOR = 4.0  # pause between two writings of the documents, over the time that one takes
State = tuple[int, ...]  # size in bytes and time of the last change in ns, of a file and of its header


@dataclass(eq=False)
class WatchedFile:
    """A file as it was when it was read. order: time of its last change when it was first read, ns, by which rows are
    sorted. unreadable: its only curve has the reason. keys: keys of the answers of its curves."""

    path: str
    state: State
    order: int
    curves: list[RadiusCurve]
    remarks: list[str] = field(default_factory=list)
    unreadable: bool = False
    keys: list[str] = field(default_factory=list)


@dataclass(eq=False, repr=False)
class Watch:
    """The recordings of one folder, their answers and their documents in `out`.

    analysis: how curves are answered. read: returns the curves of files. read_settings: all settings of `read`
    besides the medium. group: as in `read_shots`. draw, errors: as in `write_report`. notify: called with a line on
    each problem. show: called with each new row. poll_interval, read_timeout: as POLL_INTERVAL and READ_TIMEOUT.
    executor: as in `analyse`.
    """

    folder: Path
    out: Path
    analysis: Analysis
    read: Callable[[list[Path]], CurveSet]
    read_settings: object = None
    _: KW_ONLY
    group: str = "auto"
    command: str = ""
    date: str | None = None
    notify: Callable[[str], None] = lambda _: None
    show: Callable[[CurveRecord], None] = lambda _: None
    poll_interval: float = POLL_INTERVAL
    read_timeout: float = READ_TIMEOUT
    draw: bool = True
    errors: CommonErrors | None = None
    executor: Executor | None = None

    def __post_init__(self) -> None:
        self._messages: set[str] = set()  # messages that were passed to `notify`
        self.outputs = Outputs(self.out, *DOCUMENTS)
        self.store = Store(self.out / "watched")
        # the curves of a file depend on these settings
        settings_key = content_hash([version("cavirheo"), self.read_settings, self.analysis.medium])[:16]
        self.records = Store(self.out / "watched" / settings_key)
        self.files: dict[str, WatchedFile] = {}
        self._states: dict[Path, tuple[State, float]] = {}  # state of each file, and time in s when it was first seen
        self._unwritten = False  # whether the documents are out of date
        self._due = 0.0  # s, earliest time to write them
        for record in self.records.values():
            if isinstance(record, dict):
                self._add_file(WatchedFile(**record))

    def pairs(self) -> tuple[list[tuple[RadiusCurve, Posterior]], list[str]]:
        """Every answered curve with its answer, in the order of the files; and remarks on the files and on scales and
        constants. Names and groups are those among all curves."""
        files, keys = self._files_in_order(), list(self._recordings())
        curves, _, repeated, hints = read_shots([curve for file in files for curve in file.curves], group=self.group)
        self._notify_once(*repeated)
        remarks = [remark for file in files for remark in file.remarks]
        answers = (self.store.get(key) for key in keys)
        pairs = zip(curves, answers, strict=True)
        return [(curve, with_source_of(answer, curve)) for curve, answer in pairs if answer], remarks + repeated + hints

    def _recordings(self) -> dict[str, RadiusCurve]:
        """The curves by the keys of their answers, without repeated recordings, as in `read_shots`."""
        first: dict[bytes, tuple[str, RadiusCurve]] = {}
        for file in self._files_in_order():
            for key, curve in zip(file.keys, file.curves, strict=True):
                first.setdefault(sample_hash(curve), (key, curve))
        return dict(first.values())

    @property
    def unreadable(self) -> int:
        return sum(file.unreadable for file in self.files.values())

    def pause(self) -> bool:
        """Wait until the next look; returns whether files are still to be read, or documents to be written."""
        time.sleep(self.poll_interval)
        return self._unwritten or any(self._is_new(path, state) for path, (state, _) in self._states.items())

    def answer_next(self) -> bool:
        """Answer the next complete files, as many as keep all cores busy; returns whether there were any."""
        new = False
        for path, state in self._complete():
            if file := self._read(path, state):
                earlier, new = self.files.get(file.path), True
                self.records.put(content_hash(file.path), vars(file))
                self._add_file(file)
                if earlier and earlier.curves and not all(map(self.store.get, file.keys)):
                    self._notify_once(f"{path.name} has changed: its recordings are answered anew")
            if len(self._unanswered()) >= 2 * cores():
                break
        unanswered = self._unanswered()
        curves = list(unanswered.values())
        self._unwritten |= new
        for place, answer in analyse(curves, self.analysis, self.store, self.executor):
            self._unwritten = True
            self.show(curve_record(curves[place], answer))
            self._write_if_due()
        self._write_if_due()
        return new or bool(unanswered)

    def _unanswered(self) -> dict[str, RadiusCurve]:
        return {key: curve for key, curve in self._recordings().items() if not self.store.get(key)}

    def _write_if_due(self) -> None:
        """Write the documents if they are out of date and the pause is over: each is rewritten completely."""
        if self._unwritten and time.monotonic() >= self._due:
            self.write()

    def write(self) -> Result:
        """Write result.json, result.csv and report.html with all answers; returns the result. Earlier documents stay
        until there is an answer."""
        started = time.monotonic()
        self._unwritten = False
        pairs, notes = self.pairs()
        document = result(pairs, self.command, date=self.date, notes=notes, errors=self.errors)
        if pairs or not self.outputs.listed_entry("result.json"):
            write_report(self.out, pairs, document, draw=self.draw, replace=True)
        now = time.monotonic()
        self._due = now + PAUSE_FACTOR * (now - started)
        return document

    def _complete(self) -> list[tuple[Path, State]]:
        """New or changed files that have not changed for `poll_interval` s, the oldest first."""
        now, states = time.monotonic(), dict[Path, State]()
        try:
            for path in measurement_files(self.folder)[0]:
                moved = str(pixels_of(path)) in self.files  # a header alone, whose film has been read
                if not moved and (state := self._state(path)):
                    states[path] = state
        except OSError as error:  # a network folder is not available
            self._notify_once(f"{self.folder} cannot be looked at ({error.strerror}): waiting")
        unchanged = {path: recorded for path, recorded in self._states.items() if states.get(path) == recorded[0]}
        self._states = {path: (state, now) for path, state in states.items()} | unchanged
        for file in [file for file in self.files.values() if file.unreadable and pixels_of(Path(file.path)) in states]:
            del self.files[file.path]  # a header whose pixels came after `read_timeout` s
            self.records.remove([content_hash(file.path)])
        stable = [(path, state) for path, (state, since) in self._states.items() if now - since >= self.poll_interval]
        return sorted((pair for pair in stable if self._is_new(*pair)), key=lambda pair: (pair[1][1], pair[0]))

    def _is_new(self, path: Path, state: State) -> bool:
        file = self.files.get(str(path))
        return file is None or file.state != state

    def _read(self, path: Path, state: State) -> WatchedFile | None:
        """The content of a file; a curve with the reason if it is unreadable; None if it is to be tried again."""
        try:
            curves, problems, remarks, _ = self.read([path])  # `pairs` gives hints once for all curves
        except InputError as error:  # a setting that is wrong for this file
            curves, problems, remarks, _ = CurveSet([], [f"{path}: {error}"], [], [])
        if self._state(path) != state:
            return None  # the file is being written
        earlier = self.files.get(str(path))
        if problems:
            self._notify_once(f"{problems[0]}; it is tried again for {self.read_timeout:g} s, and whenever it changes")
            if time.monotonic() - self._states[path][1] < self.read_timeout:
                return None
            stem = {"name": path.stem, "group": path.stem, "source": printable(str(path))}
            curves = [unusable_curve(problems[0], stem)]
        order = earlier.order if earlier else state[1]
        return WatchedFile(str(path), state, order, curves, list(remarks), unreadable=bool(problems))

    def _add_file(self, file: WatchedFile) -> None:
        self.files[file.path] = file
        file.keys = [self.analysis.key(curve) for curve in file.curves]

    def _files_in_order(self) -> list[WatchedFile]:
        return sorted(self.files.values(), key=lambda file: (file.order, file.path))

    def _state(self, path: Path) -> State | None:
        """State of a file, and of its header if it has one; None if the file does not exist, or one of them cannot be
        looked at, as on a network share that is away, which is said once."""
        state: State = ()
        for place in filter(None, (path, header_of(path))):
            try:
                status = place.stat()
            except FileNotFoundError:
                continue
            except OSError as error:
                self._notify_once(f"{place} cannot be looked at ({error.strerror}): waiting")
                return None
            state += (status.st_size, status.st_mtime_ns)
        return state or None

    def _notify_once(self, *texts: str) -> None:
        for text in texts:
            if text not in self._messages:
                self._messages.add(text)
                self.notify(text)
