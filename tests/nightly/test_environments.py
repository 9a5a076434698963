"""In a poor environment each command works, or says in one line what it lacks, and leaves no broken file."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from valid import TEXTS

pytestmark = pytest.mark.slow

COMMANDS = {
    "infer": "infer curve.csv -o out",
    "simulate": "simulate --rmax-um 250 --stretch 7 --material newtonian(0.05) -o out",
    "rheometer": "rheometer frequency.csv -o out",
    "collapse-time": "collapse-time times.csv -o out",
}
WELL = {  # where everything must work: what the shell does before
    "no home": "unset HOME XDG_CACHE_HOME",
    "home that is a file": "export HOME=/dev/null",
    "dumb terminal": "export TERM=dumb COLUMNS=20",
    "C locale": "unset PYTHONIOENCODING; export LC_ALL=C PYTHONUTF8=0 PYTHONCOERCECLOCALE=0",
    "ASCII streams": "export PYTHONIOENCODING=ascii:strict",
    "one core": "taskset -pc $(taskset -pc $$ | grep -o '[0-9]*$') $$ > /dev/null",
    "no input": "exec 0<&-",
}
BADLY = {  # where a command may also say that it cannot
    "1 GB of memory": "ulimit -v 1048576",
    "nothing can be written": "ulimit -f 0",
    "50 kB can be written": "ulimit -f 49",
    "stderr is full": "exec 2>/dev/full",
    "stdout is closed": "exec 1>&-",
    "all streams are closed": "exec 0<&- 1>&- 2>&-",
}
CASES = [(case, command) for case in WELL for command in ("infer", "rheometer")]
CASES += [(case, command) for case in BADLY for command in COMMANDS]


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("here")
    for name in ("curve.csv", "frequency.csv", "times.csv"):
        (folder / name).write_text(TEXTS[name])
    return folder


def run(case: str, command: str, folder: Path) -> tuple[int, str, str]:
    words = ["bash", "-c", f'{(WELL | BADLY)[case]}; exec "$@"', "bash", sys.executable, "-m", "cavirheo"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "NO_COLOR": "1"}
    how = {"cwd": folder, "env": environment, "timeout": 400, "stdin": subprocess.DEVNULL, "capture_output": True}
    done = subprocess.run([*words, *COMMANDS[command].split()], encoding="utf-8", errors="replace", **how)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(("case", "command"), CASES)
def test_works_or_says_in_one_line_what_it_lacks(here, tmp_path, case, command):
    folder = tmp_path / "work"
    shutil.copytree(here, folder)
    status, out, err = run(case, command, folder)
    assert "Traceback" not in out + err, err[-3000:]
    assert status in ((0, 1) if case in WELL else (0, 1, 2)), (status, err[-2000:])
    if status == 2 and "stderr" not in case and "streams" not in case:
        assert f"\n{err}".count("\nerror:") == 1, err
        assert len(err.splitlines()) <= 3, err
    for path in filter(Path.is_file, sorted(folder.rglob("*"))):
        old = here / path.relative_to(folder)
        content = path.read_bytes()
        if old.exists():
            assert content == old.read_bytes(), path
        elif path.suffix != ".h5":  # what is left is complete
            assert path.suffix not in (".tmp", ".part"), path
            assert content, path
