"""Files read in a process of its own: one that exhausts time or memory, or ends the process, ends nothing else.

What comes back is pickled between our own two processes; nothing that was uploaded is ever unpickled.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Lock
from typing import Any

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.reading.shots import Recordings, read_shots

MEMORY = 4 << 30  # bytes of address space that reading may take

_SPAWN = multiprocessing.get_context("spawn")

Found = tuple[list[RadiusCurve], list[str]]


class Reader:
    """`read_shots` in a child process that stays warm from call to call and is replaced when it fails."""

    def __init__(self, seconds: float) -> None:
        self.seconds, self._lock = seconds, Lock()
        self._begin()

    def read(self, files: Sequence[Path], **options: Any) -> Found:
        """As `read_shots`, with file names instead of paths in curves and problems.

        Raises:
            InputError: reading took too long or too much memory, or broke the process.
        """
        names = ", ".join(path.name for path in files[:3]) + (", ..." if len(files) > 3 else "")
        with self._lock:
            if not self._child.is_alive():
                self._replace()
            try:
                self._pipe.send(([str(path) for path in files], options))
                slow = f"reading {names} took more than {self.seconds:g} s; is the file damaged?"
                require(self._pipe.poll(self.seconds), slow, "app.reading_too_slow")
                answer = self._pipe.recv()
            except (EOFError, OSError, InputError) as error:
                self._replace()
                ended = f"{names}: damaged so badly that reading it ended the reader"
                raise error if isinstance(error, InputError) else InputError(ended, "app.reader_ended") from None
        if isinstance(answer, InputError):
            raise answer
        curves, problems = answer.curves, answer.problems + answer.remarks
        folder = f"{files[0].parent}/" if files else ""
        return [_named(curve) for curve in curves], [problem.replace(folder, "") for problem in problems]

    def close(self) -> None:
        with self._lock:
            self._end()

    def _begin(self) -> None:
        """Begin to load, so that the next file need not wait."""
        self._pipe, theirs = _SPAWN.Pipe()
        self._child = _SPAWN.Process(target=_serve, args=(theirs,), daemon=True)
        self._child.start()
        theirs.close()

    def _end(self) -> None:
        self._child.kill()
        self._child.join()
        self._pipe.close()

    def _replace(self) -> None:
        self._end()
        self._begin()


def _named(curve: RadiusCurve) -> RadiusCurve:
    """The curve without the names of the server's folders."""
    meta = {**curve.meta, "source": Path(curve.source).name}
    if "group_source" in meta:
        meta["group_source"] = meta["group"]
    return replace(curve, meta=meta)


def _serve(pipe: Connection) -> None:
    with suppress(ImportError, ValueError, OSError):  # no such limit on this system: the time limit stays
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    with suppress(EOFError):
        while True:
            files, options = pipe.recv()
            try:
                answer: Recordings | InputError = read_shots(files, **options)
            except MemoryError:
                answer = InputError("the file needs more memory than is allowed here", "app.out_of_memory")
            except Exception as error:
                answer = InputError(f"the file cannot be read ({type(error).__name__}: {error})")
            pipe.send(answer)
