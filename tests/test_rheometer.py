"""Rheometer sweeps: exact answers of known models, what instruments export, and a word for what cannot be used."""

from __future__ import annotations

import csv
import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from files import write_xlsx

from cavirheo.companions.rheometer import frequency_sweep, read_sweeps, strain_sweep
from cavirheo.companions.rheometer.document import regimes, rheometry
from cavirheo.companions.rheometer.read import VOCABULARY
from cavirheo.companions.rheometer.sweeps import Sweep
from cavirheo.errors import InputError
from cavirheo.io.tables import Table
from cavirheo.reporting import read_json
from cavirheo.reporting.record import Result
from cavirheo.writing import style
from cavirheo.writing.document import write_json

EXAMPLES = Path(__file__).parent.parent / "examples"
OMEGA = np.logspace(-1, 2, 16)
STRAIN = np.logspace(-4, 1, 51)


@pytest.fixture(scope="module")
def examples():
    """The module that makes the examples, for the truth."""
    spec = importlib.util.spec_from_file_location("make_examples", EXAMPLES / "make_examples.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def sweep(kind: str, x, storage, loss) -> Sweep:
    x = np.asarray(x)
    return Sweep(
        kind=kind, name="gel", x=x, storage=np.broadcast_to(storage, x.shape), loss=np.broadcast_to(loss, x.shape)
    )


def maxwell(omega, G=1e3, tau=1.0):
    return G * (omega * tau) ** 2 / (1 + (omega * tau) ** 2), G * omega * tau / (1 + (omega * tau) ** 2)


def softening(gamma, G=2e3, at=1.0):
    return G / (1 + (gamma / at) ** 2)


@pytest.fixture
def plain(monkeypatch):
    """Without pictures, which take half a second each."""
    monkeypatch.setattr(style, "available", lambda: False)


class TestFrequencySweep:
    def test_kelvin_voigt_is_exact(self):
        found = frequency_sweep(sweep("frequency", OMEGA, 5e3, 0.3 * OMEGA))
        assert found.viscosity_Pa_s == pytest.approx(0.3, rel=1e-12)
        assert found.plateau_storage_Pa == pytest.approx(5e3)
        assert (found.plateau_from, found.plateau_to) == (OMEGA[0], OMEGA[-1])
        assert found.tan_delta == pytest.approx(0.3 / 5e3)
        assert found.complex_viscosity_Pa_s == pytest.approx(np.hypot(5e3, 0.3))
        assert found.crossover is None
        assert found.message == ""

    def test_maxwell(self):
        omega = np.logspace(-1, 3, 41)
        found = frequency_sweep(sweep("frequency", omega, *maxwell(omega)), at=3.3)
        storage, loss = maxwell(3.3)
        assert found.crossover == pytest.approx(1.0, rel=1e-3)
        assert found.crossover_modulus_Pa == pytest.approx(500, rel=1e-3)
        assert found.viscosity_Pa_s == pytest.approx(loss / 3.3, rel=2e-4)
        assert found.viscosity_Pa_s * 3.3 / found.tan_delta == pytest.approx(storage, rel=2e-4)
        assert found.plateau_storage_Pa == pytest.approx(1e3, rel=1e-3)
        assert found.plateau_from == pytest.approx(np.sqrt(2 / 0.1 - 1), rel=0.15)  # slope 2/(1+(wt)2) = 0.1

    def test_zener_on_a_coarse_grid(self):
        omega = np.logspace(-1, 2, 10)
        storage, loss = maxwell(omega, 4e3, 0.1)
        found = frequency_sweep(sweep("frequency", omega, 1e3 + storage, loss + 0.05 * omega))
        assert found.viscosity_Pa_s == pytest.approx(maxwell(1.0, 4e3, 0.1)[1] + 0.05, rel=2e-3)

    def test_a_liquid_has_no_plateau_and_says_so(self):
        found = frequency_sweep(sweep("frequency", OMEGA, *maxwell(OMEGA, 1e4, 1e-3)))
        assert found.plateau_storage_Pa is None
        assert any("no plateau" in note for note in found.notes)
        assert found.viscosity_Pa_s == pytest.approx(10.0, rel=1e-4)

    def test_noise_does_not_break_a_plateau(self):
        noise = 1 + 0.02 * np.random.default_rng(1).standard_normal((2, OMEGA.size))
        found = frequency_sweep(sweep("frequency", OMEGA, 5e3 * noise[0], 0.3 * OMEGA * noise[1]))
        assert found.plateau_storage_Pa == pytest.approx(5e3, rel=0.02)
        assert found.plateau_to / found.plateau_from > 100

    @pytest.mark.parametrize(
        ("omega", "at", "named"),
        [
            ([2.0, 5, 20], 1.0, "2 to 20 rad/s"),
            ([0.01, 0.1, 0.5], 1.0, "0.01 to 0.5 rad/s"),
            ([0.05, 0.08, 20], 1.0, "1 rad/s"),
        ],
    )
    def test_nothing_is_extrapolated(self, omega, at, named):
        found = frequency_sweep(sweep("frequency", omega, 1e3, 10.0), at)
        assert named in found.message
        assert found.viscosity_Pa_s is None
        assert found.tan_delta is None

    def test_an_end_of_the_data_rounded_by_the_export_is_inside(self):
        found = frequency_sweep(sweep("frequency", [1.0003, 2, 5], 1e3, 10.0))
        assert found.viscosity_Pa_s == pytest.approx(10.0)


class TestStrainSweep:
    def test_softening_gel(self):
        found = strain_sweep(sweep("strain", STRAIN, softening(STRAIN), 50.0))
        assert found.plateau_storage_Pa == pytest.approx(2e3, rel=1e-3)
        assert found.plateau_from == STRAIN[0]
        assert found.plateau_to == pytest.approx(np.sqrt(1 / 0.95 - 1), rel=0.02)
        assert found.departs == "softens"
        assert found.crossover == pytest.approx(np.sqrt(39), rel=0.01)
        assert found.crossover_modulus_Pa == pytest.approx(50, rel=0.01)

    @pytest.mark.parametrize("tolerance", [0.02, 0.1])
    def test_tolerance(self, tolerance):
        found = strain_sweep(sweep("strain", STRAIN, softening(STRAIN), 50.0), tolerance)
        assert found.plateau_to == pytest.approx(np.sqrt(1 / (1 - tolerance) - 1), rel=0.02)

    def test_stiffening(self):
        found = strain_sweep(sweep("strain", STRAIN, 500 * (1 + (STRAIN / 0.3) ** 2), 5.0))
        assert found.departs == "stiffens"
        assert found.plateau_to == pytest.approx(0.3 * np.sqrt(0.05), rel=0.02)

    def test_scatter_at_low_torque_is_left_out_and_counted(self):
        storage = softening(STRAIN)
        storage[:6] *= [1.8, 0.5, 1.4, 0.7, 1.25, 0.88]
        found = strain_sweep(sweep("strain", STRAIN, storage, 50.0))
        assert found.plateau_from == STRAIN[6]
        assert found.plateau_to == pytest.approx(np.sqrt(1 / 0.95 - 1), rel=0.02)
        assert any("6 points below the linear range" in note and "torque" in note for note in found.notes)

    @pytest.mark.parametrize("seed", range(5))
    def test_noise(self, seed):
        noise = 1 + 0.02 * np.random.default_rng(seed).standard_normal(STRAIN.size)
        found = strain_sweep(sweep("strain", STRAIN, softening(STRAIN) * noise, 50.0))
        assert found.plateau_storage_Pa == pytest.approx(2e3, rel=0.01)
        assert found.plateau_to == pytest.approx(np.sqrt(1 / 0.95 - 1), rel=0.25)

    def test_one_stray_point_does_not_end_the_range(self):
        storage = softening(STRAIN)
        storage[15] *= 1.3
        found = strain_sweep(sweep("strain", STRAIN, storage, 50.0))
        assert found.plateau_to == pytest.approx(np.sqrt(1 / 0.95 - 1), rel=0.02)

    def test_a_sweep_that_ends_in_the_linear_range_has_no_limit(self):
        found = strain_sweep(sweep("strain", STRAIN[:20], 1e3, 10.0))
        assert found.plateau_to == STRAIN[19]
        assert found.departs is None
        assert found.crossover is None

    def test_no_linear_range_is_invented(self):
        found = strain_sweep(sweep("strain", STRAIN, 1e3 * STRAIN**-0.3, 10.0))
        assert found.message
        assert found.plateau_storage_Pa is None
        assert found.plateau_to is None

    def test_a_second_plateau_is_told(self):
        storage = 1e3 * np.where(STRAIN < 3e-4, 1.0, 0.3)
        found = strain_sweep(sweep("strain", STRAIN, storage, 10.0))
        assert any("higher" in note for note in found.notes)


TITLES = {  # title: (kind, factor to SI; None where the unit is missing or unknown)
    "G' (Pa)": ("storage", 1),
    "G'": ("storage", 1),
    "Gp": ("storage", 1),
    "G′ [kPa]": ("storage", 1e3),
    "G_prime_Pa": ("storage", 1),
    "Storage modulus": ("storage", 1),
    "Storage Modulus [Pa]": ("storage", 1),
    "storage_modulus_MPa": ("storage", 1e6),
    "G' in Pa": ("storage", 1),
    "Storage modulus G' / Pa": ("storage", 1),
    "Shear modulus (elastic component)(Pa)": ("storage", 1),
    "Speichermodul [Pa]": ("storage", 1),
    "Module de Stockage [Pa]": ("storage", 1),
    "Storage modulus (psi)": ("storage", None),
    'G" (Pa)': ("loss", 1),
    "G'' [mPa]": ("loss", 1e-3),
    "G″": ("loss", 1),
    "Gpp": ("loss", 1),
    "Loss modulus (dyn/cm2)": ("loss", 0.1),
    "Shear modulus (viscous component) (Pa)": ("loss", 1),
    "Angular Frequency": ("omega", 1),
    "Angular frequency (rad/s)": ("omega", 1),
    "ang. frequency": ("omega", 1),
    "Ang. Frequency [rad·s⁻¹]": ("omega", 1),
    "omega (rad/s)": ("omega", 1),
    "omega_rad_per_s": ("omega", 1),
    "ω [1/s]": ("omega", 1),
    "Frequency(Hz)": ("omega", 2 * np.pi),
    "Fréquence [Hz]": ("omega", 2 * np.pi),
    "Frequency [1/s]": ("omega", None),
    "Frequency": ("omega", None),
    "Oscillation strain (%)": ("strain", 0.01),
    "Shear Strain [1]": ("strain", 1),
    "Strain [-]": ("strain", 1),
    "strain_percent": ("strain", 0.01),
    "Complex shear strain(%)": ("strain", 0.01),
    "γ [%]": ("strain", 0.01),
    "Déformation de Cisaillement [%]": ("strain", 0.01),
    "Strain": ("strain", None),
    "Action Name": ("interval", 1),
    "Strain rate (1/s)": ("", 1),
    "Complex viscosity (Pa s)": ("", 1),
    "Temperature (°C)": ("", 1),
    "Normal force F (N)": ("", 1),
}


@pytest.mark.parametrize("title", TITLES)
def test_titles(title):
    kind, factor = TITLES[title]
    columns = Table(VOCABULARY, [title], [], [], []).columns
    alike = {"frequency": "omega", "shear strain": "strain"}
    assert [alike.get(column.name.kind, column.name.kind) for column in columns] == [kind] * bool(kind)
    if factor is None:
        with pytest.raises(InputError):
            _ = columns[0].factor
    elif kind:
        assert columns[0].factor == pytest.approx(factor)


FREQUENCY_ROWS = list(zip(OMEGA, 1e3 + OMEGA, 5 * OMEGA, strict=True))
RHEOCOMPASS = (
    "Project:\tgel\nTest:\tA\n\nResult:\tFrequency sweep 1\n\nInterval and data points:\t1\t16\n"
    "Interval data:\tPoint No.\tAngular Frequency\tStorage Modulus\tLoss Modulus\tShear Strain\tStatus\n\t\t\t\t\t\t\n"
    "\t\t[rad/s]\t[kPa]\t[Pa]\t[1]\t\n"
    + "".join(f"\t{k}\t{w:.6g}\t{s / 1e3:.6g}\t{v:.6g}\t0.01\tDSO\n" for k, (w, s, v) in enumerate(FREQUENCY_ROWS, 1))
)
TRIOS = (
    "Filename\tgel\nOperator\tme\n[Options]\nVelocity limit\t1.0e-3 rad/s\n[step]\nPeak hold - 1\nStress\tShear rate\n"
    "Pa\t1/s\n1.0\t2.0\n\n[step]\nFrequency sweep - 2\n"
    "Storage modulus\tLoss modulus\tTan(delta)\tAngular frequency\tOscillation strain\nPa\tPa\t\trad/s\t%\n"
    + "".join(f"{s:.6g}\t{v:.6g}\t{v / s:.6g}\t{w:.6g}\t1.0\n" for w, s, v in FREQUENCY_ROWS)
    + "\n[step]\nPeak hold - 3\nStress\tShear rate\nPa\t1/s\n1.0\t2.0\n"
)
RSPACE = (
    "Action Name;Shear strain(%);Complex shear strain(%);Frequency(Hz);Shear modulus (elastic component)(Pa);"
    "Shear modulus (viscous component)(Pa)\nPre shear;4,5E+003;;;;\nPre shear;4,6E+003;;;;\n"
    + "".join(f"Sweep;;1,00;{w / 2 / np.pi:.6g};{s:.6g};{v:.6g}\n".replace(".", ",") for w, s, v in FREQUENCY_ROWS)
)
LAYOUTS = {
    "comma.csv": "omega,G',G''\n" + "".join(f"{w:.6g},{s:.6g},{v:.6g}\n" for w, s, v in FREQUENCY_ROWS),
    "quotes.csv": 'omega (rad/s),"G\' (Pa)","G"" (Pa)"\n'
    + "".join(f"{w:.6g},{s:.6g},{v:.6g}\n" for w, s, v in FREQUENCY_ROWS),
    "savetxt.txt": "# omega Gp Gpp\n" + "".join(f"{w:.6g} {s:.6g} {v:.6g}\n" for w, s, v in FREQUENCY_ROWS),
    "german.csv": "Kreisfrequenz [rad/s];Speichermodul [Pa];Verlustmodul [Pa]\n"
    + "".join(f"{w:.6g};{s:.6g};{v:.6g}\n".replace(".", ",") for w, s, v in FREQUENCY_ROWS),
    "hertz.tsv": "Frequency (Hz)\tG' (MPa)\tG'' (kPa)\n"
    + "".join(f"{w / 2 / np.pi:.7g}\t{s / 1e6:.6g}\t{v / 1e3:.6g}\n" for w, s, v in FREQUENCY_ROWS),
    "rheocompass.csv": RHEOCOMPASS.encode("utf-16"),
    "rheocompass-le.csv": RHEOCOMPASS.encode("utf-16-le"),
    "trios.txt": TRIOS,
    "trios.csv": TRIOS.replace("\t", ","),
    "rspace.csv": RSPACE,
}


def put(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("name", LAYOUTS)
def test_layouts(tmp_path, name):
    (found,) = read_sweeps(put(tmp_path / name, LAYOUTS[name]))
    assert found.kind == "frequency"
    for values, expected in zip((found.x, found.storage, found.loss), zip(*FREQUENCY_ROWS, strict=True), strict=True):
        assert values == pytest.approx(expected, rel=1e-5)
    assert found.held in (None, pytest.approx(0.01))
    assert any("2 pi" in note for note in found.notes) == (name in ("hertz.tsv", "rspace.csv"))
    assert any("no unit" in note for note in found.notes) == (name in ("comma.csv", "savetxt.txt"))
    assert any("in the 0 rows with moduli of 'Pre shear'" in note for note in found.notes) == (name == "rspace.csv")


def test_every_sheet_of_a_workbook(tmp_path):
    frequency = [["Angular frequency", "Storage modulus", "Loss modulus"], ["rad/s", "Pa", "Pa"], *FREQUENCY_ROWS]
    strain = [["Strain (%)", "G' (Pa)", "G'' (Pa)"], *([100 * g, softening(g), 50] for g in STRAIN)]
    sheets = {"about": [["Sample", "gel"]], "frequency": frequency, "strain": strain}
    found = read_sweeps(write_xlsx(tmp_path / "gel.xlsx", sheets))
    assert [(one.name, one.kind) for one in found] == [("gel[1]", "frequency"), ("gel[2]", "strain")]
    assert found[1].x == pytest.approx(STRAIN)


def test_several_tables_in_one_file_and_one_that_is_no_sweep(tmp_path):
    strain = (
        "Interval and data points:\t2\t51\nInterval data:\tPoint No.\tShear Strain\tStorage Modulus\tLoss Modulus\n"
    )
    strain += "\t\t[%]\t[Pa]\t[Pa]\n" + "".join(f"\t1\t{100 * g:.6g}\t{softening(g):.6g}\t50\n" for g in STRAIN)
    time = (
        "Result:\ttime sweep\nInterval data:\tAngular Frequency\tStorage Modulus\tLoss Modulus\n\t[rad/s]\t[Pa]\t[Pa]\n"
    )
    time += "\t10\t1000\t50\n" * 20
    found = read_sweeps(put(tmp_path / "gel.csv", RHEOCOMPASS + "\n" + strain + "\n" + time))
    assert [one.kind for one in found] == ["frequency", "strain"]
    assert all(any("no sweep of frequency in the 20 rows" in note for note in one.notes) for one in found)


def test_unusable_rows_are_dropped_and_counted(tmp_path):
    rows = "0.2,,1\n0.3,nan,2\n\n0.4,-5,2\n0.5,5,0\n0.6,---,3\n"
    (found,) = read_sweeps(put(tmp_path / "a.csv", LAYOUTS["comma.csv"] + rows))
    assert len(found.x) == 16
    assert "3 rows without a number left out" in found.notes
    assert "2 rows with a modulus or setting that is not positive left out" in found.notes


@pytest.mark.parametrize("order", ["one after the other", "row by row", "up and down"])
def test_repeated_rows_are_repeated_sweeps(tmp_path, order):
    first, second = ([(w, factor * s, v) for w, s, v in FREQUENCY_ROWS] for factor in (1.0, 1.1))
    rows = {
        "one after the other": first + second,
        "row by row": [row for pair in zip(first, second, strict=True) for row in pair],
        "up and down": first + second[::-1],
    }[order]
    found = read_sweeps(put(tmp_path / "a.csv", "omega,Gp,Gpp\n" + "".join("{},{},{}\n".format(*row) for row in rows)))
    assert [one.name for one in found] == ["a[1]", "a[2]"]
    assert found[1].storage == pytest.approx(1.1 * found[0].storage)
    assert any("read as 2 sweeps" in note for note in found[0].notes)


def test_a_setting_measured_twice_is_averaged_and_counted(tmp_path):
    (found,) = read_sweeps(put(tmp_path / "a.csv", LAYOUTS["comma.csv"] + f"{OMEGA[3]:.6g},3000,7\n"))
    assert found.storage[3] == pytest.approx((1e3 + OMEGA[3] + 3000) / 2)
    assert any("1 row" in note and "averaged" in note for note in found.notes)


TABLE = "{}\n" + "".join(f"{g:.5g},{softening(g):.6g},50\n" for g in STRAIN)
BAD = {  # content, code, what is named
    "empty": ("", "rheometer.empty", ""),
    "words": ("hello\nworld\n", "rheometer.no_moduli", "G' and G''"),
    "no loss": ("omega,G'\n1,2\n2,3\n3,4\n", "rheometer.no_moduli", "G'' among 'omega', \"G'\""),
    "no setting": ("time (s),G',G''\n1,2,3\n2,3,4\n3,4,5\n", "rheometer.no_sweep", "'time (s)'"),
    "strain without unit": (TABLE.format("strain,G',G''"), "rheometer.no_unit", "'strain'"),
    "frequency without unit": (TABLE.format("Frequency,G',G''"), "rheometer.no_unit", "'Frequency'"),
    "frequency per second": (TABLE.format("Frequency (1/s),G',G''"), "rheometer.no_unit", "'Frequency (1/s)"),
    "unknown unit": (TABLE.format("strain (%),G' (psi),G''"), "rheometer.unknown_unit", "'psi'"),
    "two columns": (TABLE.format("strain (%),G' (Pa),G'' (Pa),G' (Pa)"), "rheometer.two_columns", "G'"),
    "no sweep": ("omega,G',G''\n" + "10,1000,50\n" * 9, "rheometer.no_sweep", "9 rows"),
    "few rows": ("omega,G',G''\n1,2,3\n5,,4\n9,4,5\n", "rheometer.no_sweep", "2 usable rows"),
    "decimal comma": ("omega,G',G''\n0,1,10,5\n0,2,11,6\n", "tabular.width", "row 2"),
    "no number": ("omega,G',G''\n1,2,3\n2,3,x4\n3,4,5\n", "tabular.number", "row 3, column \"G''\": 'x4'"),
    "comma or point": ("omega;G';G''\n0.5;1,234;5\n1.5;2,000;5\n", "tabular.comma", "'1,234'"),
    "two sweeps": (
        "omega (rad/s),strain (%),G',G''\n"
        + "".join(f"10,{g},1000,50\n" for g in (0.1, 1, 10, 100))
        + "".join(f"{w},1,1000,50\n" for w in (0.1, 1, 10, 100)),
        "rheometer.two_sweeps",
        "10 rad/s",
    ),
    "old Excel": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), "tabular.workbook", ""),
    "broken Excel": (b"PK\x03\x04" + bytes(600), "tabular.workbook", ""),
}


@pytest.mark.parametrize("name", BAD)
def test_files_that_cannot_be_used(tmp_path, name):
    content, code, named = BAD[name]
    with pytest.raises(InputError) as caught:
        read_sweeps(put(tmp_path / "file.csv", content))
    assert caught.value.code == code
    assert str(caught.value).startswith(f"{tmp_path / 'file.csv'}: ")
    assert named in str(caught.value)


def test_an_unreadable_file_is_one_line_and_status_2(run, tmp_path):
    put(tmp_path / "file.csv", "")
    status, out, err = run("rheometer", "file.csv")
    assert (status, out) == (2, "")
    (line,) = err.splitlines()
    assert line.startswith("error: file.csv: ")


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["nowhere.csv"], "nowhere.csv"),
        (["a.csv", "--at", "-1"], "--at"),
        (["a.csv", "--tolerance", "0"], "--tolerance"),
        (["a.csv", "--beside", "a.csv"], "a.csv"),
        (["a.csv", "-o", "a.csv"], "a.csv"),
    ],
)
def test_bad_usage(run, tmp_path, words, named):
    put(tmp_path / "a.csv", LAYOUTS["comma.csv"])
    status, _, err = run("rheometer", *words)
    assert status == 2
    assert named in err
    assert "Traceback" not in err


def test_outside_the_data_is_status_1_and_the_rest_is_answered(plain, run, tmp_path):
    put(tmp_path / "a.csv", LAYOUTS["comma.csv"])
    status, out, _ = run("rheometer", "a.csv", "--at", 1000, "-o", "r")
    assert status == 1
    assert "1000 rad/s lies outside the data, 0.1 to 100 rad/s" in out
    document = json.loads((tmp_path / "r" / "rheometer.json").read_text())
    assert document["viscosity_Pa_s"]["mean"] is None
    assert document["shear_modulus_Pa"]["mean"] == pytest.approx(1e3, rel=0.01)


def test_a_good_file_is_answered_beside_a_bad_one(plain, run, tmp_path):
    put(tmp_path / "bad.csv", "")
    put(tmp_path / "good.csv", LAYOUTS["comma.csv"])
    status, out, err = run("rheometer", "bad.csv", "good.csv")
    assert status == 2
    assert "bad.csv" in err
    assert "µ = 5.00 Pa s" in out


@pytest.mark.needs("matplotlib")
def test_examples_give_back_the_truth(run, tmp_path, examples):
    """The main job: both sweeps of one gel, documents, pictures."""
    files = [EXAMPLES / f"soft_gel_{kind}_sweep.csv" for kind in ("strain", "frequency")]
    status, out, err = run("rheometer", *files, "-o", "r")
    assert status == 0, err
    assert "soft_gel: G = 1.50 kPa" in out
    found = json.loads((tmp_path / "r" / "rheometer.json").read_text())
    storage, loss = (float(modulus) for modulus in examples.moduli(1.0))
    assert found["schema"] == 1
    assert found["material"] == "soft_gel"
    assert found["shear_modulus_Pa"]["mean"] == pytest.approx(storage, rel=0.01)
    assert found["shear_modulus_Pa"]["std"] is None
    assert found["viscosity_Pa_s"]["mean"] == pytest.approx(loss, rel=0.01)
    strain, _ = found["sweeps"]
    assert strain["plateau_storage_Pa"] == pytest.approx(float(examples.moduli(2 * np.pi)[0]), rel=0.01)
    assert strain["plateau_to"] == pytest.approx(examples.HALF_STRAIN * np.sqrt(1 / 0.95 - 1), rel=0.1)
    storage, loss = (float(modulus) for modulus in examples.moduli(2 * np.pi))
    assert strain["crossover"] == pytest.approx(examples.HALF_STRAIN * np.sqrt((storage / loss - 1) / 4), rel=0.02)
    names = {"rheometer.json", "rheometer.csv", "strain-sweep.png", "frequency-sweep.png", ".cavirheo"}
    assert {path.name for path in (tmp_path / "r").iterdir()} == names
    rows = (tmp_path / "r" / "rheometer.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["kind", "strain", "frequency"]
    assert len(set(rows[0].split(","))) == len(rows[0].split(","))


def test_the_shipped_sweeps_are_what_the_function_makes(examples, tmp_path):
    examples.write_sweeps(tmp_path)
    for path in tmp_path.iterdir():
        assert path.read_text() == (EXAMPLES / path.name).read_text()


def test_no_linear_range_is_status_1(plain, run, tmp_path):
    put(tmp_path / "a.csv", "strain (%),G',G''\n" + "".join(f"{g},{1 / g},0.1\n" for g in STRAIN))
    status, out, _ = run("rheometer", "a.csv")
    assert status == 1
    assert "no linear range" in out


def test_repeats_give_mean_and_deviation(plain, run, tmp_path):
    for k, factor in enumerate((0.9, 1.0, 1.1), 1):
        text = "omega,Gp,Gpp\n" + "".join(f"{w},{factor * 1e3},{factor * 5 * w}\n" for w in OMEGA)
        put(tmp_path / f"gel_{k}.csv", text)
    status, out, _ = run("rheometer", "gel_1.csv", "gel_2.csv", "gel_3.csv", "-o", "r")
    assert status == 0
    assert "gel: G = 1.00 ± 0.10 kPa" in out
    assert "5.00 ± 0.50" in out
    document = json.loads((tmp_path / "r" / "rheometer.json").read_text())
    assert document["shear_modulus_Pa"]["std"] == pytest.approx(100)


def test_names_in_brackets_are_printed_as_they_are(plain, run, tmp_path):
    put(tmp_path / "gel[red].csv", LAYOUTS["quotes.csv"])
    out = run("rheometer", "gel[red].csv", "--name", "gel [bold] :x:")[1]
    assert "gel[red]" in out
    assert "gel [bold] :x:: G =" in out


def test_the_strain_plateau_stands_in_for_a_solid_only(plain, run, tmp_path):
    for name, loss in (("solid", 50), ("liquid", 5000)):
        rows = "".join(f"{g},{softening(g)},{loss},10\n" for g in STRAIN)
        put(tmp_path / f"{name}.csv", f"strain [1],G',G'',omega\n{rows}")
    assert "G = 2.00 kPa (plateau of the strain sweep at 10.0 rad/s)" in run("rheometer", "solid.csv")[1]
    assert "G = – (no plateau)" in run("rheometer", "liquid.csv", "--replace")[1]


def test_a_frequency_sweep_beyond_the_linear_range_is_told(plain, run, tmp_path):
    put(tmp_path / "a.csv", TABLE.format("strain [1],G',G''"))
    rows = "".join(f"{w},1000,{w},0.5\n" for w in OMEGA)
    put(tmp_path / "b.csv", "omega,G',G'',strain [1]\n" + rows)
    _, out, _ = run("rheometer", "a.csv", "b.csv")
    assert "b was run at a strain of 50 %, beyond the linear range (to 23 %)" in " ".join(out.split())


def bubbles(path: Path) -> Path:
    """A result of `infer`: two shots of one group, one more that failed."""
    quantity = {"median": None, "q05": None, "q95": None}
    shared = {
        "source": "gel.mat", "group": "gel", "group_source": "gel.mat", "max_radius_m": 2e-4, "time_of_max_s": 0.0,
        "material": "nhkv", "method": "bdt", "rmse_over_rmax": 0.01, "mae_over_rmax": 0.01,
        "max_difference_over_rmax": 0.02, "window": {"collapses": 3, "t_star_end": 3.0}, "notes": [], "seconds": 0.1,
        "provenance": {},
    }  # fmt: skip
    shots = [("1", "ok", 6e4, 7.0), ("2", "ok", 8e4, 9.0), ("3", "failed", None, None)]
    curves = [
        shared | {
            "name": name, "verdict": verdict, "strain_rate_per_s": rate, "stretch": quantity | {"median": stretch},
            "shear_modulus_Pa": quantity, "viscosity_Pa_s": quantity,
        }
        for name, verdict, rate, stretch in shots
    ]  # fmt: skip
    group = {
        "name": "gel", "n": 2, "n_failed": 1, "verdicts": {"ok": 2, "failed": 1},
        "shear_modulus_Pa": {"mean": 6e3, "std": 500.0, "median": 6e3},
        "viscosity_Pa_s": {"mean": 0.03, "std": 0.004, "median": 0.03},
    }  # fmt: skip
    document = {"schema": 1, "version": "0", "command": "cavirheo infer", "curves": curves, "groups": [group]}
    write_json(path, Result.model_validate(document))
    return path


def test_beside_bubbles(run, tmp_path):
    before = bubbles(tmp_path / "result.json").read_bytes()
    files = [EXAMPLES / f"soft_gel_{kind}_sweep.csv" for kind in ("strain", "frequency")]
    status, out, err = run("rheometer", *files, "--beside", "result.json", "-o", ".", "--name", "soft gel")
    assert status == 0, err
    text = " ".join(out.split())
    assert "6.00 ± 0.50" in text
    assert "The regimes differ: the rheometer measures at 0.063 to 100 rad/s, strain ≤ 1.0 %" in text
    assert "the bubble at 6.0e4 to 8.0e4 1/s and λ = 7.0 to 9.0" in text
    assert (tmp_path / "result.json").read_bytes() == before
    with (tmp_path / "table.csv").open(newline="", encoding="utf-8") as file:
        modulus, viscosity, other = csv.DictReader(file)
    assert [row["quantity"] for row in (modulus, viscosity, other)] == [
        "shear_modulus_Pa", "viscosity_Pa_s", "viscosity_at_1_rad_per_s"
    ]  # fmt: skip
    method = "rheometer, 0.063 to 100 rad/s, strain ≤ 1.0 %"
    assert float(modulus[f"{method}_mean"]) == pytest.approx(1500, rel=0.01)
    assert float(modulus["cavirheo_trusted_std"]) == 500
    assert (modulus["n_answered"], modulus["n_failed"]) == ("2", "1")
    assert viscosity[f"{method}_mean"] == other["cavirheo_trusted_mean"] == ""  # another frequency is another quantity


def test_the_regime_of_bubbles_is_that_of_the_trusted_shots(tmp_path):
    result = read_json(bubbles(tmp_path / "result.json"))
    result.curves[1].verdict = "model_does_not_fit"
    assert "the bubble at 6.0e4 1/s and λ = 7.0" in regimes(rheometry([], "gel", command="cavirheo rheometer"), result)


def test_without_matplotlib_it_says_so(run, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "available", lambda: False)
    put(tmp_path / "a.csv", LAYOUTS["comma.csv"])
    status, out, _ = run("rheometer", "a.csv", "-o", "r")
    assert status == 0
    assert "cavirheo[plot]" in out
    assert {path.name for path in (tmp_path / "r").iterdir()} == {"rheometer.json", "rheometer.csv", ".cavirheo"}
