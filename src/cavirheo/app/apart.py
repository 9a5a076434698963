"""Files read in a process of its own: one that exhausts time or memory, or ends the process, ends nothing else.

What comes back is pickled between our own two processes; nothing that was uploaded is ever unpickled.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from dataclasses import replace
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from threading import Lock
from typing import Any

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.reading.shots import read_shots

MEMORY = 4 << 30  # bytes of address space that reading may take

Found = tuple[list[RadiusCurve], list[str]]


class Reader:
    """`read_shots` in a child process that stays warm from call to call and is replaced when it fails."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self._lock = Lock()
        self._child: SpawnProcess | None = None
        self._pipe: Connection | None = None
        self._context = multiprocessing.get_context("spawn")

    def start(self) -> None:
        """Begin to load, so that the first file need not wait."""
        with self._lock:
            self._ready()

    def read(self, files: Sequence[Path], **options: Any) -> Found:
        """As `read_shots`, with file names instead of paths in curves and problems.

        Raises:
            InputError: reading took too long or too much memory, or broke the process.
        """
        with self._lock:
            pipe = self._ready()
            names = ", ".join(path.name for path in files[:3]) + (", ..." if len(files) > 3 else "")
            try:
                pipe.send(([str(path) for path in files], options))
                if not pipe.poll(self.seconds):
                    self._end()
                    raise InputError(f"reading {names} took more than {self.seconds:g} s; is the file damaged?")
                answer = pipe.recv()
            except (EOFError, OSError):
                self._end()
                raise InputError(f"{names}: damaged so badly that reading it ended the reader") from None
        if isinstance(answer, InputError):
            raise answer
        curves, problems = answer
        folder = f"{files[0].parent}/" if files else ""
        return [_named(curve) for curve in curves], [problem.replace(folder, "") for problem in problems]

    def close(self) -> None:
        with self._lock:
            self._end()

    def _ready(self) -> Connection:
        if self._pipe is None or self._child is None or not self._child.is_alive():
            self._pipe, theirs = self._context.Pipe()
            self._child = self._context.Process(target=_serve, args=(theirs,), daemon=True)
            self._child.start()
            theirs.close()
        return self._pipe

    def _end(self) -> None:
        if self._child is not None and self._pipe is not None:
            self._child.kill()
            self._child.join()
            self._pipe.close()
        self._child = self._pipe = None


def _named(curve: RadiusCurve) -> RadiusCurve:
    """The curve without the names of the server's folders."""
    meta = {**curve.meta, "source": Path(curve.source).name}
    if "group_source" in meta:
        meta["group_source"] = meta["group"]
    return replace(curve, meta=meta)


def _serve(pipe: Connection) -> None:
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    except (ImportError, ValueError, OSError):  # no such limit on this system: the time limit stays
        pass
    while True:
        try:
            files, options = pipe.recv()
        except EOFError:
            return
        try:
            answer: Found | InputError = read_shots(files, **options)
        except MemoryError:
            answer = InputError("the file needs more memory than is allowed here")
        except Exception as error:
            answer = InputError(f"the file cannot be read ({type(error).__name__}: {error})")
        pipe.send(answer)
