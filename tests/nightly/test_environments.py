"""Surroundings that take something away: each command works, or says in one line what it lacks, and leaves no broken
file. Every case is a process of its own, with limits set before it begins."""

from __future__ import annotations

import contextlib
import csv
import ctypes
import json
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from conftest import ROOT
from valid import TEXTS

pytestmark = pytest.mark.slow
SECONDS = 400

COMMANDS = {
    "infer": "infer curve.csv --verify none -o {out}",
    "fit": "fit curve.csv --window 1 -o {out}",
    "simulate": "simulate --rmax-um 250 --stretch 7 --material newtonian(0.05) -o {out} --fields",
    "rheometer": "rheometer frequency.csv -o {out}",
    "collapse-time": "collapse-time times.csv -o {out}",
    "compare": "compare . --references sets.csv -o {out}",
    "models": "models",
}


@dataclass(frozen=True)
class Surroundings:
    """`changed`: of the environment, None where a variable is taken away. `before`: called in the new process."""

    changed: Mapping[str, str | None] = field(default_factory=dict)
    before: Callable[[], object] = lambda: None
    streams: Mapping[str, object] = field(default_factory=dict)
    out: str = "out"


def limit(what: int, most: int) -> Callable[[], object]:
    return lambda: resource.setrlimit(what, (most, most))


def bound_by_permissions() -> None:
    """As everybody is, also where the tests run as root (PR_CAPBSET_DROP; the program's capabilities are the bound)."""
    for capability in (1, 2, 3) if os.geteuid() == 0 else ():  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH, CAP_FOWNER
        ctypes.CDLL(None, use_errno=True).prctl(24, capability, 0, 0, 0)


def closed(*numbers: int) -> Callable[[], object]:
    return lambda: [os.close(number) for number in numbers]


WELL = {  # where everything must work
    "no home": Surroundings({"HOME": None, "XDG_CACHE_HOME": None}),
    "home that is not there": Surroundings({"HOME": "/nowhere/at/all"}),
    "home that is a file": Surroundings({"HOME": "/dev/null"}),
    "no terminal type": Surroundings({"TERM": None, "COLUMNS": None}),
    "dumb terminal": Surroundings({"TERM": "dumb", "COLUMNS": "20"}),
    "columns that are none": Surroundings({"COLUMNS": "wide", "LINES": "-1"}),
    "C locale": Surroundings({"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": None}),
    "ASCII streams": Surroundings({"PYTHONIOENCODING": "ascii:strict"}),
    "locale that is not there": Surroundings({"LC_ALL": "xx_YY.UTF-8"}),
    "odd time zone": Surroundings({"TZ": "Nowhere/Odd"}),
    "time zone of words": Surroundings({"TZ": "<[/]\x1b>-99:99"}),
    "one core": Surroundings(before=lambda: os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})),
    "no input": Surroundings(before=closed(0)),
}
BADLY = {  # where a command may also say that it cannot
    "64 open files": Surroundings(before=limit(resource.RLIMIT_NOFILE, 64)),
    "16 open files": Surroundings(before=limit(resource.RLIMIT_NOFILE, 16)),
    "2 GB of memory": Surroundings(before=limit(resource.RLIMIT_AS, 2 << 30)),
    "1 GB of memory": Surroundings(before=limit(resource.RLIMIT_AS, 1 << 30)),
    "nothing can be written": Surroundings(before=limit(resource.RLIMIT_FSIZE, 0)),
    "3 kB can be written": Surroundings(before=limit(resource.RLIMIT_FSIZE, 3000)),
    "50 kB can be written": Surroundings(before=limit(resource.RLIMIT_FSIZE, 50_000)),
    "read-only folder": Surroundings(before=bound_by_permissions, out="closed"),
    "read-only folder above": Surroundings(before=bound_by_permissions, out="closed/out"),
    "a file in the way": Surroundings(out="curve.csv"),
    "a file above": Surroundings(out="curve.csv/below"),
    "a device in the way": Surroundings(out="/dev/null"),
    "a long name": Surroundings(out="n" * 300),
    "a name of nothing": Surroundings(out=""),
    "stdout is full": Surroundings(streams={"stdout": "/dev/full"}),
    "stderr is full": Surroundings(streams={"stderr": "/dev/full"}),
    "stdout is closed": Surroundings(before=closed(1)),
    "stderr is closed": Surroundings(before=closed(2)),
    "all streams are closed": Surroundings(before=closed(0, 1, 2)),
    "nobody reads": Surroundings(streams={"stdout": "broken"}),
}
CASES = [(case, command) for case in WELL for command in ("infer", "rheometer", "models")]
CASES += [(case, command) for case in BADLY for command in COMMANDS]


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("here")
    for name in ("curve.csv", "frequency.csv", "times.csv"):
        (folder / name).write_text(TEXTS[name])
    (folder / "sets.csv").write_text("set,files,method,quantity,mean\ngel,curve.csv,IMR,G_kPa,5\n")
    return folder


def run(command: str, about: Surroundings, folder: Path) -> tuple[int, str, str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "NO_COLOR": "1", **about.changed}
    words = [word.format(out=about.out) for word in COMMANDS[command].split(" ")]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with contextlib.ExitStack() as stack:
        for name, target in about.streams.items():
            if target == "broken":
                reader, streams[name] = os.pipe()
                os.close(reader)
            else:
                streams[name] = stack.enter_context(open(str(target), "w"))
        done = subprocess.run(
            [sys.executable, "-m", "cavirheo", *words], cwd=folder, preexec_fn=about.before, timeout=SECONDS,
            env={key: value for key, value in environment.items() if value is not None}, stdin=subprocess.DEVNULL,
            **streams,
        )  # fmt: skip
    return (
        done.returncode,
        (done.stdout or b"").decode("utf-8", "replace"),
        (done.stderr or b"").decode("utf-8", "replace"),
    )


def whole(path: Path) -> bool:
    """Whether a file of ours is complete."""
    content = path.read_bytes()
    match path.suffix:
        case ".json":
            return bool(json.loads(content))
        case ".html":
            return content.rstrip().endswith(b"</html>")
        case ".png":
            return content.endswith(b"IEND\xaeB`\x82")
        case ".csv":
            widths = {len(row) for row in csv.reader(content.decode().splitlines()) if not row[0].startswith("#")}
            return content.endswith(b"\n") and len(widths) == 1
    return path.suffix == ".h5" or bool(content)


@pytest.mark.parametrize(("case", "command"), CASES)
def test_works_or_says_in_one_line_what_it_lacks(here, tmp_path, case, command):
    about = {**WELL, **BADLY}[case]
    folder = tmp_path / "work"
    shutil.copytree(here, folder)
    (folder / "closed").mkdir(mode=0o555)
    status, out, err = run(command, about, folder)
    assert "Traceback" not in out + err, err[-3000:]
    assert status in ((0, 1) if case in WELL else (0, 1, 2)), (status, err[-2000:])
    if status == 2 and "stderr" not in case and "streams" not in case:
        errors = [line for line in err.splitlines() if line.startswith("error:")]
        assert len(errors) == 1, err
        assert len(err.splitlines()) <= 3, err
    for path in sorted(folder.rglob("*")):
        old = here / path.relative_to(folder)
        if path.is_file() and old.exists():
            assert path.read_bytes() == old.read_bytes(), path
        elif path.is_file():
            assert path.suffix not in (".tmp", ".part"), path
            assert whole(path), path
