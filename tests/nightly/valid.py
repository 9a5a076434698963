"""Small files of every kind that the program reads, all of them valid: what mutated and damaged ones are made from."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from files import ods_row, save_v73, write_ods, write_xls, write_xlsx  # noqa: E402

TIME = np.arange(-8.0, 92.0)  # us
RADIUS = 250 * (0.12 + 0.88 * np.abs(np.cos(np.pi * TIME / 46)) * np.exp(-np.maximum(TIME, 0) / 70))  # um
SECONDS, METRES = TIME * 1e-6, RADIUS * 1e-6
STAR = 250e-6 * np.sqrt(998 / 101325)  # s per unit of t*


def rows(separator: str, *columns: np.ndarray, comma: bool = False) -> str:
    """Lines of numbers."""
    text = "\n".join(separator.join(f"{value:.6g}" for value in row) for row in zip(*columns, strict=True)) + "\n"
    return text.replace(".", ",") if comma else text


def table(*shots: int, titles: str = "shot,time_us,radius_um") -> str:
    """A CSV with a column that tells the shots apart."""
    return titles + "\n" + "".join(f"{k},{t:g},{r:.6g}\n" for k in shots for t, r in zip(TIME, RADIUS, strict=True))


OMEGA = np.geomspace(0.1, 100, 13)
STORAGE, LOSS = 5000 + 30 * OMEGA, 200 + 25 * OMEGA
TEXTS = {
    "curve.csv": "time_us,radius_um\n" + rows(",", TIME, RADIUS),
    "deviation.csv": "time_us,radius_um,radius_std_um\n" + rows(",", TIME, RADIUS, 0.01 * RADIUS),
    "shots.csv": table(1, 2, 3),
    "semicolon.csv": "t [us];R (µm)\n" + rows(";", TIME, RADIUS, comma=True),
    "tab.txt": "# made by a program\n# time_us\tradius_um\n" + rows("\t", TIME, RADIUS),
    "bare.txt": rows(" ", SECONDS, RADIUS),
    "separated.txt": (rows(" ", SECONDS, METRES) + "-1000 -1000\n") * 3,
    "axes.txt": rows(" ", TIME, RADIUS, 1.02 * RADIUS),
    "frequency.csv": "Angular frequency (rad/s),G' (Pa),G'' (Pa),Strain (%)\n"
    + rows(",", OMEGA, STORAGE, LOSS, 1 + 0 * OMEGA),
    "strain.csv": "Strain (%);Frequency (Hz);Storage modulus (kPa);Loss modulus (kPa)\n"
    + rows(";", OMEGA, 1 + 0 * OMEGA, 5 / (1 + OMEGA / 90), 0.2 + 0 * OMEGA, comma=True),
    "intervals.txt": "[step]\nStep\tomega\tG'\tG''\n\trad/s\tPa\tPa\n"
    + rows("\t", 1 + 0 * OMEGA, OMEGA, STORAGE, LOSS),
    "times.csv": "name,rmax_um,stretch,t1_us\n" + "".join(f"s{k},{240 + k},7.{k},{22 + 0.1 * k}\n" for k in range(8)),
    "pressure.csv": "time_us,pressure_kPa\n" + rows(",", TIME + 8, 50 * np.sin(TIME)),
    "published.csv": "set,files,density,stretch,method,quantity,mean,std,source\n# by hand\n"
    "gel,curve.csv,1004,7,IMR,G_kPa,6.4,1.6,doi:1\ngel,,,,IMR,mu_Pa_s,0.02,0.009,\nother,*.mat,,,rheometer,G_kPa,1.3,,\n",
    "recipe.toml": """[problem]
material = "nhkv"
medium = { name = "water", density = 1000.0 }
reference_max_radius_um = 245.0
frame_interval_us = 1.0
frames = 20
[prior]
log10_shear_modulus = [3.0, 6.0]
log10_viscosity = [-3.0, 0.0]
stretch = [3.0, 11.0]
[data]
n = 100
seed = 1
[network]
width = 16
heads = 2
outputs = ["log10_viscosity"]
[training]
epochs = 4
lr = 1e-2
schedule = "cosine"
[export]
name = "tiny"
""",
}


def bdt(count: int = 3) -> dict[str, object]:
    """The cells of published files."""
    shots, empty = [METRES / METRES.max()] * (count - 1), np.empty((0, 0))
    return {
        "R_nondim_All": cells(*shots, empty), "t_nondim_All": cells(*[SECONDS / STAR] * (count - 1), empty),
        "RmaxList": np.full((1, count), 250e-6), "lambda_max_mean": 7.1, "lambda_max_std": 0.3, "rho": 1000.0,
    }  # fmt: skip


def cells(*arrays: np.ndarray) -> np.ndarray:
    """A cell array of one row."""
    held = np.empty((1, len(arrays)), dtype=object)
    for k, array in enumerate(arrays):
        held[0, k] = np.atleast_2d(array)
    return held


VARIABLES: dict[str, Callable[[], dict[str, object]]] = {
    "bdt": bdt,
    "imr": lambda: {"Rnew": METRES, "t": SECONDS, "note": "made for a test"},
    "pixels": lambda: {"Rnew": RADIUS / 2, "deltax": 2e-6, "deltat": 1e-6},
    "rows": lambda: {"R": np.stack([RADIUS, RADIUS]), "t": SECONDS},
    "shifted": lambda: {"shift_normRnew": np.stack([RADIUS / 250] * 2), "Rmax": np.full(2, 250.0), "t": SECONDS},
    "times": lambda: {"pIMR_array": np.array([[250e-6 + k * 1e-6, 7 + 0.1 * k, 22e-6 + k * 1e-7] for k in range(6)])},
}


def mat5(name: str, packed: bool) -> Callable[[Path], None]:
    return lambda path: savemat(path, VARIABLES[name](), do_compression=packed)


def mat73(name: str) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        kept = {key: np.asarray(value) for key, value in VARIABLES[name]().items() if not isinstance(value, str)}
        save_v73(path, kept)

    return make


def hdf5(path: Path, shots: int = 2) -> None:
    with h5py.File(path, "w") as file:
        for k in range(shots):
            group = file.create_group(f"gel/shot{k}")
            group["time_us"], group["radius_um"], group["radius_std_um"] = TIME, RADIUS, 0.01 * RADIUS
            group.attrs["stretch"] = 7.0


def hdf5_packed(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for name, values in (("time", SECONDS), ("radius", METRES)):
            file.create_dataset(name, data=values, chunks=(20,), compression="gzip", shuffle=True, fletcher32=True)


def grid(text: str, separator: str = ",") -> list[list[object]]:
    """The cells of a text table, numbers as numbers."""

    def value(cell: str) -> object:
        try:
            return float(cell)
        except ValueError:
            return cell

    return [[value(cell) for cell in line.split(separator)] for line in text.splitlines()]


def xlsx(*names: str) -> Callable[[Path], None]:
    return lambda path: write_xlsx(path, {name.split(".")[0]: grid(TEXTS[name]) for name in names}) and None


def ods(path: Path) -> None:
    write_ods(path, "".join(map(ods_row, grid(TEXTS["curve.csv"]))))


def shard(path: Path) -> None:
    """A training set of 40 curves, complete."""
    import tomllib

    from cavirheo.training.recipe import Recipe

    problem = Recipe.model_validate(tomllib.loads(TEXTS["recipe.toml"])).problem
    rng = np.random.default_rng(0)
    with h5py.File(path, "w") as file:
        about = {"problem": json.dumps(problem.to_dict()), "seed": 1, "total": 40, "made_by": "0.1.0", "start": 0}
        file.attrs.update(about)
        file["theta"] = problem.prior.sample(40, 1)
        file["radius"] = rng.random((40, 20)).astype(np.float32)
        file.create_dataset("status", data=np.array(["ok"] * 40, dtype=object), dtype=h5py.string_dtype())


def network(path: Path) -> None:
    """A tiny network; its card is written by `card_of`."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    weights = numpy_helper.from_array(np.full((100, 1), 0.01, np.float32), "w")
    ends = [
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", width])]
        for name, width in (("radius", 100), ("theta", 1))
    ]
    nodes = [helper.make_node("MatMul", ["radius", "w"], ["a"]), helper.make_node("Tanh", ["a"], ["theta"])]
    graph = helper.make_graph(nodes, "g", *ends, [weights])
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    path.write_bytes(onnx.ModelProto.SerializeToString(made))


def card_of(content: bytes) -> dict[str, object]:
    """The card that a model with this content would have."""
    card = json.loads((ROOT / "src/cavirheo/models/bdt-viscous.json").read_text())
    card["onnx"]["sha256"] = hashlib.sha256(content).hexdigest()
    return card


BINARIES: dict[str, Callable[[Path], None]] = {
    **{f"{name}.mat": mat5(name, packed=False) for name in VARIABLES},
    **{f"{name}-packed.mat": mat5(name, packed=True) for name in VARIABLES},
    **{f"{name}-73.mat": mat73(name) for name in VARIABLES},
    "groups.h5": hdf5,
    "packed.h5": hdf5_packed,
    "curve.xlsx": xlsx("curve.csv"),
    "sweeps.xlsx": xlsx("frequency.csv", "times.csv", "published.csv"),
    "times.xlsx": xlsx("times.csv"),
    "curve.ods": ods,
    "old.xls": lambda path: write_xls(path) and None,
    "shard-00000.h5": shard,
    "network.onnx": network,
}


def content(name: str, folder: Path) -> bytes:
    """The bytes of a file of TEXTS or BINARIES."""
    if name in TEXTS:
        return TEXTS[name].encode()
    path = folder / name
    BINARIES[name](path)
    return path.read_bytes()


def documents() -> dict[str, str]:
    """One document of each kind, as the program writes it."""
    from answers import answer, bubble

    from cavirheo.companions import rheometer as document
    from cavirheo.companions.collapse_times import CollapseTimes, read_groups
    from cavirheo.companions.rheometer import read_sweeps
    from cavirheo.physics.media import WATER
    from cavirheo.reporting import result
    from cavirheo.reporting.laws import Laws, WeighedLaw
    from cavirheo.writing.document import as_json

    found = result([(bubble(f"shot[{k}]"), answer(bubble(), 6e3 + 100 * k, draws=40)) for k in range(3)], "x")
    law = WeighedLaw(log_evidence=-12.5, standard_error=0.3, probability=0.25, answer=found.curves[0])
    shot = {"name": "a", "shots": 1, "chosen": "nhkv", "contenders": [], "laws": {"nhkv": law}, "pairs": []}
    groups, *_ = read_groups([ROOT / "tests" / "meta" / "golden" / "times.csv"], WATER)
    groups[0].answer("nhkv", medium=WATER)
    medium = {"density": WATER.density, "pressure": WATER.pressure}
    sweeps = read_sweeps(ROOT / "examples" / "soft_gel_strain_sweep.csv")
    made = {
        "result": found,
        "laws": Laws(command="x", curves=[shot], groups=[]),
        "collapse-time": CollapseTimes(command="x", material="nhkv", medium=medium, groups=groups),
        "rheometer": document.rheometry(sweeps, "gel", command="x", date="", notes=[]),
    }
    return {f"{name}.json": as_json(one) for name, one in made.items()}
