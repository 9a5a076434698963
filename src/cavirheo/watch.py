"""Watching a folder during an experiment: each recording is answered once, when its file is complete.

A file is complete when its size and time are those of the previous look. `watched/` in the folder of the results holds
each answer by its key (workflow/store.py). So a run that is killed at any moment loses only the answers that it was
computing; the next one reads all files again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, printable
from cavirheo.inference.analysis import Analysis
from cavirheo.io.curves import unusable_curve
from cavirheo.io.files import measurement_files
from cavirheo.io.shots import CurveSet, read_shots
from cavirheo.parallel import Executor, cores
from cavirheo.posterior import Posterior
from cavirheo.reporting import result, write_documents
from cavirheo.reporting.documents import curve_record
from cavirheo.reporting.record import CurveRecord, Result
from cavirheo.video.formats import header_of, pixels_of
from cavirheo.workflow.store import Store, analyse, with_source_of
from cavirheo.writing.document import Outputs

if TYPE_CHECKING:
    from cavirheo.inference.population import CommonErrors

PAUSE = 0.4  # s between two looks at the folder
State = tuple[int, ...]  # size in bytes and time of the last change in ns, of a file and of its header


@dataclass(eq=False, repr=False)
class Watch:
    """The recordings of one folder, their answers and their documents in `outputs`.

    analysis: how curves are answered. read: returns the curves of files. group: as in `read_shots`. draw: as in
    `write_documents`. errors: as in `result`. notify: called with a line on each problem. show: called with each new
    row. executor: as in `analyse`.
    """

    folder: Path
    outputs: Outputs
    analysis: Analysis
    read: Callable[[list[Path]], CurveSet]
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
        self.store = Store(self.outputs.folder / "watched")
        # state and content of all files that were read, also of those that have been moved since
        self.files: dict[Path, tuple[State, CurveSet]] = {}
        self._seen: dict[Path, State] = {}  # states of the files at the latest look
        self._waiting: list[RadiusCurve] = []  # curves without an answer
        self._said: set[str] = set()

    def step(self) -> bool:
        """Look at the folder, read complete files and answer curves, a few for each core; returns whether something is
        left to do."""
        before, self._seen = self._seen, self._states()
        new = [path for path, state in self._seen.items() if path not in self.files or self.files[path][0] != state]
        complete = sorted((self._seen[path][1], path) for path in new if before.get(path) == self._seen[path])
        complete = complete[: 2 * cores()]  # these are answered before more are read
        for _, path in complete:
            self._read(path, self._seen[path])
        if complete:
            self._waiting = [curve for curve in self._curves()[0] if not self._answer(curve)]
        batch = self._waiting[: 2 * cores()]
        self._waiting = self._waiting[len(batch) :]
        for index, answer in analyse(batch, self.analysis, self.store, self.executor):
            self.show(curve_record(batch[index], answer))
        if complete or batch:
            self.write()
        return bool(new or self._waiting)

    def write(self) -> Result:
        """Write result.json, result.csv and report.html with all answers; returns the result. Earlier documents stay
        until there is an answer."""
        curves, notes = self._curves()
        pairs = [(curve, with_source_of(answer, curve)) for curve in curves if (answer := self._answer(curve))]
        document = result(pairs, self.command, date=self.date, notes=notes, errors=self.errors)
        if pairs or not self.outputs.listed_entry("result.json"):
            write_documents(self.outputs, pairs, document, draw=self.draw)
        return document

    @property
    def unreadable(self) -> int:
        """Number of files that cannot be read."""
        return sum(bool(content.problems) for _, content in self.files.values())

    def _answer(self, curve: RadiusCurve) -> Posterior | None:
        answer: Posterior | None = self.store.get(self.analysis.key(curve))
        return answer

    def _curves(self) -> tuple[list[RadiusCurve], list[str]]:
        """All curves, each recording once, with names and groups among all; and remarks on files and scales."""
        contents = [content for _, content in self.files.values()]
        curves = [curve for content in contents for curve in content.curves]
        curves, _, remarks = read_shots(curves, group=self.group)
        self._notify_once(*remarks)
        return curves, list(dict.fromkeys([remark for content in contents for remark in content.remarks] + remarks))

    def _read(self, path: Path, state: State) -> None:
        """Keep the content of a file; if it cannot be read, a curve with the reason."""
        try:
            content = self.read([path])
        except InputError as error:  # a setting that is wrong for this file
            content = CurveSet([], [f"{path}: {error}"], [])
        if self._state(path) != state:
            return  # it is being written
        if content.problems:
            self._notify_once(f"{content.problems[0]}; it is tried again when it changes")
            stem = {"name": path.stem, "group": path.stem, "source": printable(str(path))}
            content = content._replace(curves=[unusable_curve(content.problems[0], stem)])
        self.files[path] = state, content

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
