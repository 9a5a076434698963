"""A run holds the folders that it writes into, and knows its own answers again: those of another run stay.

A lock that ends with the process is held on a hidden file in each folder, so that a run which was killed blocks none.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from cavirheo.errors import InputError, printable

try:
    import fcntl
except ModuleNotFoundError:  # Windows, where no folder is held
    fcntl = None  # type: ignore[assignment]

LOCK = ".cavirheo.lock"  # in a folder while a run holds it


@dataclass(eq=False)
class Claim:
    """One run of a command.

    Attributes:
        command: what was typed.
        request: the verb, its inputs and every option that an answer depends on, as JSON can hold them.
        replace: whether answers of other runs may be replaced.
    """

    command: str
    request: Mapping[str, Any]
    replace: bool = False
    inputs: list[str] = field(default_factory=list)  # SHA-256 of inputs without a name
    _held: dict[Path, IO[str]] = field(default_factory=dict)
    _new: list[Path] = field(default_factory=list)  # folders that were made

    @property
    def key(self) -> str:
        """By which the run is known again: the same command with the same inputs has it too."""
        text = json.dumps([self.request, self.inputs], sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def hold(self, folder: Path, new: list[Path]) -> None:
        """Until the run ends. new: what was made for it, removed then if it is empty. Raises OSError, and InputError:
        another run holds it."""
        place = Path(os.path.realpath(folder)) / LOCK
        self._new += new
        if fcntl is None or place in self._held:
            return
        while True:
            file = place.open("a+", encoding="utf-8", errors="replace")
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.seek(0)
                holder = printable(file.read(200)) or "a process of this machine"
                file.close()
                message = (
                    f"{folder} is in use by another run ({holder}): wait until it ends, or name another folder by -o"
                )
                raise InputError(message, "document.busy") from None
            except OSError:  # this file system has no locks
                file.close()
                place.unlink(missing_ok=True)
                return
            with suppress(FileNotFoundError):  # removed by the run before, in this moment
                if os.path.samestat(os.fstat(file.fileno()), place.stat()):
                    break
            file.close()
        self._held[place] = file
        file.truncate(0)
        file.write(f"process {os.getpid()}: {self.command}"[:200])
        file.flush()

    def release(self) -> None:
        """The folders are free, and those that were made and are empty are gone."""
        for place, file in self._held.items():
            with suppress(OSError):
                place.unlink()
            with suppress(OSError):  # a full disk
                file.close()
        self._held.clear()
        for folder in self._new:
            with suppress(OSError):  # something is in it
                folder.rmdir()


_CLAIM: ContextVar[Claim | None] = ContextVar("claim", default=None)


def current() -> Claim | None:
    """That of the command that runs; None in Python."""
    return _CLAIM.get()


@contextmanager
def claimed(claim: Claim) -> Iterator[None]:
    """While a command runs, or a call from Python writes."""
    before = _CLAIM.set(claim)
    try:
        yield
    finally:
        _CLAIM.reset(before)
        claim.release()
