"""Files through every room that takes files, on the command line in this process, and what is wrong with what it said.

A batch is many files and a good one in one call: the good one is answered, each other is answered or refused in one
line that names it. A room that takes one file is called for each.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from apart import Ended, each_apart
from valid import TEXTS, shard

import cavirheo
from cavirheo import verbs
from cavirheo.companions import collapse_times, published_values, rheometer
from cavirheo.companions.rheometer import read_sweeps
from cavirheo.errors import InputError, SolverError
from cavirheo.io import write_csv
from cavirheo.io.option_tables import read_trace
from cavirheo.physics.driving import Trace
from cavirheo.physics.media import WATER
from cavirheo.training.recipe import read_recipe

SECONDS = float(os.environ.get("CAVIRHEO_HOSTILE_SECONDS", 240))  # for one call, on a machine that others use too
LINE = 1200  # characters of a refusal, but for the file's name
FINE = ("answered", "refused")


@dataclass(frozen=True)
class Said:
    """Of one call: exit status, stdout, stderr, and the traceback if there was one."""

    status: int
    out: str
    err: str
    error: str = ""


def call(words: Sequence[str]) -> Said:
    """What a command says in this process, also what the libraries below write to the two streams themselves."""
    status, error, sys.argv = 0, "", ["cavirheo", *words]
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        for file, number in ((out, 1), (err, 2)):
            os.dup2(file.fileno(), number)
        streams = [os.fdopen(os.dup(n), "w", encoding="utf-8", errors="surrogateescape") for n in (1, 2)]
        try:
            with contextlib.redirect_stdout(streams[0]), contextlib.redirect_stderr(streams[1]):
                verbs.main()
        except SystemExit as stop:
            status = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
        except BaseException:
            error = traceback.format_exc()
        texts = []
        for stream, file in zip(streams, (out, err), strict=True):
            stream.close()
            file.seek(0)
            texts.append(file.read().decode("utf-8", "surrogateescape"))
    return Said(status, *texts, error)


def trouble(said: Said, refusals: int) -> str:
    """What is wrong with what a call said, whatever it was about; `refusals`: how many lines may be errors."""
    both = said.out + said.err
    if said.error or "Traceback (most recent" in both:
        return "traceback"
    if said.status not in (0, 1, 2):
        return f"exit status {said.status}"
    if odd := re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202e\u2066-\u2069\ud800-\udfff]", both):
        return f"control character {odd[0]!r}"
    if "Warning:" in said.err:
        return "warning"
    lines = said.err.splitlines()
    others = [line for line in lines if not line.startswith("error:")]
    if len(lines) - len(others) > refusals or len(others) > 3:
        return "more than one line"
    return "long line" if max(map(len, lines), default=0) > LINE + 400 else ""


@dataclass(frozen=True)
class Batch:
    """A room that takes many files: the words before them and the document that holds where its answers are from."""

    words: tuple[str, ...]
    document: str
    good: str = "curve.csv"


BATCHES = {
    "infer": Batch(("infer", "--model", "bdt-viscoelastic"), "result.json"),
    "fit": Batch(("fit", "--window", "1"), "result.json"),
    "which-law": Batch(("which-law", "--laws", "nhkv,newtonian"), "laws.json"),
    "collapse-time": Batch(("collapse-time",), "collapse-time.json"),
    "rheometer": Batch(("rheometer",), "rheometer.json", "frequency.csv"),
}
_BUBBLE = "simulate --rmax-um 250 --stretch 7 --shear-modulus 5e3 --viscosity 0.05 --duration-us 20 -o {out}"
SINGLES = {
    "simulate --driving": f"{_BUBBLE} --driving {{file}}",
    "compare --references": "compare {here} --references {file} -o {out}",
    "compare FOLDER": "compare {file} --references {published} -o {out}",
    "rheometer --beside": "rheometer {sweep} --beside {file} -o {out}",
    "infer --model": "infer {curve} --model {file} -o {out}",
    "evaluate MODEL": "evaluate {file} {data} -o {out}",
    "evaluate DATA": "evaluate bdt-viscous {file} -o {out}",
    "generate": "generate {file} -n 1 -o {out}",
    "train": "train {file} {data} -o {out}",
    "train DATA": "train {recipe} {file} -o {out}",
    "show": "show {file}",
}


class WrongCurveError(Exception):
    """What is wrong although nothing was raised."""


def read_curves(path: str) -> None:
    for curve in cavirheo.read_curves(path)[:20]:
        known = curve.radius[np.isfinite(curve.radius)]
        fine = np.isfinite(curve.time).all() and (np.diff(curve.time) > 0).all() and (known > 0).all()
        if not fine or not all(isinstance(note, str) and "\n" not in note for note in curve.notes):
            raise WrongCurveError(f"a curve that no curve may be: {curve!r}, {curve.notes}")
        for use in (
            lambda c=curve: (c.max_radius, c.collapse_times(), c.noise, c.strain_rate(), c.normalised(WATER)),
            lambda c=curve: c.resampled(1e-6, 100, allow_short=True),
            lambda c=curve: write_csv(Path(path).with_name("written.out"), c),
        ):
            with contextlib.suppress(InputError):
                use()


def times(path: str) -> None:
    groups, problems, *_ = collapse_times.read_groups([Path(path)], WATER)
    for group in groups:
        group.model_dump_json()
    for problem in problems:
        raise InputError(problem)


def sweeps(path: str) -> None:
    rheometer.rheometry(read_sweeps(Path(path)), "x", command="x", date="", notes=[]).model_dump_json()


def pressure(path: str) -> None:
    trace = read_trace(Path(path))
    with contextlib.suppress(InputError):
        Trace(*trace[:2])


def references(path: str) -> None:
    published_values.read_references(Path(path))


def recipe(path: str) -> None:
    found = read_recipe(Path(path))
    found.settings()
    _ = found.problem.id, found.problem.prior.sample(2, 0)


def load(path: str) -> None:
    cavirheo.load(path)


def load_folder(path: str) -> None:
    """The file as the only shard of a training set."""
    with tempfile.TemporaryDirectory(dir=Path(path).parent) as folder:
        Path(folder, "shard-00000.h5").symlink_to(path)
        data = cavirheo.load(folder)
        _ = data.sha256, data.failures, data.split(0)


READERS = (read_curves, times, sweeps, pressure, references, recipe, load, load_folder)
PYTHON: dict[str, Callable[[str], None]] = {f"Python {reader.__name__}": reader for reader in READERS}
OURS = (AttributeError, TypeError, IndexError, KeyError, NameError, AssertionError, ZeroDivisionError, MemoryError)
OURS += (RecursionError, OverflowError, FloatingPointError, NotImplementedError)


def program(room: str, path: str) -> tuple[str, str]:
    """(outcome, text) of one file that a program reads, which is told the file's name as it is."""
    try:
        PYTHON[room](path)
    except (InputError, SolverError) as error:
        line, key = str(error), Path(path).parent.name
        cause = error.__cause__ or error.__context__
        while isinstance(cause, InputError):
            cause = cause.__cause__ or cause.__context__
        if getattr(error, "code", "") == "reading.damaged" and isinstance(cause, OURS) and made_here(cause):
            return "a mistake of ours is hidden", "".join(traceback.format_exception(cause))
        clean = not re.search(r"[\x00-\x1f\x7f-\x9f]", line.replace(path, f"/{key}/"))
        return "refused" if clean and f"/{key}/" in line else "not one line that names it", line
    except WrongCurveError as error:
        return "wrong", str(error)
    except Exception:
        return "traceback", traceback.format_exc()
    return "answered", ""


def made_here(error: BaseException) -> bool:
    """Whether our own line raised it, not a library that says so that the file is damaged."""
    return "/cavirheo/" in traceback.extract_tb(error.__traceback__)[-1].filename


def single(room: str, path: str, given: dict[str, str]) -> tuple[str, str]:
    """(outcome, text) of one file in a room that takes one."""
    if room in PYTHON:
        return program(room, path)
    with tempfile.TemporaryDirectory() as out:
        words = SINGLES[room].split()
        said = call([word.format(file=path, out=f"{out}/out", **given) for word in words])
        written = Path(out, "out").is_dir()
    wrong = trouble(said, refusals=1)
    text = f"status {said.status}\n{said.out[-1500:]}\n{said.err[-3000:]}\n{said.error}"
    if wrong:
        return wrong, text
    if said.status < 2 or (written and "error:" not in said.err):  # status 2 with a document: part was unreadable
        return "answered", text
    named = any(line.startswith("error:") and f"/{Path(path).parent.name}/" in line for line in said.err.splitlines())
    return "refused" if named else "does not name the file", text


def batch(room: str, paths: dict[str, str], given: dict[str, str]) -> dict[str, tuple[str, str]]:
    """(outcome, text) by key of many files and a good one in one call."""
    about = BATCHES[room]
    with tempfile.TemporaryDirectory() as out:
        good = str(Path(given["here"]) / about.good)
        said = call([*about.words, good, *paths.values(), "-o", f"{out}/out"])
        document = Path(out, "out", about.document)
        sources = _sources(json.loads(document.read_text())) if document.exists() else set()
        report = Path(out, "out", "report.html")
        html = report.read_text() if report.exists() else ""
    text = f"status {said.status}\n{said.out[-3000:]}\n{said.err[-6000:]}\n{said.error}"
    wrong = trouble(said, refusals=len(paths))
    if not wrong and good not in sources:
        wrong = "the good file is not answered"
    if not wrong and ("<script>alert" in html or "<img src=x" in html):
        wrong = "markup of a file is in the report"
    found = {}
    for key in paths:
        lines = [line for line in said.err.splitlines() if line.startswith("error:") and f"/{key}/" in line]
        answered = any(f"/{key}/" in source for source in sources)
        answered |= any(f"/{key}/" in line and "same recording" in line for line in (said.out + said.err).splitlines())
        outcome = {(True, 0): "answered", (False, 1): "refused"}.get((answered, len(lines)), "")
        found[key] = (wrong or outcome or f"answered: {answered}, lines: {len(lines)}", text)
    return found


def _sources(value: Any) -> set[str]:
    """Every `source` in a document."""
    if isinstance(value, dict):
        own = {value["source"]} if isinstance(value.get("source"), str) else set()
        return own.union(*map(_sources, value.values()))
    return set().union(*map(_sources, value)) if isinstance(value, list) else set()


def prepared(folder: Path) -> dict[str, str]:
    """The good files that the calls need beside the hostile one."""
    here = folder / "good"
    data = here / "data"
    data.mkdir(parents=True)
    for name, text in TEXTS.items():
        (here / name).write_text(text)
    shorter = TEXTS["curve.csv"].rstrip().rpartition("\n")[0]
    (here / "curve.csv").write_text(shorter + "\n")  # unlike those of the corpus: equal recordings count once
    (here / "sets.csv").write_text("set,files\ngel,*.csv\n")
    shard(data / "shard-00000.h5")
    names = {"here": here, "data": data, "published": here / "sets.csv", "sweep": here / "frequency.csv"}
    names |= {"recipe": here / "recipe.toml", "curve": here / "curve.csv"}
    return {key: str(path) for key, path in names.items()}


ROOMS = (*BATCHES, *SINGLES, *PYTHON)
Outcomes = dict[tuple[str, str], tuple[str, str]]  # (room, key of the file): outcome, text


def through(files: dict[str, Path], given: dict[str, str], only: Sequence[str], size: int = 50) -> Outcomes:
    """Every file through these rooms; a batch that is not clean is repeated file by file, which tells whose fault."""
    keys = list(files)
    parts = [keys[k : k + size] for k in range(0, len(keys), size)]
    jobs = [(room, part) for room in only if room in BATCHES for part in parts]
    jobs += [(room, [key]) for key in keys for room in only if room not in BATCHES]
    found = dict(_judged(jobs, files, given))
    again = [(room, [key]) for (room, key), (outcome, _) in found.items() if room in BATCHES and outcome not in FINE]
    return found | dict(_judged(again, files, given))


def _judged(jobs: list[tuple[str, list[str]]], files: dict[str, Path], given: dict[str, str]) -> Iterator[tuple]:
    def work(job: int) -> dict[str, tuple[str, str]]:
        room, part = jobs[job]
        if room in BATCHES:
            return batch(room, {key: str(files[key]) for key in part}, given)
        return {part[0]: single(room, str(files[part[0]]), given)}

    for job, answer in each_apart(work, range(len(jobs)), SECONDS):
        room, part = jobs[job]
        for key in part:
            yield (room, key), (answer.outcome, answer.why) if isinstance(answer, Ended) else answer[key]


def table(found: Outcomes) -> str:
    """Room by outcome, then every file with which something is wrong."""
    counts = Counter((room, outcome) for (room, _), (outcome, _) in found.items())
    kinds = sorted({outcome for _, outcome in counts}, key=lambda kind: (kind not in FINE, kind))
    wide = max(map(len, kinds)) + 2
    lines = [f"{'room':22s}" + "".join(f"{kind:>{wide}s}" for kind in kinds)]
    for room in dict.fromkeys(room for room, _ in counts):
        lines.append(f"{room:22s}" + "".join(f"{counts[room, kind]:{wide}d}" for kind in kinds))
    wrong = [f"{outcome}: {room}, {key}" for (room, key), (outcome, _) in found.items() if outcome not in FINE]
    return "\n".join([*lines, "", *sorted(wrong)])
