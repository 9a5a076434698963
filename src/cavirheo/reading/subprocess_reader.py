"""Files read in a process of its own: one that exhausts time or memory, or ends the process, ends nothing else.

It answers by arrays and JSON (message.py): whatever a file makes of the process that reads it, nothing that comes from
there is executed.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import count
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Lock
from time import monotonic
from typing import Any

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.reading.message import decode, encode
from cavirheo.reading.recordings import examine
from cavirheo.reading.shots import Recordings, read_shots
from cavirheo.video.measurement import Measurement

MEMORY = 4 << 30  # bytes of address space that reading may take

_SPAWN = multiprocessing.get_context("spawn")

Found = tuple[list[RadiusCurve], list[str]]
Report = Callable[[float, str], Any]


class Reader:
    """A child process that reads files, stays warm from call to call, and is replaced when it fails."""

    def __init__(self, seconds: float, *, at_once: bool = True) -> None:
        """seconds: that a call may take. at_once: begin to load, so that the first file need not wait."""
        self.seconds, self._lock = seconds, Lock()
        self._child: Any = None
        if at_once:
            self._begin()

    def read(self, files: Sequence[Path | RadiusCurve], **options: Any) -> Found:
        """As `read_shots`, with file names instead of paths in curves and problems.

        Raises:
            InputError: reading took too long or too much memory, or broke the process.
        """
        paths = [Path(one.source) if isinstance(one, RadiusCurve) else one for one in files]
        given = [str(one) if isinstance(one, Path) else one for one in files]
        answer = self.ask(paths, (_read, given, options))
        folder = f"{paths[0].parent}/" if paths else ""
        problems = answer.problems + answer.remarks + answer.hints
        return [_named(curve) for curve in answer.curves], [problem.replace(folder, "") for problem in problems]

    def measure(self, path: Path, images: Path, most: float, say: Report, **options: Any) -> Measurement:
        """As `cavirheo.measure`; the frames, at most so many bytes, are left in the file `images` (.npy) and mapped.

        Raises InputError: as `read`.
        """
        found = self.ask([path], (_measure, str(path), str(images), most, options), say)
        return replace(found, recording=replace(found.recording, frames=np.load(images, mmap_mode="r")))

    def ask(self, paths: Sequence[Path], work: tuple[Any, ...], say: Report = lambda *_: None) -> Any:
        """What work, a function with its arguments after the first, the pipe to this process, finds there in files.

        Raises InputError: as `read`.
        """
        names = ", ".join(path.name for path in paths[:3]) + (", ..." if len(paths) > 3 else "")
        slow = f"reading {names} took more than {self.seconds:g} s; is the file damaged, or too long?"
        with self._lock:
            if self._child is None or not self._child.is_alive():
                self._replace()
            try:
                self._pipe.send(work)
                end, answer = monotonic() + self.seconds, 0.0
                while isinstance(answer, float):
                    say(answer, "of the frames")  # the share that is measured
                    require(self._pipe.poll(max(end - monotonic(), 0.0)), slow, "app.reading_too_slow")
                    answer = _decoded(self._pipe.recv_bytes())
            except BaseException as error:
                self._replace()
                ended = f"{names}: damaged so badly that reading it ended the reader"
                known = not isinstance(error, EOFError | OSError)
                raise error if known else InputError(ended, "app.reader_ended") from None
        if isinstance(answer, InputError):
            raise InputError(str(answer).replace(f"{paths[0].parent}/", ""), answer.code)
        return answer

    def close(self) -> None:
        with self._lock:
            self._end()

    def _begin(self) -> None:
        self._pipe, theirs = _SPAWN.Pipe()
        self._child = _SPAWN.Process(target=_serve, args=(theirs,), daemon=True)
        self._child.start()
        theirs.close()

    def _end(self) -> None:
        if self._child is not None:
            self._child.kill()
            self._child.join()
            self._pipe.close()

    def _replace(self) -> None:
        self._end()
        self._begin()


def _named(curve: RadiusCurve) -> RadiusCurve:
    """The curve without the names of the server's folders."""
    group: dict[str, Any] = {"group_source": curve.group} if "group_source" in curve.meta else {}
    return curve.labelled(source=Path(curve.source).name, **group)


def _decoded(message: bytes) -> Any:
    try:
        return decode(message)
    except Exception as error:  # a reader that sends anything else is damaged
        raise EOFError(f"no message of a reader ({type(error).__name__})") from error


def _serve(pipe: Connection) -> None:
    with suppress(ImportError, ValueError, OSError):  # no such limit on this system: the time limit stays
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    with suppress(EOFError):
        while True:
            work, *given = pipe.recv()
            try:
                answer = encode(work(pipe, *given))
            except InputError as error:
                answer = encode(error)
            except MemoryError:
                answer = encode(InputError("the file needs more memory than is allowed here", "app.out_of_memory"))
            except Exception as error:
                answer = encode(InputError(f"the file cannot be read ({type(error).__name__}: {error})"))
            pipe.send_bytes(answer)


def _read(_: Connection, files: list[str | RadiusCurve], options: dict[str, Any]) -> Recordings:
    return read_shots(files, **options)


def _measure(pipe: Connection, path: str, images: str, most: float, options: dict[str, Any]) -> Measurement:
    def begin(frames: int) -> Callable[[], None]:
        done = count(1)
        return lambda: pipe.send_bytes(encode(next(done) / frames))

    found, _ = examine(path, begin=begin, **options)
    seen = found.recording.frames
    large = f"{path}: its frames are {seen.nbytes / 1e6:.0f} MB; at most {most / 1e6:.0f} MB are shown here"
    require(seen.nbytes <= most, f"{large}: cut it to the bubble, or use cavirheo measure", "app.too_large")
    np.save(images, seen)
    return replace(found, recording=replace(found.recording, frames=seen[:0]))
