"""Scores the answers of programs to the recordings of the challenge.

    python -m validation.challenge.score TRUTH.csv ANSWERS.csv [ANSWERS.csv ...] [-o OUT]

Each file of answers is one program, named by the file. Without -o the tables are printed; with it they stand in OUT.md
and the picture in OUT.png.
The page README.md beside this file explains the columns.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

QUANTITIES = {"G": 1.0, "mu": 1e-6}  # Pa, Pa s: bounds below count as these
ANSWERED = tuple(f"{name}{end}" for name in QUANTITIES for end in ("", "_low", "_high"))
TRUTH = ("name", "half", "difficulty", "law", *QUANTITIES)
LEVEL = 0.9
Row = dict[str, str]


@dataclass(frozen=True)
class Judged:
    """One quantity of one recording as one program answers it; log10. error, low and high: NaN where there is none."""

    about: Row  # of the recording
    error: float
    low: float  # bounds less truth
    high: float
    verdict: str

    @property
    def bounded(self) -> bool:
        return bool(np.isfinite(self.low) and np.isfinite(self.high))

    @property
    def one_sided(self) -> bool:
        return bool(np.isfinite(self.low) != np.isfinite(self.high))

    @property
    def held(self) -> bool:
        """Also of a bound on one side."""
        return (self.bounded or self.one_sided) and not (self.low > 0.0 or self.high < 0.0)

    @property
    def width(self) -> float:
        return self.high - self.low

    @property
    def interval_score(self) -> float:
        """Width, and 2/(1 - level) times the distance of the truth from the interval; smaller is better.

        Gneiting and Raftery 2007, doi:10.1198/016214506000001437, equation 43.
        """
        return self.width + 2.0 / (1.0 - LEVEL) * max(self.low, -self.high, 0.0)


def read(path: Path, columns: Sequence[str] = (), numbers: Sequence[str] = ()) -> list[Row]:
    """The lines of a table by the names in its first line; `columns` must be there, and `numbers` are not negative, or
    empty. Raises ValueError: something else is written, with the line."""
    try:
        table = csv.reader(path.read_text(encoding="utf-8-sig").splitlines(), skipinitialspace=True)
    except UnicodeDecodeError:
        raise ValueError(f"{path}: it must be text in UTF-8") from None
    heads, found = [name.strip() for name in next(table, [])], list[Row]()
    missing = [name for name in columns if name not in heads]
    if missing:
        expected = f"its first line must name {', '.join(columns)}, with commas between"
        raise ValueError(f"{path}: {expected}; missing: {', '.join(missing)}")
    for cells in filter(None, table):
        where = f"{path}, line {table.line_num}"
        if len(cells) != len(heads):
            raise ValueError(f"{where}: {len(cells)} cells for {len(heads)} columns")
        row = dict(zip(heads, map(str.strip, cells), strict=True))
        for name in numbers:
            if not _is_amount(row.get(name, "")):
                raise ValueError(f"{where}: {name} must be a number that is not negative, or empty; got {row[name]!r}")
        for name in QUANTITIES:
            low, high = (number(row.get(f"{name}_{end}")) for end in ("low", "high"))
            if low > high:
                raise ValueError(f"{where}: {name}_low {low:g} is above {name}_high {high:g}")
        found.append(row)
    return found


def _is_amount(text: str) -> bool:
    """Whether this is a number that is not negative, or nothing."""
    try:
        return not text or 0.0 <= float(text) < np.inf
    except ValueError:
        return False


def number(text: str | None, least: float = -np.inf) -> float:
    """NaN where nothing is written."""
    return max(float(text), least) if text not in (None, "") else np.nan


def judge(truth: Sequence[Row], answers: Sequence[Row], quantity: str) -> list[Judged]:
    """The answers to all recordings that have this quantity: a liquid has no G.

    Raises ValueError for an answer to a recording that does not exist, or two to the same.
    """
    given, times = {row["name"]: row for row in answers}, Counter(row["name"] for row in answers)
    names = {row["name"] for row in truth}
    for name, count in times.items():
        if count > 1 or name not in names:
            got = f"{count} of" if count > 1 else "the unknown name"
            raise ValueError(f"each recording has one answer, by its name in the table of truths; got {got} {name!r}")
    found = []
    for about in truth:
        true, row = float(about[quantity]), given.get(about["name"], {})
        if true <= 0:
            continue
        columns = (quantity, f"{quantity}_low", f"{quantity}_high")
        error, low, high = np.log10([number(row.get(one), QUANTITIES[quantity]) for one in columns]) - np.log10(true)
        found.append(Judged(about, float(error), float(low), float(high), row.get("verdict") or ""))
    return found


def share(held: int, n: int) -> str:
    """'88 ± 4 (44 of 50)': the standard error is that of a program whose intervals hold as often as they say."""
    return f"{100 * held / n:.0f} ± {100 * np.sqrt(LEVEL * (1 - LEVEL) / n):.0f} ({held} of {n})" if n else ""


def cells(judged: Sequence[Judged]) -> list[str]:
    """The cells of HEADS."""
    values = np.abs([one.error for one in judged if np.isfinite(one.error)])
    bounded, sided = ([one for one in judged if getattr(one, kind)] for kind in ("bounded", "one_sided"))
    row = [f"{len(values)} of {len(judged)}", f"{np.median(values):.2f}" if len(values) else ""]
    row.append(share(sum(one.held for one in bounded), len(bounded)))
    row.append(f"{np.median([one.width for one in bounded]):.2f}" if bounded else "")
    row.append(f"{np.mean([one.interval_score for one in bounded]):.2f}" if bounded else "")
    row.append(f"{sum(one.held for one in sided)} of {len(sided)}" if sided else "")
    return row


HEADS = ("answered", "error", "held, %", "width", "interval score", "bounds held")


def markdown(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    lines = [list(heads), *map(list, rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def grouped(truth: Sequence[Row], programs: dict[str, list[Row]], by: Callable[[Judged], str], word: str) -> str:
    """A table with a row for each program, group of recordings and quantity."""
    rows = []
    for program, answers in programs.items():
        for quantity in QUANTITIES:
            judged = judge(truth, answers, quantity)
            for group in dict.fromkeys(sorted(map(by, judged))):
                mine = [one for one in judged if by(one) == group]
                rows.append([program, quantity, group, *cells(mine)])
    return markdown(("program", "", word, *HEADS), rows)


def report(truth: Sequence[Row], programs: dict[str, list[Row]]) -> str:
    """Every table, in Markdown."""
    parts = [
        f"{len(truth)} recordings. Errors and widths are decades (0.1 is 26 %).",
        grouped(truth, programs, lambda one: one.about["half"], "bubble"),
        grouped(truth, programs, lambda one: one.about["difficulty"], "difficulty"),
        grouped(truth, programs, lambda one: one.about["law"], "law"),
    ]
    judging = {name: rows for name, rows in programs.items() if any(row.get("verdict") for row in rows)}
    if judging:
        parts.append(grouped(truth, judging, lambda one: one.verdict.partition(":")[0] or "none", "its own verdict"))
    return "\n\n".join(parts)


def draw(truth: Sequence[Row], programs: dict[str, list[Row]], path: Path) -> None:
    """Answer over truth, with the interval, of every recording in the order of its truth; open: the interval misses."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    figure = Figure(figsize=(9.0, 0.6 + 1.9 * len(programs)), layout="constrained")
    places = figure.subplots(len(programs), 2, squeeze=False, sharex="col", sharey=True)
    colours = {"field": "#0072b2", "real": "#d55e00"}
    for (program, answers), line in zip(programs.items(), places, strict=True):
        for quantity, axes in zip(QUANTITIES, line, strict=True):
            for one in judge(truth, answers, quantity):
                x, colour = float(one.about[quantity]), colours[one.about["half"]]
                if one.bounded:
                    axes.plot([x, x], [one.low, one.high], color=colour, lw=1.0, alpha=0.6)
                inside = colour if one.held else "white"
                axes.plot(x, one.error, "o", ms=4, color=colour, mfc=inside)
            axes.axhline(0.0, color="#444444", lw=0.8)
            axes.set(xscale="log", ylim=(-1.6, 1.6), ylabel=f"{program}\nlog10 of {quantity} over truth")
            axes.xaxis.set_minor_formatter(NullFormatter())
        for axes, (quantity, unit) in zip(places[-1], (("G", "Pa"), ("mu", "Pa s")), strict=True):
            axes.set_xlabel(f"true {quantity}, {unit} (blue: field's bubble, red: real one)")
    figure.savefig(path, dpi=110)


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth", type=Path)
    parser.add_argument("answers", type=Path, nargs="+")
    parser.add_argument("-o", "--out", type=Path)
    given = parser.parse_args(words)
    try:
        run(given.truth, given.answers, given.out)
    except (OSError, ValueError) as error:
        sys.exit(f"score.py: {error}")


def run(truths: Path, answers: Sequence[Path], out: Path | None) -> None:
    """Print or write the tables of these files, and draw the picture. Raises ValueError as `read` and `judge`."""
    truth, programs = read(truths, TRUTH), dict[str, list[Row]]()
    for path in answers:
        if path.stem in programs:
            raise ValueError(f"two files are named {path.name}: each file is a program with that name, rename one")
        programs[path.stem] = read(path, ("name", *ANSWERED), (*ANSWERED, "seconds"))
    text = report(truth, programs)
    if out is None:
        print(text)
        return
    out.parent.mkdir(parents=True, exist_ok=True)
    out.with_suffix(".md").write_text(text + "\n", encoding="utf-8")
    draw(truth, programs, out.with_suffix(".png"))


if __name__ == "__main__":
    main()
