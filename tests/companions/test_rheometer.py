"""Rheometer sweeps: exact answers of known models, what instruments export, and what is refused."""

import json
import runpy

import numpy as np
import pytest
from conftest import ROOT, done, refused
from files import lines, put, write_xlsx

from cavirheo.companions.rheometer import Sweep, frequency_sweep, read_sweeps, strain_sweep

EXAMPLES = ROOT / "examples"
SWEEPS = [EXAMPLES / f"soft_gel_{kind}_sweep.csv" for kind in ("strain", "frequency")]
OMEGA = np.logspace(-1, 2, 16)
STRAIN = np.logspace(-4, 1, 51)


def of_strain(strain, storage, loss) -> Sweep:
    return strain_sweep(*np.broadcast_arrays(np.asarray(strain), storage, loss))


def of_frequency(omega, storage, loss, at: float = 1.0) -> Sweep:
    return frequency_sweep(*np.broadcast_arrays(np.asarray(omega), storage, loss), at)


def maxwell(omega, G=1e3, tau=1.0):
    return G * (omega * tau) ** 2 / (1 + (omega * tau) ** 2), G * omega * tau / (1 + (omega * tau) ** 2)


def softening(gamma, G=2e3, at=1.0):
    return G / (1 + (gamma / at) ** 2)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_frequency_sweep_of_kelvin_voigt(noise):
    wrong, close = 1 + noise * np.random.default_rng(1).standard_normal((2, OMEGA.size)), noise or 1e-12
    found = of_frequency(OMEGA, 5e3 * wrong[0], 0.3 * OMEGA * wrong[1])
    assert found.viscosity_Pa_s == pytest.approx(0.3, rel=3 * close)
    assert found.plateau_storage_Pa == pytest.approx(5e3, rel=close)
    assert found.plateau_to / found.plateau_from > 100
    assert found.message == ""


def test_frequency_sweep_of_maxwell():
    omega = np.logspace(-1, 3, 41)
    storage, _ = maxwell(omega)
    found = of_frequency(omega, *maxwell(omega), at=3.3)
    assert found.viscosity_Pa_s == pytest.approx(maxwell(3.3)[1] / 3.3, rel=5e-3)
    assert found.plateau_storage_Pa == pytest.approx(1e3, rel=1e-3)
    assert found.plateau_from == omega[storage > 0.88e3][0]
    liquid = of_frequency(OMEGA, *maxwell(OMEGA, 1e4, 1e-3))
    assert (liquid.plateau_storage_Pa, liquid.viscosity_Pa_s) == (None, pytest.approx(10.0, rel=1e-4))


@pytest.mark.parametrize(
    ("omega", "answered"),
    [([2.0, 5, 20], False), ([0.01, 0.1, 0.5], False), ([0.05, 0.08, 20], False), ([1.0003, 2, 5], True)],
)
def test_nothing_is_extrapolated(omega, answered):
    """But an end of the data that the export has rounded is inside."""
    found = of_frequency(omega, 1e3, 10.0, 1.0)
    assert bool(found.message) == (not answered)
    assert found.viscosity_Pa_s == (pytest.approx(10.0) if answered else None)


SCATTER = np.append([1.8, 0.5, 1.4, 0.7, 1.25, 0.88], np.ones(STRAIN.size - 6))  # at low torque
SOFT, FIVE = softening(STRAIN), np.sqrt(1 / 0.95 - 1)
STRAIN_SWEEPS = {  # G', and where the linear range ends: the last strain before it is found
    "softening": (SOFT, FIVE),
    "scatter": (SOFT * SCATTER, FIVE),
    "stiffening": (500 * (1 + (STRAIN / 0.3) ** 2), 0.3 * np.sqrt(0.05)),
    "has none": (1e3 * STRAIN**-0.3, None),
}


@pytest.mark.parametrize("name", STRAIN_SWEEPS)
def test_strain_sweeps(name):
    storage, end = STRAIN_SWEEPS[name]
    found = of_strain(STRAIN, storage, 50.0)
    assert found.plateau_to == (end and max(x for x in STRAIN if x < end))
    assert bool(found.message) == (end is None)
    if end == FIVE:
        assert found.plateau_storage_Pa == pytest.approx(2e3, rel=0.01)
        assert name != "scatter" or found.plateau_from == STRAIN[6]


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


def table(head, separator=",", units=(1.0, 1.0, 1.0), rows=FREQUENCY_ROWS):
    """The text of a table of rows in these units; NaN where there is none."""
    return f"{head}\n" + lines(separator, *np.divide(rows, units).T)


LAYOUTS = {
    "comma.csv": table("omega,G',G''"),
    "savetxt.txt": table("# omega Gp Gpp", " "),
    "german.csv": table("Kreisfrequenz [rad/s];Speichermodul [Pa];Verlustmodul [Pa]", ";").replace(".", ","),
    "french.csv": table("Fréquence [Hz];Module de Stockage [Pa];G'' [mPa]", ";", (2 * np.pi, 1, 1e-3)),
    "signs.csv": table("ω [1/s],G′ [kPa],Loss modulus (dyn/cm2)", units=(1, 1e3, 0.1)),
    "words.csv": table(
        'Strain rate (1/s),Viscosity (Pa s),Ang. Frequency [rad·s⁻¹],storage_modulus_MPa,G" (Pa),strain_percent',
        units=(1, 1, 1, 1e6, 1, 1), rows=[(7, 8, *row, 1) for row in FREQUENCY_ROWS],
    ),
    "rheocompass.csv": RHEOCOMPASS.encode("utf-16"),
    "trios.txt": TRIOS,
    "rspace.csv": RSPACE,
}  # fmt: skip


@pytest.mark.parametrize("name", LAYOUTS)
def test_layouts(tmp_path, name):
    (found,) = read_sweeps(put(tmp_path / name, LAYOUTS[name]))
    assert found.kind == "frequency"
    storage = 1e3 + np.sqrt(OMEGA[7] * OMEGA[8])
    assert (found.plateau_storage_Pa, found.viscosity_Pa_s) == pytest.approx((storage, 5.0), rel=1e-2)
    assert any("2 pi" in note for note in found.notes) == (name in ("french.csv", "rspace.csv"))
    assert any("no unit" in note for note in found.notes) == (name in ("comma.csv", "savetxt.txt"))
    assert any("2 rows left out" in note for note in found.notes) == (name == "rspace.csv")


def test_every_sheet_of_a_workbook(tmp_path):
    frequency = [["Angular frequency", "Storage modulus", "Loss modulus"], ["rad/s", "Pa", "Pa"], *FREQUENCY_ROWS]
    strain = [["Strain (%)", "G' (Pa)", "G'' (Pa)"], *([100 * g, softening(g), 50] for g in STRAIN)]
    sheets = {"about": [["Sample", "gel"]], "frequency": frequency, "strain": strain}
    found = read_sweeps(write_xlsx(tmp_path / "gel.xlsx", sheets))
    assert [(one.name, one.kind) for one in found] == [("gel[1]", "frequency"), ("gel[2]", "strain")]
    assert found[1].plateau_from == pytest.approx(STRAIN[0])


@pytest.mark.parametrize("first", ["strain", "frequency"])
def test_a_table_of_two_sweeps_is_split(tmp_path, first):
    """The frequency stays in a strain sweep; where both change it is a sweep at constant stress, or is refused."""
    sweeps = {
        "strain": [(10.0, 100 * g, softening(g), 50.0) for g in STRAIN],
        "frequency": [(w, 1.0 + k % 2 / 100, 1e3 + w, 5 * w) for k, w in enumerate(OMEGA)],
    }
    rows = [row for kind in sorted(sweeps, reverse=first == "strain") for row in sweeps[kind]]
    head = "omega (rad/s),strain (%),G' (Pa),G'' (Pa)"
    found = read_sweeps(put(tmp_path / "gel.csv", table(head, units=(1.0,) * 4, rows=rows)))
    assert [one.kind for one in found] == ["strain", "frequency"]
    assert found[0].plateau_storage_Pa == pytest.approx(2e3, rel=0.01)
    assert found[1].viscosity_Pa_s == pytest.approx(5.0)
    assert "16 of the 67 rows of the table are of this sweep" in found[1].notes
    stress = [(w, 1e5 / (1e3 + w), 1e3 + w, 5 * w) for w in 10 * OMEGA]
    text = table(head, units=(1.0,) * 4, rows=stress)
    assert [one.kind for one in read_sweeps(put(tmp_path / "stress.csv", text))] == ["frequency"]
    twice = [(w, strain, 1e3 + w, 5 * w) for strain in (1.0, 10.0) for w in OMEGA]
    with refused("rheometer.mixed", "'omega (rad/s)' and 'strain (%)'", "header of its own"):
        read_sweeps(put(tmp_path / "twice.csv", table(head, units=(1.0,) * 4, rows=twice)))


def test_unusable_rows_are_dropped_and_counted(tmp_path):
    rows = "0.2,,1\n0.3,nan,2\n\n0.4,-5,2\n0.5,5,0\n0.6,---,3\n"
    (found,) = read_sweeps(put(tmp_path / "a.csv", LAYOUTS["comma.csv"] + rows))
    assert any(note.startswith("5 rows left out") for note in found.notes)


BAD = {  # content, code, what is named; what is no table at all, test_reading.py refuses by the same reader
    "empty": ("", "empty", ""),
    "no setting": ("time (s),G',G''\n1,2,3\n2,3,4\n3,4,5\n", "no_sweep", "'time (s)'"),
    "strain without unit": (table("strain,G',G''"), "no_unit", "'strain'"),
    "frequency per second": (table("Frequency (1/s),G',G''"), "no_unit", "'Frequency (1/s)"),
    "unknown unit": (table("strain (%),G' (psi),G''"), "unknown_unit", "'psi'"),
    "no sweep": ("omega,G',G''\n" + "10,1000,50\n" * 9, "no_sweep", "9 rows"),
}


@pytest.mark.parametrize("name", BAD)
def test_files_that_cannot_be_used(tmp_path, name):
    content, code, named = BAD[name]
    path = put(tmp_path / "file.csv", content)
    with refused(f"rheometer.{code}", f"{path}: ", named):
        read_sweeps(path)


def test_examples_give_back_the_truth(run, tmp_path):
    made = runpy.run_path(str(EXAMPLES / "make_examples.py"))
    assert "5 % in a strain sweep, 12 % in a frequency sweep" in done(run("rheometer", *SWEEPS, "-o", "r"))
    found = json.loads((tmp_path / "r" / "rheometer.json").read_text())
    assert (found["schema"], found["material"], found["shear_modulus_Pa"]["std"]) == (1, "soft_gel", None)
    means = (found["shear_modulus_Pa"]["mean"], found["viscosity_Pa_s"]["mean"])
    assert means == pytest.approx(np.ravel(made["moduli"](1.0)), rel=0.01)
    strain, _ = found["sweeps"]
    (storage, _), half = made["moduli"](2 * np.pi), made["HALF_STRAIN"]
    assert strain["plateau_storage_Pa"] == pytest.approx(storage, rel=0.01)
    assert strain["plateau_to"] == pytest.approx(half * np.sqrt(1 / 0.95 - 1), rel=0.3)
    assert {path.name for path in (tmp_path / "r").iterdir()} == {"rheometer.json", ".cavirheo"}
    made["write_sweeps"](tmp_path)  # the shipped sweeps are what this makes
    assert all((tmp_path / path.name).read_text() == path.read_text() for path in SWEEPS)


@pytest.mark.parametrize(
    ("words", "status", "viscosity"), [([], 0, 5.0), (["--at", 1e3], 1, None), (["bad.csv"], 2, 5.0)]
)
def test_repeats_give_mean_and_deviation_and_outside_is_status_1(run, tmp_path, words, status, viscosity):
    for k, factor in enumerate((0.9, 1.0, 1.1), 1):
        rows = [(w, factor * 1e3, factor * 5 * w) for w in OMEGA]
        put(tmp_path / f"gel_{k}.csv", table("omega,Gp,Gpp", rows=rows))
    put(tmp_path / "bad.csv", "")
    assert run("rheometer", "gel_1.csv", "gel_2.csv", "gel_3.csv", *words, "-o", "r")[0] == status
    document = json.loads((tmp_path / "r" / "rheometer.json").read_text())
    for name, mean in (("shear_modulus_Pa", 1e3), ("viscosity_Pa_s", viscosity)):
        spread = document[name]["mean"], document[name]["std"]
        assert spread == (pytest.approx((mean, 0.1 * mean), rel=1e-5) if mean else (None, None))


@pytest.mark.parametrize(("loss", "modulus"), [(50.0, 2e3), (5000.0, None)])
def test_the_strain_plateau_stands_in_for_a_solid_only(run, tmp_path, loss, modulus):
    rows = [(g, softening(g), loss, 10.0) for g in STRAIN]
    put(tmp_path / "gel.csv", table("strain [1],G',G'',omega", units=(1.0,) * 4, rows=rows))
    assert run("rheometer", "gel.csv", "--at", 5, "-o", "at")[0] == 1  # there is no frequency sweep
    assert ("gel: no plateau\n" in done(run("rheometer", "gel.csv", "-o", "r"))) == (modulus is None)
    document = json.loads((tmp_path / "r" / "rheometer.json").read_text())
    assert document["shear_modulus_Pa"]["mean"] == (modulus and pytest.approx(modulus, rel=0.01))
