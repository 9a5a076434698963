"""Store: answers by their keys, in memory and in a folder. Whatever ends a run, an answer that is kept stays."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar

from cavirheo.curve import RadiusCurve
from cavirheo.messages import Message
from cavirheo.physics.bubble import Bubble
from cavirheo.physics.media import Medium
from cavirheo.posterior import Checks, Diagnostics, Evidence, OtherAnswer, Posterior, WindowAnswer
from cavirheo.writing.document import into, whole
from cavirheo.writing.packing import decode, encode

_TYPES = (Posterior, Checks, Message, WindowAnswer, Evidence, Diagnostics, Bubble, OtherAnswer, RadiusCurve)
_KINDS: dict[str, Any] = {kind.__name__: kind for kind in _TYPES} | {"Medium": partial(Medium, unusual=True)}
_Value = TypeVar("_Value")


class Store:
    """Values by their keys. Many threads may use it.

    folder: a file for each, which is never seen half-written; None: memory alone. most: so many are held in memory, the
    latest ones; None: all. A value that has no file in the folder is held in any case. Only what this store itself has
    put there counts for `written`.
    """

    def __init__(self, folder: Path | None = None, most: int | None = None) -> None:
        self.folder, self.most = folder, most
        self.written: set[str] = set()
        self._held: OrderedDict[str, Future[Any]] = OrderedDict()
        self._lock = Lock()

    def get(self, key: str, kind: type[_Value] = Posterior) -> _Value | None:  # type: ignore[assignment]
        """What is kept under a key; None where there is nothing, or nothing of this kind that can be read."""
        with self._lock:
            held = self._held.get(key)
        if held is not None:
            value = held.result()
        elif (value := self.folder and read_kept(self._place(key), kind)) is not None:
            self._hold(key, value)
        return value if isinstance(value, kind) else None

    def put(self, key: str, value: Any, *, file: bool = True) -> None:
        """Keep a value, in a file unless `file` is False. Raises InputError: the folder cannot be written."""
        if self.folder and file:
            with into(self.folder):
                keep(self._place(key), value)
            self.written.add(key)
        self._hold(key, value)

    def once(self, key: str, function: Callable[[], _Value]) -> _Value:
        """What is held under a key, or what `function` returns. The first thread that asks calls it, and the others
        wait. All of them get its error, which is not kept."""
        with self._lock:
            mine = key not in self._held
            task: Future[_Value] = self._held.setdefault(key, Future())
            self._held.move_to_end(key)
            self._trim()
        if mine:
            try:
                task.set_result(function())
            except BaseException as error:  # raised again in every thread that waits
                with self._lock:
                    self._held.pop(key, None)
                task.set_exception(error)
        return task.result()

    def values(self, kind: type[_Value]) -> Iterable[_Value]:
        """All of a kind that are in files."""
        for place in sorted(self.folder.glob("*.npz")) if self.folder else ():
            if (value := read_kept(place, kind)) is not None:
                yield value

    def remove(self, keys: Iterable[str]) -> None:
        """Forget these, and the folder if nothing else is in it."""
        for key in keys:
            self._held.pop(key, None)
            if self.folder:
                place = self._place(key)
                for path in (place, place.with_name(f".{place.name}.part.npz")):
                    path.unlink(missing_ok=True)
        with suppress(OSError):  # there is none, or something else is in it
            if self.folder:
                self.folder.rmdir()

    def _place(self, key: str) -> Path:
        assert self.folder
        return self.folder / f"{key}.npz"

    def _hold(self, key: str, value: Any) -> None:
        task: Future[Any] = Future()
        task.set_result(value)
        with self._lock:
            self._held[key] = task
            self._trim()

    def _trim(self) -> None:
        """Let the oldest go where too many are held."""
        if self.most is None or len(self._held) <= self.most:
            return
        for key in list(self._held)[: len(self._held) - self.most]:
            if self.folder is None or self._place(key).exists():
                del self._held[key]


def keep(path: Path, value: Any) -> None:
    """An answer, a curve, or several of them in a tuple or a dict. Raises OSError."""
    with whole(path) as temporary:
        temporary.write_bytes(encode(value, default=str))


def read_kept(path: Path, kind: type[_Value]) -> _Value | None:
    """What `keep` wrote; None where there is nothing, or nothing of this kind that can be read."""
    with suppress(EOFError, OSError):  # whatever is wrong with it, the answer is found anew
        value = decode(path.read_bytes(), _KINDS)
        return value if isinstance(value, kind) else None
    return None
