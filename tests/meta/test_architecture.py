"""The plan of the packages (docs/architecture.md) holds: imports run one way, and extras stay optional."""

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import cavirheo

SOURCE = Path(cavirheo.__file__).parent
ROOMS = (  # from the ground up: a room imports those below it, and only those that it may
    ("arrays", ""),
    ("errors", ""),
    ("files", "errors"),
    ("parallel", "errors"),
    ("parameters", "errors"),
    ("landmarks", "errors"),
    ("writing", "errors files parameters"),
    ("messages", "errors writing parameters"),
    ("physics", "errors parallel parameters landmarks writing"),
    ("prior", "errors parameters"),
    ("posterior", "errors writing messages parameters physics"),
    ("curve", "errors messages parameters landmarks writing"),
    ("video", "errors files messages parameters curve landmarks writing"),
    ("io", "errors files messages parameters curve landmarks video writing"),
    ("problem", "errors parameters prior physics"),
    (
        "inference",
        "errors files parallel messages parameters prior posterior curve landmarks physics problem writing",
    ),
    (
        "training",
        "errors files parallel parameters prior posterior curve io physics problem inference writing",
    ),
    ("workflow", "errors files messages parallel physics posterior curve inference writing"),
    ("reporting", "errors messages physics parallel parameters posterior curve io inference workflow writing"),
    ("watch", "errors parallel physics posterior curve io inference workflow reporting writing"),
    (
        "companions",
        "errors files parallel parameters landmarks posterior curve io physics inference reporting writing workflow",
    ),
    (
        "app",
        "errors parallel parameters posterior curve video io physics problem inference reporting writing "
        "workflow companions",
    ),
    ("loading", "errors files reporting training companions video writing"),
)
MAY_USE = {room: {"arrays", *below.split()} - {room} for room, below in ROOMS}
EXTRAS = ("torch", "matplotlib", "gradio", "av", "tifffile", "dask", "distributed", "dask_jobqueue")
FREE = ("verbs", "__main__", "__init__")  # the command line and the package's face see every room


@cache
def trees() -> dict[str, ast.Module]:
    """Every module by its path below the package."""
    paths = sorted(SOURCE.rglob("*.py"))
    return {str(path.relative_to(SOURCE)): ast.parse(path.read_text(encoding="utf-8")) for path in paths}


def room_of(module: str) -> str:
    return module.split("/")[0].removesuffix(".py")


def imported(tree: ast.Module) -> set[str]:
    """Rooms that a module names in any import, at the top or inside a function."""
    found = set()
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module]
            if node.module == "cavirheo":
                names = [f"cavirheo.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        found |= {name.split(".")[1] for name in names if name.startswith("cavirheo.")}
    return found


def test_imports_run_one_way():
    wrong = {}
    for name, tree in trees().items():
        room = room_of(name)
        if room not in FREE and (other := imported(tree) - MAY_USE[room] - {room}):
            wrong[name] = other
    assert wrong == {}


def test_nothing_reads_provenance():
    """It is written down whole, and no code looks an entry of it up."""
    looked_up = re.compile(r"\.provenance(\[|\.get\(|\.pop\()")
    assert [name for name, tree in trees().items() if looked_up.search(ast.unparse(tree))] == []


def test_only_training_names_torch():
    assert [
        name for name, tree in trees().items() if room_of(name) != "training" and "import torch" in ast.unparse(tree)
    ] == []


def test_inference_needs_no_extra():
    code = f"""import sys; sys.modules.update(dict.fromkeys({EXTRAS}))
import cavirheo.inference.bdt, cavirheo.inference.verify, cavirheo.verbs, cavirheo.reporting
from cavirheo import infer, read_curves"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_plan_itself_runs_upwards():
    order = [room for room, _ in ROOMS]
    for room, below in MAY_USE.items():
        assert below - {"arrays"} <= set(order[: order.index(room)]), room
