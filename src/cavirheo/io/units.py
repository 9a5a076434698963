"""Units and titles as people write them (`[µm]`, `Zeit / s`), in several languages."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
ALIASES = {
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


def plain(text: str) -> str:
    """Without accents; every prime is ', every double one ''; the micro sign is the letter mu."""
    text = unicodedata.normalize("NFKD", text)
    text = "".join(c for c in text if not unicodedata.combining(c)).replace("−", "-")
    return re.sub("[′’‘´`]", "'", re.sub('["”“″]', "''", text))


def plain_title(text: str) -> str:
    """Small letters, digits and primes; no spaces, brackets or points."""
    return re.sub(r"[\s_\-.,:;=/^()\[\]{}]+", "", plain(text).lower())


def plain_unit(text: str) -> str:
    """`rad/s` -> rads, `s^-1` -> s-1, `µm` -> um; capitals stay: mPa is not MPa."""
    return re.sub(r"[\s/·⋅.*^_()\[\]{}]+", "", plain(text).replace("μ", "u"))


def unit_of(written: str, units: Mapping[str, float]) -> str | None:
    """The one of these units that is written so, in any spelling; None for another."""
    unit = plain_unit(written)
    return next((spelling for spelling in (unit, ALIASES.get(unit)) if spelling in units), None)
