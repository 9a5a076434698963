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


@pytest.mark.needs("matplotlib")
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


def test_simulate_all_options(run, tmp_path):
    """Ultrasound on a nucleus in a material with memory: the same as in Python, stress included."""
    words = "--rmax-um 2 --stretch 1 --duration-us 10 --fps 1e7 --motion gilmore --precise"
    law = "zener(2e3, 0.01, 1e-6)"
    done(run("simulate", "--material", law, *words.split(), "--pulse", -2000, 0.5, 1, "-o", "a"))
    way = {"max_radius": 2e-6, "stretch": 1.0, "time": np.arange(101) / 1e7, "bubble": Bubble(motion="gilmore")}
    expected = simulate(materials.parse(law), **way, driving=Pulse(-2e6, 5e5, 1e-6), accuracy=PRECISE)
    there = np.genfromtxt(tmp_path / "a" / "simulation.csv", delimiter=",", names=True)
    assert there["radius_um"] == pytest.approx(expected.radius * 1e6, rel=1e-8)
    assert there["stress_Pa"] == pytest.approx(expected.stress, rel=1e-8)
    assert there["strain"] == pytest.approx(expected.strain, abs=1e-8)
    assert there["strain_rate_per_s"] == pytest.approx(expected.strain_rate, rel=1e-8, abs=1e-3)
    assert there["radius_um"].max() > 4


@pytest.mark.parametrize(
    "way",
    [
        "--polytropic 1.4", "--motion rayleigh-plesset", "--relaxed", "--pulse -500 1 2", "--contents kinetic",
        "--damage 0.2 2", "--confinement-damping 0.2", "--confinement-inertia 0.1", "--wall-distance-um 500",
        "--vapour-excess 3000",
    ],
)  # fmt: skip
def test_each_option_matters(run, tmp_path, way):
    words = "simulate --material neo-hookean(2e3)+ucm(0.05,3e-6) --rmax-um 100 --stretch 5 --duration-us 30 -o {}"
    for name, more in (("a", ""), ("b", way)):
        done(run(*words.format(name).split(), *more.split()))
    one, two = (read_curves(tmp_path / name / "simulation.csv")[0].radius for name in "ab")
    assert np.abs(one - two).max() > 1e-7
