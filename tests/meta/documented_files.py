"""Files under the names that the pages' commands use, from what comes with the package."""

import csv
import re
import shutil
from pathlib import Path

import numpy as np
from scipy.io import savemat
from test_documentation import ROOT, blocks

import cavirheo
from cavirheo.physics.media import MEDIA
from cavirheo.video import Scene, render

SMALL = {"n": 240, "epochs": 2, "warmup_steps": 2, "dropout_epochs": 1}  # instead of hours
SMALL_NETWORK = {"n": 400, "samples": 2048, "width": 32, "depth": 2, "hidden": 16, "parts": 2, "warm_up": 2}


def shot(path: Path, curve: cavirheo.RadiusCurve, medium: cavirheo.Medium | None = None) -> None:
    """A .mat file as IMR writes it, in m and s, or BDT's cells, whose times are those of a medium."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if medium is None:
        savemat(path, {"Rnew": curve.radius, "t": curve.time})
        return
    one: dict[str, np.ndarray] = {key: np.empty((1, 1), object) for key in ("R_nondim_All", "t_nondim_All")}
    one["t_nondim_All"][0, 0], one["R_nondim_All"][0, 0] = (row[None] for row in curve.normalised(medium))
    savemat(path, one | {"RmaxList": curve.max_radius})


def video(path: Path, rate: float, scale: float) -> None:
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
        for key, value in (SMALL_NETWORK if "[posterior]" in text else SMALL).items():
            text = re.sub(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
        recipe.write_text(text, "utf-8")


def write_shots(folder: Path) -> None:
    """Recordings of one shot each, or of two; the measurements that tables of references name, too."""
    shutil.copytree(ROOT / "examples", folder / "examples", ignore=shutil.ignore_patterns("tutorials"))
    stiff = cavirheo.read_curves(folder / "examples/stiff_gel.mat")[0]
    for path in ("SHOT.mat", "SHOTS.mat", "SHOTS/first.mat", "FOLDER/gel_1/first.mat"):
        shot(folder / path, stiff)
    shot(folder / "CELLS.mat", stiff, cavirheo.Medium(density=998.0))
    rows = (folder / "examples/soft_gel.csv").read_text("utf-8").splitlines(keepends=True)
    first = "".join(row for row in rows if row.startswith(("shot", "1,")))
    (folder / "FOLDER/water").mkdir()
    for path in ("SHOTS.csv", "shots.csv", "FILE", "FOLDER/water/shots.csv"):
        (folder / path).write_text(first, "utf-8")
    for k in (1, 2):
        both = "".join(row for row in rows if row.startswith(("shot", f"{2 * k - 1},", f"{2 * k},")))
        (folder / f"gel_{k}.csv").write_text(both, "utf-8")
    shutil.copy(folder / "examples/bubble.mp4", folder)
    video(folder / "VIDEO.mp4", 270e3, 2.76)
    (folder / "VIDEOS").mkdir()
    video(folder / "VIDEOS/first.mp4", 500e3, 2.5)
    published = (row for row in (ROOT / "examples/published_values.csv").open(encoding="utf-8") if row[0] != "#")
    for row in [row for row in csv.DictReader(published) if row["files"] not in ("", "-")]:
        medium = MEDIA[row["medium"]] if row["medium"] else cavirheo.Medium(density=float(row["density"]))
        for data in ("PATH/TO/DATA", "MEASUREMENTS"):
            shot(folder / data / row["files"].replace("*", "first"), stiff, medium)


def write_tables(folder: Path) -> None:
    """Collapse times, simulated; and the tables that pages show."""
    gel, shots = cavirheo.NeoHookeanKelvinVoigt(8e3, 0.05), []
    for size, stretch in ((180e-6, 5.0), (220e-6, 7.0), (260e-6, 6.0), (300e-6, 8.0)):
        times = np.linspace(0.0, 60e-6, 6001)
        radius = cavirheo.simulate(gel, max_radius=size, stretch=stretch, time=times).radius
        fall = int(np.argmax(np.diff(radius) > 0))
        shots.append((size, stretch, times[fall]))
    savemat(folder / "TABLE.mat", {"pIMR_array": np.array(shots)})
    lines = [f"{1e6 * size},{stretch},{1e6 * first:.3f}\n" for size, stretch, first in shots]
    (folder / "TABLE.csv").write_text("rmax_um,stretch,t1_us\n" + "".join(lines), "utf-8")
    for page, table in (("docs/how-to/compare.md", "REF.csv"), ("docs/method/population.md", "concentration.csv")):
        text = next(text for text in blocks((ROOT / page).read_text("utf-8"), "") if text.startswith(("set,", "shot,")))
        (folder / table).write_text(text, "utf-8")
