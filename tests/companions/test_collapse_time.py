"""Collapse times: the model against its limits and simulations, what a table can and cannot tell, the command."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import WATER, code_of, done, refusal
from files import put, text_table
from scipy.stats import t as student

from cavirheo import Bubble, SolverError, load
from cavirheo.companions.collapse_times import read_table
from cavirheo.inference.collapse_time import CollapseEstimate, estimate
from cavirheo.physics.collapse import RAYLEIGH, analytic_time, inverse_square, rayleigh_time, simulated_time

EMPTY = replace(WATER, surface_tension=0.0, vapour_reference_pressure=1e-6, sound_speed=float("inf"), name="empty")
BARE = Bubble(motion="rayleigh-plesset", exponent=1.4)
R = 2e-4
HEAD = "rmax_um,stretch,t1_us"


def table(n: int = 30, G: float = 1e4, mu: float = 0.1, noise: float = 0.0, seed: int = 0, time=analytic_time):
    """R_max, stretch and t_1 of n shots."""
    rng = np.random.default_rng(seed)
    radius, stretch = rng.uniform(1e-4, 4e-4, n), rng.uniform(5.0, 9.0, n)
    return radius, stretch, time(radius, stretch, G, mu) * np.exp(noise * rng.standard_normal(n))


def write(path, shots):
    radius, stretch, time = shots
    return text_table(path, HEAD, radius * 1e6, stretch, time * 1e6)


def test_the_empty_bubble_is_rayleighs():
    """The analytic model exactly, the simulated one to the little gas of lambda = 40."""
    assert pytest.approx(0.914681, rel=1e-6) == RAYLEIGH
    assert analytic_time(R, 1e6, 0, 0, EMPTY) == pytest.approx(rayleigh_time(R, EMPTY), rel=1e-12)
    assert simulated_time(R, 40.0, 0, 0, EMPTY, bubble=BARE) == pytest.approx(rayleigh_time([R], EMPTY), rel=1e-4)


def test_first_order_in_elasticity():
    """Far from R_0 the solid pulls with 5/2 G; the paper's next term in 1/lambda is 27 % too large."""
    for stretch in (40.0, 10.0):
        times = [simulated_time(R, stretch, G, 0, EMPTY, bubble=BARE)[0] for G in (0, 1e4)]
        f = [(rayleigh_time(R, EMPTY) / time) ** 2 for time in times]
        # energy that the 1/R part of the stress takes (docs/how-to/collapse-time.md)
        assert (f[1] - f[0]) * EMPTY.pressure / 1e4 == pytest.approx(2.5 - 2 * 1.10327 / stretch, rel=1e-2)
    published = (inverse_square(R, 10.0, 1e4, 0) - inverse_square(R, 10.0, 0, 0)) * WATER.pressure / 1e4
    assert published == pytest.approx(2.5 - 2 * 1.40218 / 10, rel=1e-4)


def test_the_model_holds_where_bubbles_are_made_and_is_infinite_where_none_collapses():
    for one in ((1e-4, 7, 3e3, 0.03), (2e-4, 6, 1e4, 0.1), (4e-4, 9, 5e4, 0.3)):
        assert analytic_time(*one) == pytest.approx(simulated_time(*one)[0], rel=0.008)
    assert np.isinf([analytic_time(1e-4, 7.0, 0.0, 5.0), simulated_time(1e-4, 7.0, 100.0, 5.0)[0]]).all()


def values(found: CollapseEstimate) -> tuple[float | None, float | None]:
    return found.shear_modulus_Pa.median, found.viscosity_Pa_s.median


@pytest.mark.parametrize(
    ("material", "G", "mu", "exact"),
    [("nhkv", 1e4, 0.1, False), ("nh", 2e4, 0.0, False), ("newtonian", 0.0, 0.1, False), ("nhkv", 8e3, 0.05, True)],
)
def test_recovers_its_own_table(material, G, mu, exact):
    shots = table(6, G, mu, time=simulated_time) if exact else table(G=G, mu=mu)
    found = estimate(*shots, material, exact=exact)
    assert values(found) == pytest.approx((G, mu), rel=2e-3 if exact else 1e-4)
    assert (found.complete, found.message) == (True, "")


def test_interval_is_that_of_the_noise():
    found = [estimate(*table(noise=0.005, seed=seed)) for seed in range(30)]
    inside = [f.shear_modulus_Pa.q05 < 1e4 < f.shear_modulus_Pa.q95 for f in found]
    assert 22 <= sum(inside) < 30  # of 27 expected
    assert np.mean([f.scatter for f in found]) == pytest.approx(0.005, rel=0.15)


def test_interval_of_one_parameter_is_students():
    """Of equal shots: t(95 %) times the standard error of the times, by G's change with them."""
    times = 1.8e-5 * np.array([0.99, 1.0, 1.015])
    found = estimate([R] * 3, [7.0] * 3, times, viscosity=0.1)
    G = found.shear_modulus_Pa
    half = student.ppf(0.95, 2) * found.scatter / np.sqrt(3) * 100 * abs(found.modulus_per_percent_Pa)
    assert G.q95 - G.median == pytest.approx(half, rel=0.02)
    assert found.modulus_per_percent_Pa < 0  # later collapses are of softer gels


def test_outliers_do_not_decide_and_bounds_are_told():
    radius, stretch, time = table(40, noise=0.002)
    time[[3, 10, 20]] *= 1.2
    found = estimate(radius, stretch, time)
    assert found.shear_modulus_Pa.median == pytest.approx(1e4, rel=0.05)
    fluid = estimate(*table(G=0.0, mu=0.1, noise=1e-3))
    assert (fluid.shear_modulus_Pa.bound, fluid.shear_modulus_Pa.q95 < 500) == ("upper", True)
    radius = np.array([1e-4, 1.5e-4, 2e-4, 3e-4])
    hard = estimate(radius, np.full(4, 7.0), 0.12 * rayleigh_time(radius), "nh")
    assert (hard.shear_modulus_Pa.bound, hard.complete) == ("undetermined", False)


def test_one_shot_is_one_relation():
    one = table(1)
    found = estimate(*one)
    assert (values(found), found.complete, estimate(*table(2)).complete) == ((None, None), False, False)
    assert "--viscosity" in found.message
    assert estimate(*one, viscosity=0.1).shear_modulus_Pa.median == pytest.approx(1e4, rel=1e-3)
    assert estimate(*one, shear_modulus=1e4).viscosity_Pa_s.median == pytest.approx(0.1, rel=1e-3)
    for few in ([np.repeat(values, 5) for values in one], ([2e-4, 2.5e-4], [6.0] * 2, [1.8e-5, 2.3e-5])):
        alike = estimate(*few)  # of the latter the best mu is 0, so G would be that without viscosity
        assert (values(alike), "too alike" in alike.message) == ((None, None), True)


SHOT = (R, 7.0, 1.8e-5)
REFUSED = [
    ("shot", (R, 0.9, 1e-5), {}),
    ("shot", (200.0, 7.0, 18.0), {}),  # um and us, taken as m and s
    ("material", SHOT, {"material": "gent"}),
    ("not_of_the_material", SHOT, {"material": "nh", "viscosity": 0.1}),
    ("out_of_range", SHOT, {"shear_modulus": -1.0}),
    ("all_given", SHOT, {"shear_modulus": 1.0, "viscosity": 0.1}),
]


@pytest.mark.parametrize(("code", "shots", "options"), REFUSED)
def test_refusals(code, shots, options):
    assert code_of(lambda: estimate(*shots, **options)) == f"collapse_time.{code}"


def test_layouts_agree(tmp_path):
    columns = table(6)
    plain, german = write(tmp_path / "a.csv", columns), tmp_path / "b.csv"
    rows = (f"{r * 1e3:.12g};{s:.12g};{t * 1e3:.12g}".replace(".", ",") for r, s, t in zip(*columns, strict=True))
    german.write_text("R_max (mm);lambda;t_1 (ms)\n" + "\n".join(rows) + "\n")
    for group in map(read_table, (plain, german)):
        found = np.array([[s.max_radius_m, s.stretch, s.collapse_time_s] for s in group.usable])
        assert found == pytest.approx(np.column_stack(columns), rel=1e-8)


BAD = {  # what is no table at all, test_reading.py refuses by the same reader
    "time_us,radius_um\n0,200\n1,199\n": "tabular.columns",  # a curve is for `infer`
    "rmax,stretch,t1_us\n200,7,18\n": "collapse_time.unit",
    "rmax_um,stretch,t1 (h)\n200,7,18\n": "collapse_time.unit",
    "rmax_um,t1_us\n200,18\n": "collapse_time.no_stretch",
    f"{HEAD}\n": "collapse_time.no_rows",
    f"{HEAD}\n200,7,5,18\n": "tabular.width",  # 7,5 was read as 7 and 5 us
}


@pytest.mark.parametrize("text", BAD)
def test_files_that_cannot_be_used(tmp_path, text):
    assert code_of(read_table, put(tmp_path / "a.csv", text)) == BAD[text]


def test_the_command(run, tmp_path):
    done(run("collapse-time", write(tmp_path / "gel.csv", table(noise=0.003)), "--density", 1000, "-o", "result"))
    document = json.loads((tmp_path / "result" / "collapse-time.json").read_text())
    (group,) = document["groups"]
    head = (document["schema"], document["medium"]["density"], group["model"], len(group["shots"]))
    assert head == (1, 1000, "analytic", 30)
    assert group["estimate"]["shear_modulus_Pa"]["median"] == pytest.approx(1e4, rel=0.05)
    assert len((tmp_path / "result" / "shots.csv").read_text().splitlines()) == 31
    done(run("collapse-time", "gel.csv", "--exact", "-o", "exact"))
    assert load(tmp_path / "exact").groups[0].model == "exact"


def test_a_failed_simulation_leaves_the_analytic_answer(run, tmp_path, monkeypatch):
    def fails(*_, **__):
        raise SolverError("the step size went to zero")

    monkeypatch.setattr("cavirheo.inference.collapse_time.simulated_time", fails)
    status, out, _ = run("collapse-time", write(tmp_path / "gel.csv", table(6, noise=0.001)), "--exact")
    assert (status, "no exact answer: the step size" in out, "analytic" in out) == (1, True, True)


def test_unusable_rows_keep_their_reason_at_status_1_and_an_unreadable_file_is_2(run, tmp_path):
    path = tmp_path / "gel.csv"
    path.write_text(f"shot,{HEAD}\nA,200,7,18\nB,nan,7,18\nC,200,7,18000\nD,200,7,18\n")
    group = read_table(path)
    assert [shot.name for shot in group.usable] == ["A", "D"]
    assert "earlier shot: D; copies" in group.notes[0]
    assert group.shots[1].message.startswith("R_max must be 1e-08 to 0.05 m, got nan")
    assert group.shots[2].message.startswith("t_1 = 1.8e+04 us")
    assert run("collapse-time", path)[0] == 1
    refusal(run("collapse-time", path, "missing.csv", "--quiet", "--replace"), "missing.csv")
