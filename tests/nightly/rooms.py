"""Files through every command that takes files, in this process, and what is wrong with what it said.

A batch is many files and a good one in one call: the good one is answered, each other is answered or refused in one
line that names it. A command that takes one file is called for each.
"""

import contextlib
import json
import os
import re
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from apart import Ended, each_apart
from valid import TEXTS, shard

from cavirheo import verbs

SECONDS = float(os.environ.get("CAVIRHEO_HOSTILE_SECONDS", 240))  # for one call, on a machine that others use too
LINE = 1600  # characters of a refusal, the file's name among them
FINE = ("answered", "refused")


@dataclass(frozen=True)
class Said:
    """Of one call: exit status, stdout, stderr, and the traceback if there was one."""

    status: int
    out: str
    err: str
    error: str = ""

    def __str__(self) -> str:
        return f"status {self.status}\n{self.out[-3000:]}\n{self.err[-6000:]}\n{self.error}"


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
    return "long line" if max(map(len, lines), default=0) > LINE else ""


BATCHES = {  # commands that take many files: the words, a good file, and the document that tells where answers are from
    "infer": ("infer --model bdt-viscoelastic", "curve.csv", "result.json"),
    "fit": ("fit --window 1", "curve.csv", "result.json"),
    "which-law": ("which-law --laws nhkv,newtonian", "curve.csv", "laws.json"),
    "collapse-time": ("collapse-time", "curve.csv", "collapse-time.json"),
    "rheometer": ("rheometer", "frequency.csv", "rheometer.json"),
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
ROOMS = (*BATCHES, *SINGLES)


def single(room: str, path: str, given: Mapping[str, str]) -> tuple[str, str]:
    """(outcome, text) of one file in a command that takes one."""
    with tempfile.TemporaryDirectory() as out:
        said = call([word.format(file=path, out=f"{out}/out", **given) for word in SINGLES[room].split()])
        written = Path(out, "out").is_dir()
    if wrong := trouble(said, refusals=1):
        return wrong, str(said)
    if said.status < 2 or (written and "error:" not in said.err):  # status 2 with a document: part was unreadable
        return "answered", str(said)
    named = any(line.startswith("error:") and f"/{Path(path).parent.name}/" in line for line in said.err.splitlines())
    return "refused" if named else "does not name the file", str(said)


def batch(room: str, paths: Mapping[str, str], given: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """(outcome, text) by key of many files and a good one in one call."""
    words, name, document = BATCHES[room]
    with tempfile.TemporaryDirectory() as out:
        good = str(Path(given["here"]) / name)
        said = call([*words.split(), good, *paths.values(), "-o", f"{out}/out"])
        written = {path.name: path.read_text() for path in Path(out, "out").glob("*.[jh]*")}
    sources = _sources(json.loads(written.get(document, "{}")))
    html = written.get("report.html", "")
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
        found[key] = (wrong or outcome or f"answered: {answered}, lines: {len(lines)}", str(said))
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


Outcomes = dict[tuple[str, str], tuple[str, str]]  # (command, key of the file): outcome, text


def through(files: Mapping[str, Path], given: Mapping[str, str], only: Sequence[str], size: int = 50) -> Outcomes:
    """Every file through these commands; a batch that is not clean is repeated file by file, to tell whose fault."""
    keys = list(files)
    parts = [keys[k : k + size] for k in range(0, len(keys), size)]
    jobs = [(room, part) for room in only if room in BATCHES for part in parts]
    jobs += [(room, [key]) for key in keys for room in only if room in SINGLES]
    found = dict(_judged(jobs, files, given))
    again = [(room, [key]) for (room, key), (outcome, _) in found.items() if room in BATCHES and outcome not in FINE]
    return found | dict(_judged(again, files, given))


def _judged(jobs: list[tuple[str, list[str]]], files: Mapping[str, Path], given: Mapping[str, str]) -> Iterator[tuple]:
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
    """Counts of each command and outcome, then every file with which something is wrong."""
    named = ((re.sub("[ -]+", "_", room), outcome) for (room, _), (outcome, _) in found.items())
    counts = Counter(f"{room}: {outcome}" for room, outcome in named)
    wrong = [f"{outcome}: {room}, {key}" for (room, key), (outcome, _) in found.items() if outcome not in FINE]
    return "\n".join([*(f"{n:6d}  {key}" for key, n in sorted(counts.items())), *sorted(wrong)])
