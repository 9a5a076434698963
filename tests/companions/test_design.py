"""`cavirheo design`: expected intervals of shots that were not taken, and how many are wanted."""

from __future__ import annotations

import json

import numpy as np
import pytest
from answers import CENTRE, answer, bubble, seen, shots
from conftest import ROOT

import cavirheo
from cavirheo import InputError, Rig
from cavirheo.companions import design as beside
from cavirheo.companions import network_design
from cavirheo.inference import design
from cavirheo.inference.design import NORMAL_90, Setting, expected, gain, linearised, shared, shots_wanted
from cavirheo.inference.law import Family
from cavirheo.inference.noise import SHAPE, Noise
from cavirheo.inference.posterior_network import load_posterior
from cavirheo.posterior import Checks, Posterior
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.record import result, result_of
from cavirheo.training import curves as training_curves
from cavirheo.training.recipe import read_recipe
from cavirheo.writing.document import Quantity

NHKV = Family("nhkv")
LAW = np.log10([6e3, 0.05])
GOOD = Setting(250e-6, 1e6, frames=120)


def told(setting: Setting, seed: int = 0, law=LAW, stretch: float = 6.0):
    return expected(*setting.film(NHKV, law, stretch, seed=seed), NHKV)


@pytest.fixture(scope="module")
def good():
    return told(GOOD)


def test_a_film_shows_the_bubble_that_is_asked_for():
    curve, truth = GOOD.film(NHKV, LAW, 6.0, seed=3)
    assert len(curve.time) == 120
    assert curve.max_radius == pytest.approx(250e-6, rel=0.03)
    assert truth["radius_scale"] * truth["max_radius_factor"] * curve.max_radius == pytest.approx(250e-6)
    assert abs(truth["time_origin"]) < 2e-6
    again, _ = GOOD.film(NHKV, LAW, 6.0, seed=3)
    assert np.array_equal(curve.radius, again.radius)


def test_less_noise_and_more_frames_tell_more(good):
    quiet = told(Setting(250e-6, 1e6, frames=120, relative_noise=0.007))
    slow = told(Setting(250e-6, 2.5e5, frames=120))
    loud = told(Setting(250e-6, 1e6, frames=120, relative_noise=0.03))
    assert np.all(quiet.half_width < loud.half_width)
    assert np.all(good.half_width < slow.half_width)
    assert np.linalg.det(good.information) > np.linalg.det(loud.information)


def test_a_linear_model_with_white_noise_has_the_textbook_posterior():
    rng = np.random.default_rng(0)
    count, deviation = 400, 0.01
    jacobian, u = rng.normal(size=(count, 3)), np.array([0.3, -0.2, 0.1])
    residual = deviation * rng.standard_normal(count)
    noise = Noise(np.full(count, deviation), np.linspace(0, 1, count), 1.0, False)
    mean, covariance = linearised(noise, u, residual, jacobian)
    weight = noise.power / (SHAPE + 0.5 * float(residual @ residual) / deviation**2)
    exact = np.linalg.inv(weight * jacobian.T @ jacobian / deviation**2 + np.eye(3))
    assert covariance == pytest.approx(exact, rel=0.02)
    assert np.all(np.abs(mean - u) < 5 * np.sqrt(np.diag(exact)))


def test_information_adds_and_scatter_takes_away():
    one, known = np.diag([1.0 / 0.1**2, 1.0 / 0.05**2]), np.diag([1e6, 1e6])
    half = NORMAL_90 * 0.1 / np.sqrt(25)  # what 25 shots reach, the first parameter being the worse
    assert [shots_wanted(one, known, half * factor) for factor in (1.0001, 0.9999)] == [25, 26]
    assert shots_wanted(one, np.diag([1e-8, 1e-8]), half) == 0  # known already
    assert shots_wanted(np.zeros((2, 2)), known, half) is None
    known, one = np.array([[0.2, 0.05], [0.05, 0.1]]), np.array([[200.0, -90.0], [-90.0, 600.0]])
    exact = np.linalg.inv(np.linalg.inv(one) + 0.1**2 * np.eye(2))
    assert shared(one, 0.1**2 * np.eye(2)) == pytest.approx(exact)
    after = np.linalg.inv(np.linalg.inv(known) + one)
    assert gain(one, known) == pytest.approx(0.5 * np.log(np.linalg.det(known) / np.linalg.det(after)))


@pytest.fixture
def quick(monkeypatch):
    """Settings whose information grows with R_max and frame rate, without a simulation."""

    def one(setting):
        size = (setting.max_radius / 1e-4) ** 2 * setting.frame_rate / 1e6
        return design.Expected(np.diag([100.0, 400.0]) * size, NORMAL_90 / np.sqrt([100.0 * size, 400.0 * size]))

    def reached(setting, family, law, stretch, medium, *, seed, bubble, workers):
        told = np.tile(one(setting).half_width, (len(law), 1))
        return told, told * [2.0, 1.5]

    def expectations(settings, family, law, stretch, medium, *, seed, bubble, workers, done):
        readable = [setting.frame_rate > 1.5e5 for setting in settings]
        return [[one(s)] * len(law) if fine else [None] * len(law) for s, fine in zip(settings, readable, strict=True)]

    monkeypatch.setattr(beside, "expectations", expectations)
    monkeypatch.setattr(beside, "reached", reached)


RANGES = {"shear_modulus": (2e3, 2e4), "viscosity": (0.02, 0.2), "stretch": (5, 8)}


def test_the_best_setting_and_its_shots(quick):
    made = cavirheo.design(ranges=RANGES, rig=Rig((1e-4, 4e-4), (1e5, 1e6)), sizes=3)
    best = made.settings[made.best]
    assert (best.max_radius_m, best.frame_rate_hz) == (pytest.approx(4e-4), 1e6)
    assert made.fewest == made.best
    sigma = np.log10(1.1) / NORMAL_90
    prior = 12.0 / 1.0**2  # of a decade, drawn evenly
    assert best.shots == int(np.ceil((1 / sigma**2 - prior) / (100.0 * 16)))
    (checked,) = made.checked  # the same setting is best and needs the fewest
    assert checked.setting == made.best
    assert (checked.answers, checked.recordings) == (6, 6)
    assert checked.shots == int(np.ceil((1 / sigma**2 - prior) / (100.0 * 16 / 2.0**2)))
    told, got = checked.told_percent["viscosity"] / 100, checked.reached_percent["viscosity"] / 100
    assert np.log1p(got) == pytest.approx(1.5 * np.log1p(told))
    assert f"so {checked.shots} shots" in made.said[-1]
    assert [one.readable for one in made.settings] == [0, 0, 0, 1, 1, 1]
    assert made.settings[0].shots is None
    assert made.known["shear_modulus"].median == pytest.approx(6.3e3, rel=0.3)


def two_settings(monkeypatch, of):
    """The plan for two frame rates, whose information for n draws is of(n), a list of matrices each."""

    def expectations(settings, family, law, *_, **__):
        return [[design.Expected(one, NORMAL_90 / np.sqrt(np.diag(one))) for one in each] for each in of(len(law))]

    monkeypatch.setattr(beside, "expectations", expectations)
    return cavirheo.design(ranges=RANGES, rig=Rig((2e-4, 2e-4), (5e5, 1e6)), check=0)


def test_the_setting_with_the_fewest_shots_is_next_where_gains_do_not_differ(quick, monkeypatch):
    """Of two settings whose mean gains differ by less than the error of so few draws."""
    about = np.diag([100.0, 400.0])
    made = two_settings(monkeypatch, lambda n: [[about] * (n - 1) + [1e9 * about], [4.0 * about] * n])
    rare, steady = made.settings
    assert rare.gain_error_nats > rare.gain_nats - steady.gain_nats > 0
    assert (made.best, made.fewest) == (1, 1)
    assert steady.gain_error_nats == pytest.approx(0.0, abs=1e-9)
    assert steady.half_width_ends_percent["viscosity"][1] == pytest.approx(steady.half_width_percent["viscosity"])


def test_one_setting_is_next_and_a_shot_alone_is_told_apart_from_it(quick, monkeypatch):
    """One setting tells most by a shot, nearly all about G; the other needs fewer shots for G and mu."""
    made = two_settings(monkeypatch, lambda n: [[np.diag([1e9, 100.0])] * n, [np.diag([400.0, 400.0])] * n])
    assert (made.best, made.fewest, made.next) == (0, 1, 1)
    following, alone = made.said
    assert following.startswith(f"next: {made.settings[1].shots} shots at")
    assert f"{made.settings[0].shots} such shots" in alone


def row(G: float, mu: float, width: float, verdict: str = "ok") -> CurveRecord:
    """Of a shot whose intervals are 10^width wide to both sides."""
    curve = bubble("shot", group="x", source="x")
    (record,) = result([(curve, answer(curve, G, mu, verdict=verdict))], "x").curves
    return record.model_copy(update={
        name: Quantity(median=value, q05=value / 10**width, q95=value * 10**width)
        for name, value in (("shear_modulus_Pa", G), ("viscosity_Pa_s", mu))
    })  # fmt: skip


def test_what_is_known_comes_from_the_trusted_answers(quick, tmp_path):
    rows = [row(5e3, 0.05, 0.1), row(5e3, 0.05, 0.1), row(9e5, 0.9, 0.1, "model_does_not_fit")]
    made = cavirheo.design(result_of(rows, "x"), draws=40)
    assert made.shots_before == 2
    assert made.spread_decades == 0.0
    assert made.known["shear_modulus"].median == pytest.approx(5e3, rel=0.02)
    half = np.log10(made.known["shear_modulus"].q95 / 5e3)
    assert half == pytest.approx(0.1 / np.sqrt(2), rel=0.15)
    scattered = cavirheo.design(result_of([row(4e3, 0.05, 0.02), row(8e3, 0.05, 0.02)], "x"))
    assert scattered.spread_decades == pytest.approx(np.log10(2) / np.sqrt(2), rel=0.1)
    other = rows[0].model_copy(update={"group": "y", "shear_modulus_Pa": rows[2].shear_modulus_Pa})
    with pytest.raises(InputError) as error:
        cavirheo.design(result_of([*rows, other], "x"))
    assert error.value.code == "design.groups"
    assert "--group" in str(error.value)
    assert cavirheo.design(result_of([*rows, other], "x"), group="y").shots_before == 1
    with pytest.raises(InputError) as error:
        cavirheo.design(result_of(rows[2:], "x"))
    assert error.value.code == "design.no_answer"


@pytest.mark.parametrize(
    "wrong",
    [
        {"ranges": {"shear_modulus": (2e3, 1e3)}}, {"ranges": {"nothing": (1, 2)}}, {"wanted": 0.0}, {"spread": -1.0},
        {"draws": 1},
        *({"rig": one} for one in (
            {"max_radius": (4e-4, 1e-4)}, {"frame_rate": (0.0,)}, {"frames": 3}, {"relative_noise": 0.0},
            {"noise": (1, 2)}, {"material": "jelly"}, {"medium": "honey"}, {"bubble": "auto"},
        )),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(quick, wrong):
    with pytest.raises(InputError):
        cavirheo.design(**({"rig": Rig(**wrong["rig"])} if "rig" in wrong else wrong))


def test_the_command_writes_a_document_that_can_be_loaded(quick, run, tmp_path):
    status, out, err = run("design", "--shear-modulus", 2e3, 2e4, "--fps", "250e3,1e6", "-o", "plan")
    assert status == 0, err
    document = cavirheo.load(tmp_path / "plan")
    assert document.known["shear_modulus"].median
    assert document.said[0] in out.replace("\n", " ")
    assert json.loads((tmp_path / "plan" / "design.json").read_text())["wanted_percent"] == 10
    assert run("design", "--fps", "fast", "-o", "plan")[0] == 2
    assert run("design", "--noise-um", "1,2", "--fps", "250e3,500e3,1e6", "-o", "plan")[0] == 2


NARROW = ["--shear-modulus", "5000", "5100", "--viscosity", "0.05", "0.051"]


@pytest.mark.parametrize(
    ("words", "said", "shots"),
    [
        ([*NARROW, "--wanted-percent", 30], "± 30 % (90 %) is already reached", {0, None}),
        (["--wanted-percent", 0.1, "--spread", 1], "no setting reaches ± 0.1 % with 10,000 shots", {None}),
    ],
)
def test_a_design_without_shots_to_draw_has_its_picture_and_its_document(quick, run, tmp_path, words, said, shots):
    pytest.importorskip("matplotlib")
    status, out, err = run("design", *words, "--fps", "100e3,1e6", "-o", "plan")
    assert status == 0, err
    assert said in out.replace("\n", " ")
    assert (tmp_path / "plan" / "design.png").exists()
    document = cavirheo.load(tmp_path / "plan")
    assert document.notes == []
    assert {one.shots for one in document.settings} == shots


def test_a_picture_that_fails_costs_only_itself(quick, run, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")

    def broken(path, figure):
        assert (tmp_path / "plan" / "design.json").exists()
        raise ValueError("no ticks")

    monkeypatch.setattr("cavirheo.writing.style.save_png", broken)
    status, _, err = run("design", *NARROW, "--fps", 1e6, "-o", "plan")
    assert status == 0, err
    assert cavirheo.load(tmp_path / "plan").notes == ["design.png could not be drawn: ValueError: no ticks"]
    assert not list((tmp_path / "plan").glob("*.png"))


@pytest.mark.slow
def test_the_interval_is_about_the_one_that_infer_gives(good):
    curve, _ = GOOD.film(NHKV, LAW, 6.0, seed=5)
    answer = cavirheo.infer(curve)
    ends = np.log10([answer.interval(name) for name in NHKV.parameters])
    assert good.half_width == pytest.approx(0.5 * np.diff(ends)[:, 0], rel=0.6)


def test_answers_of_recordings_check_what_is_expected():
    known = np.log10([[6e3, 0.06], [4e3, 0.05]])
    setting = Setting(250e-6, 1e6)
    told, got = design.reached(setting, NHKV, known, np.array([6.0, 7.0]), seed=5)
    assert told.shape == got.shape == (2, 2)
    assert np.all(np.abs(np.log(told / got)) < np.log(2.5))
    nothing = Setting(30e-6, 1e5)
    assert len(design.reached(nothing, NHKV, known, np.array([6.0, 7.0]))[0]) == 0


def test_a_parameter_that_is_hardly_seen_has_no_lower_end_but_the_priors():
    low, high = design.interval(3.5, 0.01, 0.0, 7.0)
    assert high - low == pytest.approx(2 * NORMAL_90 * 0.01, rel=0.01)
    low, high = design.interval(3.5, 1.0, 0.0, 7.0)
    assert low < 0.5  # the range of the prior begins there
    assert 3.5 < high < 4.2


def test_the_scatter_of_shots_comes_from_the_population_and_is_counted(quick):
    """Shots of 0.05 decades each that scatter by 0.15: as many as are told bring the material to what is wanted."""
    rng = np.random.default_rng(4)
    first = shots(8, 0.15, 0.05, seed=5)
    made = result([(bubble(f"shot {k}"), one) for k, one in enumerate(first)], "x")
    record = made.groups[0].population
    plan = cavirheo.design(made, wanted=0.2, rig=Rig((2e-4, 2e-4), (1e6,)))
    assert plan.shots_before == 8
    told = [record.spreads_decades[name].median for name in NHKV.parameters]
    assert list(plan.spreads_decades.values()) == pytest.approx(told)
    assert plan.spread_decades == pytest.approx(np.sqrt(np.mean(np.square(told))))
    assert np.log10(plan.known["shear_modulus"].median / record.shear_modulus_Pa.median) == pytest.approx(0, abs=0.02)
    exact = cavirheo.design(made, wanted=0.2, rig=Rig((2e-4, 2e-4), (1e6,)), spread=0.0)
    more, ignoring = made.groups[0].population.still_wanted(made.curves, 0.2), exact.settings[0].shots
    assert plan.settings[0].shots == pytest.approx(more, abs=2)  # 0.05 and 0.025 decades of a shot, against 0.05
    assert ignoring < 0.5 * more
    truths = CENTRE + 0.15 * rng.standard_normal((more, 2))
    later = [seen(x + 0.05 * rng.standard_normal(2), 0.05, 300, seed=100 + k) for k, x in enumerate(truths)]
    material = cavirheo.population([*first, *later])
    half = max(0.5 * np.log10(high / low) for low, _, high in map(material.interval, NHKV.parameters))
    assert 0.6 < half / np.log10(1.2) < 1.25


def test_shots_that_do_not_count_are_counted_for(quick):
    answers = shots(6, 0.1, 0.05, seed=5)
    good = result([(bubble(f"shot {k}"), one) for k, one in enumerate(answers)], "x")
    more = good.groups[0].population.still_wanted(good.curves, 0.15)
    half = [row.model_copy(update={"verdict": "failed"}) for row in good.curves]
    twice = good.groups[0].population.still_wanted([*good.curves, *half], 0.15)
    assert twice == pytest.approx(2 * more, abs=1)
    assert good.groups[0].population.still_wanted(half, 0.15) is None
    assert good.groups[0].population.still_wanted(good.curves, 0.95) == 0


class Wide:
    """A network that is twice as wide as it may be where the viscosity is small."""

    def __init__(self, model, material, checked):
        pass

    def infer(self, curve):
        law, allowed = np.log10([curve.meta["G"], curve.meta["mu"]]), 0.05
        half = allowed * (2.0 if law[1] < -2.0 else 1.0)
        theta = law + np.outer(np.linspace(-half, half, 201) / 0.9, [1.0, 1.0])
        return Posterior(("log10_shear_modulus", "log10_viscosity"), ("Pa", "Pa s"), theta, Checks("ok"), "nhkv", "x")


@pytest.fixture
def weak(monkeypatch):
    """The network `Wide` in the place of the shipped one, and recordings without a simulation."""

    def film(setting, family, law, stretch, medium=None, seed=0, **_):
        curve = bubble("designed", G=10.0 ** law[0], mu=10.0 ** law[1])
        return curve, {}

    monkeypatch.setattr(Setting, "film", film)
    monkeypatch.setattr(network_design, "expected", lambda *_, **__: design.Expected(np.eye(2), np.full(2, 0.05)))
    monkeypatch.setattr(network_design, "Networked", Wide)
    return load_posterior()


def test_the_range_where_a_network_is_too_wide_is_found_and_drawn_more_often(weak, run, tmp_path):
    status, out, err = run("design", "--for-training", "posterior", "--recordings", 60, "-o", "weak")
    assert status == 0, err
    made = cavirheo.load(tmp_path / "weak" / "network-design.json")
    worst = made.ranges[made.worst]
    assert (worst.parameter, worst.low) == ("viscosity", pytest.approx(1e-4))
    assert worst.width_ratio == pytest.approx(2.0, rel=0.02)
    others = [one.width_ratio for one in made.ranges if one.parameter == "viscosity" and one is not worst]
    assert max(others) < 1.5
    assert made.recordings == 60
    assert "viscosity" in out
    found = read_recipe(tmp_path / "weak" / "recipe.toml")
    assert found.posterior.more.ranges["viscosity"] == pytest.approx((worst.low, worst.high), rel=1e-5)
    assert {law for law, _, _ in found.posterior.kinds} == {law for law, _ in weak.card.kinds}
    low, high = found.posterior.more.ranges["viscosity"]
    share = {}
    for often in (None, found.posterior.more):
        draws = [_drawn_viscosity(found, k, often) for k in range(400)]
        share[often is None] = np.mean([low <= mu <= high for mu in draws if mu])
    assert share[True] == pytest.approx(1 / 3, abs=0.08)
    assert share[False] == pytest.approx(0.5 + 0.5 / 3, abs=0.08)


def _drawn_viscosity(recipe, index, often):
    """Of curve `index` of a training set; none for a law without."""
    seen = []

    def simulate(material, **_):
        seen.append(getattr(material, "viscosity", None))
        raise InputError("not simulated")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training_curves, "simulate", simulate)
        training_curves.simulated_curve(recipe.posterior.model_copy(update={"more": often}), 5, index)
    return seen[0]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("share = 0.5\nnothing = [1, 2]", "nothing"),
        ("share = 0.5\nviscosity = [2, 1]", "viscosity"),
        ("share = 0.5\nviscosity = [1e-9, 1]", "viscosity"),
        ("share = 0.5\nviscosity = 1", "viscosity"),
        ("share = 2\nviscosity = [0.1, 1]", "share"),
    ],
)
def test_a_recipe_draws_more_only_from_what_it_draws(tmp_path, text, told):
    recipe = (ROOT / "recipes/posterior.toml").read_text()
    (tmp_path / "r.toml").write_text(recipe.replace("[data]", f"[posterior.more]\n{text}\n\n[data]"))
    with pytest.raises(InputError, match=told):
        read_recipe(tmp_path / "r.toml")


def test_a_network_is_not_looked_at_without_a_law_or_beside_a_result(run):
    for words in (
        ("--for-training", "bdt-viscous"),
        ("--for-training", "posterior", "--material", "gent"),
        ("x", "--for-training", "posterior"),
    ):
        status, _, err = run("design", *words, "-o", "w")
        assert status == 2, err
        assert err.startswith("error: ")
