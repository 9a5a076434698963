"""The package's two own exceptions; their messages say what was given, what was expected, and how to mend it."""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches
from numbers import Integral
from os import PathLike
from pathlib import Path
from reprlib import repr as brief
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import ValidationError

_INVISIBLE = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff]"
)
_INVISIBLE_IN_LINES = re.compile(rf"(?![\t\r\n]){_INVISIBLE.pattern}")
_LONGEST = 2000  # characters of a message


def printable(text: str) -> str:
    """The text with what a terminal would obey and a document cannot hold written as an escape: control characters,
    marks of direction, and the bytes of a file name that are no UTF-8 (`\\xe9`)."""
    return _INVISIBLE.sub(_escape, text)


def without_unseen(text: str) -> tuple[str, int]:
    """(the text without such characters but tabs and ends of lines, how many there were)."""
    return _INVISIBLE_IN_LINES.subn("", text)


def _escape(character: re.Match[str]) -> str:
    code = ord(character[0])
    return f"\\x{code & 0xFF:02x}" if code < 0x100 or 0xDC80 <= code <= 0xDCFF else f"\\u{code:04x}"


class InputError(ValueError):
    """What the user gave cannot be used (a file, a curve, an option).

    `code` names the mistake for programs and stays the same when the sentence is put better: "curve.no_maximum".
    `where` is the file, row, option or curve that it concerns, and `message` what is wrong there; both are one
    printable line, whatever names and cells they quote.
    """

    def __init__(self, message: str, code: str = "input", where: str = "") -> None:
        self.message: str = _line(message)
        self.code: str = code
        self.where: str = _line(where)
        super().__init__(f"{self.where}: {self.message}" if where else self.message)

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str]]:
        return type(self), (self.message, self.code, self.where)

    def within(self, where: str) -> InputError:
        """The same mistake, with the file, row or option that it concerns before what is known of its place."""
        return type(self)(self.message, self.code, f"{where}: {self.where}" if self.where else where)


def _line(text: str) -> str:
    line = printable(re.sub(r"\s*[\r\n]\s*", " ", text))
    return line if len(line) <= _LONGEST else line[: _LONGEST - 1] + "…"


def require(fine: bool, message: str, code: str = "input", where: str = "") -> None:
    """Raise InputError with this message, code and place unless all is fine."""
    if not fine:
        raise InputError(message, code, where)


def expect(value: object, kind: type, what: str) -> None:
    """Raise InputError unless the value is of this kind; `what` says what was expected, and how to come by it."""
    if not isinstance(value, kind):  # else its text, which may take long, is not needed
        raise InputError(f"expected {what}; got {type(value).__name__} {brief(value)}", "input.type")


def expect_whole(value: object, name: str, least: int, code: str = "input.whole") -> None:
    """Raise InputError unless the value is a whole number, `least` or more."""
    fine = isinstance(value, Integral) and int(value) >= least
    require(fine, f"{name} must be a whole number from {least} up, got {brief(value)}", code)


def numbered(numbers: str | Iterable[int], what: str, code: str, first: int = 1, last: int | None = None) -> list[int]:
    """Sorted, each once: "1,4-7" or [1, 4, 5, 6, 7]. Raises InputError: no such list, or numbers beyond these ends."""
    ends = f"{first} up" if last is None else f"{first} to {last}"
    like = f"{first},{first + 3}-{first + 6}"
    message = f'{what} must be numbers from {ends} and ranges of them, such as "{like}", got {numbers!r}'
    chosen: set[int] = set()
    for part in numbers.split(",") if isinstance(numbers, str) else map(str, numbers):
        match = re.fullmatch(r"\s*(\d{1,6})\s*(?:[-–]\s*(\d{1,6})\s*)?", part)
        low, high = (int(match[1]), int(match[2] or match[1])) if match else (0, -1)
        require(first <= low <= high <= (last or high), message, code)
        chosen.update(range(low, high + 1))
    require(bool(chosen), message, code)
    return sorted(chosen)


def number_of(text: str | None, what: str) -> float | None:
    """What was typed; None where nothing was. Raises InputError: no number, or one that can be read in two ways."""
    number = (text or "").strip()
    two = f"{what} {number} can be read in two ways: type it without the comma, or with a point"
    require(not re.fullmatch(r"[+-]?[1-9]\d{0,2}(,\d{3})+", number), two, "input.which_number")
    try:
        return float(number.replace(",", ".")) if number else None
    except ValueError:
        raise InputError(f"{what} must be a number, got {number!r}", "input.not_a_number") from None


def as_path(path: str | PathLike[str]) -> Path:
    """The path of one file or folder. Raises InputError: it is none."""
    message = f"expected the path of one file, as text; got {type(path).__name__} {brief(path)}"
    require(isinstance(path, str | PathLike), message, "input.path")
    return Path(path)


def validation_message(error: ValidationError, kind: Any) -> str:
    """In one line, of the first entries that the pydantic model `kind` refuses: where, what is expected and given."""
    parts = []
    for item in error.errors(include_url=False):
        where, what = ".".join(map(str, item["loc"])), item["msg"].removeprefix("Value error, ")
        if item["type"] == "extra_forbidden":
            what, table = "unknown key", kind
            for key in item["loc"][:-1]:
                table = next(f.annotation for name, f in table.model_fields.items() if key in (name, f.alias))
            names = [field.alias or name for name, field in table.model_fields.items()]
            close = get_close_matches(str(item["loc"][-1]), names, 1)
            what += f", did you mean {close[0]}?" if close else f"; known: {', '.join(names)}"
        elif item["type"] == "missing":
            what = "is missing"
        elif where:
            what += f", got {brief(item['input'])}"
        parts.append(f"{where}: {what}".removeprefix(": "))
    return "; ".join(parts[:3]) + (f"; and {len(parts) - 3} more" if len(parts) > 3 else "")


class SolverError(RuntimeError):
    """A simulation did not reach its end time; the message is the status of the solve."""
