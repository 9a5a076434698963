"""Read files in a child process: a file that exhausts time or memory, or crashes its reader, affects nothing else.

Answers are arrays and JSON: nothing that a child sends is executed, whatever a file does to the child.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from threading import BoundedSemaphore
from typing import Any

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, listed
from cavirheo.io.shots import CurveSet, read_shots
from cavirheo.messages import Message
from cavirheo.writing.packing import decode, encode

MEMORY = 4 << 30  # bytes of address space that reading may take
KINDS: dict[str, Any] = {kind.__name__: kind for kind in (RadiusCurve, Message, CurveSet, InputError)}
_SPAWN = multiprocessing.get_context("spawn")


class Reader:
    """Reads files, each call in a process of its own, at most so many at a time."""

    def __init__(self, seconds: float, *, processes: int = 1) -> None:
        """seconds: time limit of a call."""
        self.seconds = seconds
        self._free = BoundedSemaphore(processes)

    def read(self, files: Sequence[Path | RadiusCurve], **options: Any) -> tuple[list[RadiusCurve], list[str]]:
        """Return (the curves, all problems, remarks and hints) of `read_shots` of files in one folder, in which the
        child works: no message names it.

        Raises InputError: reading took too long or too much memory, or crashed the process.
        """
        paths = [Path(file.source) if isinstance(file, RadiusCurve) else file for file in files]
        contents = [
            file.labelled(source=path.name) if isinstance(file, RadiusCurve) else path.name
            for file, path in zip(files, paths, strict=True)
        ]
        folder = str(paths[0].parent) if paths else "."
        with self._free:
            answer = self._answer((folder, contents, options), listed([path.name for path in paths], 3))
        if isinstance(answer, InputError):
            raise answer
        curves = []
        for curve in answer.curves:
            group: dict[str, Any] = {"group_source": curve.group} if "group_source" in curve.meta else {}
            curves.append(curve.labelled(source=Path(curve.source).name, **group))
        return curves, answer.problems + answer.remarks + answer.hints

    def _answer(self, request: tuple[Any, ...], names: str) -> Any:
        pipe, end_of_child = _SPAWN.Pipe(duplex=False)
        process = _SPAWN.Process(target=_read, args=(end_of_child, *request), daemon=True)
        process.start()
        end_of_child.close()
        try:
            if not pipe.poll(self.seconds):
                slow = f"reading {names} took more than {self.seconds:g} s; is the file damaged, or too long?"
                raise InputError(slow, "app.reading_too_slow")
            return decode(pipe.recv_bytes(), KINDS)
        except (EOFError, OSError):
            message = f"{names}: damaged so badly that reading it ended the reader"
            raise InputError(message, "app.reader_ended") from None
        finally:
            process.kill()
            process.join()
            pipe.close()


def _read(pipe: Connection, folder: str, files: list[str | RadiusCurve], options: dict[str, Any]) -> None:
    """Send what was read, or why not; in the child."""
    with suppress(ImportError, ValueError, OSError):  # no such limit on this system: only the time limit holds
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    os.chdir(folder)  # files have names without folders there
    try:
        answer = encode(read_shots(files, **options))
    except InputError as error:
        answer = encode(error)
    except MemoryError:
        answer = encode(InputError("the file needs more memory than is allowed here", "app.out_of_memory"))
    except Exception as error:  # libraries raise nearly anything for a damaged file
        answer = encode(InputError(f"the file cannot be read ({type(error).__name__}: {error})"))
    pipe.send_bytes(answer)
