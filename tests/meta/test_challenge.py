"""The open challenge: recordings of known truth are made and scored, and both mean what they say."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from cavirheo import Bubble, Medium, NeoHookeanKelvinVoigt, read_curves, simulate
from cavirheo.physics.elastic import Fung
from cavirheo.physics.materials import Viscoelastic
from cavirheo.physics.viscous import Newtonian, PowerLaw
from validation.challenge import answers, camera, make, score, truth


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder of two recordings."""
    folder = tmp_path_factory.mktemp("challenge")
    make.make(folder, seed=7, n=2, workers=2)
    return folder


def test_recordings_are_read_and_are_of_their_truth(made):
    rows = score.read(made / "truth.csv")
    for recording, row in zip(answers.read(made / "recordings"), rows, strict=True):
        (curve,) = read_curves(recording.path)
        assert recording.name == row["name"]
        assert curve.max_radius == pytest.approx(float(row["R_max"]), rel=0.1)
        assert recording.max_radius == pytest.approx(float(row["R_max"]), rel=0.1)
        assert recording.density == pytest.approx(float(row["density"]), rel=0.01)
        assert recording.time[-1] - float(row["origin_us"]) * 1e-6 > 1.5 * curve.max_radius / 10.0


def test_a_recording_depends_on_its_seed_and_number_alone(made, tmp_path):
    make.make(tmp_path, seed=7, n=1, workers=1)
    for name in ("recordings/shot001.csv", "truth.csv"):
        first, again = ((folder / name).read_text().splitlines() for folder in (made, tmp_path))
        assert again == first[: len(again)]
    assert make.cells(7, 60) != make.cells(8, 60)


def test_sixty_recordings_have_each_bubble_law_and_difficulty_equally_often():
    design = make.cells(3, 60)
    for half in truth.HALVES:
        for difficulty in camera.LEVELS:
            laws = [law for a, law, b in design if (a, b) == (half, difficulty)]
            assert sorted(laws) == sorted(2 * truth.LAWS)


LAWS = {  # a truth, and the material of it
    "power-law": (
        {"G": 0.0, "mu": 0.05, "exponent": 0.6},
        PowerLaw(0.05 * 1e5**0.4, 0.6, rest_rate=truth.PLATEAU),
    ),
    "fung + newtonian": (
        {"G": 5e3, "mu": 0.05, "stiffening": 0.01, "accommodation": 0.05, "damping": 0.2},
        Viscoelastic(Fung(5e3, 0.01), Newtonian(0.05)),
    ),
    "nhkv": ({"G": 8e3, "mu": 0.05, "accommodation": 0.05, "damping": 0.2}, NeoHookeanKelvinVoigt(8e3, 0.05)),
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


def test_a_parabola_reads_the_maximum():
    time = np.arange(9) * 1e-6
    radius = 2e-4 * (1 - 0.02 * (1e6 * time - 3.3) ** 2)
    assert camera.read_maximum(time, radius) == pytest.approx((3.3e-6, 2e-4), rel=1e-6)


def test_camera_shows_scale_and_clock(monkeypatch):
    """With hardly any noise a recording is its curve, up to its scale and from its origin."""
    quiet = camera.Level(**{**vars(camera.LEVELS["easy"]), "noise": (1e-9, 2e-9), "exposure": (0.0, 1e-9)})
    monkeypatch.setattr(camera, "LEVELS", {**camera.LEVELS, "easy": quiet})
    seen = camera.film(np.random.default_rng(1), "easy", lambda t: 1 - 0.1 * t, 2e-4, 2e-5)
    after = seen.time >= seen.origin
    expected = 2e-4 * (1 - 0.1 * (seen.time - seen.origin) / 2e-5) / seen.scale
    assert seen.radius[after] == pytest.approx(expected[after], rel=1e-6)


def judged(row: dict[str, str], G: str = "1000"):
    """Scores of G and mu of one answer."""
    about = [{"name": "a", "half": "real", "G": G, "mu": "0.1"}]
    return [score.judge(about, [{"name": "a", "seconds": "1", **row}], name) for name in ("G", "mu")]


def test_scores_of_an_interval():
    row = {"G": "2000", "G_low": "100", "G_high": "10000", "mu": "0.1", "mu_low": "0.2", "mu_high": "0.4"}
    (G,), (mu,) = judged(row)
    assert (G.held, mu.held) == (True, False)
    assert G.error == pytest.approx(np.log10(2))
    assert G.interval_score == pytest.approx(G.width) == pytest.approx(2.0)
    assert mu.interval_score == pytest.approx(np.log10(2) + 20 * np.log10(2))


def test_a_bound_on_one_side_is_no_interval():
    (G,), (mu,) = judged({"G_high": "2000", "mu_low": "0.2"})
    assert (G.held, mu.held) == (True, False)
    assert (score.cells([G, mu])[0], score.cells([G, mu])[-1]) == ("0 of 2", "1 of 2")


def test_liquids_have_no_modulus_and_what_is_missing_is_not_answered():
    none, (mu,) = judged({"G": "5", "mu": ""}, G="0.0")
    assert (none, mu.bounded, score.cells([mu])[0]) == ([], False, "0 of 1")
    about = [{"name": "a", "half": "real", "G": "0.0", "mu": "0.1"}]
    (missing,) = score.judge(about, [], "mu")
    assert np.isnan(missing.error)
    for wrong in ([{"name": "b"}], [{"name": "a", "seconds": "1"}] * 2):
        with pytest.raises(ValueError, match="one answer"):
            score.judge(about, wrong, "mu")


@pytest.mark.needs("matplotlib")
def test_tables_and_picture(made, tmp_path, monkeypatch):
    truths, paths = score.read(made / "truth.csv"), []
    for name, spread in (("narrow", 1.1), ("wide", 4.0)):
        rows = []
        for row in truths:
            G, mu = float(row["G"]) or 500.0, float(row["mu"])
            rows.append({"name": row["name"], "G": G, "G_low": G / spread, "G_high": G * spread, "mu": mu})
            rows[-1] |= {"mu_low": mu / spread, "mu_high": mu * spread, "seconds": 2.0}
        paths.append(tmp_path / f"{name}.csv")
        make.write_table(paths[-1], rows)
    monkeypatch.setattr("sys.argv", ["score", str(made / "truth.csv"), *map(str, paths), "-o", str(tmp_path / "out")])
    score.main()
    assert f"| narrow over wide | mu | {np.log(1.1) / np.log(4):.2f} |" in (tmp_path / "out.md").read_text()
    assert (tmp_path / "out.png").stat().st_size > 1000


def test_frames_that_were_held_out():
    held = [{"set": "gel", "name": "a", "time_us": f"{t}", "radius_um": "100", "R_max_um": "200"} for t in (1, 2)]
    predicted = [{"name": "a", "time_us": "1", "radius_um": "102"}, {"name": "a", "time_us": "2", "radius_um": "98"}]
    text = score.ahead(held, {"some": predicted, "half": predicted[:1]})
    assert "| some | gel | 1 of 1 | 1.00 | 1.00 |" in text
    assert "| half | gel | 0 of 1 |" in text


def test_a_runner_goes_on_where_it_stopped(made, tmp_path, monkeypatch):
    asked = []
    out = tmp_path / "answers.csv"
    monkeypatch.setattr("sys.argv", ["run", str(made / "recordings"), str(out)])
    for _ in range(2):
        answers.run("", lambda recording, options: asked.append(recording.name) or {"G": "1"})
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert asked == ["shot001", "shot002"] == [row["name"] for row in rows]
    assert all(float(row["seconds"]) >= 0 for row in rows)
