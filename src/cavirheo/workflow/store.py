"""Answers by their keys in a folder; and the analysis of curves, which stores each answer at once: it remains, whatever
ends the run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
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

UNFINISHED = "unfinished"  # subfolder with the answers of a command until its documents are complete
_TYPES = (Posterior, Checks, Message, Evidence, Diagnostics, Bubble, RadiusCurve)
_KINDS: dict[str, Any] = {kind.__name__: kind for kind in _TYPES} | {"Medium": partial(Medium, unusual=True)}


class Store:
    """Answers by their keys. `folder` has a file for each, written completely or not at all; those that were used are
    in memory, too (an answer takes about 50 kB).

    Raises InputError: `folder` is a link or no folder.
    """

    def __init__(self, folder: Path) -> None:
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            message = f"{folder} must be a folder and no link, for answers are kept there: give another place with -o"
            raise InputError(message, "document.folder")
        self.folder = folder
        self._used: dict[str, Any] = {}

    def get(self, key: str) -> Any:
        """The value of a key; None if there is none that can be read."""
        if key not in self._used:
            with suppress(EOFError, OSError):  # a missing or damaged file: the answer is computed again
                self._used[key] = decode(self._file(key).read_bytes(), _KINDS)
        return self._used.get(key)

    def put(self, key: str, value: Any, *, file: bool = True) -> None:
        """Store a value; in a file, too, unless `file` is False. Raises InputError: the folder cannot be written."""
        if file:
            with writable_folder(self.folder), atomic_file(self._file(key)) as temporary:
                temporary.write_bytes(encode(value, default=str))
        self._used[key] = value

    def remove_used(self) -> None:
        """Remove the values that were used, and the folder if it is then empty. Values of other runs stay."""
        for key in self._used:
            self._file(key).unlink(missing_ok=True)
            part_of(self._file(key)).unlink(missing_ok=True)
        self._used.clear()
        with suppress(OSError):  # there is no folder, or it is not empty
            self.folder.rmdir()

    def _file(self, key: str) -> Path:
        return self.folder / f"{key}.npz"


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


def analyse_all(
    curves: Sequence[RadiusCurve],
    analyses: Mapping[str, Analysis],
    store: Store,
    executor: Executor | None = None,
    *,
    visible: bool = True,
) -> dict[str, dict[int, Posterior]]:
    """The answers of each analysis by the indices of their curves, ascending. After Ctrl-C they are not complete: no
    further curve is begun."""
    answers = {name: dict[int, Posterior]() for name in analyses}
    kept = sum(store.get(analysis.key(curve)) is not None for analysis in analyses.values() for curve in curves)
    if kept and visible:
        total = len(curves) * len(analyses)
        say(f"{kept} of {total} answers are taken from {store.folder}, where an unfinished run left them")
    with suppress(KeyboardInterrupt):
        for name, analysis in analyses.items():
            for index, answer in analyse(curves, analysis, store, executor, visible=visible):
                answers[name][index] = answer
    return {name: dict(sorted(found.items())) for name, found in answers.items()}


def with_source_of(answer: Posterior, curve: RadiusCurve) -> Posterior:
    """The answer with the SHA-256 of this curve's file; the recording may have been answered from another file."""
    return replace(answer, provenance={**answer.provenance, "source_sha256": curve.source_sha256})
