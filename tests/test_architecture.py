"""Imports run one way (docs/architecture.md), and whoever only infers needs no torch."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parent.parent / "src" / "cavirheo"
MAY_USE = {
    "errors": set(),
    "landmarks": {"errors"},
    "writing": {"errors"},
    "curve": {"errors", "landmarks", "writing"},
    "reading": {"errors", "curve"},
    "physics": {"errors", "landmarks", "writing"},
    "posterior": {"errors", "writing"},
    "problem": {"errors", "physics"},
    "inference": {"errors", "curve", "physics", "problem", "posterior"},
    "training": {"errors", "curve", "physics", "problem", "inference", "writing"},
    "reporting": {"errors", "curve", "posterior", "writing"},
    "beside": {"errors", "curve", "reading", "physics", "posterior", "inference", "reporting", "writing"},
    "app": {"errors", "curve", "reading", "physics", "posterior", "inference", "reporting", "writing"},
}


def imports(path: Path) -> set[str]:
    """Rooms of the package that a module names in any import, at the top or inside a function."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        found |= {name.split(".")[1] for name in names if name.startswith("cavirheo.")}
    return found


def modules() -> list[Path]:
    """All but the command line, which may see every room."""
    return sorted(
        p for p in SOURCE.rglob("*.py") if p.relative_to(SOURCE).parts[0] not in ("verbs", "__main__.py", "__init__.py")
    )


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(SOURCE)))
def test_imports_run_one_way(path):
    room = path.relative_to(SOURCE).parts[0].removesuffix(".py")
    if room == "models":
        return
    assert imports(path) <= MAY_USE[room] | {room}


def test_only_training_names_torch():
    offenders = [
        p for p in SOURCE.rglob("*.py") if "training" not in p.parts and "import torch" in p.read_text("utf-8")
    ]
    assert offenders == []


def test_inference_loads_neither_torch_nor_matplotlib():
    code = (
        "import sys; sys.modules['torch'] = None; sys.modules['matplotlib'] = None; "
        "import cavirheo.inference.amortised, cavirheo.verbs, cavirheo.reporting; "
        "from cavirheo import infer, read_curves"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_modules_stay_short():
    """All but the solver, which must be one file (docs/architecture.md)."""
    lines = {str(p.relative_to(SOURCE)): len(p.read_text("utf-8").splitlines()) for p in SOURCE.rglob("*.py")}
    assert lines.pop("physics/solver.py") <= 660
    assert {name: n for name, n in lines.items() if n > 420} == {}
