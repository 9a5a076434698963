"""How long a new user waits for the first answer: what README says, step by step, in an environment made for it.

    python benchmarks/first_answer.py [--mat SHOT.mat]

Each step's time on the clock and of the processors (of this step alone, and of what it starts). On a busy machine the
second is the one to compare; what is downloaded counts on the clock alone.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parent.parent
VIDEO = "infer {examples}/bubble.mp4 --fps 500000 --um-per-px 4 -o by-video"


def timed(words: list[str], folder: Path) -> tuple[float, float, subprocess.CompletedProcess[str]]:
    """s on the clock and of the processors."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
    after, clock = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - began
    return clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done


def size(folder: Path) -> float:
    """MB on the disk."""
    return sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def main() -> None:
    take = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    take.add_argument("--mat", type=Path, default=ROOT / "examples" / "stiff_gel.mat")
    shot = take.parse_args().mat.absolute()
    with tempfile.TemporaryDirectory() as made:
        folder, program = Path(made), str(Path(made, "new", "bin", "cavirheo"))
        pip = [str(Path(made, "new", "bin", "pip")), "install", "--quiet", "--disable-pip-version-check"]
        pip += ["-c", str(ROOT / "constraints.txt")]
        steps = {
            "python3 -m venv": [sys.executable, "-m", "venv", "new"],
            "pip install .": [*pip, str(ROOT)],
            "infer, first time": [program, "infer", str(shot), "-o", "first"],
            "infer, second time": [program, "infer", str(shot), "-o", "second"],
            'pip install ".[plot,video]"': [*pip, f"{ROOT}[plot,video]"],
            "infer of a recording, first time": [program, *VIDEO.format(examples=ROOT / "examples").split()],
            "infer of a recording, second time": [program, *VIDEO.format(examples=ROOT / "examples").split()],
        }
        print(f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores\n")
        print("| step | clock, s | processors, s | MB |")
        print("|---|---|---|---|")
        for step, words in steps.items():
            clock, processors, done = timed(words, folder)
            if done.returncode > 1:
                sys.exit(f"{step}: {done.stdout}{done.stderr}")
            installed = f"{size(folder / 'new'):.0f}" if words[0] == pip[0] else ""
            print(f"| {step} | {clock:.0f} | {processors:.0f} | {installed} |", flush=True)
        print("\n" + (folder / "by-video" / "result.csv").read_text("utf-8").splitlines()[1][:200])


if __name__ == "__main__":
    main()
