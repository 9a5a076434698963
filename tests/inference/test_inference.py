"""The paper's network on shots of known truth, the true scale, every way to fail, and input warnings."""

import re
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from answers import fit, simulated
from conftest import BDT, EXAMPLE, ROOT, WATER, code_of, rows_of
from files import write_curve

import cavirheo
from cavirheo import Bubble, Medium, NeoHookeanKelvinVoigt, Newtonian, RadiusCurve, predict_radius, read_curves
from cavirheo.inference import input_warnings

infer = partial(cavirheo.infer, model="bdt-viscoelastic")
infer_many = partial(cavirheo.infer_many, model="bdt-viscoelastic")
GEL = NeoHookeanKelvinVoigt(3e3, 0.05)


def shot(G=8e3, mu=0.05, **given) -> RadiusCurve:
    return simulated(NeoHookeanKelvinVoigt(G, mu), **{"frames": 140, "stated_time_of_max": 0.0, **given})


@pytest.mark.slow
def test_frames_after_the_window_lie_where_the_draws_predict_them():
    truth = shot()
    cut = shot(noise=0.01).window(collapses=1)
    answer = cavirheo.infer(cut, material="nhkv", bubble="field", trust_input=True)
    later = truth.time > cut.time[-1]
    mean, low, high = predict_radius(answer, truth.time[later])
    for lost in (1.0, 0.95):  # also of a bubble that loses more in a collapse than any law here
        assert np.mean((low < lost * truth.radius[later]) & (lost * truth.radius[later] < high)) > 0.8
    assert np.sqrt(np.mean((mean - truth.radius[later]) ** 2)) < 0.05 * cut.max_radius
    assert code_of(predict_radius, replace(answer, curve=None), truth.time) == "predict.draws"


@pytest.mark.parametrize("file", ["soft_gel.csv", "stiff_gel.mat"])
def test_shipped_examples_give_back_their_truth(file):
    truth = [row for row in rows_of(ROOT / "examples" / "truth.csv") if row["set"] == Path(file).stem]
    answers = infer_many(read_curves(ROOT / "examples" / file))
    assert [a.checks.verdict for a in answers] == ["unverified"] * len(truth)
    for name, unit, close in (("shear_modulus", "Pa", 0.15), ("viscosity", "Pa_s", 0.2)):
        found = np.mean([one.median(name) for one in answers])
        assert found == pytest.approx(float(truth[0][f"{name}_{unit}"]), rel=close)
    assert [one.stretch for one in answers] == pytest.approx([float(row["stretch"]) for row in truth], rel=0.08)
    assert max(a.checks.rmse_over_rmax for a in answers) < 0.03
    assert [a.interval("G") for a in answers] == [None] * len(truth)


@pytest.mark.parametrize("max_radius", [210e-6, 300e-6])
@pytest.mark.parametrize("medium", [WATER, Medium(density=1100.0, sound_speed=1600.0, surface_tension=0.06)])
def test_the_medium_and_small_changes_of_size_enter(max_radius, medium):
    """Equal Cauchy and Reynolds numbers carry the answer over where surface tension and heat change little."""
    time = np.arange(0.0, 5 * medium.time_scale(max_radius), 0.25e-6)
    curve = shot(max_radius=max_radius, time=time, medium=medium)
    answer = infer(curve, medium=medium)
    assert answer.checks.verdict == "unverified"
    assert answer.median("shear_modulus") == pytest.approx(8e3, rel=0.1)
    assert answer.median("viscosity") == pytest.approx(0.05, rel=0.2)


STATED = {  # what a file states, what is given, the density that is used, and codes of messages
    "the file": ({"density": 1060.0}, {}, 1060.0, ["stated.used"]),
    "a medium that is given": ({"density": 1060.0}, {"medium": "water"}, 998.0, ["stated.replaced"]),
    "a given one for no density": ({"density": 1.06}, {"medium": Medium(1100.0)}, 1100.0, ["stated.replaced"]),
    "nothing": ({}, {}, 998.0, []),
    "a boiling liquid": ({"temperature": 390.0}, {}, 998.0, ["physics.boiling"]),
}


@pytest.mark.parametrize("name", STATED)
def test_the_constants_that_a_file_states_are_those_of_its_shot(name):
    stated, given, density, codes = STATED[name]
    curve = read_curves(EXAMPLE)[0].labelled(medium=stated)
    plain, answer = infer_many([curve.labelled(medium={}), curve], workers=1, **given)
    assert answer.medium.density == density
    families = ("stated", "check_input", "physics")
    assert [one.code for one in answer.checks.messages if one.code.partition(".")[0] in families] == codes
    assert plain.checks.verdict != "failed"
    (impossible,) = infer_many([curve.labelled(medium={"density": 1.06})], workers=1)
    assert impossible.checks.verdict == "failed"
    assert re.search("1060.*--density", impossible.checks.messages[0].text)
    analysis = cavirheo.inference.Analysis(**given)
    assert (analysis.key(curve) == analysis.key(curve.labelled(medium={}))) == (not stated)


STRETCHES = [(8.0, {}, False), (4.0, {}, True), (None, {"stretch": 4.0}, True), (4.0, {"stretch": "free"}, False)]


@pytest.mark.parametrize(("stated", "given", "contradicts"), STRETCHES)
def test_a_stretch_that_contradicts_the_late_plateau_is_doubted(stated, given, contradicts):
    curve = read_curves(EXAMPLE)[0].labelled(stretch=stated)  # its late radius is R_max/8.8
    messages = cavirheo.fit(curve, "nhkv", window=1, **given).checks.messages
    assert ("check_input.stretch" in [message.code for message in messages]) == contradicts


@pytest.mark.parametrize(("radius", "time"), [(2.0, 1.0), (0.36, 1.0), (1.0, 1e-3), (1.0, 2.0)])
def test_a_wrong_scale_or_rate_is_no_ok(run, tmp_path, radius, time):
    """Diameters, pixels, ms as us, half the frame rate."""
    curve = read_curves(EXAMPLE)[0]
    wrong = replace(curve, time=curve.time * time, radius=curve.radius * radius)
    write_curve(tmp_path / "wrong.csv", wrong)
    status, _, _ = run("infer", *BDT, tmp_path / "wrong.csv", "-o", "out")
    document = cavirheo.load("out")
    assert document.curves[0].verdict in (("failed",) if time < 1 else ("failed", "check_input"))
    assert "Rayleigh" in document.curves[0].message
    assert (status, document.groups[0].n_counted) == (1, 0)


def recorded(law, stretch, max_radius=250e-6, *, start=0.0, periods=5.0, frames=80, noise=0.006, seed=0, **bubble):
    """A recording of so many first collapses and frames, from `start` of the first collapse after R_max on."""
    elastic = (2.5 - 2.8 / stretch) * getattr(law, "shear_modulus", 0.0) / WATER.pressure
    first = 0.9147 * WATER.time_scale(max_radius) / np.sqrt(1.0 + elastic)
    about = {"max_radius": max_radius, "stretch": stretch, "noise": noise, "seed": seed, "within": Bubble(**bubble)}
    curve = simulated(law, time=first * np.linspace(start, periods, frames), **about)
    return RadiusCurve(curve.time, np.maximum(curve.radius, 1e-7))


def gel(seed, stiff):
    """A gel of any size, viscosity, frame rate and noise, recorded from R_max on, and its stretch."""
    random = np.random.default_rng(seed)
    modulus, stretch = (10 ** random.uniform(5.0, 6.5), 1.3) if stiff else (10 ** random.uniform(2.7, 4.7), 4.0)
    stretch += random.uniform(0.0, 1.7 if stiff else 6.0)
    law = NeoHookeanKelvinVoigt(modulus, 10 ** random.uniform(-2.0, -0.8))
    settings = {"periods": random.uniform(2.5, 8.0), "frames": random.integers(40, 150), "seed": seed}
    kinetic = {"contents": "kinetic", "accommodation": 10 ** random.uniform(-1.5, 0.0), "confinement_damping": 0.2}
    size, noise = 10 ** random.uniform(-4.3, -3.4), random.uniform(0.003, 0.01)
    return recorded(law, stretch, size, noise=noise, **settings, **(kinetic if seed % 2 else {}))


def test_a_recording_that_starts_at_the_maximum_is_no_doubt():
    """The twelve of a group count, whatever a frame would change in their answers."""
    soft = [recorded(GEL, 7.0, noise=0.008, seed=seed) for seed in range(12)]
    stated = simulated(stated_time_of_max=0.0), simulated(maximum=(0.0, 250e-6)), *read_curves(EXAMPLE)
    assert [curve.begins_late for curve in (*soft, *stated)] == [True] * 12 + [False] * len(stated)
    assert [answer.checks.warnings for answer in infer_many(soft)] == [()] * 12
    answer = fit(soft[0])
    assert (answer.checks.warnings, answer.checks.verdict) == ((), "ok")


def doubts(curve) -> list[str]:
    return [one.code.removeprefix("check_input.") for one in input_warnings.curve_warnings(curve, WATER)]


def test_frames_that_stand_several_times_or_backwards_or_come_at_another_rate_are_a_doubt():
    """As a camera or an export repeats them: on a longer clock, or in place of every second frame."""
    curve = recorded(GEL, 7.0, frames=100)
    half = replace(curve, radius=np.repeat(curve.radius[::2], 2))
    thrice = RadiusCurve(1e-6 * np.arange(300), np.repeat(curve.radius, 3))
    some = replace(curve, radius=curve.radius[np.floor(0.85 * np.arange(100)).astype(int)])
    rounded = replace(half, radius=np.round(half.radius, 6))
    assert all("frames_repeated" in doubts(one) for one in (half, thrice, some, rounded))
    assert infer(half).checks.verdict == "check_input"
    backwards = replace(curve, radius=curve.radius[::-1])
    assert infer(backwards).checks.verdict in ("check_input", "does_not_fit", "failed")
    assert [doubts(curve.labelled(frame_rate_hz=k / np.diff(curve.time)[0])) for k in (1, 0.1)] == [[], ["rate_unused"]]


@pytest.mark.parametrize("frames", [40, 100, 300])
def test_a_rounded_recording_is_no_doubt(frames):
    for step, noise in product((1e-6, 2.76e-6, 1e-5), (0.0, 0.006, 0.03)):
        curve = recorded(GEL, 7.0, frames=frames, noise=noise)
        rounded = replace(curve, radius=np.maximum(np.round(curve.radius / step), 1.0) * step)
        assert "frames_repeated" not in doubts(rounded)


def test_a_maximum_that_was_missed_is_a_doubt():
    """Nearly half of the fall to the first collapse is not recorded: no clock within a frame holds that."""
    late = recorded(GEL, 7.0, start=0.4, frames=150, noise=0.003)
    assert late.frames_missed == pytest.approx(0.4 / (4.6 / 149), rel=0.4)
    assert recorded(GEL, 7.0, frames=150, noise=0.003).frames_missed == 0.0
    doubtful, trusted = infer(late), infer(late, trust_input=True)
    assert doubtful.checks.verdict == "check_input" != trusted.checks.verdict
    assert doubtful.checks.warnings == trusted.checks.warnings
    assert np.array_equal(doubtful.theta, trusted.theta)


def test_stiffening_that_a_late_start_feigns_is_said():
    """The same shot (the truth does not stiffen), whole and from 8 us after R_max on."""
    whole = read_curves(EXAMPLE)[0]
    kept = whole.time >= whole.time_of_max + 8e-6
    late = RadiusCurve(whole.time[kept], whole.radius[kept])
    said = [[message.code for message in cavirheo.infer(curve).checks.messages] for curve in (late, whole)]
    assert ["stiffening.late_start" in codes for codes in said] == [True, False]


def test_stiff_gels_are_told_from_soft_ones_misread():
    """Radii doubled, or the frame interval wrong by two; a few recordings show too little to tell."""
    stiff, soft = ([gel(seed, kind) for seed in range(30)] for kind in (True, False))
    wrong = zip(soft, [(2.0, 1.0), (1.0, 2.0), (1.0, 0.5)] * 10, strict=True)
    misread = [RadiusCurve(curve.time * time, curve.radius * radius) for curve, (radius, time) in wrong]
    of_stiff, of_misread, of_soft = (sum(bool(doubts(one)) for one in curves) for curves in (stiff, misread, soft))
    assert (of_stiff <= 1, of_misread >= 27, of_soft) == (True, True, 0)


@pytest.mark.parametrize(("scale", "factor"), [(2.0, 2.0), (0.4, 2.5)])
def test_the_doubt_of_a_scale_says_how_far_it_is_off(scale, factor):
    curve = recorded(NeoHookeanKelvinVoigt(8e3, 0.05), 7.0)
    (said,) = input_warnings.curve_warnings(RadiusCurve(curve.time, scale * curve.radius), WATER)
    assert 0.95 * said.parameters["factors"][0] <= factor <= 1.05 * said.parameters["factors"][-1]
    assert ("too large" in said.text) == (scale > 1.0)
    assert "--rmax-um" in said.text


def test_no_open_recording_is_doubted_but_the_one_of_a_wrong_scale(real_data):
    for path in sorted([*real_data.glob("[!c]*/*.mat"), *real_data.glob("water_laser/*.csv")]):  # not collapse_times
        for curve in read_curves(path, density=1025.0 if "agarose_2p5" in str(path) else 998.0):
            assert bool(doubts(curve)) == ("WRONG_SCALE" in path.name), curve.name


def test_a_first_collapse_alone_does_not_tell_the_viscosity_of_a_liquid():
    """In water it asked for up to ninety times the viscosity: walls and sound of the vessel lengthen it, too."""
    whole = simulated(Newtonian(0.03), frames=130, stated_time_of_max=0.0)
    seen = whole.time < whole.collapse_times()[0] + 2.5e-6
    fall = RadiusCurve(whole.time[seen], whole.radius[seen], stated_time_of_max=0.0)

    def doubted(curve, law="newtonian", **around):
        answer = cavirheo.infer(curve, material=law, window=1, bubble=Bubble(**around))
        return "check_input.no_rebound" in [one.code for one in answer.checks.messages]

    assert doubted(fall)
    assert not doubted(whole)
    assert not doubted(fall, "nhkv")
    assert not doubted(fall, confinement_damping=0.3)


def test_a_modulus_beyond_all_soft_matter_is_a_doubt():
    """Compressed contents of a bubble in water at 30 MPa answered 6 MPa and 1 Pa s."""
    deep = Medium(pressure=3e7, density=1010.0, sound_speed=1531.0)
    stiff = simulated(NeoHookeanKelvinVoigt(3e7, 0.3), max_radius=140e-6, stretch=2.0, medium=deep, noise=0.005,
                      frame=5e-8, frames=60, stated_time_of_max=0.0)  # fmt: skip
    answer = cavirheo.infer(stiff, medium=deep, material="nhkv", bubble="field")
    assert (answer.checks.verdict, answer.bound("G")) == ("check_input", "lower")
    assert "check_input.stiffness" in [one.code for one in answer.checks.messages]
