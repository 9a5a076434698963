"""The open challenge: how often intervals hold the truth of its recordings, and their width; by cavirheo and others.

`field`, `real` and `all` are of `infer` and seed 1; `several.field` and so on of UNSEEN, which --full takes, too.
`fit.field` and so on, which --full alone takes, are of other programs and seed 1; `pyimr.G.ratio` is the width of an
interval of `infer` over that of PyIMR, in recordings where both hold the truth. PyIMR takes minutes a recording and an
environment of its own: its answers are kept in challenge/pyimr.csv, where some recordings may lack one.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from validation.challenge import answers, make, run_cavirheo, run_scipy, score, truth
from validation.numbers import SEED, Number, Run, coverage, share, statistic

UNSEEN = (8, 9, 10)  # seeds on which nothing was developed; 2 is unused until a release
PROGRAMS = {"infer": (run_cavirheo.answer, ["infer"]), "fit": (run_cavirheo.answer, ["fit"])}
PROGRAMS |= {"scipy": (run_scipy.answer, list[str]())}
PYIMR = Path(__file__).parents[1] / "challenge" / "pyimr.csv"  # its answers to seed 1
PARTS = (*PROGRAMS, "pyimr")

Row = dict[str, str]


def one(job: tuple[str, int, str, int], folder: Path) -> dict:
    program, seed, name, _ = job
    answer, options = PROGRAMS[program]
    (recording,) = [one for one in answers.read(folder / str(seed) / "recordings") if one.name == name]
    began = time.perf_counter()
    found = answer(recording, options)
    found.pop("predict", None)
    return {"name": f"{seed}.{name}", "seconds": time.perf_counter() - began, **found}


def measure(run: Run) -> Iterator[Number]:
    n, wanted = run.count(20, 60), [part for part in PARTS if run.part in ("", part)]
    unseen = UNSEEN if run.full and "infer" in wanted else ()
    programs = [one for one in PROGRAMS if one in wanted or (one, run.part) == ("infer", "pyimr")]
    truths, found = dict[int, list[Row]](), dict[tuple[str, int], list[Row]]()
    with TemporaryDirectory() as folder:
        for seed in (SEED, *unseen):
            make.make(Path(folder) / str(seed), seed, n, run.workers)
            made = score.read(Path(folder) / str(seed) / "truth.csv")
            truths[seed] = [{**row, "name": f"{seed}.{row['name']}"} for row in made]
            for program in programs:
                if program == "infer" or (run.full and seed == SEED):
                    jobs = [(program, seed, row["name"], n) for row in made]
                    rows = run.rows("challenge", partial(one, folder=Path(folder)), jobs)
                    found[program, seed] = [{key: str(value) for key, value in row.items()} for row in rows]
    if "infer" in wanted:
        yield from judged("", truths[SEED], found["infer", SEED])
    if unseen:
        answered = [row for seed in unseen for row in found["infer", seed]]
        yield from judged("several.", [row for seed in unseen for row in truths[seed]], answered)
    for program in ("fit", "scipy"):
        if (program, SEED) in found:
            yield from judged(f"{program}.", truths[SEED], found[program, SEED])
    if run.full and "pyimr" in wanted:
        yield from compared(truths[SEED], found["infer", SEED])
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
    yield statistic(f"{prefix}seconds", [score.number(row.get("seconds")) for row in rows], "s")


def compared(truths: list[Row], infer: list[Row]) -> Iterator[Number]:
    """PyIMR's numbers, and the widths of `infer` over its widths."""
    rows = [{**row, "name": f"{SEED}.{row['name']}"} for row in score.read(PYIMR)]
    asked = [row for row in truths if row["name"] in {row["name"] for row in rows}]
    yield from judged("pyimr.", asked, rows)
    for quantity in score.QUANTITIES:
        yield statistic(f"pyimr.{quantity}.ratio", score.ratios(truths, infer, rows, quantity), "1")
