"""The command line: the main job on the shipped examples, and every bad input refused."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from conftest import BDT, EXAMPLE, done
from files import write_curve

from cavirheo import Bubble, read_curves, simulate
from cavirheo.physics import materials
from cavirheo.physics.accuracy import PRECISE
from cavirheo.physics.bubble import Damage
from cavirheo.physics.media import Pulse


def infer(run, *words: object, status: int = 0) -> tuple[list[dict], list[dict], str]:
    """Rows of curves and groups, and what stands on stderr."""
    found, _, err = run("infer", *words, *BDT, "-o", "r", "--replace")
    assert found == status, err
    document = json.loads(Path("r", "result.json").read_text())
    return document["curves"], document["groups"], err


@pytest.fixture
def shot(tmp_path) -> Path:
    write_curve(tmp_path / "shot.csv", read_curves(EXAMPLE)[1])
    return tmp_path / "shot.csv"


def test_the_main_job(run):
    curves, (group,), _ = infer(run, EXAMPLE)
    assert [(row["verdict"], row["medium"]["density"]) for row in curves] == [("unverified", 998.0)] * 5
    assert (group["n"], group["n_counted"], group["verdict"]) == (5, 0, "unverified")
    assert Path("r", "report.html").read_text().count("<svg") == 5 + 2  # the plane of the group, and all curves
    assert not list(Path("r").glob("*.png"))


FRAMES = range(60)
FAILED = {  # a table of a curve that cannot be answered, and what the reason must name
    "three.csv": ("time_us,radius_um\n0,100\n1,101\n2,102\n", "3 of 3"),
    "nan.csv": ("time_us,radius_um\n" + "".join(f"{k},nan\n" for k in FRAMES), "0 of 60"),
    "fast.csv": ("time_us,radius_um\n" + "".join(f"{1e6 * k},{140 * np.cos(k / 40):.2f}\n" for k in FRAMES), "(1 us)"),
    "grows.csv": ("time_us,radius_um\n" + "".join(f"{k},{100 + k}\n" for k in FRAMES), ""),
    "pixels.csv": ("time_us,radius_px\n" + "".join(f"{k},{140 * np.cos(k / 40):.2f}\n" for k in FRAMES), "--rmax-um"),
}


def test_failed_curves_keep_their_row_and_the_others_their_answer(run, tmp_path, shot):
    for name, (content, _) in FAILED.items():
        (tmp_path / name).write_text(content)
    curves, _, _ = infer(run, *FAILED, shot, status=1)
    assert [c["verdict"] for c in curves] == ["failed"] * len(FAILED) + ["unverified"]
    for row, (_, named) in zip(curves, FAILED.values(), strict=False):
        assert named in row["messages"][-1]["text"]
        assert [row[name]["median"] for name in ("shear_modulus_Pa", "viscosity_Pa_s", "stretch")] == [None] * 3
    (tmp_path / "empty.csv").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    curves, _, err = infer(run, "empty.csv", "folder", "*.xlsx", shot, status=2)
    assert {*re.findall(r"^error: ([^:]+):", err, re.MULTILINE)} == {"empty.csv", "folder", "*.xlsx"}
    assert [c["verdict"] for c in curves] == ["unverified"]


LAW = "zener(2e3, 0.01, 1e-6)"
MOVED = Bubble(exponent=1.4, damage=Damage(0.2, 2.0), confinement_damping=0.2, confinement_inertia=0.1)
FILLED = Bubble("kinetic", 0.07, wall_distance=1e-5, vapour_excess=3e3)
WAYS = {  # options of a command, and the same in Python
    "--motion gilmore --precise --pulse -2000 0.5 1": {
        "bubble": Bubble(motion="gilmore"), "driving": Pulse(-2e6, 5e5, 1e-6), "accuracy": PRECISE,
    },
    "--polytropic 1.4 --relaxed --damage 0.2 2 --confinement-damping 0.2 --confinement-inertia 0.1": {
        "bubble": MOVED, "relaxed": True,
    },
    "--contents kinetic --wall-distance-um 10 --vapour-excess 3000": {"bubble": FILLED},
}  # fmt: skip


@pytest.mark.parametrize("options", WAYS)
def test_a_simulation_is_that_of_python_with_every_option(run, tmp_path, options):
    """A nucleus in a material with memory, under ultrasound or released, stress included."""
    stretch = 1 if "--pulse" in options else 3
    words = f"--rmax-um 2 --stretch {stretch} --duration-us 10 --fps 1e7 {options} -o a"
    done(run("simulate", "--material", LAW, *words.split()))
    time = np.arange(101) / 1e7
    way = {"max_radius": 2e-6, "stretch": float(stretch), "time": time}
    expected = simulate(materials.parse(LAW), **way, **WAYS[options])
    there = np.genfromtxt(tmp_path / "a" / "simulation.csv", delimiter=",", names=True)
    assert there["radius_um"] == pytest.approx(expected.radius * 1e6, rel=1e-5)
    assert there["stress_Pa"] == pytest.approx(expected.stress, rel=1e-4, abs=1.0)
    assert there["strain"] == pytest.approx(expected.strain, abs=1e-5)
    assert there["strain_rate_per_s"] == pytest.approx(expected.strain_rate, rel=1e-3, abs=1e3)
    assert np.ptp(there["radius_um"]) > 0.5
