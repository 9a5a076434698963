"""What a column's title names: a kind of number and its unit, as people write them (`R [um]`, `Zeit / µs`)."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Mapping
from typing import Any, TypeVar

Kind = TypeVar("Kind")

_LONGEST = 120  # characters of a title; more is a sentence, and takes time


def column_of(
    title: str, titles: Mapping[str, Kind], units: Mapping[Any, Collection[str]]
) -> tuple[Kind | None, str | None]:
    """(kind, unit) that a column's title names: `time_us`, `R [um]`, `Shear Strain (%)`, `omega in rad/s`.

    titles: kinds by title as `plain_title` writes them; units: known units by kind as `plain_unit` writes them, which
    count in small letters too. (None, None): no title that is known. The unit is None where there is none, and as
    written where it stands in brackets and is not known.
    """
    if len(title) > _LONGEST:
        return None, None
    text = _plain(title).strip()
    named: tuple[Kind | None, str | None] = (None, None)
    for cut in re.finditer(r"\s*[\s_\[(/,.\-]\s*((in|en)\s)?", text):
        kind = titles.get(plain_title(text[: cut.start()]))
        if kind is None:
            continue
        written = text[cut.end() :].rstrip("]), ")
        unit, known = plain_unit(written), units.get(kind, ())
        if unit in known or unit.lower() in known:
            return kind, unit if unit in known else unit.lower()
        if re.fullmatch(r"\s*[\[(][^\[\]()]+[\])]\s*", text[cut.start() :]):
            named = kind, written
    kind = titles.get(plain_title(text))
    return named if kind is None else (kind, None)


def _plain(text: str) -> str:
    """Without accents; every prime is ', every double one ''; the micro sign is the letter mu."""
    text = unicodedata.normalize("NFKD", text)
    text = "".join(c for c in text if not unicodedata.combining(c)).replace("−", "-")
    return re.sub("[′’‘´`]", "'", re.sub('["”“″]', "''", text))


def plain_title(text: str) -> str:
    """Small letters, digits and primes; no spaces, brackets or points."""
    return re.sub(r"[\s_\-.,:;=/^()\[\]{}]+", "", _plain(text).lower())


def plain_unit(text: str) -> str:
    """`rad/s` -> rads, `s^-1` -> s-1, `µm` -> um; capitals stay: mPa is not MPa."""
    return re.sub(r"[\s/·⋅.*^_()\[\]{}]+", "", _plain(text).replace("μ", "u"))
