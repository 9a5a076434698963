"""The tutorials run on what comes with the package, in seconds, and say what their pages and notebooks show."""

import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from conftest import ROOT

RUNNER = ROOT / "docs" / "site" / "tutorial.py"
pytestmark = pytest.mark.skipif(not RUNNER.exists(), reason="the docs are not in the sdist")
SCRIPTS = {path.stem: path for path in sorted(ROOT.glob("examples/tutorials/*.py"))}
SHOWN = {  # tutorial: what its outputs say
    "gel": r"(?s)250.*\[9\.\d+, 10\.\d+\].*stiff_gel: G = (29|30|31)\.?\d* kPa.*mean & & 3\d\.\d \$.*@",
    "liquid": r"(?s)\n\[1\] .* 0\.0[56]\d+ .*3 curves.*undetermined.*upper limit of G",
    "own_law": r"logarithmic \+ newtonian: RMSE 0\.3\d% of R_max",
    "cluster": r"(?s)2 .*soft_gel\[1\]: the same(?!.*not the same)",
    "app": r"soft_gel\[1\]: G [56]\d\d\d Pa \[",
}
NEEDS = {"gel": ("matplotlib", "av"), "liquid": ("matplotlib",), "own_law": ("matplotlib",)}
NEEDS |= {"cluster": ("distributed",), "app": ("gradio",)}


def ran(script: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    surroundings = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    command = [sys.executable, str(RUNNER), str(script), str(folder)]
    return subprocess.run(command, env=surroundings, capture_output=True, text=True, timeout=600)


def outputs(notebook: Path) -> str:
    """What all cells printed."""
    cells = json.loads(notebook.read_text("utf-8"))["cells"]
    return "".join(one.get("text", "") for cell in cells for one in cell.get("outputs", ()))


def test_every_tutorial_is_tested():
    assert set(SHOWN) == set(SCRIPTS)


@pytest.mark.slow
@pytest.mark.parametrize("stem", SCRIPTS)
def test_a_tutorial_says_what_is_so(stem, tmp_path):
    if any(find_spec(name) is None for name in NEEDS[stem]):
        pytest.skip("an extra is not installed")
    done = ran(SCRIPTS[stem], tmp_path)
    assert done.returncode == 0, done.stderr
    said = outputs(tmp_path / f"{stem}.ipynb")
    assert re.search(SHOWN[stem], said), said
    page = (tmp_path / f"{stem}.md").read_text("utf-8")
    assert all(line.rstrip() in page for line in said.splitlines())
    assert len(re.findall(r"!\[.*?\]\(\w+-\d\.png\)", page)) == len(list(tmp_path.glob("*.png")))


@pytest.mark.parametrize(
    "wrong", ["1 / 0", *(f'run("{line}", shell=True, check=True)' for line in ("false", "cavirheo infer nowhere.csv"))]
)
def test_a_cell_that_fails_leaves_no_page(wrong, tmp_path):
    script = tmp_path / "bad.py"
    script.write_text(f"# %%\n{wrong}\n")
    assert ran(script, tmp_path / "out").returncode != 0
    assert not (tmp_path / "out").exists()
