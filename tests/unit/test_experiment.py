"""One curve and what is assumed of it: noise, priors, exposure, means of dense frames, and the predictive check."""

from dataclasses import replace

import numpy as np
import pytest
from answers import GEL, simulated
from conftest import FIELD, REAL, refused
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.stats import multivariate_t, norm

from cavirheo import NeoHookeanKelvinVoigt, Newtonian, RadiusCurve, simulate
from cavirheo.inference.answer import REJECTED, predictive_check
from cavirheo.inference.assumptions import FREE, Family, Options
from cavirheo.inference.emulator import emulator
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.frames import MOST_FRAMES, compared_frames
from cavirheo.inference.noise import GAMMA_A, Noise
from cavirheo.prior import Prior

R_MAX = 250e-6
TRUTH = {"shear_modulus": 8e3, "viscosity": 0.05, "stretch": 7.0}


def shot(law=GEL, noise=0.01, **given) -> RadiusCurve:
    return simulated(law, max_radius=R_MAX, stretch=TRUTH["stretch"], noise=noise, maximum=(0.0, R_MAX), **given)


def experiment(curve, law="nhkv", bubble=FIELD, exposure=0.0, **given) -> Experiment:
    curve = replace(curve, meta={**curve.meta, "exposure_s": exposure})
    return Experiment(curve, Family(law), options=Options(free=tuple(FREE), bubble=bubble, **given))


@pytest.mark.parametrize("discrepancy", [False, True])
def test_variance_and_discrepancy_of_the_noise_are_integrated_out(discrepancy):
    """Against dense matrices, at irregular times: the variance is of an inverse gamma distribution."""
    rng = np.random.default_rng(1)
    time, deviation, residual = np.sort(rng.uniform(0, 4, 15)), rng.uniform(0.5, 2, 15), rng.standard_normal(15)
    velocity = rng.standard_normal(15)
    noise = Noise(deviation, time, 2.0, discrepancy, velocity)
    total = 0.0
    for (ratio, clock, tau), log_prior in zip(noise.grid, noise.log_prior, strict=True):
        kernel = np.exp(-np.abs(time[:, None] - time) / tau)
        late = 2.0 * clock * velocity
        C = np.diag(deviation**2) + np.median(deviation) ** 2 * kernel * (ratio**2 + np.outer(late, late))
        total += np.exp(log_prior) * multivariate_t.pdf(residual, shape=C, df=2 * GAMMA_A)
    assert np.sum(np.exp(noise.log_prior)) == pytest.approx(1.0)
    assert noise.log_density(residual[None])[0] == pytest.approx(np.log(total), abs=1e-6)


@pytest.mark.parametrize("discrepancy", [False, True])
def test_newton_is_the_derivative_of_the_density(discrepancy):
    rng = np.random.default_rng(2)
    noise = Noise(np.full(20, 0.01), np.arange(20.0), 5.0, discrepancy)
    residual, J = 0.02 * rng.standard_normal(20), rng.standard_normal((20, 2))
    (gradient,), (curvature,) = noise.newton(residual[None], J[None])
    step = 1e-6
    moved = [(-noise.log_density((residual - s * step * J[:, 0])[None])[0]) for s in (1, -1)]
    assert gradient[0] == pytest.approx((moved[0] - moved[1]) / (2 * step), rel=1e-4)
    assert np.all(np.linalg.eigvalsh(curvature) > 0)


def test_exposure_is_the_mean_over_the_shutter():
    there = experiment(shot(noise=0.0), exposure=0.4e-6)
    late = np.append(np.log10(list(TRUTH.values())), [0.5, 0.0, 0.0])  # the clock, by a quarter of a frame
    seen = there.predict(late)
    around = np.linspace(-0.5, 0.5, 402)[1:-1]
    instants = np.abs(there.time_since_max[:, None] - 0.25e-6 + 0.4e-6 * around).ravel()
    ordered, places = np.unique(instants, return_inverse=True)
    radius = simulate(GEL, max_radius=R_MAX, stretch=7.0, time=ordered).radius[places] / R_MAX
    brute = radius.reshape(-1, 400).mean(axis=1)
    sharp = experiment(shot(noise=0.0)).predict(late)
    assert np.max(np.abs(seen - brute)) < 5e-3
    assert np.std(sharp - brute) > 1.5 * np.std(seen - brute)
    for exposure in (-1.0, 2e-6):  # no time; longer than a frame
        with refused("experiment.exposure"):
            experiment(shot(), exposure=exposure)


@pytest.mark.parametrize("bubble", [FIELD, REAL])
@pytest.mark.parametrize("camera", [(0.0, 0.0, 0.0), (0.9, 0.0, 0.0), (0.0, 0.9, 0.0), (0.0, 0.0, 0.9)])
def test_emulated_frames_are_those_of_the_solver_with_clock_scale_and_factor(bubble, camera):
    there = experiment(shot(noise=0.003), bubble=bubble, exposure=0.4e-6)
    x = there.from_best(TRUTH | {"accommodation": 0.1, "confinement_damping": 0.2, "confinement_inertia": 0.1})
    for name, value in zip(("time_origin", "radius_scale", "max_radius_factor"), camera, strict=True):
        x[there.names.index(name)] = value
    exact = there.predict(x)[there.counted]
    assert np.sqrt(np.mean((there.emulated(x[None], emulator())[0] - exact) ** 2)) < 0.006


def test_a_real_bubble_at_the_end_of_its_switch_is_the_fields():
    """Without walls: it has equilibrium contents in an unbounded liquid, by the solver and by the emulator."""
    real, field = (experiment(shot(), bubble=bubble) for bubble in (REAL, FIELD))
    x = real.from_best(TRUTH | {"confinement_damping": 0.4, "confinement_inertia": 0.2})
    x[real.names.index("accommodation")] = np.inf
    of_field = field.from_best(TRUTH)
    assert real.predict(x) == pytest.approx(field.predict(of_field))
    ours, theirs = (one.emulated(at[None], emulator()) for one, at in ((real, x), (field, of_field)))
    assert ours == pytest.approx(theirs)


def test_priors_are_normalised_and_their_coordinates_normal():
    u = np.array([0.7])
    for low, high, mean, std in ((1.0, 3.0, 0.0, np.inf), (-1.0, 1.0, 0.2, 0.5)):
        one = Prior(("a",), [low], [high], [mean], [std])
        assert quad(lambda x, one=one: np.exp(one.log_density(np.array([x]))), low, high)[0] == pytest.approx(1.0)
        slope = (one.to_x(u + 1e-6) - one.to_x(u - 1e-6)) / 2e-6
        assert np.exp(one.log_density(one.to_x(u))) * slope == pytest.approx(norm.pdf(u), rel=1e-5)
        assert one.to_u(one.to_x(u)) == pytest.approx(u, abs=1e-6)


@pytest.mark.parametrize(("n", "degree"), [(15, 5), (90, 11)])
def test_predictive_check_rejects_at_its_nominal_rate(n, degree):
    rng = np.random.default_rng(0)
    J = 100.0 * np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n), degree)
    project = np.eye(n) - J @ np.linalg.pinv(J)
    p = np.array([predictive_check(project @ rng.standard_normal(n), J, np.full(n, 0.5)) for _ in range(1000)])
    assert [np.mean(p < level) for level in (0.05, 0.5, 0.9)] == pytest.approx([0.05, 0.5, 0.9], abs=0.05)
    assert 0.001 < np.mean(p < REJECTED) < 0.02


def test_predictive_check_sees_a_wave_and_says_nothing_of_few_frames():
    J = 100.0 * np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, 90), 11)
    wave = np.random.default_rng(0).standard_normal(90) + 2.5 * np.sin(np.arange(90) / 3.0)
    assert predictive_check(wave - J @ np.linalg.pinv(J) @ wave, J, np.ones(90)) < REJECTED
    assert predictive_check(wave[:5], J[:5], np.ones(5)) is None


DENSE = {  # frames far denser than the motion needs: a gel, a liquid, a stiff gel, clean radii
    "gel": (GEL, 7.0, 0.006), "liquid": (Newtonian(0.003), 11.0, 0.003),
    "stiff": (NeoHookeanKelvinVoigt(2e5, 0.05), 2.5, 0.01), "clean": (GEL, 7.0, 0.0002),
}  # fmt: skip


@pytest.mark.parametrize("shot", DENSE)
def test_means_of_dense_frames_are_on_the_motion(shot):
    """Each mean has the noise of its frames and nothing else, and a recording of the usual rate stays as it is."""
    material, stretch, noise = DENSE[shot]
    about: dict = {"stretch": stretch, "frames": 2500, "frame": 4e-8}
    measured, true = simulated(material, noise=noise, **about), simulated(material, **about)
    window = measured.window(min(3, len(measured.collapse_times())))
    frames = compared_frames(window)
    assert len(frames.time) <= MOST_FRAMES < len(window.time) == np.sum(frames.averaged)
    root, scale = np.sqrt(frames.averaged), noise * true.max_radius
    missed = root * (frames.radius - CubicSpline(true.time, true.radius)(frames.time)) / scale
    assert np.sqrt(np.mean(missed**2)) < 1.3
    assert abs(np.mean(missed)) < 4.0 / np.sqrt(len(missed))
    collapse = np.argmin(np.abs(frames.time - true.collapse_times()[0]))
    assert frames.averaged[collapse] < 0.2 * np.max(frames.averaged)
    usual = simulated(material, noise=noise, frames=100, stretch=stretch)
    assert np.array_equal(compared_frames(usual).radius, usual.radius)


def test_the_default_family_has_the_stated_probabilities_of_its_switches():
    """A third liquid, half of the gels without stiffening, a fifth with the field's bubble."""
    there = experiment(shot(), law="auto", bubble=REAL)
    prior = there.prior()
    x = dict(
        zip(
            prior.names, prior.to_x(np.random.default_rng(0).standard_normal((20_000, len(prior.names)))).T, strict=True
        )
    )
    assert np.mean(np.isneginf(x["shear_modulus"])) == pytest.approx(1 / 3, abs=0.015)
    assert np.mean(np.isneginf(x["stiffening"])) == pytest.approx(1 / 2, abs=0.015)
    assert np.mean(np.isposinf(x["accommodation"])) == pytest.approx(1 / 5, abs=0.015)
