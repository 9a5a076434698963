"""A warning on the recording or its settings decides the verdict and stands in the messages."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from answers import fit, simulated
from conftest import BDT, EXAMPLE, messages

import cavirheo
from cavirheo import Bubble, NeoHookeanKelvinVoigt, Newtonian, RadiusCurve, read_curves
from cavirheo.inference import input_checks
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.law import Family
from cavirheo.inference.options import Options
from cavirheo.io import write_csv
from cavirheo.io.shots import read_shots
from cavirheo.landmarks import RAYLEIGH
from cavirheo.physics.media import WATER
from cavirheo.reporting import read_json

infer = partial(cavirheo.infer, model="bdt-viscoelastic")
infer_many = partial(cavirheo.infer_many, model="bdt-viscoelastic")

GEL = NeoHookeanKelvinVoigt(3e3, 0.05)


def codes(messages) -> list[str]:
    return [one.code for one in messages]


@pytest.mark.parametrize(("radius", "time"), [(2.0, 1.0), (0.36, 1.0), (1.0, 1e-3), (1.0, 2.0)])
def test_a_wrong_scale_or_rate_is_no_ok(run, tmp_path, radius, time):
    """Diameters, pixels, ms as us, half the frame rate."""
    curve = read_curves(EXAMPLE)[0]
    wrong = replace(curve, time=curve.time * time, radius=curve.radius * radius)
    write_csv(tmp_path / "wrong.csv", wrong)
    status, _, _ = run("infer", *BDT, tmp_path / "wrong.csv", "-o", "out")
    document = read_json("out/result.json")
    assert document.curves[0].verdict in (("failed",) if time < 1 else ("failed", "check_input"))
    assert "Rayleigh" in document.curves[0].message
    assert (status, document.groups[0].n_trusted) == (1, 0)


def test_who_vouches_for_the_input_gets_the_verdict_and_the_doubt():
    curve = replace(read_curves(EXAMPLE)[0], warnings=messages("check the unit: it is odd", code="check_input.test"))
    doubtful, trusted = infer(curve), infer(curve, trust_input=True)
    assert (doubtful.checks.verdict, trusted.checks.verdict) == ("check_input", "ok")
    assert doubtful.checks.message == trusted.checks.message == "check the unit: it is odd"
    assert doubtful.median("shear_modulus") == trusted.median("shear_modulus")


def recorded(law, stretch, max_radius=250e-6, *, start=0.0, periods=5.0, frames=80, noise=0.006, seed=0, **bubble):
    """A recording of so many first collapses and frames, from `start` of the first collapse after R_max on."""
    elastic = (2.5 - 2.8 / stretch) * getattr(law, "shear_modulus", 0.0) / WATER.pressure
    first = RAYLEIGH * WATER.time_scale(max_radius) / np.sqrt(1.0 + elastic)
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


def repeated(curve) -> bool:
    return "check_input.frames_repeated" in codes(input_checks.plain(curve, WATER))


def test_frames_that_stand_several_times_are_a_doubt():
    """As a camera or an export repeats them: on a longer clock, or in place of every second frame."""
    curve = recorded(GEL, 7.0, frames=100)
    half = replace(curve, radius=np.repeat(curve.radius[::2], 2))
    thrice = RadiusCurve(1e-6 * np.arange(300), np.repeat(curve.radius, 3))
    some = replace(curve, radius=curve.radius[np.floor(0.85 * np.arange(100)).astype(int)])
    rounded = replace(half, radius=np.round(half.radius, 6))
    assert [repeated(one) for one in (curve, half, thrice, some, rounded)] == [False, True, True, True, True]
    assert infer(half).checks.verdict == "check_input"


@pytest.mark.parametrize("step", [1e-6, 2.76e-6, 1e-5])
@pytest.mark.parametrize("noise", [0.0, 0.006, 0.03])
def test_a_rounded_recording_is_no_doubt(step, noise):
    """Its frames are alike where the bubble is slow, round the maximum and at rest."""
    for frames in (40, 100, 300):
        curve = recorded(GEL, 7.0, frames=frames, noise=noise)
        rounded = replace(curve, radius=np.maximum(np.round(curve.radius / step), 1.0) * step)
        assert not repeated(rounded)


def test_a_recording_that_runs_backwards_is_a_doubt():
    grown = read_curves(EXAMPLE)[0]
    for curve in (recorded(GEL, 7.0, frames=100), grown):
        assert input_checks.plain(curve, WATER) == []
        backwards = replace(curve, radius=curve.radius[::-1])
        assert "check_input.frames_backwards" in codes(input_checks.plain(backwards, WATER))
    assert infer(replace(grown, radius=grown.radius[::-1])).checks.verdict in ("check_input", "failed")


def test_a_maximum_that_was_missed_is_a_doubt():
    """Nearly half of the fall to the first collapse is not recorded: no clock within a frame holds that."""
    late = recorded(GEL, 7.0, start=0.4, frames=150, noise=0.003)
    assert late.frames_missed == pytest.approx(0.4 / (4.6 / 149), rel=0.4)
    assert infer(late).checks.verdict == "check_input"
    assert infer(late, trust_input=True).checks.verdict != "check_input"
    assert recorded(GEL, 7.0, frames=150, noise=0.003).frames_missed == 0.0


def test_stiff_gels_are_told_from_soft_ones_misread():
    """Radii doubled, or the frame interval wrong by two; a few recordings show too little to tell."""
    stiff, soft = ([gel(seed, kind) for seed in range(30)] for kind in (True, False))
    wrong = zip(soft, [(2.0, 1.0), (1.0, 2.0), (1.0, 0.5)] * 10, strict=True)
    misread = [RadiusCurve(curve.time * time, curve.radius * radius) for curve, (radius, time) in wrong]

    def doubted(curves):
        return sum(bool(input_checks.plain(curve, WATER)) for curve in curves)

    assert (doubted(stiff) <= 1, doubted(misread) >= 27, doubted(soft)) == (True, True, 0)


@pytest.mark.parametrize(("scale", "factor"), [(2.0, 2.0), (0.4, 2.5)])
def test_the_doubt_of_a_scale_says_how_far_it_is_off(scale, factor):
    curve = recorded(NeoHookeanKelvinVoigt(8e3, 0.05), 7.0)
    (said,) = input_checks.plain(RadiusCurve(curve.time, scale * curve.radius), WATER)
    assert 0.95 * said.parameters["factors"][0] <= factor <= 1.05 * said.parameters["factors"][-1]
    assert ("too large" in said.text) == (scale > 1.0)
    assert "--rmax-um" in said.text


def test_no_open_recording_is_doubted_but_the_one_of_a_wrong_scale(real_data):
    for path in sorted([*real_data.glob("*/*.mat"), *real_data.glob("water_laser/*.csv")]):
        if path.parent.name == "collapse_times":
            continue
        for curve in read_curves(path, density=1025.0 if "agarose_2p5" in str(path) else 998.0):
            said = input_checks.plain(curve, WATER)
            assert bool(said) == ("WRONG_SCALE" in path.name), (curve.name, said)


def test_a_mean_of_trials_is_judged_as_a_measurement():
    """Smooth, and 1 % from any simulation: too far for a simulated curve, but less than what its trials scatter."""
    curve = recorded(NeoHookeanKelvinVoigt(8e3, 0.1), 5.0, periods=2.0, frames=200, noise=0.0)
    bent = replace(curve, radius=curve.radius * (1.0 + 0.015 * np.sin(np.linspace(0.0, 9.0, 200))))
    mean = replace(bent, radius_std=np.full(200, 0.02 * 250e-6))
    assert bent.noise < 1e-4 * bent.max_radius
    exact, measured = (fit(one, window=1).checks for one in (bent, mean))
    assert exact.verdict == "model_does_not_fit"
    assert 0.001 < measured.rmse_over_rmax < 0.03
    assert measured.verdict == "ok"


def test_a_single_wrong_frame_is_a_doubt_where_it_decides():
    curve = simulated(GEL, frames=130, stated_time_of_max=0.0)
    radius = curve.radius.copy()
    radius[int(RAYLEIGH * WATER.time_scale(250e-6) / 1e-6)] = 0.9 * 250e-6  # where the bubble is smallest
    spiking, names = replace(curve, radius=radius), ("log10_viscosity",)
    assert "check_input.spikes" in codes(infer(spiking).checks.warnings)
    doubted = {
        factor: bool(input_checks.of_spikes(spiking, names, lambda _, f=factor: np.log10([f]), np.zeros(1)))
        for factor in (0.5, 0.9, 1.2, 2.0)
    }
    assert doubted == {0.5: True, 0.9: False, 1.2: False, 2.0: True}


def test_a_first_collapse_alone_does_not_tell_the_viscosity_of_a_liquid():
    """In water it asked for up to ninety times the viscosity: walls and sound of the vessel lengthen it, too."""
    whole = simulated(Newtonian(0.03), frames=130, stated_time_of_max=0.0)
    seen = whole.time < whole.collapse_times()[0] + 2.5e-6
    fall = RadiusCurve(whole.time[seen], whole.radius[seen], stated_time_of_max=0.0)

    def said(curve, law="newtonian", **around):
        options = Options(window=1, bubble=Bubble(**around))
        return input_checks.of_walls(Experiment(curve, Family(law), options=options))

    assert said(fall)
    assert said(whole) == said(fall, "nhkv") == said(fall, confinement_inertia="free") == []
    assert said(fall, wall_distance=1e-3) == said(fall, confinement_damping=0.3) == []
    for trusted in (False, True):
        answer = cavirheo.infer(fall, material="newtonian", bubble="field", verify="none", trust_input=trusted)
        assert (answer.checks.verdict == "check_input") == (not trusted)


def test_names_are_told_apart_by_folder(tmp_path):
    curves = read_curves(EXAMPLE)[:3]
    for place, curve in zip(("one/s1.csv", "two/s1.csv", "two/s2.csv"), curves, strict=True):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        write_csv(tmp_path / place, curve)
    files = sorted(tmp_path.glob("*/*.csv"))
    assert [one.name for one in read_shots(files).curves] == ["one/s1", "two/s1", "s2"]
    groups = {how: [one.group for one in read_shots(files, group=how).curves] for how in ("file", "folder", "none")}
    assert groups == {"file": ["s1", "s1", "s2"], "folder": ["one", "two", "two"], "none": ["one/s1", "two/s1", "s2"]}
