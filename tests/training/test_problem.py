"""The training problem: prior, identity, and the way between a shot and the reference scale."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import refused

from cavirheo.physics.materials import NeoHookeanKelvinVoigt, Newtonian
from cavirheo.physics.media import BU2026, WATER
from cavirheo.prior import Prior, uniforms
from cavirheo.problem import FrameGrid, TrainingProblem, natural_values

RANGES = {"log10_shear_modulus": [3.0, 6.0], "log10_viscosity": [-3.0, 0.0], "stretch": [3.0, 11.0]}


@pytest.fixture
def problem() -> TrainingProblem:
    return TrainingProblem("nhkv", Prior.uniform(RANGES))


def test_draws_are_fixed_for_all_time():
    """A change would silently change every training set."""
    np.testing.assert_allclose(uniforms(1, 0, 2), [0.3035680343067586, 0.8487087496857769], rtol=1e-15)


def test_prior_is_uniform_and_independent(problem):
    theta = problem.prior.sample(4000, seed=3)
    unit = (theta - problem.prior.low) / (problem.prior.high - problem.prior.low)
    assert 0 <= unit.min() < unit.max() <= 1
    for column in unit.T:
        counts, _ = np.histogram(column, bins=10, range=(0, 1))
        assert np.sum((counts - 400) ** 2 / 400) < 27.9  # chi-square, 9 degrees of freedom: 0.1 %
    assert np.abs(np.corrcoef(unit.T) - np.eye(3)).max() < 0.06


@pytest.mark.parametrize(
    ("material", "ranges", "code"),
    [
        ("nhkv", RANGES | {"stretch": [11.0, 3.0]}, "prior.range"),
        ("nhkv", RANGES | {"stretch": [3.0, np.inf]}, "prior.range"),
        ("nhkv", RANGES | {"stretch": [3.0]}, "prior.range"),
        ("nhkv", RANGES | {"density": [900.0, 1100.0]}, "prior.name"),
        ("nhkv", {name: RANGES[name] for name in ("log10_viscosity", "stretch")}, "problem.prior"),
        ("newtonian", RANGES, "problem.prior"),
        ("x", RANGES, "problem.material"),
    ],
)
def test_a_prior_that_is_none_or_of_another_law_is_refused(material, ranges, code):
    with refused(code):
        TrainingProblem(material, Prior.uniform(ranges))


def test_material_from_theta(problem):
    assert problem.material([4.0, -1.0, 7.0]) == NeoHookeanKelvinVoigt(1e4, 0.1)
    viscous = TrainingProblem("newtonian", Prior.uniform({"log10_viscosity": [-4, 0], "stretch": [3, 11]}))
    assert viscous.material([-2.0, 7.0]) == Newtonian(0.01)
    assert natural_values(problem.prior.names, [4.0, -1.0, 7.0])["stretch"] == 7.0


def test_identity_changes_with_every_part(problem):
    assert TrainingProblem.from_dict(problem.to_dict()).id == problem.id
    others = [
        replace(problem, medium=BU2026),
        replace(problem, medium=replace(WATER, conductivity_slope=5.4e-5)),
        replace(problem, grid=FrameGrid(frames=101)),
        replace(problem, reference_max_radius=246e-6),
        replace(problem, prior=Prior.uniform(RANGES | {"stretch": [3.0, 10.0]})),
        replace(problem, prior=Prior.uniform(dict(reversed(RANGES.items())))),
    ]
    assert len({problem.id, *(other.id for other in others)}) == 7


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (
            lambda problem: TrainingProblem.from_dict(problem.to_dict() | {"medium": {"wetness": 1.0}}),
            "problem.unreadable",
        ),
        (lambda problem: problem.material([4.0, -1.0]), "problem.theta"),
        (lambda problem: problem.grid_step(float("nan")), "problem.max_radius"),
    ],
)
def test_what_is_not_of_the_problem_is_refused(problem, call, code):
    with refused(code):
        call(problem)


def test_scale_keeps_cauchy_and_reynolds(problem):
    medium = replace(WATER, density=1060.0, pressure=90e3)
    shot = 80e-6
    reference = {"shear_modulus": 5e3, "viscosity": 0.05, "stretch": 7.0}
    found = problem.to_shot(reference, shot, medium)

    def numbers(g, mu, radius, m):  # Ca = p/G, Re = p t_c/mu
        return m.pressure / g, m.pressure * radius * np.sqrt(m.density / m.pressure) / mu

    of_shot = numbers(found["shear_modulus"], found["viscosity"], shot, medium)
    np.testing.assert_allclose(of_shot, numbers(5e3, 0.05, 245e-6, WATER), rtol=1e-12)
    assert found["stretch"] == 7.0


def test_simulations_run_at_the_reference(problem):
    (simulation,) = problem.simulate_many([[5.0, 0.0, 4.0]])
    assert simulation.ok
    assert simulation.radius[0] == pytest.approx(245e-6)
    np.testing.assert_array_equal(simulation.time, problem.grid.time)
    again = problem.simulate_many([[5.0, 0.0, 4.0], [4.5, 0.0, 4.0]], workers=2)
    np.testing.assert_array_equal(again[0].radius, simulation.radius)
    assert not np.array_equal(again[1].radius, simulation.radius)
