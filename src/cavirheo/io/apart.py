"""Call a function in a process of its own: a file that exhausts memory or time there, or crashes its reader, affects
nothing else.

What is sent to a child and back is arrays and JSON: nothing of it is executed, whatever a file does to the child.
"""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from threading import Timer
from time import monotonic
from typing import Any

from cavirheo.errors import InputError
from cavirheo.parallel import tie_to_parent
from cavirheo.writing.export import decode, encode

MEMORY = 1_000_000_000  # bytes that reading a workbook or a file of MATLAB may take
SECONDS = 30.0  # for reading it
_CHILD = "import sys; sys.path[:] = {path}; from cavirheo.io.apart import serve; serve({module!r}, {name!r}, {memory})"
_SIZE = 8  # bytes of the length of a request or an answer
_children: dict[str, Any] = {}  # that wait for another call, by the function that they call
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_children.clear)  # a child answers the process that started it


def call(
    function: Callable[..., Any],
    *arguments: Any,
    memory: int = MEMORY,
    seconds: float = SECONDS,
    name: str = "it",
    kept: bool = True,
) -> Any:
    """Return function(*arguments), which are all what `encode` takes, or records in `KINDS` of the function's module.

    The function reads the file of this name, and may take so many bytes of memory (on Linux) and seconds. kept: whether
    the process waits for another call of it.

    Raises InputError: as `function`; or it took too long ("limits.time") or too much memory ("limits.memory"), raised
    another error ("reading.damaged"), or ended the process ("reading.ended").
    """
    module = function.__module__
    key = f"{module}.{function.__name__}"
    child: Any = _children.pop(key, None) if kept else None
    if child is None or child.poll() is not None:
        path = [folder for folder in sys.path if folder]  # no modules from the current folder
        program = _CHILD.format(path=path, module=module, name=function.__name__, memory=memory)
        command = [sys.executable, "-P", "-c", program]
        child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    timer, began = Timer(seconds, child.kill), monotonic()
    timer.start()
    try:
        request = encode(arguments)
        child.stdin.write(len(request).to_bytes(_SIZE) + request)
        child.stdin.flush()
        answer = decode(child.stdout.read(int.from_bytes(child.stdout.read(_SIZE))), _kinds(module))
        if kept:
            _children[key] = child
    except (EOFError, OSError):  # the child has ended
        if monotonic() - began >= seconds:
            message = f"reading {name} took more than {seconds:g} s: is it damaged, or too long?"
            raise InputError(message, "limits.time") from None
        message = f"reading {name} ended its process: the file is badly damaged, or too large; save a table as CSV"
        raise InputError(message, "reading.ended") from None
    finally:
        timer.cancel()
        if _children.get(key) is not child:
            child.kill()
            child.communicate()
    if isinstance(answer, InputError):
        raise answer
    return answer


def _kinds(module: str) -> Mapping[str, Any]:
    return {"InputError": InputError, **getattr(importlib.import_module(module), "KINDS", {})}


def serve(module: str, name: str, memory: int) -> None:
    """Answer one call after the other; in the child."""
    tie_to_parent(os.getppid())
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # a library may print
    function = getattr(importlib.import_module(module), name)
    with suppress(ImportError, ValueError, OSError):  # no such limit on this system: only the time limit holds
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + memory, used + memory))
    while size := int.from_bytes(requests.read(_SIZE)):
        arguments = decode(requests.read(size), _kinds(module))
        try:
            answer = encode(function(*arguments))
        except InputError as error:
            answer = encode(error)
        except MemoryError:
            message = "takes more memory than is given to a file: save what is needed of it, a table as CSV"
            answer = encode(InputError(message, "limits.memory"))
        except BaseException as error:  # libraries raise nearly anything for a damaged file
            message = f"cannot be read, it may be damaged or cut off ({type(error).__name__}: {str(error)[:300]})"
            answer = encode(InputError(message, "reading.damaged"))
        answers.write(len(answer).to_bytes(_SIZE) + answer)
        answers.flush()
