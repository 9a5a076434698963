"""Pages that take their numbers from validation/results.json.

A number of a page stands between markers, which a reader does not see: `<!--KEY:FORMAT-->88<!--/-->`. KEY is a claim
and the name of its number, FORMAT one of Python's; `%` multiplies by 100 and writes no sign. `se` before the format
takes the standard error, `n` alone the number of cases, `k` that of a share. What no run has measured is a dash.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "validation" / "results.json"
MARKED = re.compile(r"(?P<begin><!--(?P<key>[a-z_]+\.[\w.]+):(?P<format>[^<>]+)-->)[^<]*(?P<end><!--/-->)")
UNMEASURED = re.compile(  # what is measured only where it is named, or with a program that few machines have
    r"challenge\.(?:fit|scipy|infer_field|open)\."
    r"|challenge\.(?:several\.)?\w+\.\w+\.error$|peers\.|times\.newcomer\."
)
AT_BEGINNING = re.compile(r"^\s*(?:[-*>]|\d+\.)?\s*<!--[a-z_]+\.", re.MULTILINE)  # Markdown would end the paragraph


def shown(value: float | None, form: str) -> str:
    """A number as pages write it: 1.8e-5 without a zero, a per cent without its sign; a dash where there is none."""
    if value is None:
        return "–"
    text = f"{100 * value:{form[:-1]}f}" if form.endswith("%") else f"{value:{form}}"
    return re.sub(r"e([+-])0*(\d)", lambda found: f"e{found[1].strip('+')}{found[2]}", text)


def number(results: Mapping[str, dict], key: str) -> dict:
    """Raises ValueError for a key that results.json must have, and has not."""
    claim, _, name = key.partition(".")
    try:
        return results[claim]["numbers"][name]
    except KeyError:
        if UNMEASURED.match(key):
            return {"value": None, "standard_error": None, "n": 0}
        raise ValueError(f"results.json has no number {key!r}; run `python -m validation {claim}`") from None


def filled(text: str, results: Mapping[str, dict]) -> str:
    """The page with the numbers of results.json between its markers."""

    def put(found: re.Match[str]) -> str:
        one, form = number(results, found["key"]), found["format"]
        if one["value"] is None:
            words = shown(None, form)
        elif form == "n":
            words = str(one["n"])
        elif form == "k":
            words = f"{one['value'] * one['n']:.0f}"
        elif form.startswith("se"):
            words = shown(one["standard_error"], form.removeprefix("se"))
        else:
            words = shown(one["value"], form)
        return found["begin"] + words + found["end"]

    return MARKED.sub(put, text)


def read_results() -> dict[str, dict]:
    return json.loads(RESULTS.read_text("utf-8"))


def marked_pages() -> list[Path]:
    patterns = ("*.md", "docs/**/*.md", "validation/**/*.md", "paper/*.md")
    return sorted(path for pattern in patterns for path in ROOT.glob(pattern) if MARKED.search(path.read_text("utf-8")))


def fill() -> None:
    """Write the numbers of results.json between the markers of all pages."""
    results = read_results()
    for path in marked_pages():
        path.write_text(filled(path.read_text("utf-8"), results), encoding="utf-8")
