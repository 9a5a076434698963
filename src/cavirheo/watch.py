"""Watching a folder during an experiment: each recording is answered once, when its file is complete.

A file is complete when its size and time are those of the previous look. `watched/` in the folder of the results holds
each answer and the content of each file by keys (workflow/store.py); the documents are made from these. So a run that
is killed at any moment loses only the answers that it was computing.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, printable
from cavirheo.inference.analysis import Analysis
from cavirheo.io.curves import unusable_curve
from cavirheo.io.files import header_of, measurement_files, pixels_of
from cavirheo.io.shots import CurveSet, read_shots
from cavirheo.parallel import Executor, cores
from cavirheo.reporting import DOCUMENTS, result, write_report
from cavirheo.reporting.documents import curve_record
from cavirheo.reporting.record import CurveRecord, Result
from cavirheo.workflow.store import Store, analyse, with_source_of
from cavirheo.writing.document import Outputs
from cavirheo.writing.packing import content_hash

if TYPE_CHECKING:
    from cavirheo.inference.population import CommonErrors

PAUSE = 0.4  # s between two looks at the folder
PAUSE_FACTOR = 4.0  # time between two writings of the documents, over the time that one takes
State = tuple[int, ...]  # size in bytes and time of the last change in ns, of a file and of its header


@dataclass(eq=False, repr=False)
class Watch:
    """The recordings of one folder, their answers and their documents in `out`.

    analysis: how curves are answered. read: returns the curves of files. read_settings: all settings of `read`. group:
    as in `read_shots`. draw, errors: as in `write_report`. notify: called with a line on each problem. show: called
    with each new row. executor: as in `analyse`.
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
    draw: bool = True
    errors: CommonErrors | None = None
    executor: Executor | None = None

    def __post_init__(self) -> None:
        self.outputs = Outputs(self.out, *DOCUMENTS)
        self.store = Store(self.out / "watched")
        # states of all files that were read, also of those that have been moved since, in the order of reading
        self.files: dict[str, State] = self.store.get(self._key("files")) or {}
        self._seen: dict[Path, State] = {}  # states of the files at the latest look
        self._waiting = bool(self.files)  # whether curves may wait for their answers
        self._unwritten = False  # whether the documents are out of date
        self._due = 0.0  # s, earliest time to write them
        self._said: set[str] = set()

    def step(self) -> bool:
        """Look at the folder, read complete files and answer curves, a few for each core; returns whether something is
        left to do."""
        before, self._seen = self._seen, self._states()
        new = [path for path, state in self._seen.items() if self.files.get(str(path)) != state]
        complete = sorted((self._seen[path][1], path) for path in new if before.get(path) == self._seen[path])
        for _, path in complete[: 2 * cores()]:
            self._read(path, self._seen[path])
        if self._waiting:
            self._answer()
        if self._unwritten and time.monotonic() >= self._due:
            self.write()
        return bool(new) or self._waiting or self._unwritten

    def write(self) -> Result:
        """Write result.json, result.csv and report.html with all answers; returns the result. Earlier documents stay
        until there is an answer."""
        started = time.monotonic()
        self._unwritten = False
        curves, notes = self._curves()
        answers = [self.store.get(self.analysis.key(curve)) for curve in curves]
        pairs = [(curve, with_source_of(one, curve)) for curve, one in zip(curves, answers, strict=True) if one]
        document = result(pairs, self.command, date=self.date, notes=notes, errors=self.errors)
        if pairs or not self.outputs.listed_entry("result.json"):
            write_report(self.out, pairs, document, draw=self.draw, replace=True)
        now = time.monotonic()
        self._due = now + PAUSE_FACTOR * (now - started)
        return document

    @property
    def unreadable(self) -> int:
        """Number of files that cannot be read."""
        return sum(content["unreadable"] for content in self._contents())

    def _key(self, *content: object) -> str:
        """A key of what was read; the curves of a file depend on these settings."""
        return content_hash([version("cavirheo"), self.read_settings, *content])[:32]

    def _contents(self) -> list[dict[str, Any]]:
        """The content of each file: its curves, remarks, and whether it is unreadable."""
        contents = [self.store.get(self._key(path, state)) for path, state in self.files.items()]
        return [content for content in contents if content]

    def _curves(self) -> tuple[list[RadiusCurve], list[str]]:
        """All curves, each recording once, with names and groups among all; and remarks on files and scales."""
        contents = self._contents()
        curves = [curve for content in contents for curve in content["curves"]]
        curves, _, repeated, hints = read_shots(curves, group=self.group)
        remarks = [remark for content in contents for remark in content["remarks"]]
        self._notify_once(*repeated)
        return curves, remarks + repeated + hints

    def _read(self, path: Path, state: State) -> None:
        """Store the content of a file; if it cannot be read, a curve with the reason."""
        try:
            curves, problems, remarks, _ = self.read([path])  # `_curves` gives hints once for all curves
        except InputError as error:  # a setting that is wrong for this file
            curves, problems, remarks = [], [f"{path}: {error}"], []
        if self._state(path) != state:
            return  # it is being written
        if problems:
            self._notify_once(f"{problems[0]}; it is tried again when it changes")
            stem = {"name": path.stem, "group": path.stem, "source": printable(str(path))}
            curves = [unusable_curve(problems[0], stem)]
        content = {"curves": curves, "remarks": remarks, "unreadable": bool(problems)}
        self.store.put(self._key(str(path), state), content)
        self.files[str(path)] = state
        self.store.put(self._key("files"), self.files)
        self._waiting = self._unwritten = True

    def _answer(self) -> None:
        """Answer the next curves."""
        curves, _ = self._curves()
        waiting = [curve for curve in curves if not self.store.get(self.analysis.key(curve))]
        batch = waiting[: 2 * cores()]
        for index, answer in analyse(batch, self.analysis, self.store, self.executor):
            self._unwritten = True
            self.show(curve_record(batch[index], answer))
        self._waiting = len(waiting) > len(batch)

    def _states(self) -> dict[Path, State]:
        """The states of the files in the folder. A header alone is no recording yet."""
        states = {}
        try:
            for path in measurement_files(self.folder)[0]:
                if not pixels_of(path) and (state := self._state(path)):
                    states[path] = state
        except OSError as error:  # a network folder is not available
            self._notify_once(f"{self.folder} cannot be looked at ({error.strerror}): waiting")
        return states

    def _state(self, path: Path) -> State:
        """State of a file, and of its header if it has one; empty if the file does not exist, or one of them cannot be
        looked at, as on a network share that is away, which is said once."""
        state: State = ()
        for place in filter(None, (path, header_of(path))):
            try:
                status = place.stat()
            except FileNotFoundError:
                continue
            except OSError as error:
                self._notify_once(f"{place} cannot be looked at ({error.strerror}): waiting")
                return ()
            state += (status.st_size, status.st_mtime_ns)
        return state

    def _notify_once(self, *texts: str) -> None:
        for text in texts:
            if text not in self._said:
                self._said.add(text)
                self.notify(text)
