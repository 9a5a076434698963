"""The two exceptions of the package, and checks of user input: texts, numbers, paths, cells of tables, and files.

Messages say what was given, what was expected, and how to correct it. The type and size of a file are checked before
it is read: a pipe or a device would never end, and gigabytes would fill the memory.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable
from numbers import Integral
from os import PathLike
from pathlib import Path
from reprlib import repr as brief
from stat import S_ISDIR, S_ISREG
from types import UnionType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import ValidationError

_INVISIBLE = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff]"
)
_INVISIBLE_IN_LINES = re.compile(rf"(?![\t\r\n]){_INVISIBLE.pattern}")
_MAX_CHARACTERS = 2000  # most characters of a message
# the start of a cell that a spreadsheet would compute as a formula, with full-width signs and quotes before it
_FORMULA = re.compile("'*[=+@\uff1d\uff0b\uff0d\uff20-]")


def printable(text: str) -> str:
    """The text with escapes for characters that a terminal obeys or a document cannot hold: control characters,
    direction marks, and the bytes of a file name that are not UTF-8 (`\\xe9`)."""

    def escape(character: re.Match[str]) -> str:
        code = ord(character[0])
        return f"\\x{code & 0xFF:02x}" if code < 0x100 or 0xDC80 <= code <= 0xDCFF else f"\\u{code:04x}"

    return _INVISIBLE.sub(escape, text)


def without_invisible(text: str) -> tuple[str, int]:
    """(the text without the characters that `printable` escapes, except tabs and line ends; how many were removed)."""
    return _INVISIBLE_IN_LINES.subn("", text)


class InputError(ValueError):
    """The user's input (a file, a curve, an option) cannot be used.

    `code` identifies the mistake for programs and stays the same when the message is reworded: "curve.never_falls".
    `where` is the file, row, option or curve that it concerns, and `message` says what is wrong there. Both are one
    printable line, whatever names and cells they quote.
    """

    def __init__(self, message: str, code: str = "input", where: str = "") -> None:
        self.message: str = _one_line(message)
        self.code: str = code
        self.where: str = _one_line(where)
        super().__init__(f"{self.where}: {self.message}" if where else self.message)

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str]]:
        return type(self), (self.message, self.code, self.where)

    def within(self, where: str) -> InputError:
        """The same error, with this file, row or option put before its place."""
        return type(self)(self.message, self.code, f"{where}: {self.where}" if self.where else where)


def _one_line(text: str) -> str:
    line = printable(re.sub(r"\s*[\r\n]\s*", " ", text))
    return line if len(line) <= _MAX_CHARACTERS else line[: _MAX_CHARACTERS - 1] + "…"


class SolverError(RuntimeError):
    """A simulation did not reach its end time; the message is the status of the solve."""


def require(condition: bool, message: str, code: str = "input", where: str = "") -> None:
    """Raise InputError with this message, code and place unless `condition`."""
    if not condition:
        raise InputError(message, code, where)


def expect(value: object, kind: type | UnionType, expected: str) -> None:
    """Raise InputError unless the value is of this kind; `expected` says what was expected, and how to get it."""
    if not isinstance(value, kind):  # brief(value) may take long, so only an error computes it
        raise InputError(f"expected {expected}; got {type(value).__name__} {brief(value)}", "input.type")


def expect_whole(value: object, name: str, least: int, code: str = "input.whole") -> None:
    """Raise InputError unless the value is a whole number, `least` or more."""
    if not isinstance(value, Integral) or isinstance(value, bool) or int(value) < least:
        raise InputError(f"{name} must be a whole number from {least} up, got {brief(value)}", code)


def parse_number_list(
    numbers: str | Iterable[int], name: str, code: str, first: int = 1, last: int | None = None
) -> list[int]:
    """Sorted distinct numbers of "1,4-7" or [1, 4, 5, 6, 7]. Raises InputError: no such list, or out of range."""
    ends, like = f"{first} up" if last is None else f"{first} to {last}", f"{first},{first + 3}-{first + 6}"
    message = f'{name} must be numbers from {ends} and ranges of them, such as "{like}", got {numbers!r}'
    chosen: set[int] = set()
    require(isinstance(numbers, Iterable), message, code)
    for part in numbers.split(",") if isinstance(numbers, str) else map(str, numbers):
        match = re.fullmatch(r"\s*(\d{1,6})\s*(?:[-–]\s*(\d{1,6})\s*)?", part)
        low, high = (int(match[1]), int(match[2] or match[1])) if match else (0, -1)
        require(first <= low <= high <= (last or high), message, code)
        chosen.update(range(low, high + 1))
    require(bool(chosen), message, code)
    return sorted(chosen)


def listed(names: Iterable[str], most: int = 5) -> str:
    """The first of the distinct names, and how many more there are."""
    unique = list(dict.fromkeys(names))
    more = f" and {len(unique) - most} more" if len(unique) > most else ""
    return (", ".join(unique[:most]) or "nothing") + more


def as_path(path: str | PathLike[str]) -> Path:
    """The path of one file or folder. Raises InputError: not a path."""
    if not isinstance(path, str | PathLike):
        message = f"expected the path of one file, as text; got {type(path).__name__} {brief(path)}"
        raise InputError(message, "input.path")
    return Path(path)


def validation_message(error: ValidationError) -> str:
    """One line on the entries that a pydantic model refuses: where, what was expected and given."""
    parts = []
    for item in error.errors(include_url=False):
        where, what = ".".join(map(str, item["loc"])), item["msg"].removeprefix("Value error, ")
        given = f", got {brief(item['input'])}" if where and item["type"] != "missing" else ""
        parts.append(f"{where}: {what}{given}".removeprefix(": "))
    return "; ".join(parts)


def as_cell(text: str) -> str:
    """The text of a cell, with a ' before it if a spreadsheet would read it as a formula and it is no number."""
    return f"'{text}" if _FORMULA.match(text) and not is_float(text) else text


def is_float(text: str) -> bool:
    """Whether the text of a cell is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text  # Python's 1_000


def check_file(path: Path, max_bytes: int, *, folder: bool = False) -> None:
    """Raise InputError unless a file of at most `max_bytes` has this path, or a folder, if allowed: "reading.missing",
    "reading.unreadable", "reading.folder", "reading.special" (a pipe, a device), "limits.bytes"."""
    name = printable(str(path))[:_MAX_CHARACTERS]
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError, ValueError):  # ValueError: a name with a zero byte
        link = f" is a link to {printable(str(path.readlink()))}, which" if path.is_symlink() else ""
        raise InputError(f"{name}{link} does not exist", "reading.missing") from None
    except OSError as error:
        raise InputError(f"{name} cannot be read ({error.strerror})", "reading.unreadable") from None
    if S_ISDIR(status.st_mode):
        require(folder, f"{name} is a directory; give the files in it, e.g. {name}/*.mat", "reading.folder")
    elif not S_ISREG(status.st_mode):
        raise InputError(f"{name} is a pipe, a socket or a device; give a file", "reading.special")
    if status.st_size > max_bytes:
        message = f"{name} is larger than the {max_bytes / 1e6:g} MB that are read; is it the right file?"
        raise InputError(message, "limits.bytes")


def read_bytes(path: str | Path, max_bytes: int) -> bytes:
    """The content of a file of at most `max_bytes`. Raises InputError as `check_file`."""
    check_file(Path(path), max_bytes)
    try:
        with Path(path).open("rb") as file:
            return file.read(max_bytes)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror})", "reading.unreadable") from None


def sha256(path: Path) -> str:
    """SHA-256 of the content of a file, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_object(path: str | Path, max_bytes: int) -> dict[str, Any]:
    """The object in a JSON file. Raises InputError as `read_bytes`, and "files.json"."""
    content, reason = read_bytes(path, max_bytes), "it holds no object"
    try:
        if isinstance(value := json.loads(content.decode("utf-8-sig")), dict):
            return value
    except (ValueError, RecursionError) as error:
        reason = str(error)
    raise InputError(f"{path} is damaged or not JSON: {reason}", "files.json")
