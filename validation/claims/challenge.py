"""The open challenge: how often intervals of `cavirheo infer` hold the truth of its recordings, and their width."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from validation.challenge import answers, make, run_cavirheo, score, truth
from validation.numbers import SEED, Number, Run, coverage, share, statistic


def one(job: tuple[str, int], folder: Path) -> dict:
    (recording,) = [one for one in answers.read(folder) if one.name == job[0]]
    found = run_cavirheo.answer(recording, ["infer"])
    found.pop("predict", None)
    return {"name": job[0], **found}


def measure(run: Run) -> Iterator[Number]:
    n = run.count(20, 60)
    with TemporaryDirectory() as folder:
        make.make(Path(folder), SEED, n, run.workers)
        truths = score.read(Path(folder) / "truth.csv")
        ask = partial(one, folder=Path(folder) / "recordings")
        rows = run.rows("challenge", ask, [(row["name"], n) for row in truths])
    rows = [{key: str(value) for key, value in row.items()} for row in rows]
    level = score.LEVEL
    for quantity in score.QUANTITIES:
        judged = score.judge(truths, rows, quantity)
        for half in (*truth.HALVES, "all"):
            mine = [one for one in judged if half in (one.about["half"], "all")]
            bounded = [one for one in mine if one.bounded]
            yield coverage(f"{half}.{quantity}.{100 * level:.0f}", [one.held for one in bounded], level)
            yield statistic(f"{half}.{quantity}.width", [one.width for one in bounded], "decades")
            yield share(f"{half}.{quantity}.bounds", [one.held for one in mine if one.one_sided])
