"""From a complete file to its answer: `cavirheo watch` on single files that arrive one after the other.

    python benchmarks/watch.py [count]

Wall time from the moment at which a file is complete to that at which result.json has its row, and processor time of
the watching process meanwhile. The compiled cache is warm: one shot is answered before.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np

from cavirheo import read_curves, simulate
from cavirheo.io import write_csv
from cavirheo.physics.materials import NeoHookeanKelvinVoigt
from cavirheo.video.synthetic import Scene, render

HERE = Path(__file__).resolve().parent
EXAMPLE = HERE.parent / "examples" / "soft_gel.csv"
RATE, SCALE, FRAMES = 500_000.0, 4.0, 100


def processor_seconds(pid: int) -> float:
    """User and system time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def rows(out: Path) -> int:
    path = out / "result.json"
    return len(json.loads(path.read_text())["curves"]) if path.exists() else 0


def film(path: Path, seed: int) -> None:
    """A bubble in a gel, as a camera sees it."""
    law = NeoHookeanKelvinVoigt(6000.0 + 100.0 * seed, 0.04)
    since = np.linspace(0.0, 180e-6, 4000)
    fall = simulate(law, max_radius=200e-6, stretch=7.0, time=since).radius
    growth = fall[: int(np.argmin(fall[:1500])) - 3][::-1]  # the way back of the first collapse
    grown = np.concatenate([growth, fall])
    when = np.arange(len(grown)) * (since[1] * RATE)
    render(when, grown * 1e6 / SCALE, frames=FRAMES, scene=Scene(width=160, height=144), seed=seed).save(path)


def measured(
    folder: Path, out: Path, words: Sequence[str], put: Callable[[int], object], count: int
) -> list[tuple[float, float]]:
    """(wall, processor) seconds of each file that `put(k)` completes."""
    command = [sys.executable, "-m", "cavirheo", "watch", str(folder), "-o", str(out), "--quiet", *words]
    process = subprocess.Popen(command)
    found = []
    try:
        for k in range(count + 1):
            before, began_processor = rows(out), processor_seconds(process.pid)
            put(k)
            began = time.perf_counter()
            while rows(out) <= before:
                time.sleep(0.01)
                if time.perf_counter() - began > 300.0 or process.poll() is not None:
                    raise SystemExit(f"no answer to file {k}")
            found.append((time.perf_counter() - began, processor_seconds(process.pid) - began_processor))
            time.sleep(0.7)
    finally:
        process.terminate()
        process.wait()
    return found[1:]  # the first loads and compiles


HEAD = """# From a complete file to its answer
`cavirheo watch`, files that arrive one after the other, compiled cache warm (`python benchmarks/watch.py`).
Wall time is from the complete file to its row in `result.json`; 0.4 to 0.8 s of it pass until the file is known to be
complete. "The answer itself" is what the row gives as its seconds, without the measuring of a video. Processor time is
that of the watching process, waiting included. Median (largest).

| file | n | asked, s | wall, s | the answer itself, s | processor, s | load of the machine |
|---|---|---|---|---|---|---|
"""
VIDEO = ("--fps", str(RATE), "--um-per-px", str(SCALE))
NETWORK = ("--model", "bdt-viscoelastic")
CASES = {
    "R(t), CSV": (2.0, ()),
    "R(t), CSV, the paper's network": (2.0, NETWORK),
    f"video, {FRAMES} frames": (5.0, VIDEO),
    f"video, {FRAMES} frames, the paper's network": (5.0, (*VIDEO, *NETWORK)),
}


def case(words: Sequence[str], count: int) -> list[list[float]]:
    """Wall, the answer's own and processor seconds of each file."""
    curve, ending = read_curves(EXAMPLE)[0], "mp4" if VIDEO[0] in words else "csv"
    with tempfile.TemporaryDirectory() as place:
        folder, out, aside = (Path(place) / name for name in ("in", "out", "aside"))
        folder.mkdir(), aside.mkdir()
        names = [f"shot{k:03d}.{ending}" for k in range(count + 1)]
        for k, name in enumerate(names):
            if ending == "mp4":
                film(aside / name, k)
            else:
                write_csv(aside / name, replace(curve, radius=curve.radius * (1 + 1e-3 * k)))
        found = measured(folder, out, words, lambda k: (aside / names[k]).rename(folder / names[k]), count)
        answers = json.loads((out / "result.json").read_text())["curves"][1:]
        return [[wall, row["seconds"], spent] for (wall, spent), row in zip(found, answers, strict=True)]


def main(count: int = 6) -> None:
    print(HEAD, end="")
    for name, (asked, words) in CASES.items():
        columns = zip(*case(words, count), strict=True)
        cells = " | ".join(f"{median(column):.2f} ({max(column):.2f})" for column in columns)
        load, cores = os.getloadavg()[0], os.cpu_count()
        print(f"| {name} | {count} | {asked:g} | {cells} | {load:.1f} on {cores} cores |", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
