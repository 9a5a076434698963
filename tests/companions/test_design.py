"""`cavirheo design`: expected intervals of shots that were not taken, and how many are needed."""

from dataclasses import replace

import numpy as np
import pytest
from answers import CENTRE, bubble, document_of, seen, shots, with_verdict
from conftest import done, error_of, refused
from scipy.stats import norm

import cavirheo
from cavirheo import Rig
from cavirheo.inference import design
from cavirheo.inference.assumptions import Family
from cavirheo.reporting import write_report

NORMAL_90 = norm.ppf(0.95)
NHKV = Family("nhkv")
LAW = np.log10([[6e3, 0.05]])
GOOD = design.Setting(250e-6, 1e6, 2.5e-6, frames=120)


def one(seed: int = 0) -> design.Draws:
    return design.Draws(NHKV, LAW, np.array([6.0]), seed=seed)


def told(setting: design.Setting) -> design.Expectation:
    ((found,),) = one().expectations([setting])
    return found


def test_a_film_shows_the_bubble_that_is_asked_for_and_tells_more_with_less_noise_and_more_frames():
    ((curve, truth),) = one(3).films(GOOD)
    assert truth["shear_modulus"] == pytest.approx(6e3)
    assert (len(curve.time), curve.max_radius) == (120, pytest.approx(250e-6, rel=0.03))
    assert np.array_equal(curve.radius, one(3).films(GOOD)[0].curve.radius)
    how = ((1e6, 1.7e-6), (2.5e5, 3.7e-6), (1e6, 7.5e-6))
    good = told(GOOD)
    quiet, slow, loud = (told(design.Setting(250e-6, rate, noise, frames=120)) for rate, noise in how)
    assert np.all(quiet.half_width < loud.half_width)
    assert np.all(good.half_width < slow.half_width)
    assert np.linalg.det(good.information) > np.linalg.det(loud.information)
    assert one().films(design.Setting(400e-6, 1e6, 4e-6, frames=10)) == [None]  # it ends before R_max


ABOUT = np.diag([100.0, 400.0])
RANGES = {"shear_modulus": (2e3, 2e4), "viscosity": (0.02, 0.2), "stretch": (5, 8)}


@pytest.fixture
def quick(monkeypatch):
    """Settings whose information grows with R_max and frame rate, without a simulation."""

    def expected(draws, setting):
        information = ABOUT * (setting.max_radius / 1e-4) ** 2 * setting.frame_rate / 1e6
        told = design.Expectation(information, NORMAL_90 / np.sqrt(np.diag(information)))
        return [told if setting.frame_rate > 1.5e5 else None] * len(draws.law)

    monkeypatch.setattr(design.Draws, "expectations", lambda draws, all, _: [expected(draws, one) for one in all])
    monkeypatch.setattr("cavirheo.companions.design.DRAWS", 40)


def test_the_best_setting_and_its_shots(quick):
    made = cavirheo.design(ranges=RANGES, rig=Rig((1e-4, 4e-4), (1e5, 1e6)))
    best = made.settings[made.next]
    assert (best.max_radius_m, best.frame_rate_hz) == (pytest.approx(4e-4), 1e6)
    sigma = np.log10(1.1) / NORMAL_90
    assert best.shots == int(np.ceil((1 / sigma**2 - 12.0) / (100.0 * 16)))  # 12: of a decade, drawn evenly
    assert ([one.readable for one in made.settings], made.settings[0].shots) == ([0] * 5 + [1] * 5, None)
    assert made.known["shear_modulus"].median == pytest.approx(6.3e3, rel=0.3)


def shot(G: float, mu: float, group="x"):
    """A curve and an answer in a dense gel whose intervals are 0.1 decades wide to both sides."""
    answer = replace(seen(np.log10([G, mu]), 0.1 / NORMAL_90, 2000), medium=cavirheo.Medium(density=1050))
    return bubble("shot", group=group, source=group), answer


def test_what_is_known_is_the_answer_of_the_group(quick):
    """Of a single shot here; of several that of their population, below."""
    curve, gel = shot(5e3, 0.05)
    made = cavirheo.design(document_of([(curve, gel)]))
    assert (made.shots_before, made.medium.density, {*made.spreads_decades.values()}) == (1, 1050, {0.0})
    assert made.known["shear_modulus"].median == pytest.approx(5e3, rel=0.02)
    assert np.log10(made.known["shear_modulus"].q95 / 5e3) == pytest.approx(0.1, rel=0.15)
    narrow = cavirheo.design(document_of([(curve, gel)]), ranges={"stretch": (5, 8)})
    assert narrow.known["shear_modulus"] == made.known["shear_modulus"]  # a range of the stretch tells nothing of it
    for low, high, bound, top in ((1.0, 3.3, "upper", 2e3), (1.0, 2.05, "upper", 330), (6.5, 7.0, "lower", 1e7)):
        theta = np.column_stack([np.linspace(low, high, 2000), gel.theta[:, 1]])
        bounded = document_of([(curve, replace(gel, theta=theta))])
        other = cavirheo.design(bounded, Rig(medium="water"))
        assert 100.0 < (G := other.known["shear_modulus"]).q05 < G.q95 / 2.0 < top / 2.0  # what infer searches
        assert bounded.curves[0].shear_modulus_Pa.bound == bound
        assert ["draws it from " in other.notes[0], "density" in other.notes[-1]] == [True, True]
    two = document_of([(curve, gel), shot(9e5, 0.05, "y")])
    assert cavirheo.design(two, group="y").known["shear_modulus"].median == pytest.approx(9e5, rel=0.02)
    with refused("design.range", "a range of shear_modulus", "one of them"):
        cavirheo.design(two, group="y", ranges={"G": (1e3, 1e4)})
    for name in (None, "z"):
        with refused("design.groups", "--group", "x, y"):
            cavirheo.design(two, group=name)
    for pairs in ([(curve, with_verdict(gel, "does_not_fit"))], [(curve, gel)] * 2):  # two shots are no population
        with refused("design.no_answer", "give ranges"):
            cavirheo.design(document_of(pairs))
    usual = document_of([(curve, replace(gel, material="auto"))])  # what infer answers by default
    assert cavirheo.design(usual).known == made.known
    usual.groups[0].population.model = "nhkv or newtonian, real"
    assert cavirheo.design(usual).known == made.known
    usual.groups[0].population.model = "newtonian or power-law, real"  # of a liquid that may thin
    with refused("design.no_answer", "n for any group", "--material newtonian"):
        cavirheo.design(usual, Rig(material="power-law"))


@pytest.mark.parametrize(("count", "advised"), [(1, True), (2, False)])
def test_no_design_is_advised_that_would_be_refused(run, tmp_path, count, advised):
    curve, gel = shot(5e3, 0.05)
    limits = np.column_stack([np.linspace(1.0, np.log10(2e3), 2000), gel.theta[:, 1]])
    pairs = [(curve, with_verdict(replace(gel, theta=limits), "bound"))] * count
    write_report(tmp_path / "result", pairs, document_of(pairs), draw=False)
    assert ("next  cavirheo design" in done(run("show", "result"))) == advised


RIGS = (
    {"max_radius": (4e-4, 1e-4)}, {"frame_rate": (0.0,)}, {"frames": 3}, {"noise": 0.0}, {"noise": 0.5},
    {"material": "jelly"}, {"material": "auto"}, {"medium": "honey"}, {"bubble": "auto"},
)  # fmt: skip
WRONG = ({"G": (2e3, 1e3)}, {"nothing": (1, 2)}, [1], {"G": (1, 2)}, {"mu": (0.1, 20)}, {**RANGES, "G": (1e3, 1e4)})
OPTIONS = (*({"ranges": one} for one in WRONG), {"wanted": 0.0}, {"wanted": "a tenth"}, {"group": "of no result"})


@pytest.mark.parametrize(("rig", "wrong"), [*((rig, {}) for rig in RIGS), *(({}, wrong) for wrong in OPTIONS)])
def test_what_cannot_be_is_refused(quick, rig, wrong):
    error_of(lambda: cavirheo.design(rig=Rig(**rig), **wrong))
    error_of(lambda: cavirheo.design(rig=5))


NARROW = ["--shear-modulus", "5000", "5100", "--viscosity", "0.05", "0.051", "--wanted-percent", 30]


@pytest.mark.parametrize(
    ("words", "shots"), [(NARROW, {0, None}), (["--wanted-percent", 0.1, "--rmax-um", "50", "200"], {None})]
)
def test_the_command_writes_a_document_that_can_be_loaded(quick, run, tmp_path, words, shots):
    """Where nothing more is needed, and where no number of shots is enough."""
    out = done(run("design", *words, "--fps", "100e3,1e6", "-o", "plan"))
    document = cavirheo.load(tmp_path / "plan")
    assert (document.notes, document.sentences[0] in out.replace("\n", " ")) == ([], True)
    assert {one.shots for one in document.settings} == shots


@pytest.mark.slow
def test_infer_reaches_what_is_expected():
    curves = [one(seed).films(GOOD)[0].curve for seed in range(8)]
    expected = np.mean([one(seed).expectations([GOOD])[0][0].half_width for seed in range(8)], axis=0)
    answers = cavirheo.infer_many(curves, material="nhkv", workers=1)
    ends = np.log10([[answer.interval(name) for name in NHKV.parameters] for answer in answers])
    assert np.mean(np.ptp(ends, axis=2), axis=0) / 2.0 == pytest.approx(expected, rel=0.35)


def test_the_scatter_of_shots_comes_from_the_population_and_is_counted(quick):
    """Shots of 0.05 decades each that scatter by 0.15: as many as are advised bring the material to its interval."""
    first = shots(8, 0.15, 0.05, seed=5)
    made = document_of([(bubble(f"shot {k}"), one) for k, one in enumerate(first)])
    record = made.groups[0].population
    plan = cavirheo.design(made, Rig((2e-4, 2e-4), (1e6,)), wanted=0.2)
    spreads = [record.spreads_decades[name].median for name in NHKV.parameters]
    assert list(plan.spreads_decades.values()) == pytest.approx(spreads)
    more = plan.settings[0].shots
    truths = CENTRE + 0.15 * np.random.default_rng(4).standard_normal((more, 2))
    rng = np.random.default_rng(6)
    later = [seen(x + 0.05 * rng.standard_normal(2), 0.05, 300, seed=100 + k) for k, x in enumerate(truths)]
    material = cavirheo.population([*first, *later])
    half = max(0.5 * np.log10(high / low) for low, high in map(material.interval, NHKV.parameters))
    assert 0.6 < half / np.log10(1.2) < 1.25
