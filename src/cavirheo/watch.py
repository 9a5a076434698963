"""Watching a folder during an experiment: each recording is answered once, when its file is complete.

A file is complete when its size and time are those of the previous look. `watched/` in the folder of the results holds
each answer by its key (workflow.py). So a run that is killed at any moment loses only the answers that it was
computing; the next one reads all files again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, printable
from cavirheo.inference.analysis import Analysis
from cavirheo.io.curves import unusable_curve
from cavirheo.io.files import measurement_files
from cavirheo.io.shots import CurveSet, read_shots
from cavirheo.parallel import cores
from cavirheo.posterior import Posterior
from cavirheo.reporting.record import Result
from cavirheo.video.formats import header_of, pixels_of
from cavirheo.workflow import Store, analyse, with_source_of

PAUSE = 0.4  # s between two looks at the folder
State = tuple[int, ...]  # size in bytes and time of the last change in ns, of a file and of its header
Pairs = list[tuple[RadiusCurve, Posterior]]


@dataclass(eq=False, repr=False)
class Watch:
    """The recordings of one folder and their answers.

    store: holds the answers. analysis: how curves are answered. group: as in `read_shots`. read: returns the curves of
    files. notify: called with a line on each problem. show: called with each new answer. publish: writes the
    document of all answers, with remarks on files and scales.
    """

    folder: Path
    store: Store
    analysis: Analysis
    group: str
    read: Callable[[list[Path]], CurveSet]
    notify: Callable[[str], None]
    show: Callable[[RadiusCurve, Posterior], None]
    publish: Callable[[Pairs, list[str]], Result]
    # state and content of all files that were read, also of those that have been moved since
    _files: dict[Path, tuple[State, CurveSet]] = field(init=False, default_factory=dict)
    _seen: dict[Path, State] = field(init=False, default_factory=dict)  # states of the files at the latest look
    _waiting: list[RadiusCurve] = field(init=False, default_factory=list)  # curves without an answer
    _said: set[str] = field(init=False, default_factory=set)

    def step(self) -> bool:
        """Look at the folder, read complete files and answer curves, a few for each core; returns whether something is
        left to do."""
        before, self._seen = self._seen, self._states()
        new = [path for path, state in self._seen.items() if path not in self._files or self._files[path][0] != state]
        complete = sorted((self._seen[path][1], path) for path in new if before.get(path) == self._seen[path])
        complete = complete[: 2 * cores()]  # these are answered before more are read
        for _, path in complete:
            self._read(path, self._seen[path])
        if complete:
            self._waiting = [curve for curve in self._curves()[0] if not self._answer(curve)]
        batch = self._waiting[: 2 * cores()]
        self._waiting = self._waiting[len(batch) :]
        unreadable = self.unreadable  # a line tells of them already
        for index, answer in analyse(batch, self.analysis, self.store):
            if batch[index].source not in unreadable:
                self.show(batch[index], answer)
        if complete or batch:
            self.write()
        return bool(new or self._waiting)

    def write(self) -> Result:
        """Write and return the document of all answers."""
        curves, notes = self._curves()
        pairs = [(curve, with_source_of(answer, curve)) for curve in curves if (answer := self._answer(curve))]
        return self.publish(pairs, notes)

    @property
    def unreadable(self) -> list[str]:
        """The files that cannot be read, as the sources of their curves."""
        return [content.curves[0].source for _, content in self._files.values() if content.problems]

    def _answer(self, curve: RadiusCurve) -> Posterior | None:
        return self.store.get(self.analysis.key(curve))

    def _curves(self) -> tuple[list[RadiusCurve], list[str]]:
        """All curves, each recording once, with names and groups among all; and remarks on files and scales."""
        contents = [content for _, content in self._files.values()]
        curves = [curve for content in contents for curve in content.curves]
        curves, _, remarks = read_shots(curves, group=self.group)
        self._notify_once(*remarks)
        return curves, list(dict.fromkeys([remark for content in contents for remark in content.remarks] + remarks))

    def _read(self, path: Path, state: State) -> None:
        """Keep the content of a file; if it cannot be read, a curve with the reason."""
        try:
            content = self.read([path])
            self.analysis.check(content.curves)
        except InputError as error:  # a setting that is wrong for this file
            content = CurveSet([], [f"{path}: {error}"], [])
        if self._state(path) != state:
            return  # it is being written
        if content.problems:
            self._notify_once(f"{content.problems[0]}; it is tried again when it changes")
            stem = {"name": path.stem, "group": path.stem, "source": printable(str(path))}
            content = content._replace(curves=[unusable_curve(content.problems[0], stem)])
        self._files[path] = state, content

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
