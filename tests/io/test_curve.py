"""RadiusCurve on shots whose maximum, collapses and plateau are known."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import WATER, code_of, error_of, slow
from scipy.integrate import solve_ivp

from cavirheo import RadiusCurve

R_MAX = 250e-6
T_C = WATER.time_scale(R_MAX)


@cache
def shot(reynolds=100.0, cauchy=20.0, stretch=8.0):
    """(R*(t*), t* of the first collapse) of a gas bubble in a Kelvin-Voigt gel, at rest at R* = 1, t* = 0."""

    def rates(t, state):
        r, u = state
        q = 1.0 / (stretch * r)
        stress = -(5.0 - 4.0 * q - q**4) / (2.0 * cauchy) - 4.0 * u / (reynolds * r)
        return [u, ((r**-4.2 / stretch**3 - 1.0 + stress) / r - 1.5 * u * u / r)]

    options = {"rtol": 1e-9, "atol": 1e-11, "dense_output": True}
    later, earlier = (solve_ivp(rates, (0.0, end), [1.0, 0.0], **options).sol for end in (8.0, -0.7))
    fine = np.linspace(0.0, 3.0, 60001)
    first = fine[np.argmax(np.diff(later(fine)[0]) > 1e-12)]
    return (lambda t: np.where(t < 0, earlier(np.minimum(t, 0.0))[0], later(np.maximum(t, 0.0))[0])), float(first)


def measured(start=-0.7, end=6.0, step=0.04, noise=0.0, seed=0, **material):
    """A recording from `start` to `end` (in t_c after R_max) every `step`; noise as a fraction of R_max."""
    random = np.random.default_rng(seed)
    t = np.arange(start + step * random.uniform(), end, step) if start < 0 else np.arange(start, end, step)
    r = shot(**material)[0](t) + noise * random.standard_normal(len(t))
    return RadiusCurve(t * T_C, np.where(r > 0, r, np.nan) * R_MAX)


@pytest.mark.parametrize("noise", [0.003, slow(0.008), 0.025])
@pytest.mark.parametrize("start", [-0.7, -0.25, -0.15, 0.0])
def test_the_time_of_the_maximum_lies_between_those_that_the_frames_leave_possible(start, noise):
    """A recording that begins up to a quarter of t_c before R_max shows no growth beyond 3 %."""
    curves = [measured(start, step=0.04, noise=noise, seed=seed) for seed in range(20)]
    spans = np.array([curve.time_of_max_span for curve in curves]) / T_C
    assert np.mean((spans[:, 0] <= 0.02) & (spans[:, 1] >= -0.02)) > 0.95
    assert np.median(np.diff(spans)) < 0.05 + 25 * noise
    assert np.quantile(np.diff(spans), 0.95) < 0.1 + 25 * noise
    error = np.array([curve.time_of_max for curve in curves]) / T_C
    assert start == -0.15 or np.sqrt(np.mean(error**2)) < 7.5 * noise  # from there on, the first frame may be it


@pytest.mark.parametrize("step", [0.04, 0.1])
@pytest.mark.parametrize("start", [-0.7, 0.0])
@pytest.mark.parametrize("material", [{"reynolds": 1000.0, "cauchy": 1000.0}, {}, {"reynolds": 20.0, "stretch": 5.0}])
def test_maximum_and_first_collapse_at_half_a_percent_noise(step, start, material):
    curves = [measured(start, step=step, noise=0.005, seed=seed, **material) for seed in range(40)]
    radius_error = np.array([c.max_radius for c in curves]) / R_MAX - 1.0
    time_error = np.array([c.time_of_max for c in curves]) / T_C
    collapse_error = np.array([c.collapse_times()[0] for c in curves]) / T_C - shot(**material)[1]
    assert np.std(radius_error) < 0.0035
    assert abs(np.mean(radius_error)) < 0.0015
    assert np.sqrt(np.mean(time_error**2)) < 0.009
    assert np.sqrt(np.mean(collapse_error**2)) < 0.2 * step


@pytest.mark.parametrize("factor", [0.5, 0.95, 1.05, 1.6])
@pytest.mark.parametrize("frame", [0, 3])
@pytest.mark.parametrize("start", [-0.7, 0.0])
def test_one_bad_frame_near_the_maximum_does_not_decide(start, factor, frame):
    curve = measured(start, noise=0.002)
    radius = curve.radius.copy()
    radius[np.argmin(np.abs(curve.time)) + frame] *= factor
    assert RadiusCurve(curve.time, radius).max_radius == pytest.approx(R_MAX, rel=0.005)


def test_another_bubble_a_late_drift_and_a_stated_time_of_the_maximum():
    first, second = measured(start=0.0, end=4.0), measured(start=-0.7, end=4.0)
    after = first.time[-1] + 0.04 * T_C + second.time - second.time[0]
    both = RadiusCurve(np.append(first.time, after), np.append(first.radius, 0.9 * second.radius))
    assert both.max_radius == pytest.approx(R_MAX, rel=1e-3)
    assert after[0] - 0.6 * T_C < both.drifts_from < after[0] + 0.2 * T_C
    curve = measured(end=8.0)
    t = curve.time / T_C
    drifting = RadiusCurve(curve.time, curve.radius + np.where(t > 3.0, (t - 3.0) * 0.3 * R_MAX, 0.0))
    assert np.nanmax(drifting.radius) > 1.3 * R_MAX
    assert drifting.max_radius == pytest.approx(R_MAX, rel=1e-3)
    assert drifting.stretch_from_tail() is None
    t = 0.02 + np.arange(0.0, 5.0, 0.04)
    late = RadiusCurve(t * T_C, shot()[0](t) * R_MAX, stated_time_of_max=0.0)
    assert (late.time_of_max, late.max_radius) == (0.0, pytest.approx(R_MAX, rel=3e-4))


NO_MAXIMUM = [
    ("few_frames", [1.0, 0.9, 0.5]),
    ("few_frames", [np.nan] * 20),
    ("few_frames", []),
    ("grows", np.linspace(0.2, 1.0, 30)),
    ("never_falls", 1.0 - 0.05 * np.linspace(-1.0, 1.0, 30) ** 2),
    ("never_falls", np.ones(30)),
]


@pytest.mark.parametrize(("code", "radius"), NO_MAXIMUM)
def test_a_maximum_that_cannot_be_determined_is_refused_with_the_reason(radius, code):
    curve = RadiusCurve(np.arange(len(radius)) * 1e-6, np.array(radius) * R_MAX, meta={"name": "shot 7"})
    for use in (lambda: curve.max_radius, lambda: curve.resampled(1e-6), curve.collapse_times, curve.strain_rate):
        error = error_of(use)
        assert (error.code, "shot 7" in str(error)) == (f"curve.{code}", True)
    assert "no R_max" in repr(curve)


def test_collapses_are_found_in_order_and_not_in_noise_spikes_or_a_creeping_bubble():
    curve = measured()
    truth, noisy = curve.collapse_times(), measured(noise=0.01).collapse_times()
    assert len(truth) >= 4
    assert np.allclose(noisy[:2], truth[:2], atol=0.04 * T_C)
    assert np.all(np.diff(noisy) > 0)
    radius = curve.radius.copy()
    frames = [int(np.argmin(np.abs(curve.time - t * T_C))) for t in (0.05, 0.6, 2.0)]
    radius[frames] += 0.5 * R_MAX
    spiking = RadiusCurve(curve.time, radius)
    assert spiking.spikes() == frames
    assert np.allclose(spiking.collapse_times(), truth, atol=0.002 * T_C)
    creeping = measured(start=0.0, reynolds=1.0, stretch=5.0, noise=0.003)
    assert (len(creeping.collapse_times()), creeping.rayleigh_ratio()) == (0, None)
    assert creeping.resampled(1e-6, 100)[-1] < 0.5 * R_MAX
    for use in (creeping.strain_rate, lambda: creeping.window(collapses=1)):
        assert code_of(use) == "curve.collapses"


@pytest.mark.parametrize("digit", [2e-6, 5e-6, 2e-5])
def test_the_noise_of_rounded_radii_is_at_least_that_of_the_rounding(digit):
    curve = measured(start=0.0, noise=1e-4)
    rounded = RadiusCurve(curve.time, np.maximum(np.round(curve.radius / digit), 1.0) * digit)
    missed = float(np.std(rounded.radius - curve.radius))
    assert 0.8 * missed < rounded.noise < 2.5 * missed
    assert curve.noise < 4e-4 * R_MAX


def test_strain_rate_is_the_mean_of_two_u_over_r():
    gentle = {"reynolds": 20.0, "stretch": 4.0}
    curve = measured(step=0.002, **gentle)
    t = np.linspace(0.0, shot(**gentle)[1], 20001)
    r = shot(**gentle)[0](t)
    mean = np.trapezoid(np.abs(2.0 * np.gradient(r, t) / r), t) / t[-1]
    assert curve.strain_rate() * T_C == pytest.approx(mean, rel=0.01)


def test_noise_does_not_decide_which_frame_a_window_ends_with():
    """The largest frame of a rebound is too large: by one standard deviation of the noise in the mean."""
    exact, noise = measured(), 0.01
    for collapses in (1, 2, 3):
        last = []
        for seed in range(50):
            error = noise * R_MAX * np.random.default_rng(seed).standard_normal(len(exact.time))
            curve = RadiusCurve(exact.time, exact.radius + error)
            last.append(error[curve.time == curve.window(collapses).time[-1]][0])
        assert abs(np.mean(last)) < 4.0 * noise * R_MAX / np.sqrt(50.0)


def test_window_ends_at_the_rebound_after_the_collapses_and_keeps_the_maximum():
    curve = measured()
    one, two = curve.window(1), curve.window(2)
    collapses = curve.collapse_times()
    assert collapses[0] < one.time[-1] < collapses[1] < two.time[-1] < collapses[2]
    assert abs(np.gradient(curve.radius, curve.time)[curve.time == one.time[-1]][0]) < 0.1 * R_MAX / T_C
    assert (one.max_radius, one.time_of_max) == (curve.max_radius, curve.time_of_max)
    assert one.time[0] >= curve.time_of_max
    assert curve.window(2, end=1e-5).time[-1] <= curve.time_of_max + 1e-5


def test_max_radius_given_by_the_user_scales_the_radii_and_says_so():
    curve = measured(noise=0.005)
    pixels = RadiusCurve(curve.time, curve.radius / 2.76, curve.radius / 276, unscaled="the radius is in pixels")
    assert code_of(lambda: pixels.max_radius) == "curve.unscaled"
    scaled = pixels.with_max_radius(R_MAX)
    assert scaled.max_radius == R_MAX
    assert np.allclose(scaled.radius, curve.radius * R_MAX / curve.max_radius, equal_nan=True)
    assert np.allclose(scaled.radius_std, scaled.radius / 100, equal_nan=True)
    assert scaled.time_of_max == pytest.approx(curve.time_of_max, abs=1e-12)
    assert "R_max set to 250 um" in scaled.notes[-1]
    assert code_of(lambda: curve.with_max_radius(-1.0)) == "curve.max_radius"


def test_stretch_from_the_plateau_only_where_there_is_one():
    stretch = 6.0
    # at rest the gas pressure balances: R_0 is the plateau of this model up to its gas content
    long = measured(end=8.0, reynolds=15.0, stretch=stretch)
    value, deviation = long.stretch_from_tail()
    level = shot(reynolds=15.0, stretch=stretch)[0](np.array([7.9]))[0]
    assert value == pytest.approx(1.0 / level, rel=0.03)
    assert 0.0 < deviation < 0.06 * value
    assert measured(end=2.5, reynolds=15.0, stretch=stretch).stretch_from_tail() is None  # too short
    assert measured(end=8.0, reynolds=1000.0, cauchy=1000.0).stretch_from_tail() is None  # still oscillating


def test_rayleigh_ratio_is_the_time_of_the_first_collapse_over_that_of_an_empty_bubble():
    curve = measured()
    scaled = RadiusCurve(curve.time, curve.radius * 2.5)
    assert scaled.rayleigh_ratio() == pytest.approx(shot()[1] / 0.9147 / 2.5, rel=5e-3)
    assert scaled.rayleigh_ratio(4.0 * 998.0) == pytest.approx(0.5 * scaled.rayleigh_ratio())
    assert replace(curve, unscaled="in pixels").rayleigh_ratio() is None


BAD = [
    ("time", [0.0, 1.0, 1.0], [1.0] * 3),
    ("time", [0.0, np.nan, 1.0], [1.0] * 3),
    ("radius", [0.0, 1.0], [1.0, -1.0]),
    ("radius", [0.0, 1.0], [1.0, np.inf]),
    ("radius", [0.0, 1.0], np.array([1.0, 1.0 + 0.1j])),
]


@pytest.mark.parametrize(("code", "time", "radius"), BAD)
def test_arrays_that_make_no_curve_are_refused(time, radius, code):
    assert code_of(RadiusCurve, time, radius) == f"curve.{code}"
