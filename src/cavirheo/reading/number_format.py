"""Numbers as people write them: decimal commas, and points, commas, spaces or apostrophes between thousands.

What a comma means is decided once for all rows of numbers in a sheet, by the one reading that all of them allow: `1,5`
and `0,123` have decimal commas, `1,234.5` and `1,234,567` have not. Where both readings are left (`1,234` alone), or
numbers with a comma stand beside others with a point, the cells stay as they are and `number` refuses them.
"""

from __future__ import annotations

import re

from cavirheo.errors import InputError

Cells = list[str]

_MISSING = {"nan", "na", "n/a", "null", "none", "#n/a"}
_SPACES = "' ’\u00a0\u202f"
_MARK = re.compile(rf"\d[,{_SPACES}]\d|\.\d+\.|−\d")  # what `float` does not read
_SPACED = re.compile(rf"(?<=\d)[{_SPACES}](?=\d{{3}}(?!\d))")
_NUMBER = re.compile(r"[+-]?\d[\d.,]*(e[+-]?\d+)?", re.I)
_READING = {  # by its decimal mark
    mark: re.compile(rf"[+-]?(\d+|[1-9]\d{{0,2}}(\{other}\d{{3}})+)(\{mark}\d*)?(e[+-]?\d+)?", re.I)
    for mark, other in (".,", ",.")
}


def with_points(rows: list[Cells]) -> tuple[list[Cells], list[str]]:
    """(the rows, their numbers with decimal points and without marks between thousands; how many were changed)."""
    if not any(_MARK.search(cell) for cells in rows for cell in cells):
        return rows, []
    tidy = {cell: _SPACED.sub("", cell.replace("−", "-")) for cells in rows for cell in cells}
    tidy = {cell: text for cell, text in tidy.items() if _NUMBER.fullmatch(text)}
    data = [cells for cells in rows if all(map(is_number, cells))] or rows  # what stands above a table says nothing
    decimal = _decimal_mark([tidy[cell] for cells in data for cell in cells if cell in tidy])
    if decimal:
        other = "." if decimal == "," else ","
        tidy = {cell: text.replace(other, "").replace(",", ".") for cell, text in tidy.items()}
    changed = {cell: text for cell, text in tidy.items() if text != cell and _is_float(text)}
    found = [cell for cells in rows for cell in cells if cell in changed]
    commas = sum(decimal == "," and "," in cell for cell in found)
    groups = sum(len(re.findall(rf"[,.{_SPACES}]", cell)) > changed[cell].count(".") for cell in found)
    said = {f"{commas} decimal commas": commas, f"marks between the thousands of {groups} numbers left out": groups}
    return [[changed.get(cell, cell) for cell in row] for row in rows], [note for note, count in said.items() if count]


def _decimal_mark(texts: list[str]) -> str:
    """The mark that is decimal in all of these numbers, or nothing where they do not say."""
    texts = [text for text in set(texts) if any(reading.fullmatch(text) for reading in _READING.values())]
    possible = [mark for mark, reading in _READING.items() if all(map(reading.fullmatch, texts))]
    marks = [(text.count(","), text.count(".")) for text in texts]
    if not any(commas for commas, _ in marks):
        return possible[0] if possible else ""
    proven = any(commas + points > 1 for commas, points in marks)
    return possible[0] if len(possible) == 1 and (proven or not any(points for _, points in marks)) else ""


def _is_float(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text  # Python's 1_000


def is_number(cell: str) -> bool:
    """A number, or what stands for a missing one: nothing, a word such as nan, signs such as ---."""
    return (
        _is_float(cell)
        or cell.strip().lower() in _MISSING
        or not re.search(r"\w", cell)
        or bool(_NUMBER.fullmatch(cell) and _MARK.search(cell))
    )


def number(cell: str) -> float:
    """NaN where the cell is missing.

    Raises:
        InputError: no number ("tabular.number"), or one with a comma of unknown meaning ("tabular.comma").
    """
    if _is_float(cell):
        return float(cell)
    if not is_number(cell):
        raise InputError(f"{cell[:30]!r} is not a number; leave the cell empty where there is none", "tabular.number")
    if "," in cell and _NUMBER.fullmatch(cell):
        two = f"{cell.replace(',', '.')} or {cell.replace(',', '')}"
        why = f"{cell[:30]!r} could be {two}: is the comma decimal? export with decimal points only"
        raise InputError(why, "tabular.comma")
    return float("nan")
