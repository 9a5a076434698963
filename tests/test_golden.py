"""What the program wrote, frozen, so that a change is seen.

Each case of golden_cases.py is made anew and compared with its file in tests/golden/. Another processor may round
otherwise, so numbers are compared with a tolerance; with CAVIRHEO_GOLDEN_EXACT=1 to the last bit, hashes included.

    python tests/test_golden.py --write [case ...]    makes the files anew, all or those of the named cases
    python tests/test_golden.py [case ...]            shows all differences
"""

from __future__ import annotations

import json
import os
import sys
import time

import pytest
from golden_cases import CASES, GOLDEN, differences, made

pytestmark = pytest.mark.needs("matplotlib")  # many documents list their pictures
EXACT = os.environ.get("CAVIRHEO_GOLDEN_EXACT", "") not in ("", "0")
SHOWN = 30  # differences


def params() -> list:
    return [pytest.param(name, marks=pytest.mark.slow if about.slow else ()) for name, about in CASES.items()]


@pytest.mark.parametrize("name", params())
def test_as_it_was(name):
    found = differing(name)
    assert not found, f"{len(found)} differences in {name}:\n" + "\n".join(found[:SHOWN])


def test_every_file_has_its_case():
    assert {path.stem for path in GOLDEN.glob("*.json")} == set(CASES)


def differing(name: str) -> list[str]:
    """Every difference between the case made now and its file."""
    old = json.loads((GOLDEN / f"{name}.json").read_text(encoding="utf-8"))
    return differences(old, made(name), CASES[name], EXACT)


def write(name: str) -> None:
    text = json.dumps(made(name), ensure_ascii=False, indent=0, separators=(",", ":"))
    (GOLDEN / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def main(words: list[str]) -> int:
    writing, names = "--write" in words, [word for word in words if not word.startswith("-")] or list(CASES)
    different = 0
    for name in names:
        began = time.perf_counter()
        found = [] if writing else differing(name)
        if writing:
            write(name)
        print(f"{name}: {len(found)} differences, {time.perf_counter() - began:.1f} s", *found, sep="\n  ", flush=True)
        different += bool(found)
    return different


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
