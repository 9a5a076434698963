"""Runs named claims and writes each number as JSON: value, unit, n, standard error, seed, commit, processor, seconds.

    python -m validation [CLAIM ...] [--full] [--data FOLDER] [-o build/validate.json]
    python -m validation --fill      # the numbers between markers of pages, of validation/results.json

Without names every claim runs, in ten minutes of two quiet cores; --full takes as many cases as a published number
needs. A claim, or a part of one, that is not run keeps its numbers in the file; calibration:infer_real runs one
setting of calibration, and challenge:fit one program of the challenge, whose numbers have a commit of their own then.
Cases of a commit without changes are kept beside the file, so that an interrupted run goes on. --data: folder of the
open sets; without it the claim open_sets is left out. Pictures of claims go to `pictures` beside the file; those of
validation/results.json to where the pages and the paper have them.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path

from cavirheo.parallel import cores
from validation import pages
from validation.claims import calibration, challenge, references, solver, times
from validation.numbers import Number, Run

ROOT = Path(__file__).resolve().parents[1]
PARTS = {"calibration": calibration.SETTINGS, "challenge": challenge.PARTS, "references": references.PARTS,
         "solver": solver.PARTS, "times": times.PARTS}  # fmt: skip
CLAIMS = (
    "solver", "peers", "calibration", "video", "population", "groups", "design", "evidence", "challenge", "open_sets",
    "references", "times",
)  # fmt: skip


def measured(name: str) -> Callable[[Run], Iterator[Number]]:
    return import_module(f"validation.claims.{name}").measure


def commit() -> str:
    """Of the repository, with a + where files have changed since."""
    words = ["git", "-C", str(ROOT), "describe", "--always", "--dirty=+", "--exclude=*"]
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()


def processor() -> str:
    table = Path("/proc/cpuinfo")
    lines = table.read_text("utf-8").splitlines() if table.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def record(numbers: list[Number]) -> dict:
    """By name; six digits, and null for what no case gave."""

    def digits(value: float) -> float | None:
        return float(f"{value:.6g}") if value == value else None

    rows = {number.name: asdict(number) for number in numbers}
    for row in rows.values():
        del row["name"]
        row |= {key: digits(row[key]) for key in ("value", "standard_error")}
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("claims", nargs="*", metavar="CLAIM", help=", ".join(CLAIMS))
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--data", type=Path, default=os.environ.get("CAVIRHEO_REAL_DATA"))
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "build" / "validate.json")
    parser.add_argument("--fill", action="store_true", help="write the numbers between markers, and run nothing")
    given = parser.parse_args()
    if given.fill:
        return pages.fill()
    unknown = set(given.claims) - {*CLAIMS, *(f"{claim}:{part}" for claim in PARTS for part in PARTS[claim])}
    if unknown:
        parser.error(f"unknown claims {', '.join(sorted(unknown))}; known: {', '.join(CLAIMS)}")
    found = json.loads(given.out.read_text("utf-8")) if given.out.exists() else {}
    given.out.parent.mkdir(parents=True, exist_ok=True)
    at = commit()
    kept = None if not at or at.endswith("+") else ROOT / "build" / "validate" / at
    pictures = ROOT if given.out.resolve() == pages.RESULTS else given.out.parent / "pictures"
    run = Run(given.full, cores(), kept, Path(given.data) if given.data else None, pictures=pictures)
    for claim in given.claims or CLAIMS:
        began = time.perf_counter()
        name, _, part = claim.partition(":")
        numbers = list(measured(name)(replace(run, part=part)))
        if not numbers:
            print(f"{claim}: left out")
            continue
        made, origin = record(numbers), {"commit": at, "date": datetime.now(UTC).date().isoformat()}
        before = found.get(name, {"numbers": {}})
        if part and name in found:
            before["numbers"] |= {key: row | origin for key, row in made.items()}
        else:
            of_before, parts = {key: before.get(key) for key in origin}, PARTS.get(name, ())
            unmade = {key: row for key, row in before["numbers"].items() if key.partition(".")[0] in parts}
            found[name] = {
                **origin,
                "processor": processor(),
                "full": given.full,
                "seconds": round(time.perf_counter() - began, 1),
                "numbers": {key: of_before | row for key, row in unmade.items() if key not in made} | made,
            }
        given.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        for number in numbers:
            value = f"{number.value:.3g} ± {number.standard_error:.2g} {number.unit}"
            print(f"{name}.{number.name}: {value} (n = {number.n})", flush=True)


if __name__ == "__main__":
    main()
