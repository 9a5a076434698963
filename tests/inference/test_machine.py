"""The machine of inference: emulator, priors, sampler, weights, noise, exposure, means of dense frames and predictive
check, each against closed forms or the solver."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from answers import GEL, seen, simulated
from conftest import FIELD, REAL, WATER, refused
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.stats import multivariate_t, norm
from threadpoolctl import threadpool_limits

from cavirheo import Bubble, InputError, NeoHookeanKelvinVoigt, Newtonian, RadiusCurve, simulate
from cavirheo.inference.answer import REJECTED, open_ends, predictive_check, trades
from cavirheo.inference.assumptions import FREE, Family, Options
from cavirheo.inference.emulator import INPUTS, RADII, RATES, Bubbles, Camera, elastic_stress, emulator, mean_viscosity
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.frames import MOST_FRAMES, compared_frames
from cavirheo.inference.noise import GAMMA_A, Noise
from cavirheo.inference.sample import (
    EMULATED,
    Draws,
    Maxima,
    Mixture,
    climb,
    effective_size,
    first_round,
    flattening,
    ridges,
    sample,
)
from cavirheo.inference.weigh import Model, Weighed, merged, pick, posterior, smooth
from cavirheo.physics.laws import table_of
from cavirheo.physics.table import look_up
from cavirheo.prior import Prior, log_normal

ELASTIC = ("linear", "neo-hookean", "quadratic", "mooney-rivlin", "yeoh", "fung", "gent", "arruda-boyce")
VISCOUS = ("newtonian", "power-law", "carreau-yasuda", "cross", "powell-eyring")


R_MAX = 250e-6
TRUTH = {"shear_modulus": 8e3, "viscosity": 0.05, "stretch": 7.0}


def shot(law=GEL, noise=0.01, **given) -> RadiusCurve:
    return simulated(law, max_radius=R_MAX, stretch=TRUTH["stretch"], noise=noise, maximum=(0.0, R_MAX), **given)


def experiment(curve, law="nhkv", bubble=FIELD, exposure=0.0, **given) -> Experiment:
    curve = replace(curve, meta={**curve.meta, "exposure_s": exposure})
    return Experiment(curve, Family(law), options=Options(free=tuple(FREE), bubble=bubble, **given))


def usual(law: str, count: int, rng: np.random.Generator) -> tuple[Family, np.ndarray]:
    """A law, and parameters (count, d) in the ranges where searches start."""
    family = Family(law)
    low, high = family.bounds(started=True).T
    return family, rng.uniform(low, high, (count, len(low)))


def test_the_emulator_is_the_same_on_any_number_of_threads():
    made = []
    for threads in (1, None):
        with threadpool_limits(threads):
            made.append(emulator.__wrapped__())
    with threadpool_limits(1):
        assert np.array_equal(*(one.trajectories(np.zeros((1, INPUTS))) for one in made))


@pytest.mark.parametrize("law", ELASTIC)
def test_the_emulator_is_told_the_stress_that_the_solver_uses(law):
    rng = np.random.default_rng(0)
    family, x = usual(law, 20, rng)
    stretch = rng.uniform(1.5, 8.0, 20)
    stress = elastic_stress(family.material(x), stretch)
    for row, parameters, ratio in zip(stress, x, stretch, strict=True):
        expected = look_up(table_of(family.material(parameters)), ratio * RADII)[0]
        felt = np.isfinite(expected) & (np.abs(expected) < 3e6)
        assert row[felt] == pytest.approx(expected[felt], rel=2e-3, abs=1.0)


@pytest.mark.parametrize("law", VISCOUS)
def test_the_emulator_is_told_the_viscosity_that_the_solver_uses(law):
    rng = np.random.default_rng(0)
    family, x = usual(law, 20, rng)
    rates = RATES / rng.uniform(1e-6, 1e-4, (20, 1))
    viscosity = mean_viscosity(family.material(x), rates)
    for row, parameters, rate in zip(viscosity, x, rates, strict=True):
        expected = -look_up(table_of(family.material(parameters)), rate)[0] / (4.0 * rate)
        assert row == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("law", ["oldroyd-b", "carreau-yasuda"])
def test_materials_that_cannot_be_have_no_frames_whoever_is_beside_them(law):
    family, rng = Family(law), np.random.default_rng(1)
    x = rng.uniform(*family.bounds().T, (40, len(family.parameters)))
    possible = np.ones(40, dtype=bool)
    for i, place in enumerate(x):
        with suppress(InputError):
            family.material(place)
            continue
        possible[i] = False

    def frames(places):
        ones, zeros = np.ones(len(places)), np.zeros(len(places))
        sizes = 2e-4 * ones, 7.0 * ones, 0.1 * ones
        bubbles = Bubbles(family.material(places), WATER, *sizes, zeros, zeros, zeros, ones, ones)
        camera = Camera(np.linspace(0.0, 6e-5, 9), np.zeros(1), np.ones(1), zeros)
        return np.isfinite(emulator().radius(bubbles, camera)).all(axis=1)

    assert 0 < np.count_nonzero(possible) < 40
    assert np.array_equal(frames(x), possible)
    assert np.array_equal([frames(x[[i]])[0] for i in range(40)], possible)


def test_the_emulator_follows_the_solver():
    rng = np.random.default_rng(7)
    family, x = usual("nhkv", 60, rng)
    stretch, radius = rng.uniform(3.0, 10.0, 60), np.full(60, 2e-4)
    accommodation, damping = 10.0 ** rng.uniform(-1.7, -0.3, 60), rng.uniform(0.0, 0.5, 60)
    inertia, excess = rng.uniform(0.0, 0.5, 60), rng.uniform(0.0, 3e3, 60)
    ones = np.ones(60)
    bubbles = Bubbles(family.material(x), WATER, radius, stretch, accommodation, damping, inertia, excess, ones, ones)
    times = np.linspace(0.0, 3.0, 50) * WATER.time_scale(2e-4)
    emulated = emulator().radius(bubbles, Camera(times, np.zeros(1), np.ones(1), np.zeros(60)))
    errors = []
    for i in range(60):
        walls = {"confinement_inertia": float(inertia[i]), "confinement_damping": float(damping[i])}
        bubble = Bubble("kinetic", float(accommodation[i]), vapour_excess=float(excess[i]), **walls)
        shot = {"max_radius": float(radius[i]), "stretch": float(stretch[i]), "time": times, "bubble": bubble}
        simulated = simulate(family.material(x[i]), **shot).radius / radius[i]
        errors.append(np.sqrt(np.mean((emulated[i] - simulated) ** 2)))
    assert (np.quantile(errors, [0.5, 0.95]) < [0.0015, 0.05]).all()


def test_priors_are_normalised_and_their_coordinates_normal():
    u = np.array([0.7])
    for low, high, mean, std in ((1.0, 3.0, 0.0, np.inf), (-1.0, 1.0, 0.2, 0.5)):
        one = Prior(("a",), [low], [high], [mean], [std])
        assert quad(lambda x, one=one: np.exp(one.log_density(np.array([x]))), low, high)[0] == pytest.approx(1.0)
        slope = (one.to_x(u + 1e-6) - one.to_x(u - 1e-6)) / 2e-6
        assert np.exp(one.log_density(one.to_x(u))) * slope == pytest.approx(norm.pdf(u), rel=1e-5)
        assert one.to_u(one.to_x(u)) == pytest.approx(u, abs=1e-6)


def test_an_atom_of_a_prior_has_its_probability_and_its_place():
    prior = Prior(("a",), np.array([1.0]), np.array([3.0]), zero=np.array([0.3]), infinite=np.array([0.1]))
    u = np.random.default_rng(0).standard_normal((20_000, 1))
    x = prior.to_x(u)
    assert np.mean(np.isneginf(x)) == pytest.approx(0.3, abs=0.015)
    assert np.mean(np.isposinf(x)) == pytest.approx(0.1, abs=0.01)
    inside = np.isfinite(x)
    assert np.mean(x[inside]) == pytest.approx(2.0, abs=0.02)
    assert prior.to_u(x)[inside] == pytest.approx(u[inside], abs=1e-9)
    assert np.array_equal(np.isneginf(prior.to_x(prior.to_u(x))), np.isneginf(x))


def test_the_default_family_has_the_stated_probabilities_of_its_switches():
    """A third liquid, half of the gels without stiffening, a fifth with the field's bubble."""
    there = experiment(shot(), law="auto", bubble=REAL)
    prior = there.prior()
    normal = np.random.default_rng(0).standard_normal((20_000, len(prior.names)))
    x = dict(zip(prior.names, prior.to_x(normal).T, strict=True))
    assert np.mean(np.isneginf(x["shear_modulus"])) == pytest.approx(1 / 3, abs=0.015)
    assert np.mean(np.isneginf(x["stiffening"])) == pytest.approx(1 / 2, abs=0.015)
    assert np.mean(np.isposinf(x["accommodation"])) == pytest.approx(1 / 5, abs=0.015)


def drawn(target, start: Mixture, rng: np.random.Generator) -> tuple[Draws, Mixture]:
    """Draws of a density from a mixture, and the last mixture."""

    def values(u):
        return target(u)[:, None]

    rounds = first_round(start, EMULATED.rounds[0], values, rng)
    draws, rounds = sample(values, lambda u, value: value[:, 0], rounds, EMULATED.rounds, rng)
    return draws, rounds.mixtures[-1]


@pytest.mark.parametrize("seed", range(3))
def test_two_separate_maxima_are_drawn_by_their_shares(seed):
    dimension, rng = 6, np.random.default_rng(seed)
    first, second = np.full(dimension, 0.6), np.full(dimension, -0.7)

    def normal(u, middle, width):
        return -0.5 * np.sum((u - middle) ** 2, axis=1) / width**2 - dimension * np.log(width * np.sqrt(2.0 * np.pi))

    def target(u):
        return 1.5 + np.logaddexp(np.log(0.3) + normal(u, first, 0.25), np.log(0.7) + normal(u, second, 0.1))

    start = Mixture.of_modes([first + 0.1, second - 0.1], [0.05 * np.eye(dimension), 0.02 * np.eye(dimension)], [0, 0])
    draws, _ = drawn(target, start, rng)
    weight, at_first = np.exp(draws.log_weight), draws.u[:, 0] > 0.0
    assert np.sum(weight) == pytest.approx(1.0)
    assert draws.log_evidence == pytest.approx(1.5, abs=0.1)
    assert weight @ at_first == pytest.approx(0.3, abs=0.05)
    own = weight[at_first] / np.sum(weight[at_first])
    assert np.sqrt(own @ (draws.u[at_first, 0] - 0.6) ** 2) == pytest.approx(0.25, rel=0.1)


def linear_problem() -> tuple[np.ndarray, Noise, Callable[[np.ndarray], np.ndarray]]:
    """Derivatives (40, 3) of frames, their noise, and residuals of a measurement of u = (0.5, -0.3, 0.2)."""
    rng = np.random.default_rng(3)
    slopes = rng.standard_normal((40, 3)) * 0.01
    noise = Noise(np.full(40, 0.01), np.arange(40.0), 10.0, False)
    measured = slopes @ [0.5, -0.3, 0.2] + 0.01 * rng.standard_normal(40)
    return slopes, noise, lambda u: measured - u @ slopes.T


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_weights_remove_the_error_of_the_emulator(error):
    _, noise, simulated = linear_problem()
    bend = error * np.sin(np.arange(40.0))[:, None]

    def emulated(u):
        return simulated(u) - (bend @ (1.0 + 0.5 * u[:, :1].T)).T

    places = np.random.default_rng(0).standard_normal((400_000, 3))  # of the prior
    density = noise.log_density(simulated(places))
    weight = np.exp(density - np.max(density))
    evidence = np.max(density) + np.log(np.mean(weight))
    mean = weight @ places / np.sum(weight)
    deviation = np.sqrt(weight @ (places - mean) ** 2 / np.sum(weight))
    found = posterior([Model(emulated, simulated, noise, 3)], seed=1)
    drawn = np.exp(found.log_weight - np.max(found.log_weight))
    assert found.effective >= max(100.0, 0.5 * len(found.x))  # after the correction the emulator is nearly right
    assert found.log_evidence == pytest.approx(evidence, abs=0.15)
    assert np.abs(drawn @ found.x / np.sum(drawn) - mean) == pytest.approx(np.zeros(3), abs=0.3 * np.max(deviation))


def test_every_draw_of_an_answer_was_simulated():
    _, noise, residuals = linear_problem()
    simulated_at: list[np.ndarray] = []

    def simulated(u):
        simulated_at.append(u)
        return residuals(u)

    found = posterior([Model(residuals, simulated, noise, 3)], seed=0)
    places = {tuple(row) for row in np.concatenate(simulated_at)}
    assert all(tuple(row) in places for row in found.x)
    assert found.log_posterior == pytest.approx(noise.log_density(residuals(found.x)) + log_normal(found.x))


def test_an_effective_size_is_kongs_and_a_power_of_weights_has_more():
    log_weight = np.log(np.array([0.5, 0.25, 0.25])) - 800.0
    assert effective_size(log_weight) == pytest.approx(1.0 / (0.25 + 2 * 0.0625))
    assert effective_size(np.full(4, -np.inf)) == 0.0
    steep = -np.linspace(0.0, 60.0, 1000)
    assert effective_size(flattening(steep, 200.0) * steep) == pytest.approx(200.0, rel=0.02)
    assert flattening(steep, 5.0) == 1.0


def test_an_interval_leaves_out_as_much_on_either_side():
    one = seen([3.8, -1.4], 0.05, 100, log_weight=np.zeros(100))
    for name in one.parameters:
        low, high = one.interval(name)
        assert np.sum(one.draws(name) < low) == np.sum(one.draws(name) > high) == 4


def test_a_few_draws_are_spread_as_all_are():
    """Every half of each parameter has half of them, also where the draws lie in a long ridge; another seed, others."""
    rng = np.random.default_rng(4)
    u = rng.standard_normal((5000, 3)) * [1.0, 0.1, 3.0]
    u[:, 1] += u[:, 0]
    draws = Draws(u, np.zeros(len(u)), np.full(len(u), -np.log(len(u))), 0.0, 0.0)
    chosen = pick(draws, 128, rng)
    assert len(set(chosen.tolist())) == 128
    below = np.mean(u[chosen] < np.median(u, axis=0), axis=0)
    assert below == pytest.approx(0.5 * np.ones(3), abs=0.05)
    assert np.std(u[chosen], axis=0) == pytest.approx(np.std(u, axis=0), rel=0.12)
    means = [np.mean(u[pick(draws, 128, rng)][:, 0]) for _ in range(40)]
    assert np.std(means) < 0.5 * np.std(u[:, 0]) / np.sqrt(128)  # nearer to all than so many independent draws
    first = [np.mean(u[pick(draws, 12, rng)][:6, 0]) for _ in range(60)]
    assert abs(np.mean(first)) < 0.25  # the first are no part of them
    half = replace(draws, log_weight=np.where(u[:, 2] > 0.0, 0.0, -np.inf))
    assert np.all(u[pick(half, 128, rng), 2] > 0.0)  # each as often as its weight says


def test_a_correction_finds_the_error_of_the_emulator():
    rng = np.random.default_rng(0)
    u, slope = rng.standard_normal((300, 2)) * [0.1, 2.0], np.array([[0.3, 0.0, -0.1], [0.0, 0.02, 0.05]])

    def error(u):
        return 0.5 + u @ slope + 0.02 * np.cos(0.7 * u[:, 1:])

    correct = smooth(u, error(u))
    inside = rng.standard_normal((300, 2)) * [0.05, 1.0]
    assert np.sqrt(np.mean((correct(inside) - error(inside)) ** 2)) < 0.008
    assert np.max(np.abs(correct(1e3 * u))) < 2.0  # far away it grows no further
    few = smooth(u[:5], np.vstack([error(u[:4]), np.full((1, 3), 50.0)]))  # one wild bubble
    assert np.abs(few(inside[:1]) - 0.5) == pytest.approx(np.zeros(3), abs=0.3)


def test_models_count_by_their_evidence():
    """Two models of the same frames, of which one has another parameter, that the frames hardly hold."""
    _, noise, small = linear_problem()

    def large(u):
        return small(u[:, :3]) - 0.004 * u[:, 3:]

    places = np.random.default_rng(0).standard_normal((400_000, 4))
    logs = [np.log(0.7) + noise.log_density(small(places[:, :3])), np.log(0.3) + noise.log_density(large(places))]
    sums = np.array([np.exp(log - np.max(logs)).sum() for log in logs])

    def residuals(x):
        return np.where(np.isinf(x[:, 3:]), small(x[:, :3]), large(np.nan_to_num(x, posinf=0.0)))

    models = [
        Model(residuals, residuals, noise, 3, np.log(0.7), lambda u: np.column_stack([u, np.full(len(u), np.inf)])),
        Model(residuals, residuals, noise, 4, np.log(0.3)),
    ]
    found = posterior(models, seed=0)
    weight = np.exp(found.log_weight - np.max(found.log_weight))
    share = np.sum(weight[np.isinf(found.x[:, 3])]) / np.sum(weight)
    assert share == pytest.approx(sums[0] / np.sum(sums), abs=0.05)
    assert found.log_evidence == pytest.approx(np.max(logs) + np.log(np.sum(sums) / len(places)), abs=0.15)
    assert effective_size(found.log_weight) >= 80.0


def test_a_climb_ends_at_the_maximum_with_its_curvature():
    slopes, noise, residuals = linear_problem()
    found = climb(residuals, noise, np.random.default_rng(0).standard_normal((5, 3)))
    u, value, curvature = found.u, found.value, found.curvature
    assert np.ptp(u, axis=0) == pytest.approx(np.zeros(3), abs=0.01)
    assert value == pytest.approx(noise.log_density(residuals(u)) + log_normal(u))
    for step in 0.05 * np.vstack([np.eye(3), -np.eye(3)]):
        assert (noise.log_density(residuals(u + step)) + log_normal(u + step) <= value + 1e-3).all()
    weight = noise.power / (2.0 + 0.5 * np.sum((residuals(u)[0] / 0.01) ** 2))
    assert curvature[0] == pytest.approx(weight * slopes.T @ slopes / 1e-4 + np.eye(3), rel=0.1, abs=30.0)


def test_a_curved_density_is_drawn_whole():
    """In four dimensions, of known evidence, from a straight distribution about its middle."""

    def density(u):
        straight = np.column_stack([u[:, 0] / 2.0, (u[:, 1] + 0.25 * u[:, 0] ** 2 - 1.0) / 0.1, u[:, 2] / 0.3, u[:, 3]])
        return log_normal(straight) - np.log(2.0 * 0.1 * 0.3) + 5.0

    for seed in range(3):
        start = Mixture.of_modes([np.array([0.0, 1.0, 0.0, 0.0])], [np.diag([4.0, 2.0, 0.1, 1.0])], [0.0])
        draws, mixture = drawn(density, start, np.random.default_rng(seed))
        assert draws.log_evidence == pytest.approx(5.0, abs=0.1)
        assert draws.error < 0.1
        weight = np.exp(draws.log_weight)
        for i, scale in ((0, 2.0), (2, 0.3)):
            order = np.argsort(draws.u[:, i])
            ends = np.interp([0.05, 0.95], np.cumsum(weight[order]), draws.u[order, i])
            assert ends == pytest.approx(scale * norm.ppf([0.05, 0.95]), rel=0.2)
        assert draws.log_density == pytest.approx(density(draws.u))
        u = mixture.draw(20_000, np.random.default_rng(seed))
        assert effective_size(density(u) - mixture.log_density(u)) > 0.03 * len(u)  # a straight one has 0.01


def test_a_ridge_is_followed_from_its_maximum():
    """Frames that hold u_1 + 0.2 u_0^2 alone: the distribution lies along this parabola."""
    noise = Noise(np.full(30, 0.01), np.arange(30.0), 10.0, False)

    def residuals(u):
        held = u[:, 1] + 0.2 * u[:, 0] ** 2
        return np.column_stack([np.full(len(u), 0.01 * (-1.0) ** i) for i in range(30)]) - held[:, None]

    maximum = climb(residuals, noise, np.array([[0.5, 0.1]]))
    assert maximum.u == pytest.approx(np.zeros((1, 2)), abs=1e-3)
    assert len(maximum.apart(3, 10.0, peaks=True)) == 1
    both = maximum.and_of(Maxima(maximum.u + 1e-5, maximum.value - 1.0, maximum.curvature))
    assert both.apart(3, 10.0, peaks=True) == [0]
    mixture = ridges(residuals, noise, maximum, EMULATED, np.random.default_rng(0), 3, 10.0)
    u = mixture.draw(2000, np.random.default_rng(1))
    assert np.std(u[:, 0]) > 0.7
    assert np.median(np.abs(u[:, 1] + 0.2 * u[:, 0] ** 2)) < 0.05


def test_failed_simulations_have_no_weight():
    _, noise, emulated = linear_problem()

    def simulated(u):
        return np.where(u[:, :1] > 0.5, np.nan, emulated(u))

    found = posterior([Model(emulated, simulated, noise, 3)], seed=0)
    assert np.all(np.isneginf(found.log_weight[found.x[:, 0] > 0.5]))
    assert 100.0 <= found.effective < 0.95 * len(found.x)


@pytest.mark.parametrize(("sign", "bound"), [(1.0, "lower"), (-1.0, "upper")])
def test_a_value_that_trades_with_a_stretch_at_its_end_is_bounded_on_that_side(sign, bound):
    """A larger stretch is not excluded, nor then the viscosity to which it would lead; G does not depend on it."""
    rng = np.random.default_rng(0)
    stretch = 40.0 - rng.exponential(size=2000)
    modulus, viscosity = 3.0 + 0.1 * rng.standard_normal((2, 2000))
    viscosity += -5.0 + 0.3 * sign * (stretch - 40.0)
    prior = Prior(("shear_modulus", "viscosity", "stretch"), np.array([1.0, -4.0, 1.05]), np.array([7.0, 1.0, 40.0]))
    x, even = np.column_stack([modulus, viscosity, stretch]), np.zeros(2000)
    assert open_ends(prior, x, even) == ["stretch"]
    assert open_ends(prior, x - [0.0, 0.0, 20.0], even) == []
    found = trades(prior, x, even, ("shear_modulus", "viscosity"), ["stretch"])
    assert found == {"viscosity": ("stretch", bound)}


def test_draws_of_a_place_that_proved_to_be_unlikely_weigh_nothing():
    alike = np.full(50, -np.log(50.0))
    wrong, right = (
        Weighed(np.arange(start, start + 50.0)[:, None], np.zeros((50, 1)), alike, alike, log_evidence, 0.1, 50.0)
        for start, log_evidence in ((0.0, -80.0), (100.0, 0.0))
    )
    both = merged([wrong, right])
    assert np.sum(np.exp(both.log_weight[:50])) < 1e-30
    assert both.effective == pytest.approx(50.0)


# --- one curve and what is assumed of it


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
    for exposure, code in ((-1.0, "curve.exposure_s"), (2e-6, "experiment.exposure")):  # no time; longer than a frame
        with refused(code):
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
