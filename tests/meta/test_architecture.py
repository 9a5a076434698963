"""The plan of the packages (docs/architecture.md) holds: imports run one way, and extras stay optional."""

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from conftest import ROOT

import cavirheo

SOURCE = Path(cavirheo.__file__).parent
EXTRAS = ("torch", "matplotlib", "gradio", "av", "tifffile", "dask", "distributed", "dask_jobqueue")
FREE = ("verbs", "__main__", "__init__")  # the command line and the package's face see every room


@cache
def sources() -> dict[str, str]:
    """The code of every module, without comments, by its path below the package."""
    paths = sorted(SOURCE.rglob("*.py"))
    return {str(path.relative_to(SOURCE)): ast.unparse(ast.parse(path.read_text("utf-8"))) for path in paths}


def room_of(module: str) -> str:
    return module.split("/")[0].removesuffix(".py")


def imported(code: str) -> set[str]:
    """Rooms that a module names in any import, at the top or inside a function."""
    faces = re.findall(r"^ *from cavirheo import (.+)$", code, re.MULTILINE)
    inner = re.findall(r"^ *(?:from|import) cavirheo\.(\w+)", code, re.MULTILINE)
    return {*inner, *(name.split()[0] for names in faces for name in names.split(", "))}


@pytest.mark.repository
def test_imports_run_one_way():
    """A room imports only those that stand before it in the table."""
    table = re.findall(r"^\| ((?:`\w+/?` ?)+)\| ", (ROOT / "docs" / "architecture.md").read_text("utf-8"), re.MULTILINE)
    order = re.findall(r"\w+", " ".join(table))
    rooms = {room_of(name) for name in sources()}
    order = [room for room in order if room in rooms]
    assert sorted({*order, *FREE}) == sorted([*rooms])
    below = {room: {*order[: k + 1]} for k, room in enumerate(order)}
    wrong = {name: imported(code) - below[room] for name, code in sources().items() if (room := room_of(name)) in below}
    assert {name: rooms for name, rooms in wrong.items() if rooms} == {}


def test_nothing_reads_provenance():
    """It is written down whole, and no code looks an entry of it up."""
    assert [name for name, code in sources().items() if re.search(r"\.provenance(\[|\.get\(|\.pop\()", code)] == []


def test_only_training_names_torch():
    assert {room_of(name) for name, code in sources().items() if "import torch" in code} <= {"training"}


def test_inference_needs_no_extra():
    code = f"""import sys; sys.modules.update(dict.fromkeys({EXTRAS}))
import cavirheo.inference.bdt, cavirheo.inference.verify, cavirheo.training.dataset, cavirheo.verbs, cavirheo.reporting
from cavirheo import infer, read_curves"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_command_line_waits_for_no_library():
    """Its help and completion import neither numbers nor documents."""
    code = "import sys, cavirheo.verbs; print(*{'numpy', 'pydantic', 'jinja2', 'rich'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
