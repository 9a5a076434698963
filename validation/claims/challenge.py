"""The open challenge: how often intervals hold the truth of its recordings, and their width; by cavirheo and others.

`field`, `real` and `all` are of `infer` and seed 1; `several.field` and so on of UNSEEN, which --full takes, too.
`fit.field` and so on are of other programs and seed 1. `open` are predictions of real recordings, where their folder is
given. `thinning`: power-law liquids. `together`: all recordings in one call. Without --full, parts other than `infer`
run where they are named.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from validation.challenge import answers, make, open_sets, run_cavirheo, run_scipy, score, truth
from validation.claims.open_sets import key_of
from validation.numbers import SEED, Number, Run, coverage, share, statistic

UNSEEN = (19,)  # of which no recording was made or answered before this release; 20 is unused until the next
PROGRAMS: dict[str, tuple[Callable[[answers.Recording, list[str]], answers.Answer], list[str]]] = {
    "infer": (run_cavirheo.answer, ["infer"]),
    "infer_field": (run_cavirheo.answer, ["infer", "--bubble", "field"]),
    "fit": (run_cavirheo.answer, ["fit"]),
    "scipy": (run_scipy.answer, []),
}
AHEAD = ("infer", "infer_field", "scipy")  # what predicts real recordings
PARTS = (*PROGRAMS, "together", "open")

Row = dict[str, str]


def named(folder: Path, name: str) -> answers.Recording:
    return next(one for one in answers.read(folder / "recordings") if one.name == name)


def one(job: tuple[str, int, str, int], folder: Path) -> dict:
    program, seed, name, _ = job
    answer, options = PROGRAMS[program]
    began = time.perf_counter()
    found = answer(named(folder / str(seed), name), options)
    found.pop("predict", None)
    return {"name": f"{seed}.{name}", "seconds": time.perf_counter() - began, **found}


def measure(run: Run) -> Iterator[Number]:
    n = run.count(20, 60)
    parts = [part for part in PARTS if run.part == part or (not run.part and (run.full or part == "infer"))]
    unseen = UNSEEN if run.full and "infer" in parts else ()
    truths, found = dict[int, list[Row]](), dict[tuple[str, int], list[Row]]()
    with TemporaryDirectory() as folder:

        def answer(program: str, seed: int, rows: list[Row]) -> None:
            jobs = [(program, seed, row["name"].partition(".")[2], n) for row in rows]
            answered = run.rows("challenge", partial(one, folder=Path(folder)), jobs)
            found[program, seed] = [{key: str(value) for key, value in row.items()} for row in answered]

        for seed in (SEED, *unseen) if parts != ["open"] else ():
            made = Path(folder) / str(seed)
            make.make(made, seed, n, run.workers)
            truths[seed] = [{**row, "name": f"{seed}.{row['name']}"} for row in score.read(made / "truth.csv")]
        for program in [one for one in PROGRAMS if one in parts]:
            answer(program, SEED, truths[SEED])
            yield from judged("" if program == "infer" else f"{program}.", truths[SEED], found[program, SEED])
        if "together" in parts:
            together = run_cavirheo.seconds_together(Path(folder) / str(SEED) / "recordings")
            yield statistic("together.seconds", [together], "s")
        for seed in unseen:
            answer("infer", seed, truths[seed])
        if unseen:
            answered = [row for seed in unseen for row in found["infer", seed]]
            yield from judged("several.", [row for seed in unseen for row in truths[seed]], answered)
    if "open" in parts:
        yield from predicted(run)
    if run.pictures and run.full and not run.part:
        shown = {program: found[program, SEED] for program in ("infer", "scipy")}
        score.draw(truths[SEED], shown, run.picture("validation/challenge/score.png"))


def judged(prefix: str, truths: list[Row], rows: list[Row]) -> Iterator[Number]:
    """The numbers of these recordings."""
    level = score.LEVEL
    for quantity in score.QUANTITIES:
        every = score.judge(truths, rows, quantity)
        for half in (*truth.HALVES, "all"):
            mine = [one for one in every if half in (one.about["half"], "all")]
            bounded, name = [one for one in mine if one.bounded], f"{prefix}{half}.{quantity}"
            yield coverage(f"{name}.{100 * level:.0f}", [one.held for one in bounded], level)
            yield statistic(f"{name}.width", [one.width for one in bounded], "decades")
            yield statistic(f"{name}.error", [abs(one.error) for one in mine], "decades")
            yield share(f"{name}.bounds", [one.held for one in mine if one.one_sided])
    liquids = [one for one in score.judge(truths, rows, "mu") if one.about["law"] == "power-law" and one.bounded]
    yield coverage(f"{prefix}thinning.mu.{100 * level:.0f}", [one.held for one in liquids], level)
    yield statistic(f"{prefix}seconds", [score.number(row.get("seconds")) for row in rows], "s")


def ahead(job: tuple[str, str, int], folder: Path) -> dict:
    """Of the frames of a real recording that were held back: RMS of predicted less measured radius over R_max, and the
    share that 90 % intervals hold, where there are any."""
    program, name, _ = job
    answer, options = PROGRAMS[program]
    held = [row for row in score.read(folder / "held.csv") if row["name"] == name]
    time, radius = (1e-6 * np.array([float(row[key]) for row in held]) for key in ("time_us", "radius_um"))
    recording = named(folder, name)
    predict = answer(recording, options).get("predict")
    rows = np.full((1, len(held)), np.nan) if predict is None else np.atleast_2d(predict(time))
    rms = float(np.sqrt(np.mean((rows[0] - radius) ** 2))) / recording.max_radius
    within = float(np.mean((rows[1] < radius) & (radius < rows[2]))) if len(rows) == 3 else np.nan
    return {"set": held[0]["set"], "rms": rms, "held": within}


def predicted(run: Run) -> Iterator[Number]:
    """Medians over the shots of each open set, and the mean share of frames that 90 % intervals hold, of all shots;
    nothing without the sets."""
    if run.data is None:
        return
    shots = run.count(1, 5)
    with TemporaryDirectory() as folder:
        open_sets.make(run.data, Path(folder), shots)
        names = list(dict.fromkeys(row["name"] for row in score.read(Path(folder) / "held.csv")))
        for program in AHEAD:
            jobs = [(program, name, shots) for name in names]
            rows = run.rows("ahead", partial(ahead, folder=Path(folder)), jobs)
            for group in open_sets.SETS:
                errors = [row["rms"] for row in rows if row["set"] == group]
                yield statistic(f"open.{program}.{key_of(group)}", errors, "R_max")
            if any(np.isfinite(row["held"]) for row in rows):
                yield statistic(f"open.{program}.held", [row["held"] for row in rows], "1", np.mean)
