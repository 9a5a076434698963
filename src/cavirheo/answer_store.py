"""Answers kept one by one while a run goes on: the same command takes them up after Ctrl-C, a kill or a full disk.

`unfinished/` in the folder of the results holds a file for each, which is never seen half-written. Its name is a hash
of all that the answer depends on: the curve, the settings, the model, our version.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.parallel import Executor, Step, Threads, one_of
from cavirheo.physics.bubble import Bubble
from cavirheo.physics.media import Medium
from cavirheo.posterior import Checks, Diagnostics, Evidence, OtherAnswer, Posterior, WindowAnswer
from cavirheo.writing.document import into, whole
from cavirheo.writing.packing import pack, unpack
from cavirheo.writing.terminal import bar, say

_TYPES = (Posterior, Checks, WindowAnswer, Evidence, Diagnostics, Bubble, OtherAnswer, RadiusCurve)
_KINDS: dict[str, Any] = {kind.__name__: kind for kind in _TYPES} | {"Medium": partial(Medium, unusual=True)}
_Kept = TypeVar("_Kept")
_Item = TypeVar("_Item")
HELD = 500  # answers of a run; of more, none is held that can be read again


class KeptAnswers(Mapping[int, Posterior]):
    """Answers by the index of their curve, in order; those that are in files are read each time that they are asked
    for. Raises InputError: such a file is gone."""

    def __init__(self, held: Mapping[int, Posterior], files: Mapping[int, Path]) -> None:
        self._held, self._files = held, files
        self._order = sorted({*held, *files})

    def __iter__(self) -> Iterator[int]:
        return iter(self._order)

    def __len__(self) -> int:
        return len(self._order)

    def __getitem__(self, index: int) -> Posterior:
        if index in self._held:
            return self._held[index]
        answer, path = read_kept(self._files[index], Posterior), self._files[index]
        message = f"{path} is gone or was changed while it was needed: the same command finds this answer anew"
        if answer is None:
            raise InputError(message, "unfinished.gone")
        return answer


class InOrder(Sequence[_Item]):
    """Items made when they are asked for: `item(i)` for i in range(count)."""

    def __init__(self, count: int, item: Callable[[int], _Item]) -> None:
        self._places, self._item = range(count), item

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, index: Any) -> Any:
        found = self._places[index]
        return [self._item(i) for i in found] if isinstance(found, range) else self._item(found)


class Unfinished:
    """The answers of one run into the folder `out`. After Ctrl-C `interrupted` is set, and nothing more is begun.

    executor: where each is found by itself; by default the verb of a step spreads them over the cores of this machine.
    Of more than HELD, each is found by itself in any case, so that they need not be held.
    """

    def __init__(self, out: str | Path, *, shown: bool = True, executor: Executor | None = None) -> None:
        self.folder, self.shown, self.interrupted = Path(out) / "unfinished", shown, False
        self.executor = executor
        self._own: set[Path] = set()  # written by this run
        self._places: set[Path] = set()  # of all that this run may keep
        way = f"{self.folder} must be a folder, for answers are kept there: give another place with -o"
        require(self.folder.is_dir() or not self.folder.exists(), way, "document.folder")

    def answers(self, curves: Sequence[RadiusCurve], *steps: Step) -> Mapping[int, Posterior]:
        """The answers of the last step by the index of the curve, in order; not all of them if it is interrupted.

        What is kept is taken, and the step before is asked only for the rest. A failed answer is not kept: another try
        may have more memory.
        """
        *before, step = steps
        places = self._kept_at(curves, steps)
        many = len(curves) > HELD
        found: dict[int, Posterior] = {}  # in memory
        files: dict[int, Path] = {}
        for i, place in enumerate(places):
            if answer := read_kept(place, Posterior):
                if many:
                    files[i] = place
                else:
                    found[i] = answer
        there = {*found, *files}
        taken = sum(places[i] not in self._own for i in there)
        if taken and self.shown:
            said = f"{taken} of {len(curves)} answers are taken from {self.folder}"
            say(f"{said}, where an unfinished run left them")
        for end in range(1, len(steps)):
            self._kept_at(curves, steps[:end])
        left = [i for i in range(len(curves)) if i not in there]
        mine = [curves[i] for i in left]
        begun = self.answers(mine, *before) if before and left else {}
        if not left or self.interrupted:
            return KeptAnswers(found, files) if many else found

        def done(k: int, answer: Posterior) -> None:
            place = places[left[k]]
            failed = answer.checks.verdict == "failed"
            if failed or not many:  # first, for an interruption may come at any moment
                found[left[k]] = answer
            if not failed:
                with into(self.folder):
                    keep(place, answer)
                self._own.add(place)
                if many:
                    files[left[k]] = place
            advance()

        executor = self.executor or (Threads() if many else None)
        try:
            with bar(step.doing, len(left), shown=self.shown) as advance:
                if executor:
                    work = partial(one_of, step.verb, dict(step.settings))
                    jobs = InOrder(len(left), lambda k: (mine[k], begun[k]) if before else (mine[k],))
                    with closing(executor.flow(work, jobs)) as flow:
                        for k, answer in flow:
                            done(k, answer)
                else:
                    given = [list(begun.values())] if before else []
                    found.update(zip(left, step.verb(mine, *given, done=done, **step.settings), strict=True))
        except KeyboardInterrupt:
            self.interrupted = True
        return KeptAnswers(found, files) if many else dict(sorted(found.items()))

    def _kept_at(self, curves: Sequence[RadiusCurve], steps: Sequence[Step]) -> list[Path]:
        """Where the answers of the last step are kept."""
        found = [self.folder / f"{_key(curve, steps)}.npz" for curve in curves]
        self._places.update(found)
        return found

    def note(self, answered: int, asked: int) -> str:
        """What is to be said of a run that was interrupted; nothing of another."""
        said = f"interrupted: {answered} of {asked} answered; the same command again answers the rest"
        return said if self.interrupted else ""

    def remove(self) -> None:
        """To be called when all documents are complete. What another run left here is kept for it."""
        for path in self._places:
            path.unlink(missing_ok=True)
            path.with_name(f".{path.name}.part.npz").unlink(missing_ok=True)
        with suppress(OSError):  # there is none, or something else is in it
            self.folder.rmdir()


def keep(path: Path, value: Any) -> None:
    """An answer, a curve, or several of them in a tuple or a dict: arrays as such, all else as JSON. Numbers come back
    to the last bit. Raises OSError."""
    arrays: list[np.ndarray] = []
    text = json.dumps(pack(value, arrays), default=str)
    with whole(path) as temporary:
        np.savez(temporary, np.frombuffer(text.encode(), np.uint8), *arrays)


def read_kept(path: Path, kind: type[_Kept]) -> _Kept | None:
    """What `keep` wrote; None where there is nothing, or nothing of this kind that can be read."""
    with suppress(Exception), np.load(path) as file:  # whatever is wrong with it, the answer is found anew
        arrays = [file[name] for name in file.files]
        value = unpack(json.loads(arrays[0].tobytes()), arrays[1:], _KINDS)
        return value if isinstance(value, kind) else None
    return None


def _key(curve: RadiusCurve, steps: Sequence[Step]) -> str:
    """Of all samples and words of the curve, and of all that is done to it."""
    content = [[field.name, getattr(curve, field.name)] for field in fields(curve)]
    return key_of([[step.identity for step in steps], content])


def key_of(content: Any) -> str:
    """SHA-256 of whatever `keep` can keep."""
    arrays: list[np.ndarray] = []
    text = json.dumps(pack(content, arrays), default=str)
    digest = hashlib.sha256(text.encode())
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
    return digest.hexdigest()
