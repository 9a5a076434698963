"""What the titles of columns name: a quantity and its unit, as people write them (`R [um]`, `Zeit / µs`).

A table is read with a vocabulary: the quantities that its columns may hold, the words that name each, and its units.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

from cavirheo.reading.number_format import is_number

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
_ALIASES = {
    word: unit
    for unit, words in {
        "s": "sec second seconds sekunde sekunden seconde secondes segundo segundos 秒",
        "ms": "msec millisecond milliseconds millisekunden millisecondes milisegundos ミリ秒 毫秒",
        "us": "usec microsecond microseconds mikrosekunden microsecondes microsegundos マイクロ秒 微秒",
        "ns": "nsec nanosecond nanoseconds nanosekunden nanosecondes nanosegundos ナノ秒 纳秒",
        "m": "meter meters metre metres metros",
        "mm": "millimeter millimeters millimetre millimetres milimetros ミリメートル 毫米",
        "um": "micron microns micrometer micrometers micrometre micrometres mikrometer micrometros "
        "マイクロメートル 微米",
        "px": "pixel pixels pix pixeles ピクセル 像素",
    }.items()
    for word in words.split()
}
_LONGEST = 120  # characters of a title; more is a sentence, and takes time


class Name(NamedTuple):
    """What a title names. kind: of the vocabulary, "" for none. unit: as the vocabulary has it, as written where it
    stands in brackets and is not known, None where there is none. number: "2" of R2, else ""."""

    kind: str = ""
    unit: str | None = None
    number: str = ""


@dataclass(frozen=True)
class Term:
    """What a column may hold."""

    words: str  # titles that name it, separated by spaces, as `plain_title` writes them
    units: Mapping[str, float] = field(default_factory=dict)  # factor to SI of each; NaN: known, but cannot be used
    unit: str | None = None  # of a title that names none; None where it must name one
    shown: str = ""  # its name in messages
    mend: str = ""  # how to write its unit, where it is missing
    twice: str = "keep the one that counts"  # how to mend a table with two columns of it
    symbols: str = ""  # titles, as `words`, that count only with a unit


@dataclass(frozen=True, eq=False)
class Vocabulary:
    """What the columns of a table may hold, by kind, and how the table is laid out.

    A declared table is typed by a person: its first line has the titles, every other one counts. A measured one may
    have other lines above its titles, units below them, and means and sums at its end. With sections a file holds
    several tables, each under its own titles.
    """

    terms: Mapping[str, Term]
    expected: str  # in a table, for messages
    codes: Mapping[str, str] = field(default_factory=dict)  # of errors, where they are not "tabular.…"
    other: Callable[[str], Name] | None = None  # what a title names that no term does
    marks: str = "#%"  # that begin a comment
    declared: bool = False
    sections: bool = False
    bare: bool = False  # whether numbers without titles are a table, too

    def name(self, title: str) -> Name:
        """What a title such as `time_us`, `R [um]`, `Shear Strain (%)` or `omega in rad/s` names."""
        return _named(self, title)

    def known(self, title: str) -> Name:
        """As `name`, by the words of the vocabulary alone."""
        if len(title) > _LONGEST:
            return Name()
        text, named = _plain(title).strip(), Name()
        for cut in re.finditer(r"\s*[\s_\[(/,.\-]\s*((in|en)\s)?", text):
            kind = self._kinds.get(plain_title(text[: cut.start()]))
            if kind is None:
                continue
            written, units = text[cut.end() :].rstrip("]), "), self.terms[kind].units
            unit = plain_unit(written)
            for known in (unit, unit.lower(), _ALIASES.get(unit), _ALIASES.get(unit.lower())):
                if known is not None and known in units:
                    return Name(kind, known)
            if re.fullmatch(r"\s*[\[(][^\[\]()]+[\])]\s*", text[cut.start() :]):
                named = Name(kind, written)
        plain = plain_title(text)
        kind = self._kinds.get(plain)
        return Name(kind) if kind and plain not in self.terms[kind].symbols.split() else named

    def code(self, mistake: str) -> str:
        return self.codes.get(mistake, f"tabular.{mistake}")

    def units(self, kind: str) -> Mapping[str, float]:
        """Of a kind; none of texts and of what is not known."""
        return self.terms[kind].units if kind else {}

    def shown(self, kind: str) -> str:
        return self.terms[kind].shown or kind

    @cached_property
    def _kinds(self) -> dict[str, str]:
        words = ((kind, f"{one.words} {one.symbols}".split()) for kind, one in self.terms.items())
        return {plain_title(word): kind for kind, some in words for word in some}


@lru_cache(4096)
def _named(vocabulary: Vocabulary, title: str) -> Name:
    if is_number(title):
        return Name()
    found = vocabulary.known(title)
    return vocabulary.other(title) if vocabulary.other and not found.kind else found


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


def unit_of(written: str, units: Mapping[str, float]) -> str | None:
    """The one of these units that is written so, in any spelling; None for another."""
    unit = plain_unit(written)
    return next((one for one in (unit, _ALIASES.get(unit)) if one is not None and one in units), None)
