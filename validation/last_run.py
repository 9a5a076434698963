"""Runs targets of the Makefile one after another, and writes how each ended to validation/last_run.json.

    python -m validation.last_run [TARGET ...]

Without targets: all that `make test` and .ci/run do not run. A target that fails does not stop the others; the exit
status is 1 if one failed. A target that is not run keeps its entry. `fuzz` takes the seconds since 1970 as its seed.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

from validation.__main__ import commit, processor

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "validation" / "last_run.json"
TARGETS = (
    "dist",
    "test-pythons",
    "test-lowest",
    "test-slow",
    "test-hostile",
    "test-planted",
    "fuzz",
    "docs",
    "validate",
)
COUNT = re.compile(r"(\d+) (passed|failed|skipped|errors?|deselected|warnings?)\b")  # of pytest
PLANTED = re.compile(r"^(\d+) of (\d+) (caught)$", re.MULTILINE)
FUZZED = re.compile(r"^ *(\d+)  (\w+: \w+)$", re.MULTILINE)  # files that a room read or refused
LAST = 200  # characters of the last line that are kept


def figures(text: str) -> dict[str, int]:
    """Counts of pytest's last summary, of planted errors, and those of the fuzzer."""
    summaries = [counts for line in text.splitlines() if (counts := COUNT.findall(line))]
    planted = [pair for caught, of, word in PLANTED.findall(text) for pair in ((caught, word), (of, "planted"))]
    return {name: int(count) for count, name in [*(summaries or [[]])[-1], *planted, *FUZZED.findall(text)]}


def run(target: str) -> dict:
    """How it ended, with the figures of its last lines; the output goes to build/last_run/TARGET.txt."""
    words, at = ["make", "-C", str(ROOT), target], commit()
    seed = int(time.time()) if target == "fuzz" else None
    words += [f"SEED={seed}"] if seed is not None else []
    log = ROOT / "build" / "last_run" / f"{target}.txt"
    log.parent.mkdir(parents=True, exist_ok=True)
    began = time.perf_counter()
    with log.open("w", encoding="utf-8") as file:
        ended = subprocess.run(words, stdout=file, stderr=subprocess.STDOUT, check=False)
    text = log.read_text("utf-8", errors="replace")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith(("make[", "make:"))]
    return {
        "outcome": "passed" if ended.returncode == 0 else f"failed ({ended.returncode})",
        "date": datetime.now(UTC).date().isoformat(),
        "seconds": round(time.perf_counter() - began, 1),
        "commit": at,
        "processor": processor(),
        **({} if seed is None else {"seed": seed}),
        "figures": figures(text),
        "last_line": lines[-1][:LAST] if lines else "",
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=" ".join(TARGETS))
    found = json.loads(OUT.read_text("utf-8")) if OUT.exists() else {}
    failed = False
    for target in parser.parse_args().targets or TARGETS:
        found[target] = run(target)
        failed = failed or found[target]["outcome"] != "passed"
        OUT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        entry = found[target]
        print(f"{target}: {entry['outcome']}, {entry['seconds']} s, {entry['figures']}", flush=True)
    sys.exit(failed)


if __name__ == "__main__":
    main()
