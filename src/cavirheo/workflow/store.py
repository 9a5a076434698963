"""Answers by their keys, in memory and in a folder; and the analysis of curves, which stores each answer at once: it
remains, whatever ends the run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference.analysis import Analysis
from cavirheo.messages import Message
from cavirheo.parallel import Executor
from cavirheo.physics.bubble import Bubble
from cavirheo.physics.media import Medium
from cavirheo.posterior import Checks, Diagnostics, Evidence, Posterior
from cavirheo.writing.document import atomic_file, part_of, writable_folder
from cavirheo.writing.packing import decode, encode
from cavirheo.writing.terminal import progress_bar, say

_TYPES = (Posterior, Checks, Message, Evidence, Diagnostics, Bubble, RadiusCurve)
_KINDS: dict[str, Any] = {kind.__name__: kind for kind in _TYPES} | {"Medium": partial(Medium, unusual=True)}


class Store:
    """Values by their keys. Many threads may use a store.

    folder: has a file for each value, written completely or not at all; None: values are in memory alone. capacity:
    only so many of the latest values are held in memory; None: all (an answer takes about 50 kB). Raises InputError:
    `folder` is a link or no folder.
    """

    def __init__(self, folder: Path | None = None, capacity: int | None = None) -> None:
        if folder and (folder.is_symlink() or (folder.exists() and not folder.is_dir())):
            message = f"{folder} must be a folder and no link, for answers are kept there: give another place with -o"
            raise InputError(message, "document.folder")
        self.folder = folder
        self.capacity = capacity
        self._latest: dict[str, Any] = {}  # values in memory, the latest last
        self._lock = Lock()

    def get(self, key: str) -> Posterior | None:
        """The answer of a key; None if there is none that can be read."""
        value = self._latest.get(key)
        if value is None and (value := self._read(key)) is not None:
            self._remember(key, value)
        return value if isinstance(value, Posterior) else None

    def put(self, key: str, value: Any, *, file: bool = True) -> None:
        """Store an answer, a curve, or several of them in a tuple or a dict; in a file, too, unless `file` is False.
        Raises InputError: the folder cannot be written."""
        if self.folder and file:
            with writable_folder(self.folder), atomic_file(self.folder / f"{key}.npz") as temporary:
                temporary.write_bytes(encode(value, default=str))
        self._remember(key, value)

    def values(self) -> list[Any]:
        """All values in files; None for one that cannot be read."""
        return [self._read(path.stem) for path in sorted(self.folder.glob("*.npz"))] if self.folder else []

    def remove(self, keys: Iterable[str]) -> None:
        """Remove the values of these keys, and the folder if it is then empty."""
        for key in keys:
            self._latest.pop(key, None)
            if self.folder:
                file = self.folder / f"{key}.npz"
                for path in (file, part_of(file)):
                    path.unlink(missing_ok=True)
        if self.folder:
            with suppress(OSError):  # there is no folder, or it is not empty
                self.folder.rmdir()

    def _read(self, key: str) -> Any:
        """The value in the file of a key; None if it cannot be read."""
        with suppress(EOFError, OSError):  # a missing or damaged file: the answer is computed again
            return decode((self.folder / f"{key}.npz").read_bytes(), _KINDS) if self.folder else None
        return None

    def _remember(self, key: str, value: Any) -> None:
        with self._lock:
            self._latest[key] = value
            if self.capacity is not None and len(self._latest) > self.capacity:
                del self._latest[next(iter(self._latest))]


def analyse(
    curves: Sequence[RadiusCurve],
    analysis: Analysis,
    store: Store,
    executor: Executor | None = None,
    *,
    visible: bool = False,
) -> Iterator[tuple[int, Posterior]]:
    """(index of the curve, its answer): first the answers that the store has, then the others as they are computed.

    executor: where they are computed; by default on all cores of this machine. visible: show a bar on stderr. A failed
    answer is held in memory alone, because another run may have more memory; the answer of an unusable curve has a
    file. Closing the iterator drops curves not yet begun.
    """
    keys = [analysis.key(curve) for curve in curves]
    missing = list[int]()
    for index, (curve, key) in enumerate(zip(curves, keys, strict=True)):
        if answer := store.get(key):
            yield index, with_source_of(answer, curve)
        else:
            missing.append(index)
    if not missing:
        return
    queue = [curves[index] for index in missing]
    progress = progress_bar(analysis.activity, len(missing), visible=visible)
    with progress as advance, closing(analysis.flow(queue, executor)) as flow:
        for place, answer in flow:
            to_file = answer.checks.verdict != "failed" or bool(queue[place].unusable)
            store.put(keys[missing[place]], answer, file=to_file)
            advance()
            yield missing[place], answer


def with_source_of(answer: Posterior, curve: RadiusCurve) -> Posterior:
    """The answer with the SHA-256 of this curve's file; the recording may have been answered from another file."""
    return replace(answer, provenance={**answer.provenance, "source_sha256": curve.source_sha256})


class Unfinished:
    """The answers of one command that writes into the folder `out`, in `out`/unfinished until its documents are
    complete: the same command continues after Ctrl-C, a kill or a full disk. After Ctrl-C `interrupted` is True, and
    no further curve is begun. Raises InputError: `out`/unfinished is not a folder."""

    def __init__(self, out: str | Path, *, visible: bool = True, executor: Executor | None = None) -> None:
        self.store = Store(Path(out) / "unfinished")
        self.visible = visible
        self.executor = executor
        self.interrupted = False
        self._keys: set[str] = set()  # of all answers that this run may store

    def answers(self, curves: Sequence[RadiusCurve], analysis: Analysis) -> dict[int, Posterior]:
        """The answers by the indices of their curves, ascending; not all of them after an interruption."""
        if self.interrupted:
            return {}
        new_keys = {analysis.key(curve) for curve in curves} - self._keys
        self._keys |= new_keys
        taken = sum(self.store.get(key) is not None for key in new_keys)
        if taken and self.visible:
            place = self.store.folder
            say(f"{taken} of {len(curves)} answers are taken from {place}, where an unfinished run left them")
        answers = dict[int, Posterior]()
        try:
            answers.update(analyse(curves, analysis, self.store, self.executor, visible=self.visible))
        except KeyboardInterrupt:
            self.interrupted = True
        return dict(sorted(answers.items()))

    def note(self, count: int, total: int) -> str:
        """A note on an interrupted run; empty for any other run."""
        if not self.interrupted:
            return ""
        return f"interrupted: {count} of {total} answered; the same command again answers the rest"

    def remove(self) -> None:
        """Remove this run's answers, when all documents are complete. Answers of other runs stay."""
        self.store.remove(self._keys)
