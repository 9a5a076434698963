"""The plan of the packages (docs/architecture.md) holds: imports run one way, and extras stay optional."""

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

import cavirheo

SOURCE = Path(cavirheo.__file__).parent
EXTRAS = ("torch", "matplotlib", "gradio", "av", "tifffile", "dask", "distributed", "dask_jobqueue")
FREE = {"verbs", "__main__", "__init__"}  # the command line and the package's face see every room


def imported(path: Path) -> set[str]:
    """Rooms that a module names in any import, at the top or inside a function."""
    code = ast.unparse(ast.parse(path.read_text("utf-8")))
    faces = re.findall(r"^ *from cavirheo import (.+)$", code, re.MULTILINE)
    inner = re.findall(r"^ *(?:from|import) cavirheo\.(\w+)", code, re.MULTILINE)
    return {*inner, *(name.split()[0] for names in faces for name in names.split(", "))}


def room(path: str | Path) -> str:
    return Path(path).relative_to(SOURCE).parts[0].removesuffix(".py")


def rooms_in_order() -> list[str]:
    """Those of the page, each above all before it."""
    table = re.findall(r"^\| ((?:`\w+/?` ?)+)\| ", (ROOT / "docs" / "architecture.md").read_text("utf-8"), re.MULTILINE)
    return re.findall(r"\w+", " ".join(table))


@pytest.mark.repository
def test_imports_run_one_way():
    rooms = {path: room(path) for path in SOURCE.rglob("*.py")}
    order = [name for name in rooms_in_order() if name in rooms.values()]
    assert {*order} | FREE == {*rooms.values()}
    below = {name: {*order[: k + 1]} for k, name in enumerate(order)}
    wrong = {path: imported(path) - below[name] for path, name in rooms.items() if name in below}
    assert {path: names for path, names in wrong.items() if names} == {}


@pytest.mark.repository
def test_types_are_where_the_page_says(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    way = importlib.import_module("way")
    types = way.types().items()
    modules = {name: path.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for name, path in types}
    assert len(modules) > 6
    homes = {name: importlib.import_module(f"cavirheo.{module}") for name, module in modules.items()}
    assert [name for name, home in homes.items() if getattr(home, name).__module__ != home.__name__] == []


def test_inference_needs_no_extra():
    code = f"""import sys; sys.modules.update(dict.fromkeys({EXTRAS}))
import cavirheo.inference.which_law, cavirheo.training.dataset, cavirheo.verbs, cavirheo.reporting
from cavirheo import infer, read_curves"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


UNNEEDED = [("verbs", "numpy pydantic jinja2 rich"), ("reporting", "numba"), ("app.reader", "numba typer")]


@pytest.mark.parametrize(("module", "libraries"), UNNEEDED)
def test_no_import_waits_for_a_library_that_it_does_not_need(module, libraries):
    code = f"import sys, cavirheo.{module}; print(*set('{libraries}'.split()) & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
