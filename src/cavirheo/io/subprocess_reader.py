"""Read files in child processes: a file that exhausts time or memory, or crashes its reader, affects nothing else.

Requests and answers are arrays and JSON: nothing that a child sends is executed, whatever a file does to the child.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from itertools import count
from multiprocessing.connection import Connection
from pathlib import Path
from queue import LifoQueue
from time import monotonic
from typing import Any

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.io.shots import CurveSet, read_shots
from cavirheo.io.videos import examine
from cavirheo.messages import Message
from cavirheo.video.frames import Footage
from cavirheo.video.measurement import Measurement, StatedNumber
from cavirheo.video.track import Track
from cavirheo.writing.packing import decode, encode

MEMORY = 4 << 30  # bytes of address space that reading may take

_SENT_TYPES = (RadiusCurve, Message, CurveSet, Footage, Measurement, StatedNumber, Track, InputError)
KINDS: dict[str, Any] = {kind.__name__: kind for kind in _SENT_TYPES}
_SPAWN = multiprocessing.get_context("spawn")
Report = Callable[[float, str], Any]


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
        """Return (the curves, all problems, remarks and hints) of `read_shots`, without the names of folders.

        Raises InputError: reading took too long or too much memory, or crashed the process.
        """
        paths = [Path(file.source) if isinstance(file, RadiusCurve) else file for file in files]
        contents = [str(file) if isinstance(file, Path) else file for file in files]
        answer = self.ask(paths, (_read, contents, options))
        folder = f"{paths[0].parent}/" if paths else ""
        remarks = [text.replace(folder, "") for text in answer.problems + answer.remarks + answer.hints]
        curves = []
        for curve in answer.curves:
            group: dict[str, Any] = {"group_source": curve.group} if "group_source" in curve.meta else {}
            curves.append(curve.labelled(source=Path(curve.source).name, **group))
        return curves, remarks

    def measure(self, path: Path, images: Path, limit: float, report: Report, **options: Any) -> Measurement:
        """Measure as `cavirheo.measure`; the frames, `limit` bytes at most, are saved in `images` (.npy) and mapped."""
        measurement = self.ask([path], (_measure, str(path), str(images), limit, options), report)
        footage = replace(measurement.recording, frames=np.load(images, mmap_mode="r"))
        return replace(measurement, recording=footage)

    def ask(self, paths: Sequence[Path], call: tuple[Any, ...], report: Report = lambda *_: None) -> Any:
        """Return the result of `call`, (function, *arguments), in a child, which puts its pipe before the arguments.

        Raises InputError: as `read`.
        """
        names = ", ".join(path.name for path in paths[:3]) + (", ..." if len(paths) > 3 else "")
        slow = f"reading {names} took more than {self.seconds:g} s; is the file damaged, or too long?"
        child = self._free.get()
        try:
            if child is None or not child.process.is_alive():
                child = _Child()
            function, *arguments = call
            child.pipe.send_bytes(encode((function.__module__, function.__name__, *arguments)))
            end, answer = monotonic() + self.seconds, 0.0
            while isinstance(answer, float):
                report(answer, "of the frames")  # the share measured so far
                require(child.pipe.poll(max(end - monotonic(), 0.0)), slow, "app.reading_too_slow")
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
            raise InputError(str(answer).replace(f"{paths[0].parent}/", ""), answer.code)
        return answer

    def close(self) -> None:
        """End the processes, each after its current call."""
        for _ in range(self._processes):
            if child := self._free.get():
                child.end()


class _Child:
    """One process, and the pipe to it."""

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
    with suppress(EOFError):
        while True:
            module, function, *arguments = decode(pipe.recv_bytes(), KINDS)
            try:
                answer = encode(getattr(import_module(module), function)(pipe, *arguments))
            except InputError as error:
                answer = encode(error)
            except MemoryError:
                answer = encode(InputError("the file needs more memory than is allowed here", "app.out_of_memory"))
            except Exception as error:  # libraries raise nearly anything for a damaged file; the child must survive it
                answer = encode(InputError(f"the file cannot be read ({type(error).__name__}: {error})"))
            pipe.send_bytes(answer)


def _read(_: Connection, files: list[str | RadiusCurve], options: dict[str, Any]) -> CurveSet:
    return read_shots(files, **options)


def _measure(pipe: Connection, path: str, images: str, limit: float, options: dict[str, Any]) -> Measurement:
    def begin(frames: int) -> Callable[[], None]:
        frame = count(1)
        return lambda: pipe.send_bytes(encode(next(frame) / frames))

    measurement, _ = examine(path, begin=begin, **options)
    frames = measurement.recording.frames
    message = f"{path}: its frames are {frames.nbytes / 1e6:.0f} MB; at most {limit / 1e6:.0f} MB are shown here"
    require(frames.nbytes <= limit, f"{message}: cut it to the bubble, or use cavirheo measure", "app.too_large")
    np.save(images, frames)
    return replace(measurement, recording=replace(measurement.recording, frames=frames[:0]))
