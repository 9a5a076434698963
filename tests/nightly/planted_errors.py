"""Errors that are planted in a copy of the package, one at a time: each must be caught by the tests that are named.

python tests/nightly/planted_errors.py [words of names or tests ...]

The exit status is the number of errors that no test caught.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]


class Planted(NamedTuple):
    """file: below src/cavirheo. old occurs there once, and becomes new. tests: stems of the modules that catch it."""

    name: str
    file: str
    old: str
    new: str
    tests: list[str]


def planted() -> list[Planted]:
    """Of the table beside this file, in which \\n stands for the end of a line."""
    _, *rows = Path(__file__).with_suffix(".tsv").read_text(encoding="utf-8").splitlines()
    cells = [row.replace(r"\n", "\n").split("\t") for row in rows]
    return [Planted(name, file, old, new, tests.split()) for name, file, old, new, tests in cells]


PLANTED = planted()


def caught(error: Planted, copy: Path) -> list[str]:
    """Stems of the test files that fail with this error in the copy of src."""
    path = copy / "cavirheo" / error.file
    right = path.read_text(encoding="utf-8")
    if right.count(error.old) != 1:
        raise SystemExit(f"{error.name}: {error.file} has {right.count(error.old)} times {error.old!r}, not once")
    words = [sys.executable, "-m", "pytest", "--maxfail=1", "-p", "no:cacheprovider", "-m", "not slow and not hostile"]
    how = {"cwd": ROOT, "env": os.environ | {"PYTHONPATH": str(copy)}, "capture_output": True, "text": True}
    path.write_text(right.replace(error.old, error.new), encoding="utf-8")
    ended = {stem: subprocess.run([*words, *ROOT.glob(f"tests/**/{stem}.py")], **how) for stem in error.tests}
    path.write_text(right, encoding="utf-8")
    for stem, done in ended.items():
        if done.returncode not in (0, 1, 5):  # 5: its tests are slow ones
            raise SystemExit(f"{stem} did not run: {done.stdout[-500:]}{done.stderr[-500:]}")
    return [stem for stem, done in ended.items() if done.returncode == 1]


def main() -> int:
    wanted = sys.argv[1:]
    chosen = [one for one in PLANTED if not wanted or any(w in one.tests or w in one.name for w in wanted)]
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "src"
        shutil.copytree(ROOT / "src", copy)
        for error in chosen:
            began, found = time.monotonic(), caught(error, copy)
            missed += not found
            said = f"caught by {', '.join(found)}" if found else f"MISSED by {', '.join(error.tests)}"
            print(f"{error.name}: {said} ({time.monotonic() - began:.0f} s)", flush=True)
    print(f"{len(chosen) - missed} of {len(chosen)} caught")
    return missed


if __name__ == "__main__":
    sys.exit(main())
