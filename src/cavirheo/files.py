"""Files are looked at before they are read: a pipe or a device would never end, and gigabytes would fill the memory.
And what a cell of a table may begin with."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from stat import S_ISREG
from typing import Any

from cavirheo.errors import InputError, require

# what a spreadsheet would compute when it opens the file, wide characters included, and quotes before it
_FORMULA = re.compile("'*[=+@\uff1d\uff0b\uff0d\uff20-]")


def as_cell(text: str) -> str:
    """The text of a cell, after a ' if a spreadsheet would take it for a formula; a number is none."""
    return f"'{text}" if _FORMULA.match(text) and not is_float(text) else text


def as_remark(text: str) -> str:
    """The text of a comment in a table, of which no part between separators is a formula."""
    return "".join(part if part in ",;\t" else as_cell(part) for part in re.split("([,;\t])", text))


def from_cell(cell: str) -> str:
    """The text that `as_cell` wrote."""
    return cell[1:] if cell[:1] == "'" and _FORMULA.match(cell) else cell


def is_float(text: str) -> bool:
    """Whether a cell is a number as it stands."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text  # Python's 1_000


def read_bytes(path: str | Path, most: int) -> bytes:
    """The content of a regular file of at most `most` bytes.

    Raises InputError: "files.unreadable", "files.kind" (a folder, a pipe, a device), "files.size".
    """
    large = f"{path} is larger than the {most / 1e6:g} MB that are read; is it the right file?"
    try:
        state = Path(path).stat()
        if not S_ISREG(state.st_mode):
            raise InputError(f"{path} is a folder, a pipe or a device; name a file", "files.kind")
        require(state.st_size <= most, large, "files.size")
        with Path(path).open("rb") as file:
            content = file.read(most + 1)  # the size of some is only known when they are read
    except InputError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{str(path)[:200]!r} cannot be read: {reason}", "files.unreadable") from None
    require(len(content) <= most, large, "files.size")
    return content


def sha256(path: Path) -> str:
    """Of the content of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_object(path: str | Path, most: int) -> dict[str, Any]:
    """The object in a JSON file. Raises InputError as `read_bytes`, and "files.json"."""
    content, reason = read_bytes(path, most), "it holds no object"
    try:
        if isinstance(value := json.loads(content.decode("utf-8-sig")), dict):
            return value
    except (ValueError, RecursionError) as error:
        reason = str(error)
    raise InputError(f"{path} is damaged or not JSON: {reason}", "files.json")
