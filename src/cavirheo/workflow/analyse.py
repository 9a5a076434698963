"""Curves answered one by one, each taken from a store if it is there and kept as soon as it is found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.inference.analysis import Analysis
from cavirheo.parallel import Executor, Threads, cores
from cavirheo.posterior import Posterior
from cavirheo.workflow.store import Store
from cavirheo.writing.terminal import bar, say

HELD = 500  # answers of a run; of more, none is held that can be read again


def analyse(
    curves: Sequence[RadiusCurve],
    analysis: Analysis,
    store: Store,
    executor: Executor | None = None,
    *,
    starts: Sequence[Posterior] | None = None,
    visible: bool = False,
) -> Iterator[tuple[int, Posterior]]:
    """(index of the curve, its answer): those that the store has first, then the others as they are found.

    executor: where each is found; by default on all cores of this machine. starts: a first answer of each curve, as of
    `Analysis.answer`. visible: show a bar on stderr. A failed answer is held in memory alone, because another run may
    have more memory; that of a curve that cannot be used has a file. Closing the iterator drops what has not begun.
    """
    keys, left = [analysis.key(curve) for curve in curves], list[int]()
    for index, (curve, key) in enumerate(zip(curves, keys, strict=True)):
        if answer := store.get(key):
            yield index, of_file(answer, curve)
        else:
            left.append(index)
    if not left:
        return
    inner = 1 if executor else max(cores() // len(left), 1)
    jobs = [(curves[index], starts[index] if starts else None) for index in left]
    with (
        bar(analysis.doing, len(left), visible=visible) as advance,
        closing((executor or Threads()).flow(partial(_answer, analysis, inner), jobs)) as flow,
    ):
        for place, answer in flow:
            fine = answer.checks.verdict != "failed" or bool(jobs[place][0].unusable)
            store.put(keys[left[place]], answer, file=fine)
            advance()
            yield left[place], answer


def _answer(analysis: Analysis, workers: int, job: tuple[RadiusCurve, Posterior | None]) -> Posterior:
    """A unit of work for an executor."""
    return analysis.answer(*job, workers=workers)


def of_file(answer: Posterior, curve: RadiusCurve) -> Posterior:
    """An answer as that of this file, whichever file held the recording when it was found."""
    return replace(answer, provenance={**answer.provenance, "source_sha256": curve.source_sha256})


class Answers(Sequence[Posterior]):
    """The answers of the curves in `indices`, in their order, each from the store when it is asked for. Raises
    InputError: its file is gone."""

    def __init__(self, store: Store, keys: Sequence[str], indices: Sequence[int]) -> None:
        self.indices: list[int] = sorted(indices)
        self._store, self._keys = store, keys

    def __len__(self) -> int:
        return len(self.indices)

    def numbered(self) -> Iterator[tuple[int, Posterior]]:
        """(index of the curve, its answer)."""
        return zip(self.indices, self, strict=True)

    def __getitem__(self, place: Any) -> Any:
        if answer := self._store.get(self._keys[self.indices[place]]):
            return answer
        message = f"an answer in {self._store.folder} is gone or was changed while it was needed: the same command "
        raise InputError(f"{message}finds it anew", "unfinished.gone")


class Unfinished:
    """The answers of one command into the folder `out`, kept in `unfinished/` there until its documents are complete:
    the same command takes them up after Ctrl-C, a kill or a full disk. After Ctrl-C `interrupted` is set, and nothing
    more is begun.

    Raises:
        InputError: something else has the name of that folder.
    """

    def __init__(self, out: str | Path, *, visible: bool = True, executor: Executor | None = None) -> None:
        self.store = Store(Path(out) / "unfinished")
        self.visible, self.executor, self.interrupted = visible, executor, False
        self._keys: set[str] = set()  # of all that this run may keep
        folder = self.store.folder
        way = f"{folder} must be a folder, for answers are kept there: give another place with -o"
        require(folder is None or folder.is_dir() or not folder.exists(), way, "document.folder")

    def answers(
        self, curves: Sequence[RadiusCurve], analysis: Analysis, starts: Sequence[Posterior] | None = None
    ) -> Answers:
        """The answers of the curves; not all of them if it is interrupted. starts: as of `analyse`."""
        keys = [analysis.key(curve) for curve in curves]
        self._keys.update(keys)
        self.store.most = 0 if len(curves) > HELD else None
        indices: list[int] = []
        if self.interrupted:
            return Answers(self.store, keys, indices)
        taken = sum(self.store.get(key) is not None for key in set(keys) - self.store.written)
        if taken and self.visible:
            message = f"{taken} of {len(curves)} answers are taken from {self.store.folder}"
            say(f"{message}, where an unfinished run left them")
        try:
            for index, _ in analyse(curves, analysis, self.store, self.executor, starts=starts, visible=self.visible):
                indices.append(index)
        except KeyboardInterrupt:
            self.interrupted = True
        return Answers(self.store, keys, indices)

    def note(self, count: int, total: int) -> str:
        """What is to be said of a run that was interrupted; nothing of another."""
        message = f"interrupted: {count} of {total} answered; the same command again answers the rest"
        return message if self.interrupted else ""

    def remove(self) -> None:
        """To be called when all documents are complete. What another run left here is kept for it."""
        self.store.remove(self._keys)
