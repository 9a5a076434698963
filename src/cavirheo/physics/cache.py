"""Compiled functions are kept on disk, so that only the first start compiles: like numba's cache, but more robust.

numba's cache loads any file that it finds (an empty or truncated file makes every later call fail), needs a writable
folder, and keeps an index that two simultaneous processes can make inconsistent. Here every compiled function is one
file. Its name has a hash of all that the code depends on, and it begins with its own checksum. A damaged file is
compiled again, a file in a read-only folder is used, and where no folder is writable the code stays in memory.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any
from uuid import uuid4

import numba
from numba.core import caching, config
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps
from numba.misc.appdirs import AppDirs

_DIGEST = 32  # bytes of sha256
NOTICES: dict[str, str] = {}  # by function ("solver.integrate"): a message on stderr, once, before it is compiled


def compiled(function: Callable[..., Any], *, counted: bool = True) -> Any:
    """`function`, compiled by numba when it is first called. "contract" fuses a product and a sum into one operation if
    the machine has it, which gains 9 %; other fastmath flags make the last bits depend on the addresses of arrays.
    counted: whether references to arrays are counted."""
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}, "_nrt": counted}
    dispatcher: Any = numba.njit(**options)(function)
    with suppress(OSError):  # without source files the code of different versions could not be distinguished
        dispatcher._cache = StoredCode(function)
    return dispatcher


def kernel(function: Callable[..., Any]) -> Any:
    """As `compiled`, for a function that makes no array: counting the references to those of its caller would take half
    of the time of a small function."""
    return compiled(function, counted=False)


class StoredCode(caching.NullCache):
    """The cache of one function: numba asks it for compiled code and gives it new code to save."""

    def __init__(self, function: Callable[..., Any]) -> None:
        file = Path(inspect.getfile(function)).absolute()
        names, values = function.__code__.co_names, function.__globals__
        caches = [getattr(value, "_cache", None) for value in values.values()]
        called = sorted({cached.source for cached in caches if isinstance(cached, StoredCode)})  # of its callees
        constants = [f"{name} {values[name]!r}" for name in names if isinstance(values.get(name), int | float | tuple)]
        self.begin: str = f"{file.stem}.{function.__name__}"
        self.source: str = _source(file, *called, *constants)
        chosen, of_user = getattr(config, "CACHE_DIR", ""), AppDirs("numba", appauthor=False).user_cache_dir
        part = f"{file.parent.name}_{hashlib.sha256(str(file.parent).encode()).hexdigest()[:16]}"
        self.folders = [Path(chosen, part)] if chosen else []
        self.folders += [file.parent / "__pycache__", Path(of_user, part)]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        target_context.refresh()
        name = self._name(sig, target_context.codegen())
        for folder in self.folders:
            with suppress(OSError):
                content = (folder / name).read_bytes()
                if hashlib.sha256(content[_DIGEST:]).digest() == content[:_DIGEST]:
                    return CompileResult._rebuild(target_context, *pickle.loads(content[_DIGEST:]))
        if notice := NOTICES.pop(self.begin, ""):
            print(notice, file=sys.stderr)
        return None

    def save_overload(self, sig: Any, cres: Any) -> None:
        content = dumps(cres._reduce())
        name = self._name(sig, cres.library.codegen)
        for folder in self.folders:
            unfinished = folder / f"{name}.{uuid4().hex[:8]}"
            try:
                folder.mkdir(parents=True, exist_ok=True)
                unfinished.write_bytes(hashlib.sha256(content).digest() + content)
                os.replace(unfinished, folder / name)
                for old in folder.glob(f"{self.begin}.*.nbc"):
                    if not old.name.startswith(f"{self.begin}.{self.source}"):
                        old.unlink(missing_ok=True)
                return
            except OSError:  # the folder is missing, not writable, or full
                with suppress(OSError):
                    unfinished.unlink()
        _say(", ".join(map(str, self.folders)))

    def _name(self, sig: Any, codegen: Any) -> str:
        depends = numba.__version__, sys.version, sig, codegen.magic_tuple()
        return f"{self.begin}.{self.source}.{hashlib.sha256(repr(depends).encode()).hexdigest()[:16]}.nbc"


@cache
def _source(file: Path, *parts: str) -> str:
    """Hash of the whole file, of the sources of the functions that it calls and of its global constants, which are
    compiled together with it, and of this module, which sets the options."""
    contents = [file.read_bytes(), Path(__file__).read_bytes(), *map(str.encode, parts)]
    return hashlib.sha256(b"".join(contents)).hexdigest()[:16]


@cache
def _say(folders: str) -> None:
    message = f"note: the compiled solver cannot be kept, for none of {folders} can be written: every start compiles it"
    print(f"{message}; set NUMBA_CACHE_DIR to a folder that can be", file=sys.stderr)
