"""The machine of inference: emulator, sampler and weights, each against closed forms or the solver."""

import numpy as np
import pytest

from cavirheo.inference.assumptions import Family
from cavirheo.inference.emulator import RADII, RATES, Bubbles, elastic_stress, emulator, mean_viscosity
from cavirheo.inference.noise import Noise
from cavirheo.inference.sample import EMULATED, Mixture, bridge, effective_size, sample, settle
from cavirheo.inference.weigh import posterior
from cavirheo.physics.bubble import Bubble
from cavirheo.physics.laws import table_of
from cavirheo.physics.media import WATER
from cavirheo.physics.simulate import simulate
from cavirheo.physics.table import look_up
from cavirheo.prior import Prior, log_normal

ELASTIC = ("linear", "neo-hookean", "quadratic", "mooney-rivlin", "yeoh", "fung", "gent", "arruda-boyce")
VISCOUS = ("newtonian", "power-law", "carreau-yasuda", "cross", "powell-eyring")


def usual(law: str, count: int, rng: np.random.Generator) -> tuple[Family, np.ndarray]:
    """A law, and parameters (count, d) in the ranges where searches start."""
    family = Family(law)
    low, high = family.bounds(started=True).T
    return family, rng.uniform(low, high, (count, len(low)))


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


def test_the_emulator_follows_the_solver():
    rng = np.random.default_rng(7)
    family, x = usual("nhkv", 60, rng)
    stretch, radius = rng.uniform(3.0, 10.0, 60), rng.uniform(8e-5, 4e-4, 60)
    accommodation, damping = 10.0 ** rng.uniform(-1.7, -0.3, 60), rng.uniform(0.0, 0.5, 60)
    ones = np.ones(60)
    bubbles = Bubbles(family.material(x), WATER, radius, stretch, accommodation, damping, ones, ones)
    times = np.linspace(0.0, 3.0, 50) * WATER.time_scale(1.0) * radius[:, None]
    emulated = emulator().radius(bubbles, times)
    errors = []
    for i in range(60):
        bubble = Bubble("kinetic", float(accommodation[i]), confinement_damping=float(damping[i]))
        shot = {"max_radius": float(radius[i]), "stretch": float(stretch[i]), "time": times[i], "bubble": bubble}
        simulated = simulate(family.material(x[i]), **shot).radius / radius[i]
        errors.append(np.sqrt(np.mean((emulated[i] - simulated) ** 2)))
    assert np.median(errors) < 0.01
    assert np.quantile(errors, 0.95) < 0.05


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


@pytest.mark.parametrize("seed", range(3))
def test_two_separate_maxima_are_drawn_by_their_shares(seed):
    dimension, rng = 6, np.random.default_rng(seed)
    first, second = np.full(dimension, 0.6), np.full(dimension, -0.7)

    def normal(u, middle, width):
        return -0.5 * np.sum((u - middle) ** 2, axis=1) / width**2 - dimension * np.log(width * np.sqrt(2.0 * np.pi))

    def target(u):
        return 1.5 + np.logaddexp(np.log(0.3) + normal(u, first, 0.25), np.log(0.7) + normal(u, second, 0.1))

    shapes = np.array([0.05 * np.eye(dimension), 0.02 * np.eye(dimension)])
    start = Mixture(np.array([0.5, 0.5]), np.array([first + 0.1, second - 0.1]), shapes).widened(0.5, 2.0)
    u, value = settle(target, start, EMULATED, rng)
    draws, *_ = sample(target, u, value, EMULATED, rng)
    at_first = draws.u[:, 0] > 0.0
    assert draws.log_evidence == pytest.approx(1.5, abs=0.15)
    assert np.mean(at_first) == pytest.approx(0.3, abs=0.06)
    assert np.std(draws.u[at_first, 0]) == pytest.approx(0.25, rel=0.1)
    half = len(draws.u) // 2  # in random order: the first half tells what the second does
    assert np.mean(at_first[:half]) == pytest.approx(np.mean(at_first[half:]), abs=0.06)


def linear_problem(bias: float) -> tuple[np.ndarray, Noise, np.ndarray]:
    """Derivatives (n, 3) of frames, their noise, and a measurement (n,) of u = (0.5, -0.3, 0.2)."""
    rng = np.random.default_rng(3)
    slopes = rng.standard_normal((40, 3)) * 0.01
    noise = Noise(np.full(40, 0.01), np.arange(40.0), 10.0, False)
    return slopes, noise, slopes @ [0.5, -0.3, 0.2] + 0.01 * rng.standard_normal(40) + bias


@pytest.mark.parametrize("error", [0.0, 0.004])
def test_weights_remove_the_error_of_the_emulator(error):
    slopes, noise, measured = linear_problem(0.0)
    bend = error * np.sin(np.arange(40.0))[:, None]

    def simulated(u):
        return measured - u @ slopes.T

    def emulated(u):
        return simulated(u) - (bend @ (1.0 + 0.5 * u[:, :1].T)).T

    places = np.random.default_rng(0).standard_normal((400_000, 3))  # of the prior
    density = noise.log_density(simulated(places))
    weight = np.exp(density - np.max(density))
    evidence = np.max(density) + np.log(np.mean(weight))
    mean = weight @ places / np.sum(weight)
    deviation = np.sqrt(weight @ (places - mean) ** 2 / np.sum(weight))
    found = posterior(emulated, simulated, noise, 3, seed=1)
    drawn = np.exp(found.log_weight - np.max(found.log_weight))
    assert effective_size(found.log_weight) >= 100.0
    assert found.log_evidence == pytest.approx(evidence, abs=0.15)
    assert np.abs(drawn @ found.u / np.sum(drawn) - mean) == pytest.approx(np.zeros(3), abs=0.3 * np.max(deviation))


def test_every_draw_of_an_answer_was_simulated():
    slopes, noise, measured = linear_problem(0.0)
    simulated_at: list[np.ndarray] = []

    def simulated(u):
        simulated_at.append(u)
        return measured - u @ slopes.T

    found = posterior(lambda u: measured - u @ slopes.T, simulated, noise, 3, seed=0)
    places = {tuple(row) for row in np.concatenate(simulated_at)}
    assert all(tuple(row) in places for row in found.u)
    assert found.log_posterior == pytest.approx(noise.log_density(measured - found.u @ slopes.T) + log_normal(found.u))


def test_a_bridge_finds_the_integral_of_a_normal_density():
    rng = np.random.default_rng(0)
    at, drawn = 0.5 * rng.standard_normal(4000), rng.standard_normal(4000)

    def ratio(u):
        return 2.0 - 0.5 * (u / 0.5) ** 2 - np.log(0.5) + 0.5 * u**2

    log_integral, error = bridge(ratio(at), ratio(drawn), 4000.0)
    assert log_integral == pytest.approx(2.0, abs=4.0 * error)
    assert error < 0.05
