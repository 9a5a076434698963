"""Pages that take their numbers from validation/results.json.

A number of a page stands between markers, which a reader does not see: `<!--KEY:FORMAT-->88<!--/-->`. KEY is a claim
and the name of its number, FORMAT one of Python's; `%` multiplies by 100 and writes no sign. `se` before the format
takes the standard error, `n` alone the number of cases, `k` that of a share. What no run has measured is a dash.
docs/claims.md is made as a whole.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "validation" / "results.json"
PAGE = ROOT / "docs" / "claims.md"
MARKED = re.compile(r"(?P<begin><!--(?P<key>[a-z_]+\.[\w.]+):(?P<format>[^<>]+)-->)[^<]*(?P<end><!--/-->)")
FENCED = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
APART = re.compile(r"`[^`\n]*`|\]\([^)\n]*\)")  # inline code, and the target of a link
MEASURED = re.compile(r"\d+\.\d+|\d+ ?%")
UNMEASURED = re.compile(  # what is measured only where it is named, or with a program that few machines have
    r"challenge\.(?:fit|scipy|infer_field|open)\."
    r"|challenge\.(?:several\.)?\w+\.\w+\.error$|solver\.peers\.pyimr|times\.newcomer\."
)
AT_BEGINNING = re.compile(r"^\s*(?:[-*>]|\d+\.)?\s*<!--[a-z_]+\.", re.MULTILINE)  # Markdown would end the paragraph

HEAD = """# Claims
`make validate` measures them again; they stand in [results.json](../validation/results.json).
± is the standard error over n cases.
[Validation](validation.md) explains the tests, and says what was not reached.

| claim | number | n | repeat | commit, date |
|---|---|---|---|---|
"""


class Claim(NamedTuple):
    """A row of the page. numbers: (words before, key without the claim, format, words after)."""

    name: str
    sentence: str
    numbers: tuple[tuple[str, str, str, str], ...]


def both(key: str, form: str, unit: str = "") -> tuple[tuple[str, str, str, str], ...]:
    """Of G and of µ; key has {} for the symbol."""
    return ("G", key.format("G"), form, unit), ("µ", key.format("mu"), form, unit)


CLAIMS = (
    Claim(
        "solver",
        "Largest error of R/R_max in a curve, median of curves; time of the field's method over ours",
        (("", "default.error", ".1e", ""), ("time", "peers.field.ratio", ".0f", "")),
    ),
    Claim(
        "calibration",
        "90 % intervals of `infer` that hold the truth of simulated gels with the real bubble",
        both("infer_real.{}.90", ".0%", "%"),
    ),
    Claim(
        "video",
        "Bias of radii in rendered recordings, largest of 12 kinds of scene; threshold and circle fit, median",
        (("", "error.bias.largest", ".3f", "px"), ("circle fit", "usual.bias.median", ".2f", "px")),
    ),
    Claim(
        "population",
        "90 % intervals of the material of many shots: its centre, and its spread",
        (("centre", "centre.90", ".0%", "%"), ("spread", "spread.90", ".0%", "%")),
    ),
    Claim(
        "groups",
        "90 % intervals of groups of simulated recordings with errors of scale, frame rate and density that all share",
        (("G", "clean.shear_modulus", ".0%", "%"), ("µ", "clean.viscosity", ".0%", "%")),
    ),
    Claim(
        "design",
        "Ratio of the interval that `design` predicts to the one that `infer` reaches, median of settings",
        both("ratio.{}", ".2f"),
    ),
    Claim(
        "evidence",
        "`which-law` chooses the law that made a simulated shot, or a simpler one that cannot be distinguished from "
        "it; the true law is excluded",
        (("right", "right_law", ".0%", "%"), ("wrong", "wrong_certainty", ".0%", "%")),
    ),
    Claim(
        "challenge",
        "90 % intervals of `infer` on recordings of another solver, another camera and another choice of values",
        both("several.all.{}.90", ".0%", "%"),
    ),
    Claim(
        "open_sets",
        "Real shots that are `ok` or `bound`; viscosity of PEG 40 % over that of a rheometer, median",
        (("", "trusted", ".0%", "%"), ("ratio", "rheometer.ratio", ".2f", "")),
    ),
    Claim(
        "references",
        "Default answers beside runs with seven times their simulations: difference of log evidence, median; of the "
        "ends of 90 % intervals, RMS",
        (("", "long.evidence", ".2f", ""), ("ends", "long.ends.rms", ".2f", "widths")),
    ),
    Claim(
        "times",
        "Clock time of an answer, median; that of 20 shots in one call over that of 20 calls",
        (("", "one.seconds", ".1f", "s"), ("ratio", "twenty.ratio", ".2f", "")),
    ),
)


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


def row(claim: Claim, results: Mapping[str, dict]) -> str:
    """Each number takes the name of its cases; n is given once where all agree."""
    about = results[claim.name]
    cells, counts, origins = [], [], []
    for words, key, form, unit in claim.numbers:
        one = number(results, f"{claim.name}.{key}")
        origins.append(f"{one.get('commit', about['commit'])}, {one.get('date', about['date'])}")
        told = f"{shown(one['value'], form)} ± {shown(one['standard_error'], form)}"
        cells.append(" ".join(part for part in (words, told, unit) if part))
        counts.append(str(one["n"]))
    n = counts[0] if len(set(counts)) == 1 else ", ".join(counts)
    options = " --full" * about["full"] + " --data FOLDER" * (claim.name == "open_sets")
    repeat = f"`python -m validation {claim.name}{options}`"
    return f"| {claim.sentence} | {', '.join(cells)} | {n} | {repeat} | {'; '.join(dict.fromkeys(origins))} |\n"


def sentences() -> str:
    """What the page of claims says beside its numbers."""
    return HEAD + "\n".join(claim.sentence for claim in CLAIMS)


def page(results: Mapping[str, dict]) -> str:
    return HEAD + "".join(row(claim, results) for claim in CLAIMS if claim.name in results)


def read_results() -> dict[str, dict]:
    return json.loads(RESULTS.read_text("utf-8"))


def marked_pages() -> list[Path]:
    patterns = ("*.md", "docs/**/*.md", "validation/**/*.md", "paper/*.md")
    return sorted(path for pattern in patterns for path in ROOT.glob(pattern) if MARKED.search(path.read_text("utf-8")))


def bare_numbers(text: str, allowed: Iterable[str] = ()) -> list[str]:
    """Numbers with a decimal point or a % sign outside of markers, code, links and what these patterns allow."""
    for pattern in (FENCED, MARKED, APART, *(re.compile(one, re.MULTILINE) for one in allowed)):
        text = pattern.sub("-", text)
    return MEASURED.findall(text)


def write(page_too: bool, fill_too: bool) -> None:
    results = read_results()
    if page_too:
        PAGE.write_text(page(results), encoding="utf-8")
    for path in marked_pages() if fill_too else ():
        path.write_text(filled(path.read_text("utf-8"), results), encoding="utf-8")
