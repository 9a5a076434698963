"""Markdown that the pages made from code share."""

from __future__ import annotations

import re
from collections.abc import Iterable


def table(head: tuple[str, ...], rows: Iterable[Iterable[str]]) -> str:
    """A table; bars within cells are escaped."""
    lines = [head, tuple("---" for _ in head), *rows]
    return (
        "".join(
            f"| {' | '.join(' '.join(cell.split()).replace('|', chr(92) + '|') for cell in line)} |\n" for line in lines
        )
        + "\n"
    )


def escaped(text: str) -> str:
    """Text as it stands: nothing of it is HTML or emphasis."""
    return re.sub(r"[\\*_\[\]`]", r"\\\g<0>", text).replace("<", "&lt;")


def prose(text: str) -> str:
    """As `escaped`, but what stands between backticks is code."""
    parts = re.split(r"(`[^`]+`)", text)
    return "".join(part if part.startswith("`") and part.endswith("`") else escaped(part) for part in parts)
