"""The plan of the packages (docs/architecture.md) holds: imports run one way, and extras stay optional."""

import ast
import importlib
import re
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest
from conftest import BDT, EXAMPLE, ROOT

import cavirheo
from cavirheo.io.files import Source

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
def test_the_picture_is_that_of_the_imports_and_types_are_where_the_page_says(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    way = importlib.import_module("way")
    assert way.PICTURE.read_text("utf-8") == way.drawn(), "run python docs/site/way.py"
    modules = {
        name: path.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for name, path in way.types().items()
    }
    assert len(modules) > 6
    homes = {name: importlib.import_module(f"cavirheo.{module}") for name, module in modules.items()}
    assert [name for name, home in homes.items() if getattr(home, name).__module__ != home.__name__] == []


def test_one_module_prints():
    """It escapes control characters. Others: a notice on compiled code, and a process that answers its parent."""
    prints = re.compile(r"^ *print\(", re.MULTILINE)
    printing = {path.name for path in SOURCE.rglob("*.py") if prints.search(path.read_text("utf-8"))}
    assert printing == {"terminal.py", "cache.py", "workbook.py"}


def test_inference_needs_no_extra():
    code = f"""import sys; sys.modules.update(dict.fromkeys({EXTRAS}))
import cavirheo.inference.which_law, cavirheo.training.dataset, cavirheo.verbs, cavirheo.reporting
from cavirheo import infer, read_curves"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(("module", "libraries"), [("verbs", "numpy pydantic jinja2 rich"), ("reporting", "numba")])
def test_no_import_waits_for_a_library_that_it_does_not_need(module, libraries):
    code = f"import sys, cavirheo.{module}; print(*set('{libraries}'.split()) & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def walk(call: Callable[[], object], carries: Callable[[Any], bool]) -> tuple[set[str], set[tuple[str, str]]]:
    """(functions of the package that are given such a value, alone or in a list; calls among them of a function in a
    room above), in all threads of this process, while `call` runs."""
    order, stays, climbs = rooms_in_order(), set[str](), set[tuple[str, str]]()

    def level(code: CodeType) -> int:
        name = room(code.co_filename)
        return order.index(name) if name in order else len(order)

    def is_ours(code: CodeType) -> bool:
        return code.co_filename.startswith(str(SOURCE)) and not re.match("<|__get", code.co_name)

    def called(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event != "call" or not is_ours(code):
            return
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        values = [frame.f_locals.get(name) for name in names if name != "self"]
        values += [item for value in values if isinstance(value, list | tuple) for item in value]
        if not any(map(carries, values)):
            return
        stays.add(f"{room(code.co_filename)}: {code.co_qualname}")
        above = frame.f_back
        while above and not is_ours(above.f_code):
            above = above.f_back
        if above and level(code) > level(above.f_code):
            climbs.add((above.f_code.co_qualname, code.co_qualname))

    threading.setprofile(called)
    sys.setprofile(called)
    try:
        call()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return stays, climbs


@pytest.mark.slow
@pytest.mark.repository
def test_a_curve_is_handed_on_by_few_functions_from_infer_to_its_answer():
    curves = cavirheo.read_curves(EXAMPLE)[:1]
    cavirheo.infer_many(curves, workers=1)  # what is loaded once does not count
    stays, climbs = walk(
        lambda: cavirheo.infer_many(curves, workers=1), lambda one: isinstance(one, cavirheo.RadiusCurve)
    )
    assert "inference: Experiment.__init__" in stays  # and it was this process that answered
    assert (len(stays) <= 20, len(climbs) <= 3) == (True, True), (stays, climbs)


@pytest.mark.slow
@pytest.mark.repository
def test_a_file_is_handed_on_by_few_functions_from_the_command_to_its_documents(run):
    stays, climbs = walk(
        lambda: run("infer", EXAMPLE, *BDT, "--no-pictures", "-o", "r"),
        lambda one: isinstance(one, Source) or (isinstance(one, Path) and one == EXAMPLE),
    )
    assert Path("r/report.html").is_file()
    assert "io: read_columns" in stays
    assert (len(stays) <= 20, len(climbs) <= 3) == (True, True), (stays, climbs)
