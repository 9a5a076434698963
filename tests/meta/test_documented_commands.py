"""The commands of every page run as they stand, in a folder with files of the names that the page uses."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from urllib.request import urlopen

import pytest
from documented_files import write_recipes, write_shots, write_tables
from test_documentation import COMMAND, PAGES, ROOT, blocks, name

import cavirheo

pytestmark = [
    pytest.mark.slow,
    *(pytest.mark.needs(library) for library in ("torch", "gradio", "distributed", "av", "matplotlib")),
    pytest.mark.skipif(shutil.which("bash") is None or shutil.which("curl") is None, reason="needs bash and curl"),
]
NOT_RUN = {  # what a line begins with: why
    "make ": "sets up an environment, or runs these tests",
    "pip install ": "changes the environment that the tests run in; tests/wheel.py installs into an empty one",
    "cavirheo evaluate bdt-viscoelastic data ": "refused with fewer than its 100,000 curves: it saw some",
    "cavirheo infer SHOTS.mat -o result --scheduler slurm:": "needs a SLURM: tests/cli/test_cluster.py starts one",
}
STAYS = ("cavirheo app", "cavirheo watch", "dask scheduler", "dask worker")  # until somebody ends them
FIRST = re.compile(r"(cavirheo|make|pip|python3?|cd|dask|AT=\S+)\b")  # word of a block that is a script
PLACES = re.compile(
    r"^```\n(.*?)^```$|^```python\n(.*?)^```$|((?:^    [^\n]+\n)+)|`(cavirheo [^`\n]+)`", re.DOTALL | re.MULTILINE
)
BARE = {"models", "laws"}  # verbs that are a whole command alone; `cavirheo design` is a name
LONGEST = 300.0  # s, of a block
WRITTEN = {  # page: files that it says its commands write
    "docs/how-to/collapse-time.md": ("result/collapse-time.json", "result/shots.csv", "result/*.png"),
    "docs/how-to/compare.md": ("DIR/comparison.csv", "DIR/result.json", "DIR/comparison.png"),
    "docs/how-to/design.md": ("plan/design.json", "plan/design.png"),
    "docs/how-to/measure.md": ("measured/measured.csv", "measured/contact.png", "measured/measure.json"),
    "docs/how-to/rheometer.md": ("*/result/rheometer.json", "*/result/rheometer.csv", "*/result/table.csv"),
    "docs/how-to/scale.md": ("data/*.h5",),
    "docs/how-to/train-a-model.md": ("run/laptop.onnx",),
    "docs/how-to/watch.md": ("result/result.json", "result/result.csv", "result/live.html"),
    "docs/how-to/which-law.md": ("*/laws.json",),
    "docs/how-to/your-shots.md": ("result/result.json", "result/result.csv", "result/report.html"),
}  # fmt: skip


def commands(text: str) -> list[str]:
    """Scripts of a page in its order: blocks, what is indented as one, and whole commands within its sentences."""
    scripts = []
    for block, code, indented, inline in PLACES.findall(text):
        if "Client(" in code:
            scripts.append(f"{shlex.quote(sys.executable)} -c {shlex.quote(code)}\n")
        elif FIRST.match(script := block or re.sub("^    ", "", indented, flags=re.M)):
            scripts.append(script)
        elif inline and whole(shlex.split(inline)[1:]):
            scripts.append(inline + "\n")
    return sorted(scripts, key=lambda script: not script.startswith("dask"))  # a page that uses one tells of it later


def whole(words: list[str]) -> bool:
    """Whether a command within a sentence is one to type, and not the name of a verb or a part."""
    verb = COMMAND.commands.get(words[0])
    if verb is None or "--help" in words:
        return True
    try:
        verb.make_context(words[0], words[1:])
    except Exception:
        return False
    return len(words) > 1 or words[0] in BARE


SCRIPTS = {
    name(page): scripts
    for page in PAGES
    if not {ROOT / "benchmarks", ROOT / "validation"} & {*page.parents}
    and (scripts := commands(page.read_text("utf-8")))
}


@pytest.fixture(scope="session")
def kit(tmp_path_factory) -> Path:
    """Every file that a page names and does not make itself."""
    folder = tmp_path_factory.mktemp("kit")
    write_recipes(folder)
    write_shots(folder)
    write_tables(folder)
    infer = ["cavirheo", "infer", "examples/soft_gel.csv", "--quiet", "-o", "result"]
    subprocess.run(infer, cwd=folder, env=surroundings(folder), check=True)
    shutil.copytree(folder / "result", folder / "RESULT")
    shutil.copy(folder / "result/result.json", folder)
    return folder


def surroundings(folder: Path) -> dict[str, str]:
    """The program on the path under its name, a home of its own, and no browser."""
    program = folder / ".bin" / "cavirheo"
    program.parent.mkdir(exist_ok=True)
    program.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m cavirheo "$@"\n', "utf-8")
    program.chmod(0o755)
    path = os.pathsep.join([str(program.parent), str(Path(sys.executable).parent), os.environ["PATH"]])
    here = {"PATH": path, "PYTHONPATH": str(ROOT / "src"), "HOME": str(folder), "BROWSER": "true", "COLUMNS": "100"}
    return os.environ | here


@dataclass
class Shell:
    """Runs scripts in a folder; what stays runs on beside them."""

    kit: Path
    folder: Path
    made: set[str] = field(default_factory=set)
    beside: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    def supply(self, line: str) -> None:
        """Files of the kit that a command reads, unless a command before wrote them."""
        outputs = set(re.findall(r"(?:-o|>) ([\w.-]+)", line))
        for top in {*re.findall(r"(?<![\w./-])(\w[\w.*-]*)", line)} - outputs - self.made:
            for path in self.kit.glob(top):
                if not (self.folder / path.name).exists():
                    (shutil.copytree if path.is_dir() else shutil.copy)(path, self.folder / path.name)
        self.made |= outputs

    def run(self, script: str) -> str:
        """What it printed; its last command must have succeeded, as all before, and written its outputs."""
        lines = [line for line in script.splitlines() if not line.startswith(tuple(NOT_RUN))]
        for line in lines:
            self.supply(line)
        staying = [line for line in lines if line.startswith(STAYS)]
        for line in staying:
            self.start(line)
        rest = "\n".join(line for line in lines if line not in staying)
        done = subprocess.run(
            ["bash", "-e", "-o", "pipefail", "-c", f"{rest}\n:"],  # so that a shell stands above the last one, too
            cwd=self.folder, env=surroundings(self.folder), capture_output=True, text=True, timeout=LONGEST,
        )  # fmt: skip
        assert done.returncode == 0, f"{rest}\n{done.stdout}\n{done.stderr}"
        outputs = re.findall(r"(?:-o|>) ([\w.-]+)", rest)
        assert [output for output in outputs if not any(self.folder.rglob(output))] == []
        return done.stdout

    def start(self, line: str) -> None:
        """A command that stays, until it answers."""
        what = next(words for words in STAYS if line.startswith(words))
        self.end(what)
        words = shlex.split(line)
        port = {"cavirheo app": 7860, "dask scheduler": 8786}.get(what)
        if port and answers(port):
            pytest.skip(f"port {port} of this machine is taken")
        out = self.folder / words[words.index("-o") + 1] / "result.json" if "-o" in words else None
        if out:
            out.unlink(missing_ok=True)
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        heeds = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a job in the background ignores Ctrl-C
        where = {"cwd": self.folder, "env": surroundings(self.folder), "preexec_fn": heeds}
        self.beside[what] = subprocess.Popen(words, **where, **silent)
        until = time.monotonic() + 120.0
        while (port and not answers(port)) or (out and not (out.exists() and cavirheo.load(out).curves)):
            assert self.beside[what].poll() is None, f"ended: {line}"
            assert time.monotonic() < until, f"no answer: {line}"
            time.sleep(0.2)
        if what == "cavirheo app":
            page = urlopen(f"http://127.0.0.1:{port}/{'live' if '--live' in words else ''}", timeout=60.0)
            assert page.status == 200

    def end(self, what: str) -> None:
        """By Ctrl-C, as the pages say."""
        if (process := self.beside.pop(what, None)) is not None:
            process.send_signal(signal.SIGINT)
            try:
                status = process.wait(60.0)
            finally:
                process.kill()
            assert status == 0 or not what.startswith("cavirheo"), what


def answers(port: int) -> bool:
    with socket.socket() as trial:
        return trial.connect_ex(("127.0.0.1", port)) == 0


@pytest.fixture
def shell(kit, tmp_path) -> Iterator[Shell]:
    shell = Shell(kit, tmp_path)
    yield shell
    for what in reversed(list(shell.beside)):
        shell.end(what)


def printed(shown: str, said: str) -> bool:
    """Whether this was printed: the same words in the same order, and numbers that differ by a tenth at most."""
    number = r"\d+(?:\.\d+)?"
    words = (re.sub(number, "#", word) for word in shown.replace("─", "").split())
    pattern = r"\s+".join(re.escape(word).replace(r"\#", f"({number})") for word in words)
    there = re.search(pattern, said.replace("─", ""))
    return there is not None and [float(one) for one in there.groups()] == pytest.approx(
        [float(one) for one in re.findall(number, shown)], rel=0.1
    )


@pytest.mark.parametrize("page", SCRIPTS)
def test_the_commands_of_a_page_run(page, shell):
    said = re.sub(" +\n", "\n", "".join(shell.run(script) for script in SCRIPTS[page]))
    text = (ROOT / page).read_text("utf-8")
    assert [shown for shown in blocks(text, "") if "───" in shown and not printed(shown, said)] == []
    assert ("curl" in text) == ("event: complete" in said)
    for path in WRITTEN.get(page, ()):
        assert "*" in Path(path).name or Path(path).name in text
        assert [one for one in shell.folder.glob(path) if one.stat().st_size], path


@pytest.mark.parametrize("wrong", ["cavirheo infer nowhere.csv\n", "cavirheo show FILE | grep nothing\ntrue\n"])
def test_a_command_that_fails_is_found(wrong, shell):
    with pytest.raises(AssertionError):
        shell.run(wrong)
    shown = "G  kPa\n─────\n9.91 ok\n"
    assert printed(shown, "more\nG kPa\n───\n 9.8  ok\n")
    assert not printed(shown, "G kPa\n───\n 5.8 ok\n")
    assert not printed(shown, "G kPa\n───\n 9.8 undetermined\n")


def test_what_is_not_run_is_still_there():
    lines = [line for scripts in SCRIPTS.values() for script in scripts for line in script.splitlines()]
    for table in (NOT_RUN, STAYS):
        assert [begin for begin in table if not any(line.startswith(begin) for line in lines)] == []
    assert set(WRITTEN) <= {*SCRIPTS}
