"""Groups of five simulated shots of one gel (6 kPa, 0.050 Pa s), changed as the name of the file says: none of what is
wrong comes out as a value."""

import pytest
from conftest import ROOT

from cavirheo import infer, load, read_curves

CASES = ROOT / "tests" / "cases" / "truth"
DOUBTED = {  # verdicts that are right, and a code that the messages of group or shots have
    "scale0.9": ({"check_input"}, "check_input.walls"),
    "mixed": ({"check_input"}, "group.doubt.heaps"),
    "double_big": ({"does_not_fit", "check_input"}, "misfit.rms"),
    "ellipse": ({"does_not_fit", "check_input"}, "misfit.systematic"),
}


def group_of(name: str, run):
    """The group's record, and those of its shots."""
    path = next(path for path in (CASES / name, CASES / f"{name}.csv") if path.exists())
    run("infer", path, "--no-pictures", "--quiet", "-o", "r")
    made = load("r")
    (group,) = made.groups
    return group, made.curves


def test_smoothed_radii_are_an_input_warning():
    answer = infer(read_curves(CASES / "savgol7.csv")[0])
    assert answer.checks.verdict == "check_input"
    assert "check_input.smoothed" in [message.code for message in answer.checks.messages]


@pytest.mark.slow
@pytest.mark.parametrize("name", DOUBTED)
def test_what_is_wrong_is_doubted(name, run):
    group, shots = group_of(name, run)
    verdicts, code = DOUBTED[name]
    assert group.verdict in verdicts
    assert code in [message.code for record in (group, *shots) for message in record.messages]


@pytest.mark.slow
def test_a_clean_group_holds_the_truth_and_says_what_it_rests_on(run):
    group, _ = group_of("base", run)
    assert group.verdict == "ok"
    modulus, viscosity = group.value("shear_modulus"), group.value("viscosity")
    assert modulus.q05 < 6e3 < modulus.q95
    assert viscosity.q05 < 0.050 < viscosity.q95
    alone = group.systematic.statistics["shear_modulus"]
    assert modulus.q95 / modulus.q05 > 1.3 * alone.q95 / alone.q05  # the error of the scale counts more than the shots
    assert "group.not_given" in [message.code for message in group.messages]
