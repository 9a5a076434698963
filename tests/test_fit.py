"""The least-squares fit: truth recovered, nuisances, bounds, failures, windows, what it says of itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fits import fit, fit_many

from cavirheo import (
    Bubble,
    InputError,
    NeoHookeanKelvinVoigt,
    Newtonian,
    QuadraticKelvinVoigt,
    RadiusCurve,
    read_curves,
    simulate,
)
from cavirheo.inference import experiment
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.law import ABLE, Family
from cavirheo.inference.noise import correlation_time
from cavirheo.inference.options import Options
from cavirheo.inference.search import Search
from cavirheo.inference.search.least_squares import LeastSquares
from cavirheo.inference.search.starts import Scan, spread_starts
from cavirheo.parameters import units
from cavirheo.physics.accuracy import DEFAULT, Accuracy
from cavirheo.physics.bubble import ACCOMMODATION
from cavirheo.physics.collapse import analytic_time
from cavirheo.physics.laws import LAWS, parse
from cavirheo.physics.media import WATER
from cavirheo.physics.viscous import Cross
from cavirheo.reporting import read_json

R_MAX = 250e-6
GEL = NeoHookeanKelvinVoigt(8e3, 0.05)


def shot(law=GEL, stretch=7.0, end=80e-6, step=1e-6, t0=0.0, scale=1.0, noise=0.0, R_max=R_MAX, **meta) -> RadiusCurve:
    """A shot whose clock is late by t0 and whose radii are too small by `scale`; R_max and its time are as measured."""
    time = np.arange(0.0, end, step)
    at = np.abs(time - t0)
    order = np.argsort(at, kind="stable")
    radius = np.empty_like(time)
    radius[order] = simulate(law, max_radius=R_max, stretch=stretch, time=at[order]).radius / scale
    radius += noise * R_max * np.random.default_rng(3).standard_normal(len(time))
    return RadiusCurve(time, radius, meta={"name": "shot"} | meta, maximum=(0.0, R_max / scale))


def values(answer, *names):
    return [answer.median(name) for name in names]


@pytest.mark.parametrize(("G", "mu", "stretch"), [(8e3, 0.05, 7.0), (2e3, 0.02, 9.0), (4e4, 0.15, 5.0)])
def test_recovers_noise_free_shots(G, mu, stretch):
    answer = fit(shot(NeoHookeanKelvinVoigt(G, mu), stretch), others=False)
    assert answer.checks.verdict == "ok"
    assert answer.best["shear_modulus"] == pytest.approx(G, rel=0.01)
    assert answer.best["viscosity"] == pytest.approx(mu, rel=0.03)
    assert answer.best["stretch"] == pytest.approx(stretch, rel=0.01)
    assert answer.checks.rmse_over_rmax < 1e-3


def test_other_laws():
    answer = fit(shot(Newtonian(0.05)), "newtonian")
    assert values(answer, "viscosity", "stretch") == pytest.approx([0.05, 7.0], rel=0.02)
    assert "shear_modulus" not in answer.parameters
    answer = fit(shot(QuadraticKelvinVoigt(3e3, 0.05, 0.3)), "qkv", stretch=7.0)
    assert values(answer, "shear_modulus", "viscosity", "stiffening") == pytest.approx([3e3, 0.05, 0.3], rel=0.05)
    own = ("log10_shear_modulus", "log10_viscosity", "log10_stiffening")
    assert answer.names == (*own, "time_origin", "max_radius_factor")
    assert "retardation_time" in Family("oldroyd-b").parameters


@pytest.mark.parametrize(
    ("name", "law", "expected"),
    [
        ("linear + newtonian", "linear(8e3) + newtonian(0.05)", {"shear_modulus": 8e3, "viscosity": 0.05}),
        pytest.param(
            "mooney-rivlin + newtonian",
            "mooney-rivlin(2e3, 300) + newtonian(0.05)",
            {"viscosity": 0.05},
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "gent + newtonian", "gent(2e3, 1000) + newtonian(0.05)", {"viscosity": 0.05}, marks=pytest.mark.slow
        ),
        pytest.param(
            "fung + newtonian", "fung(2e3, 0.02) + newtonian(0.05)", {"viscosity": 0.05}, marks=pytest.mark.slow
        ),
        ("power-law", "power-law(3, 0.7)", {"reference_viscosity": 3.0 * 1e5**-0.3, "exponent": 0.7}),
        pytest.param("cross", "cross(0.3, 0.02, 1e-5)", {}, marks=pytest.mark.slow),
        pytest.param(
            "zener", "zener(8e3, 0.05, 1e-6)", {"shear_modulus": 8e3, "viscosity": 0.05}, marks=pytest.mark.slow
        ),
        pytest.param("qsls", "qsls(4e3, 0.08, 5e-6, 0.02)", {"viscosity": 0.08}, marks=pytest.mark.slow),
    ],
)
def test_a_law_of_each_family_is_recovered(name, law, expected):
    """Every curve is followed; the parameters that one curve determines come back."""
    answer = fit(shot(parse(law)), name, stretch=7.0, window=2)
    assert answer.checks.rmse_over_rmax < 2e-3
    for parameter, value in expected.items():
        assert answer.best[parameter] == pytest.approx(value, rel=0.05), parameter


def test_every_law_but_those_with_lists_can_be_fitted():
    assert set(LAWS) - set(ABLE) == {"ogden"}
    family = Family("nhkv + maxwell")
    assert family.parameters == ("shear_modulus", "viscosity", "viscosity_2", "relaxation_time")
    assert units(("log10_viscosity_2", "log10_exponent", "stretch")) == ("Pa s", "1", "1")
    assert Family("cross").material(np.zeros(4)) == Cross(1.0, 1.0, 1.0, 1.0)


def test_starts_come_from_the_collapse_time():
    curve, family = shot(), Family("nhkv")
    scan = Scan(LeastSquares(Experiment(curve, family, options=Options(stretch=7.0))))
    assert scan.timed.sum() > 10
    G, mu = 10.0 ** scan.points[scan.timed][:, :2].T
    t1 = curve.collapse_times()[0] - curve.time_of_max
    assert analytic_time(R_MAX, 7.0, G, mu) == pytest.approx(np.full(len(G), t1))
    assert not Scan(LeastSquares(Experiment(curve, Family("newtonian")))).timed.any()


def test_time_origin_and_scale_are_recovered_when_free():
    curve = shot(t0=0.3e-6, scale=1.01)
    wrong = fit(curve, stretch=7.0)
    answer = fit(curve, bubble="field", free=("t0", "scale"), stretch=7.0)
    assert abs(np.log(wrong.median("shear_modulus") / 8e3)) > 0.05
    assert answer.median("time_origin") == pytest.approx(0.3e-6, abs=0.03e-6)
    assert answer.median("radius_scale") == pytest.approx(1.01, abs=2e-3)
    assert values(answer, "shear_modulus", "viscosity") == pytest.approx([8e3, 0.05], rel=0.03)
    for name, true in (("shear_modulus", 8e3), ("viscosity", 0.05), ("radius_scale", 1.01)):
        low, high = answer.interval(name)
        assert low < true < high, name
    assert set(answer.diagnostics.free) == {"time_origin", "radius_scale"}
    assert answer.units == ("Pa", "Pa s", "s", "1")
    # R_max read off the curve 1 % too small, the calibration being right
    low = replace(shot(), meta={"name": "low"}, maximum=(0.0, 0.99 * R_MAX))
    assert fit(low, free=("rmax",)).median("max_radius_factor") == pytest.approx(1 / 0.99, abs=2e-3)


def test_intervals_hold_the_truth_and_are_seeded():
    curve = shot(noise=0.01)
    answer, again, other = (fit(curve, seed=seed) for seed in (1, 1, 2))
    assert answer.theta.shape[1] == 5
    assert len(answer.theta) == len(answer.log_weight) >= 100
    assert np.array_equal(answer.theta, again.theta)
    assert not np.array_equal(answer.theta, other.theta)
    for name, truth in (("shear_modulus", 8e3), ("viscosity", 0.05), ("stretch", 7.0)):
        low, high = answer.interval(name, 0.99)
        assert low < truth < high
        assert low < answer.best[name] < high
    assert -1 < answer.diagnostics.correlations["viscosity, stretch"] < -0.5


def test_the_interval_of_a_viscosity_that_may_be_nothing_has_its_shelf():
    """Where vapour resists, frames bound a small viscosity from above only."""
    rng, time, bubble = np.random.default_rng(1), np.arange(70) * 1e-6, Bubble("kinetic", ACCOMMODATION)
    run = simulate(NeoHookeanKelvinVoigt(4e3, 0.003), max_radius=3e-4, stretch=8.0, time=time, bubble=bubble)
    curve = RadiusCurve(time, run.radius + 0.007 * 3e-4 * rng.normal(size=70), maximum=(0.0, 3e-4))
    answer = fit(curve, bubble=Bubble("kinetic"), others=False, trust_input=True)
    low, high = answer.interval("viscosity")
    assert low < 5e-4 < 3e-3 < high < 0.02


def test_correlated_residuals_count_less():
    rng = np.random.default_rng(0)
    white = rng.standard_normal(4000)
    red = np.zeros(4000)
    for i in range(1, 4000):
        red[i] = 0.8 * red[i - 1] + white[i]
    assert correlation_time(white) == pytest.approx(1.0, abs=0.2)
    assert correlation_time(red) == pytest.approx(1.8 / 0.2, rel=0.25)  # (1 + rho)/(1 - rho)
    assert correlation_time(np.zeros(10)) == 1.0


@pytest.mark.slow
def test_a_parameter_at_its_bound_is_flagged():
    answer = fit(shot(t0=2e-6), free=("t0",), stretch=7.0)
    assert "time origin is at the upper end of what is expected" in answer.checks.message
    assert answer.diagnostics.at_bound == ("time_origin",)
    soft = fit(shot(Newtonian(0.05)))  # no elasticity to find: G goes to its lower end, or is wide
    assert soft.checks.verdict == "undetermined" or soft.interval("shear_modulus")[0] < 100


def test_failed_simulations_are_counted_and_survived(monkeypatch):
    solve = experiment.simulate

    def fails_often(material, **options):
        run = solve(material, **options)
        broken = material.viscous.viscosity < 0.03
        return replace(run, status="broken", radius=np.full_like(run.radius, np.nan)) if broken else run

    monkeypatch.setattr(experiment, "simulate", fails_often)
    answer = fit(shot())
    assert answer.checks.verdict == "ok"
    assert answer.diagnostics.failed_simulations > 5
    assert answer.median("viscosity") == pytest.approx(0.05, rel=0.03)
    monkeypatch.setattr(experiment, "simulate", lambda m, **o: replace(solve(m, **o), status="broken"))
    nothing = fit(shot())
    assert nothing.checks.verdict == "failed"
    assert "all 64 simulations of nhkv failed" in nothing.checks.message


def test_windows():
    curve = shot(end=100e-6)
    collapses = len(curve.collapse_times())
    answer = fit(curve)
    assert collapses > 3
    assert answer.checks.collapses == 3
    assert list(answer.windows) == ["1", "2", "3"]
    ends = [window.t_star_end for window in answer.windows.values()]
    assert ends == sorted(ends)
    assert [window.best["viscosity"] for window in answer.windows.values()] == pytest.approx([0.05] * 3, rel=0.03)
    assert fit(curve, window=1).checks.collapses == 1
    assert fit(curve, window="all").checks.collapses == collapses
    timed = fit(curve, end=40e-6)
    assert timed.checks.t_star_end == pytest.approx(40e-6 / WATER.time_scale(R_MAX), rel=1e-3)
    assert "a window of 30 collapses" in fit(curve, window=30).checks.message


def test_the_plateau_as_prior_of_the_stretch():
    curve = shot(NeoHookeanKelvinVoigt(8e3, 0.2), end=150e-6)
    assert curve.stretch_from_tail()
    answer = fit(curve, window=1, stretch="plateau")
    assert "late plateau" in answer.diagnostics.stretch_source
    assert answer.median("stretch") == pytest.approx(7.0, rel=0.02)
    without = fit(shot(end=40e-6), stretch="plateau")
    assert "no late plateau" in without.checks.message
    given = fit(curve, stretch=7.0)
    assert given.diagnostics.stretch_source == "given"
    assert "stretch" not in given.names


def test_frames_beside_a_collapse_count_less_where_their_instants_are_uncertain():
    curve, family, rng = shot(), Family("nhkv"), np.random.default_rng(5)
    late = np.interp(curve.time + 0.3e-6 * rng.standard_normal(len(curve.time)), curve.time, curve.radius)
    blurred = replace(curve, radius=late + 1e-3 * R_MAX * rng.standard_normal(len(late)))
    x = np.array([np.log10(8e3), np.log10(0.05), np.log10(7.0), 0.0, 0.0])
    sigma = {}
    for weights in ("learnt", "equal"):
        there = Experiment(blurred, family, options=Options(weights=weights))
        there.weigh(there.predict(x))
        sigma[weights] = there.sigma
    lowest = np.argmin(np.abs(there.since - (curve.collapse_times()[0] - 1e-6)))
    assert sigma["learnt"][lowest] > 4 * sigma["learnt"][0]
    assert np.ptp(sigma["equal"]) == 0


def test_finite_differences_are_above_the_solvers_noise():
    there = Experiment(shot(), Family("nhkv"))
    fit = LeastSquares(there)
    x = np.array([np.log10(8e3), np.log10(0.05), np.log10(7.0), 0.0, 0.0])
    used, exact = (fit.jacobian(x, how, there.predict(x, how)) for how in (DEFAULT, Accuracy(relative_error=1e-8)))
    assert np.all(np.linalg.norm(used - exact, axis=0) < 5e-3 * np.linalg.norm(exact, axis=0))


def test_starts_fill_the_box():
    points = spread_starts(np.array([[0.0, 1.0], [2.0, 4.0]]), 64)
    assert points.shape == (64, 2)
    counts, _, _ = np.histogram2d(points[:, 0], points[:, 1], bins=4, range=[[0, 1], [2, 4]])
    assert counts.min() >= 2


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"material": "jelly"}, "law.not_fittable"),
        ({"material": "ogden"}, "law.not_fittable"),
        ({"material": "nhkv + newtonian"}, "laws.viscous_twice"),
        ({"material": "nhkv(8e3, 0.1)"}, "law.not_fittable"),
        ({"window": 0}, "option.window"),
        ({"window": "most"}, "option.window"),
        ({"end": -1.0}, "option.end"),
        ({"free": ("gravity",)}, "option.free"),
        ({"free": ("t0", "t0")}, "option.free"),
        ({"stretch": 0.5}, "option.stretch"),
        ({"stretch": "tail"}, "option.stretch"),
        ({"weights": "motion"}, "option.weights"),
        ({"t0_bound": 0.0}, "option.t0_bound"),
        ({"scale_bound": 0.5}, "option.scale_bound"),
    ],
)
def test_bad_options_are_named(options, code):
    curve = RadiusCurve(np.arange(3) * 1e-6, np.array([1e-4, 2e-4, 1e-4]))
    with pytest.raises(InputError) as error:
        fit(curve, **options)
    assert error.value.code == code


def test_an_interval_as_wide_as_the_range_is_no_ok():
    """The best value lies inside the range, but the interval runs to its end: a gel too soft for its curve to tell."""
    answer = fit(shot(NeoHookeanKelvinVoigt(300.0, 0.05), end=35e-6, noise=0.01), window=1)
    low, high = answer.interval("shear_modulus")
    assert low < 20 < 100 < answer.best["shear_modulus"] < high
    assert answer.checks.verdict == "undetermined"
    assert answer.bound("shear_modulus") == "upper"
    assert answer.bound("viscosity") is None
    assert "an upper limit of G alone: any value below" in answer.checks.message


def test_a_curve_that_cannot_be_fitted_is_a_failed_row():
    bad = RadiusCurve(np.arange(3) * 1e-6, np.array([1e-4, 2e-4, 1e-4]), meta={"name": "three"})
    seen = []
    answers = fit_many([bad, shot()], done=lambda index, _: seen.append(index))
    assert [a.checks.verdict for a in answers] == ["failed", "ok"]
    assert "3 of 3 frames" in answers[0].checks.message
    assert sorted(seen) == [0, 1]


def test_command_line(run, tmp_path):
    curve = shot(end=60e-6)
    rows = [f"{t * 1e6:.6g},{r * 1e6:.6g}" for t, r in zip(curve.time, curve.radius, strict=True)]
    (tmp_path / "gel.csv").write_text("time_us,radius_um\n" + "\n".join(rows) + "\n")
    status, out, err = run("fit", "gel.csv", "--free", "t0", "-o", "out")
    assert status == 0, err
    assert "1 collapse" in out
    (record,) = read_json(tmp_path / "out" / "result.json").curves
    assert record.method == "least_squares"
    assert record.shear_modulus_Pa.q05 < record.shear_modulus_Pa.median < record.shear_modulus_Pa.q95
    assert "time_origin" in record.other_parameters
    assert "shear_modulus, viscosity" in record.provenance["correlations"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "correlations" in page
    assert "t_0 =" in page
    status, _, err = run("fit", "gel.csv", "--window", "x")
    assert (status, err.count("\n")) == (2, 1)
    assert "--window" in err
    assert "'x'" in err


@pytest.mark.slow
def test_published_alginate_shots(real_data):
    """PAAm 12 % - alginate 0.3 %: published 6.44 +- 1.64 kPa, 0.020 +- 0.009 Pa s; the window decides mu."""
    (file,) = (real_data / "paam_alginate_0p3").glob("*.mat")
    settings = {"free": "none", "others": False}
    answers = fit_many(read_curves(file)[:2], window="all", **settings)
    assert [a.checks.verdict for a in answers] == ["ok", "ok"]
    assert np.mean([a.median("shear_modulus") for a in answers]) == pytest.approx(6440, abs=2 * 1640)
    (first,) = fit_many(read_curves(file)[:1], window=1, **settings)
    assert first.best["viscosity"] > answers[0].best["viscosity"]


def two_solutions(seed: int, frames: int, stretch: float) -> RadiusCurve:
    """A stiff gel at 270,000 frames/s: few frames show a collapse, and another stretch follows them nearly as well."""
    frame, R_max, rng = 1.0 / 270e3, 374e-6, np.random.default_rng([6, seed])
    law = NeoHookeanKelvinVoigt(*((4e3, 0.03) if stretch == 9.0 else (3e3, 0.02)))
    time = frame * np.arange(frames)
    run = simulate(law, max_radius=R_max, stretch=stretch, time=np.maximum(time + rng.uniform(-0.5, 0.5) * frame, 0.0))
    return RadiusCurve(time, run.radius + rng.normal(0.0, 0.025 * R_max, frames))


@pytest.mark.parametrize(("seed", "frames", "true"), [(6, 24, 9.0), pytest.param(10, 30, 8.0, marks=pytest.mark.slow)])
def test_two_solutions_are_both_found_and_each_has_its_own_values(seed, frames, true):
    curve = two_solutions(seed, frames, true)
    answer = fit(curve, bubble="field", trust_input=True)
    modes = [one for one in answer.others if one.material == "nhkv" and one.evidence]
    assert any(one.best["stretch"] < 0.75 * true for one in modes)
    assert answer.best["stretch"] == pytest.approx(true, rel=0.1)
    for name in ("shear_modulus", "viscosity", "stretch"):  # the best values are of the solution with the interval
        low, high = answer.interval(name)
        assert 0.95 * low <= answer.best[name] <= 1.05 * high


def test_a_minimum_that_only_rough_simulations_reach_gives_way_to_the_next(monkeypatch):
    """The chains of a Gent law can be taut where a rough simulation steps over it."""
    shot = Experiment(two_solutions(6, 24, 9.0), Family("nhkv"), WATER, Options())
    first, second, *_ = Search(shot).minima()
    solve = Experiment.predict

    def stops(self, x, accuracy=DEFAULT, **how):
        return None if accuracy is DEFAULT and np.array_equal(x, first.x) else solve(self, x, accuracy, **how)

    monkeypatch.setattr(Experiment, "predict", stops)
    assert np.array_equal(Search(shot).minima()[0].x, second.x)


@pytest.mark.slow
def test_both_solutions_of_a_real_stiff_gel_are_said_or_in_the_interval(real_data):
    (file,) = (real_data / "pa_stiff").glob("RofT_shifted*.mat")
    answer = fit(read_curves(file)[0])
    low, high = answer.interval("stretch")
    assert low <= answer.best["stretch"] <= high
    same = [one for one in answer.others if one.bubble == answer.bubble]
    near = [one for one in same if one.evidence.log > answer.evidence.log - 3.0]
    assert near
    met = all(one.intervals["stretch"][0] < high and one.intervals["stretch"][2] > low for one in near)
    assert met or "two solutions of the same model" in answer.checks.message


@pytest.mark.slow
@pytest.mark.parametrize("number", [6, 18, 20])
def test_best_values_are_of_the_solution_that_has_the_interval(real_data, number):
    """Shots of a polymer solution that no Newtonian liquid follows: minima are broad, and near one another."""
    (file,) = (real_data / "peg8000_40wv").glob("*.mat")
    answer = fit(read_curves(file)[number - 1], "newtonian", others=False)
    low, high = answer.interval("viscosity")
    assert 0.8 * low < answer.best["viscosity"] < 1.2 * high
    assert answer.checks.rmse_over_rmax < 0.09


def test_frames_that_drift_upwards_are_left_out_and_counted():
    curve = shot(end=200e-6)
    late = curve.time > 120e-6
    risen = curve.radius + np.where(late, 0.4 * R_MAX * (curve.time - 120e-6) / 80e-6, 0.0)
    answer = fit(replace(curve, radius=risen), window="all")
    said = int(answer.checks.message.split(" frames from ")[0].split()[-1])
    collapses = int(np.sum(curve.time > curve.collapse_times()[2]))  # the drift is known from the last collapse on
    assert np.sum(late) <= said <= collapses
    assert values(answer, "shear_modulus", "viscosity") == pytest.approx([8e3, 0.05], rel=0.03)


def test_a_stretch_that_the_file_states_is_a_prior():
    early = shot(end=40e-6, noise=0.02)
    stated = replace(early, meta={**early.meta, "stretch": 7.0, "stretch_std": 0.05})
    free, known = fit(early), fit(stated)
    assert "the file states" in known.diagnostics.stretch_source
    assert np.ptp(known.interval("stretch")) < 0.8 * np.ptp(free.interval("stretch"))
    assert known.interval("stretch")[0] > free.interval("stretch")[0] + 0.5


def test_a_window_ends_at_most_a_period_after_its_last_collapse():
    curve = shot(end=300e-6)  # after some collapses the rebounds are too small to be seen
    collapses = curve.collapse_times()
    last = len(collapses)
    end = curve.window(last).time[-1]
    assert collapses[-1] < end <= collapses[-1] + (collapses[-1] - collapses[-2]) + 1e-6
    assert end < curve.time[-1] - 50e-6


def test_a_stretch_that_no_bubble_has_is_said_to_be_left_out():
    curve = shot(noise=0.01)
    wrong = replace(curve, meta={**curve.meta, "stretch": -8.7})
    answer = fit(wrong, bubble="field", window=1)
    assert "-8.7 is no R_max/R_0" in answer.checks.message
