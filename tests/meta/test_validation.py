"""The open challenge: recordings of known truth are made and scored, and both mean what they say."""

import numpy as np
import pytest
from conftest import ROOT

from cavirheo import Bubble, Medium, NeoHookeanKelvinVoigt, Newtonian, read_curves, simulate
from cavirheo.physics.laws import Fung, PowerLaw
from cavirheo.physics.materials import Viscoelastic
from validation import numbers, pages
from validation.__main__ import CLAIMS
from validation.challenge import answers, make, score, truth


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("challenge")
    make.make(folder, seed=7, n=2, workers=2)
    return folder


def test_recordings_are_read_and_are_of_their_truth(made):
    rows = score.read(made / "truth.csv")
    for recording, row in zip(answers.read(made / "recordings"), rows, strict=True):
        (curve,) = read_curves(recording.path)
        assert recording.name == row["name"]
        assert [curve.max_radius, recording.max_radius] == pytest.approx([float(row["R_max"])] * 2, rel=0.1)
        assert recording.density == pytest.approx(float(row["density"]), rel=0.01)
        assert recording.time[-1] - float(row["origin_us"]) * 1e-6 > 1.5 * curve.max_radius / 10.0


REAL, FUNG = {"accommodation": 0.05, "damping": 0.2}, Viscoelastic(Fung(5e3, 0.01), Newtonian(0.05))
LAWS = {  # a truth, and the material of it
    "power-law": ({"G": 0.0, "mu": 0.05, "exponent": 0.6}, PowerLaw(0.05 * 1e5**0.4, 0.6, rest_rate=truth.PLATEAU)),
    "fung + newtonian": ({"G": 5e3, "mu": 0.05, "stiffening": 0.01} | REAL, FUNG),
    "nhkv": ({"G": 8e3, "mu": 0.05} | REAL, NeoHookeanKelvinVoigt(8e3, 0.05)),
}


@pytest.mark.parametrize("law", LAWS)
def test_two_solvers_agree_on_a_truth(law):
    """The challenge's, which shares nothing with the package, and the package's."""
    values, material = LAWS[law]
    half = "real" if "damping" in values else "field"
    one = truth.Truth(half, law, **values, stretch=6.0, R_max=200e-6, density=1010.0)
    medium, at = Medium(density=1010.0), np.linspace(0.0, 1.6, 60)
    bubble = Bubble("kinetic", 0.05, confinement_damping=0.2) if half == "real" else Bubble()
    run = simulate(material, max_radius=200e-6, stretch=6.0, time=at * one.t_c, medium=medium, bubble=bubble)
    assert np.max(np.abs(truth.solve(one, 1.7)(at) - run.radius / 200e-6)) < 5e-3


WHOLE = {"G": "2000", "G_low": "100", "G_high": "10000", "mu": "0.1", "mu_low": "0.2", "mu_high": "0.4"}
SCORES = [
    ("1000", WHOLE, [True, False], [True, True]),
    ("1000", {"G_high": "2000", "mu_low": "0.2"}, [True, False], [False, False]),  # bounds are no intervals
    ("0.0", {"G": "5", "mu": ""}, [False], [False]),  # a liquid has no modulus
]


@pytest.mark.parametrize(("G", "row", "held", "bounded"), SCORES)
def test_scores(G, row, held, bounded):
    about = [{"name": "a", "half": "real", "G": G, "mu": "0.1"}]
    answer = [{"name": "a", "seconds": "1", **row}]
    scores = [one for name in ("G", "mu") for one in score.judge(about, answer, name)]
    assert [one.held for one in scores] == held
    assert [one.bounded for one in scores] == bounded
    if row is WHOLE:
        assert scores[0].interval_score == pytest.approx(scores[0].width) == pytest.approx(2.0)
        assert scores[1].interval_score == pytest.approx(np.log10(2) + 20 * np.log10(2))


WRONG = [("a,1,2,1,,,", "above G_high 1"), ("a,-1,,,,,", "not negative"), ("a,,,", "4 cells")]
WRONG += [("b,,,,,,", "unknown name 'b'"), ("a,,,,,,\na,,,,,,", "2 of 'a'")]


@pytest.mark.parametrize(("lines", "said"), WRONG)
def test_a_wrong_file_of_answers_is_refused_in_one_line(tmp_path, lines, said):
    truths, mine = tmp_path / "truth.csv", tmp_path / "mine.csv"
    truths.write_text("name,half,difficulty,law,G,mu\na,real,easy,nhkv,1000,0.1\n")
    mine.write_text(f"name, G, G_low, G_high, mu, mu_low, mu_high\n{lines}\n")
    with pytest.raises(SystemExit, match=rf"\Ascore.py: .*{said}.*\Z"):
        score.main([str(truths), str(mine)])


RESULTS = pages.read_results()


@pytest.mark.parametrize("page", [str(path.relative_to(ROOT)) for path in pages.marked_pages()])
def test_a_page_has_the_numbers_of_the_results(page):
    text = (ROOT / page).read_text("utf-8")
    assert text == pages.filled(text, RESULTS), "run python -m validation --fill"


@pytest.mark.repository
def test_every_claim_has_its_command_on_the_page_and_headline_numbers_are_marked():
    text = (ROOT / "docs/validation.md").read_text("utf-8")
    assert {*RESULTS} == {*CLAIMS}
    assert [claim for claim in CLAIMS if f"`python -m validation {claim}" not in text] == []
    for page in ("README.md", "docs/how-far.md", "docs/validation.md"):
        assert pages.MARKED.search((ROOT / page).read_text("utf-8"))
        assert not pages.AT_BEGINNING.search((ROOT / page).read_text("utf-8"))


def test_shares_and_their_standard_errors():
    number = numbers.coverage("held", [True] * 45 + [False] * 5, 0.9)
    assert (number.value, number.n, number.standard_error) == (0.9, 50, pytest.approx(0.0424, abs=1e-4))
    assert 0.0 < numbers.share("all", [True] * 5).standard_error < 0.15
    assert numbers.share("none", []).n == 0
    assert np.isnan(numbers.statistic("one", [2.0], "s").standard_error)
