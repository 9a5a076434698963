"""Units of time and length as people and programs write them: `µs`, `microns`, `rad/s`, `マイクロメートル`."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "cm": 1e-2}
_WORDS_OF_UNITS = {
    "s": "sec second seconds sekunde sekunden seconde secondes segundo segundos 秒",
    "ms": "msec millisecond milliseconds millisekunden millisecondes milisegundos ミリ秒 毫秒",
    "us": "usec microsecond microseconds mikrosekunden microsecondes microsegundos マイクロ秒 微秒",
    "ns": "nsec nanosecond nanoseconds nanosekunden nanosecondes nanosegundos ナノ秒 纳秒",
    "m": "meter meters metre metres metros",
    "mm": "millimeter millimeters millimetre millimetres milimetros ミリメートル 毫米",
    "um": "micron microns micrometer micrometers micrometre micrometres mikrometer micrometros マイクロメートル 微米",
    "px": "pixel pixels pix pixeles ピクセル 像素",
    "px2": "pixel2 pixels2",
    "frame": "frames",
    "um2": "micron2 microns2 sqmicrons squm",
}
_UNITS_BY_WORD = {word: unit for unit, words in _WORDS_OF_UNITS.items() for word in words.split()}


def plain_text(text: str) -> str:
    """Return the text without accents, with ' for primes, '' for double primes, a plain minus, and mu for micro."""
    if not text.isascii():
        text = unicodedata.normalize("NFKD", text)
        text = "".join(c for c in text if not unicodedata.combining(c)).replace("−", "-")
    return re.sub("[′’‘´`]", "'", re.sub('["”“″]', "''", text))


def unit_of(text: str, units: Mapping[str, float]) -> str | None:
    """Return the unit of `units` that is written, or None. `rad/s` is read as rads, `s^-1` as s-1, `µm` as um; capitals
    count if only they differ: mPa is not MPa."""
    unit = re.sub(r"[\s/·⋅.*^_()\[\]{}]+", "", plain_text(text).replace("μ", "u"))
    spellings = (unit, unit.lower(), _UNITS_BY_WORD.get(unit), _UNITS_BY_WORD.get(unit.lower()))
    return next((spelling for spelling in spellings if spelling in units), None)
