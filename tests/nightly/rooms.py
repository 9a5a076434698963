"""Files through every command that takes files, in this process, and what is wrong with what it said.

A command that takes many files gets many and a good one in one call: the good one is answered, each other is answered
or refused in one line that names it. A command that takes one file is called for each.
"""

import json
import os
import re
import sys
import tempfile
import traceback
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from apart import Ended, each_apart
from valid import TEXTS, shard

from cavirheo import verbs

SECONDS = float(os.environ.get("CAVIRHEO_HOSTILE_SECONDS", 240))  # for one call, on a machine that others use too
LINE = 1600  # characters of a refusal, the file's name among them
FINE = ("answered", "refused")


class Said(NamedTuple):
    """Of one call: exit status, stdout, stderr, and the traceback if there was one."""

    status: int
    out: str
    err: str
    error: str

    def __str__(self) -> str:
        return f"status {self.status}\n{self.out[-3000:]}\n{self.err[-6000:]}\n{self.error}"


def call(words: Sequence[str], folder: Path) -> Said:
    """What a command says in this process, also what the libraries below write to the two streams themselves."""
    status, error, sys.argv = 0, "", ["cavirheo", *words]
    for number, name in ((1, "stdout"), (2, "stderr")):
        with (folder / name).open("wb") as file:
            os.dup2(file.fileno(), number)
        setattr(sys, name, open(number, "w", encoding="utf-8", errors="surrogateescape", closefd=False))  # noqa: SIM115
    try:
        verbs.main()
    except SystemExit as stop:
        status = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except BaseException:
        error = traceback.format_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    texts = ((folder / name).read_bytes().decode("utf-8", "surrogateescape") for name in ("stdout", "stderr"))
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
    return "long line" if max(map(len, lines), default=0) > LINE else ""


BATCHES = {  # of as many files as there are, and a good one
    "infer": "infer --model bdt-viscoelastic {curve} {file} -o {out}",
    "fit": "fit --window 1 {curve} {file} -o {out}",
    "which-law": "which-law --laws nhkv,newtonian {curve} {file} -o {out}",
    "collapse-time": "collapse-time {times} {file} -o {out}",
    "rheometer": "rheometer {sweep} {file} -o {out}",
}
ROOMS = BATCHES | {
    "infer --references": "infer --model bdt-viscoelastic {curve} --references {file} -o {out}",
    "compare RESULT": "compare {file} --references {published} -o {out}",
    "infer --model": "infer {curve} --model {file} -o {out}",
    "generate": "generate {file} -n 1 -o {out}",
    "train": "train {file} {data} -o {out}",
    "train DATA": "train {recipe} {file} -o {out}",
    "show": "show {file}",
}


Outcomes = dict[tuple[str, str], tuple[str, str]]  # (command, key of the file): outcome, text


def judged(room: str, paths: Mapping[str, Path], given: Mapping[str, str]) -> Outcomes:
    """Of these files in one call."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "out")
        words = [
            word.format(file=path, out=out, **given)
            for word in ROOMS[room].split()
            for path in (paths.values() if word == "{file}" else [""])
        ]
        said = call(words, Path(folder))
        sources = set[str]()  # every `source` in the documents
        for path in out.glob("*.json"):
            json.loads(path.read_text(), object_hook=lambda one: sources.add(str(one.get("source"))))
        html = "".join(path.read_text() for path in out.glob("*.html"))
        written = out.is_dir()
    wrong = trouble(said, refusals=len(paths))
    if not wrong and room in BATCHES and not sources & {given["curve"], given["sweep"], given["times"]}:
        wrong = "the good file is not answered"
    if not wrong and ("<script>alert" in html or "<img src=x" in html):
        wrong = "markup of a file is in the report"
    errors = [line for line in said.err.splitlines() if line.startswith("error:")]
    twice = [line for line in (said.out + said.err).replace("\n      ", " ").splitlines() if "same recording" in line]
    found = {}
    for key in paths:
        lines = [line for line in errors if f"/{key}/" in line]
        if room in BATCHES:
            answered = any(f"/{key}/" in text for text in (*sources, *twice))
        else:  # status 2 with a document: part was unreadable
            answered = said.status < 2 or (written and not errors)
        outcome = {(True, 0): "answered", (False, 1): "refused"}.get((answered, len(lines)))
        found[room, key] = (wrong or outcome or f"answered: {answered}, lines: {len(lines)}", str(said))
    return found


def prepared(folder: Path) -> dict[str, str]:
    """The good files that the calls need beside the hostile one."""
    here = folder / "good"
    data = here / "data"
    data.mkdir(parents=True)
    for name, text in TEXTS.items():
        (here / name).write_text(text)
    shorter = TEXTS["curve.csv"].rstrip().rpartition("\n")[0]
    (here / "curve.csv").write_text(shorter + "\n")  # unlike those of the corpus: equal recordings count once
    (here / "sets.csv").write_text("set,method,quantity,mean\ngel,IMR,G_kPa,5\n")
    shard(data / "shard-00000.h5")
    names = {"here": here, "data": data, "published": here / "sets.csv", "sweep": here / "frequency.csv"}
    names |= {"recipe": here / "recipe.toml", "curve": here / "curve.csv", "times": here / "times.csv"}
    return {key: str(path) for key, path in names.items()}


def through(files: Mapping[str, Path], given: Mapping[str, str], only: Iterable[str], size: int = 50) -> Outcomes:
    """Every file through these commands; a batch that is not clean is repeated file by file, to tell whose fault."""
    keys = list(files)
    parts = [keys[k : k + size] for k in range(0, len(keys), size)]
    jobs = [(room, part) for room in only if room in BATCHES for part in parts]
    jobs += [(room, [key]) for key in keys for room in only if room not in BATCHES]
    found = _done(jobs, files, given)
    again = [(room, [key]) for (room, key), (outcome, _) in found.items() if room in BATCHES and outcome not in FINE]
    return found | _done(again, files, given)


def _done(jobs: list[tuple[str, list[str]]], files: Mapping[str, Path], given: Mapping[str, str]) -> Outcomes:
    def work(job: int) -> Outcomes:
        room, part = jobs[job]
        return judged(room, {key: files[key] for key in part}, given)

    found: Outcomes = {}
    for job, answer in each_apart(work, range(len(jobs)), SECONDS):
        room, part = jobs[job]
        found |= {(room, key): answer for key in part} if isinstance(answer, Ended) else answer
    return found


def wrong(found: Outcomes) -> list[str]:
    """Every file with which something is wrong, and what."""
    return sorted(f"{outcome}: {room}, {key}" for (room, key), (outcome, _) in found.items() if outcome not in FINE)
