"""The commands of every page run as they stand, in a folder with files of the names that the page uses."""

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from conftest import WATER
from files import cells
from scipy.io import savemat
from test_documentation import PAGES, ROOT, blocks, name

import cavirheo
from validation.rendering import Scene, render

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not all(map(find_spec, ("torch", "av", "matplotlib"))), reason="needs the extras"),
    pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash"),
]
NOT_RUN = {  # what a line begins with: why
    "make ": "sets up an environment, or runs these tests",
    "pip install ": "changes the environment that the tests run in; tests/wheel.py installs into an empty one",
    "cavirheo infer SHOTS.mat -o result --slurm": "needs a SLURM: tests/cli/test_cluster.py starts one",
    "cavirheo app": "stays until it is ended; tests/app",
    "cavirheo watch": "stays until it is ended; tests/companions/test_watch.py",
    **dict.fromkeys(("AT=", "PLACE=", "ASKED=", "curl "), "asks a running app; tests/app/test_app.py"),
    "dask ": "stays until it is ended; tests/cli/test_cluster.py",
}
FIRST = re.compile(r"(cavirheo|make|pip|python3?|cd)\b")  # word of a block that is a script


def commands(text: str) -> list[str]:
    """Lines of the scripts of a page that end by themselves on this machine."""
    scripts = [block for block in blocks(text, "") if FIRST.match(block)]
    lines = [line for script in scripts for line in script.splitlines()]
    return [line for line in lines if not line.startswith(tuple(NOT_RUN)) and "--scheduler" not in line]


SCRIPTS = {
    name(page): lines
    for page in PAGES
    if ROOT / "validation" not in page.parents and (lines := commands(page.read_text("utf-8")))
}


# --- files of the names that the pages use, from what comes with the package

SMALL = {"n": 240, "epochs": 2, "warmup_steps": 2, "dropout_epochs": 1}  # instead of hours
SMALL_EMULATOR = {"n": 64, "epochs": 20, "width": 16, "depth": 1, "components": 16}


def shot(path: Path, curve: cavirheo.RadiusCurve, medium: cavirheo.Medium | None = None) -> None:
    """A .mat file as IMR writes it, in m and s, or BDT's cells, whose times are those of a medium."""
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {"Rnew": curve.radius, "t": curve.time}
    if medium is not None:
        time, radius = map(cells, curve.normalised(medium))
        content = {"t_nondim_All": time, "R_nondim_All": radius, "RmaxList": curve.max_radius}
    savemat(path, content)


def video(path: Path, rate: float = 270e3, scale: float = 2.76) -> None:
    """A bubble as a camera of `rate` frames per second and `scale` um per pixel sees it."""
    fine = np.linspace(0.0, 200e-6, 20_000)
    gel = cavirheo.NeoHookeanKelvinVoigt(1e4, 0.06)
    radius = cavirheo.simulate(gel, max_radius=180e-6, stretch=6.5, time=fine).radius
    growth = int(np.argmin(radius[:4000]))
    grown = np.concatenate([radius[:growth][::-1], radius])[200:]
    seen = np.arange(len(grown)) * fine[1] * rate, grown / scale * 1e6
    scene = Scene(width=192, height=192, exposure=0.1, empty=3)
    render(*seen, frames=int(160e-6 * rate) + 3, scene=scene, seed=3).save(path, crf=18)


def write_recipes(folder: Path) -> None:
    """Those of the project, with so few curves and steps that a training takes seconds."""
    shutil.copytree(ROOT / "recipes", folder / "recipes")
    for recipe in (folder / "recipes").glob("*.toml"):
        text = recipe.read_text("utf-8")
        for key, value in (SMALL_EMULATOR if "[emulator]" in text else SMALL).items():
            text = re.sub(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
        recipe.write_text(text, "utf-8")


def write_shots(folder: Path) -> None:
    """Recordings of one shot each, or of two; the measurements that tables of references name, too."""
    shutil.copytree(ROOT / "examples", folder / "examples", ignore=shutil.ignore_patterns("tutorials"))
    stiff = cavirheo.read_curves(folder / "examples/stiff_gel.mat")[0]
    for path in ("SHOT.mat", "SHOTS.mat", "FOLDER/gel_1/first.mat"):
        shot(folder / path, stiff)
    rows = (folder / "examples/soft_gel.csv").read_text("utf-8").splitlines(keepends=True)
    first = "".join(row for row in rows if row.startswith(("shot", "1,")))
    (folder / "FOLDER/water").mkdir()
    for path in ("SHOTS.csv", "FOLDER/water/shots.csv"):
        (folder / path).write_text(first, "utf-8")
    for k in (1, 2):
        both = "".join(row for row in rows if row.startswith(("shot", f"{2 * k - 1},", f"{2 * k},")))
        (folder / f"gel_{k}.csv").write_text(both, "utf-8")
    video(folder / "VIDEO.mp4")
    for gel in ("paam_alginate_0p3", "peg8000_10wv", "peg8000_40wv"):
        shot(folder / "MEASUREMENTS" / gel / "first.mat", stiff, WATER)


def write_tables(folder: Path) -> None:
    """Collapse times of a gel, and the tables that pages show."""
    shutil.copy(ROOT / "tests/cases/times.csv", folder / "TABLE.csv")
    page = (ROOT / "docs/how-to/compare.md").read_text("utf-8")
    (folder / "REF.csv").write_text(next(text for text in blocks(page, "") if text.startswith("set,")), "utf-8")


@pytest.fixture(scope="session")
def kit(tmp_path_factory) -> Path:
    """Every file that a page names and does not make itself."""
    folder = tmp_path_factory.mktemp("kit")
    write_recipes(folder)
    write_shots(folder)
    write_tables(folder)
    infer = ["cavirheo", "infer", "examples/soft_gel.csv", "--quiet", "-o", "result"]
    done = subprocess.run(infer, cwd=folder, env=surroundings(folder), check=True, capture_output=True)
    assert (done.stdout, done.stderr) == (b"", b"")  # of the processes, too, that answered its five shots
    return folder


def surroundings(folder: Path) -> dict[str, str]:
    """The program on the path, a home of its own, and no browser."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    here = {"PATH": path, "PYTHONPATH": str(ROOT / "src"), "HOME": str(folder), "BROWSER": "true", "COLUMNS": "100"}
    return os.environ | here


@pytest.mark.parametrize("page", SCRIPTS)
def test_the_commands_of_a_page_run(page, kit, tmp_path):
    """In a folder with the kit's files; every one must succeed and write its outputs."""
    lines = SCRIPTS[page]
    shutil.copytree(kit, tmp_path, dirs_exist_ok=True)
    made = {output for line in lines for output in re.findall(r"(?:-o|>) ([\w.-]+)", line)}
    for output in made & {"result"}:  # of the kit: the page makes it itself
        shutil.rmtree(tmp_path / output)
    how = {"cwd": tmp_path, "env": surroundings(tmp_path), "capture_output": True, "text": True, "timeout": 600.0}
    done = subprocess.run(["bash", "-e", "-o", "pipefail", "-c", "\n".join(lines)], **how)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    assert [output for output in made if not any(tmp_path.rglob(output))] == []
