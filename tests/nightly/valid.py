"""Small files of every kind that the program reads, all of them valid: what mutated and damaged ones are made from."""

import json
import re
import tempfile
import tomllib
from pathlib import Path

import h5py
import numpy as np
from answers import answer, bubble, written
from broken_recipes import RIGHT
from files import Make, cells, hdf5, ods_row, put, saved, saved73, write_ods, write_xls, write_xlsx
from files import lines as rows
from typer.testing import CliRunner

from cavirheo import verbs
from cavirheo.training.recipe import PointRecipe

TIME = np.arange(-8.0, 92.0)  # us
RADIUS = 250 * (0.12 + 0.88 * np.abs(np.cos(np.pi * TIME / 46)) * np.exp(-np.maximum(TIME, 0) / 70))  # um
SECONDS, METRES = TIME * 1e-6, RADIUS * 1e-6
STAR = 250e-6 * np.sqrt(998 / 101325)  # s per unit of t*

OMEGA = np.geomspace(0.1, 100, 13)
STORAGE, LOSS, ONE = 5000 + 30 * OMEGA, 200 + 25 * OMEGA, np.ones(13)
SHOTS = np.repeat([1, 2, 3], 100), np.tile(TIME, 3), np.tile(RADIUS, 3)
TEXTS = {
    "curve.csv": "time_us,radius_um\n" + rows(",", TIME, RADIUS),
    "deviation.csv": "time_us,radius_um,radius_std_um\n" + rows(",", TIME, RADIUS, 0.01 * RADIUS),
    "shots.csv": "shot,time_us,radius_um\n" + rows(",", *SHOTS),
    "tab.txt": "# made by a program\n# time_us\tradius_um\n" + rows("\t", TIME, RADIUS),
    "separated.txt": (rows(" ", SECONDS, METRES) + "-1000 -1000\n") * 3,
    "frequency.csv": "Angular frequency (rad/s),G' (Pa),G'' (Pa),Strain (%)\n" + rows(",", OMEGA, STORAGE, LOSS, ONE),
    "intervals.txt": "[step]\nStep\tomega\tG'\tG''\n\trad/s\tPa\tPa\n" + rows("\t", ONE, OMEGA, STORAGE, LOSS),
    "times.csv": "name,rmax_um,stretch,t1_us\n" + "".join(f"s{k},{240 + k},7.{k},{22 + 0.1 * k}\n" for k in range(8)),
    "published.csv": "set,method,quantity,mean,std,source\n# by hand\n"
    "gel,IMR,G_kPa,6.4,1.6,doi:1\ngel,IMR,mu_Pa_s,0.02,0.009,\nother,rheometer,G_kPa,1.3,,\n",
    "recipe.toml": RIGHT,
}
BDT = {"RmaxList": np.full((1, 3), 250e-6), "lambda_max_mean": 7.1, "lambda_max_std": 0.3, "rho": 1000.0}
BDT |= {"R_nondim_All": cells(*[METRES / METRES.max()] * 2, []), "t_nondim_All": cells(*[SECONDS / STAR] * 2, [])}
VARIABLES: dict[str, dict[str, object]] = {
    "bdt": BDT,
    "imr": {"Rnew": METRES, "t": SECONDS},
    "pixels": {"Rnew": RADIUS / 2, "deltax": 2e-6, "deltat": 1e-6},
}


PACKED = {"chunks": (20,), "compression": "gzip", "shuffle": True, "fletcher32": True}
GROUP = {"/time_us": TIME, "/radius_um": RADIUS, "/radius_std_um": 0.01 * RADIUS, "/stretch": 7.0}
GROUPS = {f"gel/shot{k}{name}": values for k in (0, 1) for name, values in GROUP.items()}


def grid(text: str) -> list[list[object]]:
    """The cells of a text table, numbers as numbers."""
    number = re.compile(r"-?\d+(\.\d+)?(e[+-]?\d+)?")
    return [[float(cell) if number.fullmatch(cell) else cell for cell in line.split(",")] for line in text.splitlines()]


def xlsx(*names: str) -> Make:
    return lambda path: write_xlsx(path, {name.split(".")[0]: grid(TEXTS[name]) for name in names})


def shard(path: Path) -> None:
    """A training set of 40 curves, complete."""
    problem = PointRecipe.model_validate(tomllib.loads(RIGHT)).problem
    rng = np.random.default_rng(0)
    about = {"problem": json.dumps(problem.to_dict()), "seed": 1, "total": 40, "made_by": "0.1.0", "start": 0}
    hdf5(
        theta=problem.prior.sample(40, 1),
        radius=rng.random((40, 20)).astype(np.float32),
        status={"data": ["ok"] * 40, "dtype": h5py.string_dtype()},
        **{f"@{name}": value for name, value in about.items()},
    )(path)


def network(path: Path) -> None:
    """A tiny network without its card."""
    from broken_models import SOUND

    path.write_bytes(SOUND)


BINARIES: dict[str, Make] = {
    **{f"{name}.mat": saved(**given) for name, given in VARIABLES.items()},
    **{f"{name}-packed.mat": saved(packed=True, **given) for name, given in VARIABLES.items()},
    **{f"{name}-73.mat": saved73(**given) for name, given in VARIABLES.items()},
    "groups.h5": hdf5(**GROUPS),
    "packed.h5": hdf5(time={"data": SECONDS, **PACKED}, radius={"data": METRES, **PACKED}),
    "curve.xlsx": xlsx("curve.csv"),
    "sweeps.xlsx": xlsx("frequency.csv", "times.csv", "published.csv"),
    "times.xlsx": xlsx("times.csv"),
    "curve.ods": lambda path: write_ods(path, "".join(map(ods_row, grid(TEXTS["curve.csv"])))),
    "old.xls": write_xls,
    "shard-00000.h5": shard,
    "network.npz": network,
}


def content(name: str, folder: Path) -> bytes:
    """The bytes of a file of TEXTS or BINARIES."""
    return put(folder / name, BINARIES.get(name) or TEXTS[name]).read_bytes()


def documents() -> dict[str, str]:
    """One document of each kind, as the program writes it."""
    with tempfile.TemporaryDirectory() as folder:
        written(folder, [(bubble(f"shot[{k}]"), answer(bubble(), 6e3 + 100 * k, draws=40)) for k in range(3)])
        for verb, name in {"collapse-time": "times.csv", "rheometer": "frequency.csv"}.items():
            path = put(Path(folder, name), TEXTS[name])
            CliRunner().invoke(verbs.app, [verb, str(path), "--quiet", "-o", f"{folder}/{verb}"])
        return {path.name: path.read_text("utf-8") for path in Path(folder).rglob("*.json")}
