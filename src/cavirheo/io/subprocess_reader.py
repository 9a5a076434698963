"""Read files in child processes: a file that exhausts time or memory, or crashes its reader, affects nothing else.

Requests and answers are arrays and JSON: nothing that a child sends is executed, whatever a file does to the child.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from queue import LifoQueue
from typing import Any

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, listed, require
from cavirheo.io.shots import CurveSet, read_shots
from cavirheo.messages import Message
from cavirheo.writing.packing import decode, encode

MEMORY = 4 << 30  # bytes of address space that reading may take

_SENT_TYPES = (RadiusCurve, Message, CurveSet, InputError)
KINDS: dict[str, Any] = {kind.__name__: kind for kind in _SENT_TYPES}
_SPAWN = multiprocessing.get_context("spawn")


class Reader:
    """Child processes that read files, each one call at a time. They stay alive between the calls, and a process that
    fails is replaced."""

    def __init__(self, seconds: float, *, processes: int = 1, prestart: bool = True) -> None:
        """seconds: time limit of a call. prestart: start one process now, so that the first file need not wait."""
        self.seconds, self._processes = seconds, processes
        self._free: LifoQueue[_Child | None] = LifoQueue()  # the process used last comes first; None: not started
        for k in range(processes):
            self._free.put(_Child() if prestart and k == processes - 1 else None)

    def read(self, files: Sequence[Path | RadiusCurve], **options: Any) -> tuple[list[RadiusCurve], list[str]]:
        """Return (the curves, all problems, remarks and hints) of `read_shots` of files in one folder.

        Raises InputError: reading took too long or too much memory, or crashed the process.
        """
        paths = [Path(file.source) if isinstance(file, RadiusCurve) else file for file in files]
        contents = [
            file.labelled(source=path.name) if isinstance(file, RadiusCurve) else path.name
            for file, path in zip(files, paths, strict=True)
        ]
        answer = self.ask(paths, _read, contents, options)
        curves = []
        for curve in answer.curves:
            group: dict[str, Any] = {"group_source": curve.group} if "group_source" in curve.meta else {}
            curves.append(curve.labelled(source=Path(curve.source).name, **group))
        return curves, answer.problems + answer.remarks + answer.hints

    def ask(self, paths: Sequence[Path], function: Callable[..., Any], *arguments: Any) -> Any:
        """Return function(pipe, *arguments) of a child, which works in the folder of these paths: no message names it.

        Raises InputError: as `read`.
        """
        names = listed([path.name for path in paths], 3)
        slow = f"reading {names} took more than {self.seconds:g} s; is the file damaged, or too long?"
        child = self._free.get()
        try:
            if child is None or not child.process.is_alive():
                child = _Child()
            folder = str(paths[0].parent) if paths else "."
            child.pipe.send_bytes(encode((folder, function.__module__, function.__name__, *arguments)))
            require(child.pipe.poll(self.seconds), slow, "app.reading_too_slow")
            answer = decode(child.pipe.recv_bytes(), KINDS)
        except BaseException as error:  # after any error, Ctrl-C included, the state of the process is unknown
            if child is not None:
                child.end()
            child = _Child()
            if not isinstance(error, EOFError | OSError):
                raise
            message = f"{names}: damaged so badly that reading it ended the reader"
            raise InputError(message, "app.reader_ended") from None
        finally:
            self._free.put(child)
        if isinstance(answer, InputError):
            raise answer
        return answer

    def close(self) -> None:
        """End the processes, each after its current call."""
        for _ in range(self._processes):
            if child := self._free.get():
                child.end()


class _Child:
    def __init__(self) -> None:
        self.pipe, child_end = _SPAWN.Pipe()
        self.process = _SPAWN.Process(target=_serve, args=(child_end,), daemon=True)
        self.process.start()
        child_end.close()

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


def _serve(pipe: Connection) -> None:
    with suppress(ImportError, ValueError, OSError):  # no such limit on this system: only the time limit holds
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    home = os.getcwd()
    with suppress(EOFError):
        while True:
            folder, module, function, *arguments = decode(pipe.recv_bytes(), KINDS)
            try:
                os.chdir(folder)  # files have names without folders there
                answer = encode(getattr(import_module(module), function)(pipe, *arguments))
            except InputError as error:
                answer = encode(error)
            except MemoryError:
                answer = encode(InputError("the file needs more memory than is allowed here", "app.out_of_memory"))
            except Exception as error:  # libraries raise nearly anything for a damaged file; the child must survive it
                answer = encode(InputError(f"the file cannot be read ({type(error).__name__}: {error})"))
            os.chdir(home)
            pipe.send_bytes(answer)


def _read(_: Connection, files: list[str | RadiusCurve], options: dict[str, Any]) -> CurveSet:
    return read_shots(files, **options)
