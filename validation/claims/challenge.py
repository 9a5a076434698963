"""The open challenge: how often intervals of `cavirheo infer` hold the truth of its recordings, and their width.

`field`, `real` and `all` are of seed 1; `several.field` and so on of UNSEEN, which --full takes, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from validation.challenge import answers, make, run_cavirheo, score, truth
from validation.numbers import SEED, Number, Run, coverage, share, statistic

UNSEEN = (8, 9, 10)  # seeds on which nothing was developed; 2 is unused until a release

Row = dict[str, str]


def one(job: tuple[int, str, int], folder: Path) -> dict:
    seed, name, _ = job
    (recording,) = [one for one in answers.read(folder / str(seed) / "recordings") if one.name == name]
    found = run_cavirheo.answer(recording, ["infer"])
    found.pop("predict", None)
    return {"name": f"{seed}.{name}", **found}


def measure(run: Run) -> Iterator[Number]:
    n, truths, jobs = run.count(20, 60), dict[int, list[Row]](), []
    with TemporaryDirectory() as folder:
        for seed in (SEED, *UNSEEN) if run.full else (SEED,):
            make.make(Path(folder) / str(seed), seed, n, run.workers)
            made = score.read(Path(folder) / str(seed) / "truth.csv")
            jobs += [(seed, row["name"], n) for row in made]
            truths[seed] = [{**row, "name": f"{seed}.{row['name']}"} for row in made]
        rows = run.rows("challenge", partial(one, folder=Path(folder)), jobs)
    rows = [{key: str(value) for key, value in row.items()} for row in rows]
    yield from judged("", truths[SEED], [row for row in rows if row["name"].startswith(f"{SEED}.")])
    if run.full:
        unseen = [row for row in rows if not row["name"].startswith(f"{SEED}.")]
        yield from judged("several.", [row for seed in UNSEEN for row in truths[seed]], unseen)


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
            yield share(f"{name}.bounds", [one.held for one in mine if one.one_sided])
