"""Problem: prior, identity, and the way between a shot and the reference scale."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from cavirheo.errors import InputError
from cavirheo.physics.materials import NeoHookeanKelvinVoigt, Newtonian
from cavirheo.physics.media import BU2026, WATER
from cavirheo.prior import Prior, uniforms
from cavirheo.problem import Camera, Problem

RANGES = {"log10_shear_modulus": [3.0, 6.0], "log10_viscosity": [-3.0, 0.0], "stretch": [3.0, 11.0]}


@pytest.fixture
def problem() -> Problem:
    return Problem("nhkv", Prior.uniform(RANGES))


def test_draw_depends_on_seed_and_index_alone(problem):
    whole = problem.prior.sample(20, seed=7)
    np.testing.assert_array_equal(problem.prior.sample(range(13, 17), seed=7), whole[13:17])
    assert not np.any(problem.prior.sample(20, seed=8) == whole)
    assert len(np.unique(whole)) == whole.size


def test_draws_are_fixed_for_all_time():
    # raw words of Philox: a change would silently change every training set
    np.testing.assert_allclose(uniforms(1, 0, 2), [0.3035680343067586, 0.8487087496857769], rtol=1e-15)


def test_prior_is_uniform_and_independent(problem):
    theta = problem.prior.sample(4000, seed=3)
    assert problem.prior.contains(theta).all()
    unit = (theta - problem.prior.low) / (problem.prior.high - problem.prior.low)
    for column in unit.T:
        counts, _ = np.histogram(column, bins=10, range=(0, 1))
        assert np.sum((counts - 400) ** 2 / 400) < 27.9  # chi-square, 9 degrees of freedom: 0.1 %
    assert np.abs(np.corrcoef(unit.T) - np.eye(3)).max() < 0.06


def test_streams_are_independent():
    ours = [uniforms(5, i, 1)[0] for i in range(500)]
    theirs = [uniforms(5, i, 1, stream=1)[0] for i in range(500)]
    assert abs(np.corrcoef(ours, theirs)[0, 1]) < 0.15


def test_contains(problem):
    inside = problem.prior.contains([[3.0, -3.0, 11.0], [2.99, -1.0, 5.0], [4.0, -1.0, np.nan]])
    assert inside.tolist() == [True, False, False]


@pytest.mark.parametrize(
    "ranges",
    [
        RANGES | {"stretch": [11.0, 3.0]},
        RANGES | {"stretch": [3.0, np.inf]},
        RANGES | {"stretch": [3.0]},
        RANGES | {"density": [900.0, 1100.0]},
    ],
)
def test_prior_refuses(ranges):
    with pytest.raises(InputError):
        Prior.uniform(ranges)


def test_problem_needs_exactly_the_parameters_of_its_material():
    with pytest.raises(InputError, match="shear_modulus"):
        Problem("nhkv", Prior.uniform({k: RANGES[k] for k in ("log10_viscosity", "stretch")}))
    with pytest.raises(InputError, match="newtonian"):
        Problem("newtonian", Prior.uniform(RANGES))
    with pytest.raises(InputError, match="unknown material"):
        Problem("honey", Prior.uniform(RANGES))


def test_material_from_theta(problem):
    assert problem.material([4.0, -1.0, 7.0]) == NeoHookeanKelvinVoigt(1e4, 0.1)
    viscous = Problem("newtonian", Prior.uniform({"log10_viscosity": [-4, 0], "stretch": [3, 11]}))
    assert viscous.material([-2.0, 7.0]) == Newtonian(0.01)
    with pytest.raises(InputError, match="shape"):
        problem.material([4.0, -1.0])


def test_identity_changes_with_every_part(problem):
    assert Problem.from_dict(problem.to_dict()).id == problem.id
    others = [
        replace(problem, medium=BU2026),
        replace(problem, medium=replace(WATER, conductivity_slope=5.4e-5)),
        replace(problem, camera=Camera(frames=101)),
        replace(problem, reference_max_radius=246e-6),
        replace(problem, prior=Prior.uniform(RANGES | {"stretch": [3.0, 10.0]})),
        replace(problem, prior=Prior.uniform(dict(reversed(RANGES.items())))),
    ]
    assert len({problem.id, *(other.id for other in others)}) == 7


def test_from_dict_refuses_what_it_does_not_know(problem):
    with pytest.raises(InputError, match="not a problem"):
        Problem.from_dict(problem.to_dict() | {"medium": {"wetness": 1.0}})


def test_scale_keeps_cauchy_and_reynolds(problem):
    medium = replace(WATER, density=1060.0, pressure=90e3)
    shot = 80e-6
    g, mu = problem.to_shot(5e3, 0.05, shot, medium)

    def numbers(g, mu, radius, m):  # Ca = p/G, Re = p t_c/mu
        return m.pressure / g, m.pressure * radius * np.sqrt(m.density / m.pressure) / mu

    np.testing.assert_allclose(numbers(g, mu, shot, medium), numbers(5e3, 0.05, 245e-6, WATER), rtol=1e-12)
    np.testing.assert_allclose(problem.from_shot(g, mu, shot, medium), (5e3, 0.05), rtol=1e-12)


def test_reference_shot_is_its_own_scale(problem):
    assert problem.grid_step(245e-6) == pytest.approx(1e-6, rel=1e-14)
    assert problem.to_shot(1e4, 0.1, 245e-6) == pytest.approx((1e4, 0.1), rel=1e-14)
    assert problem.grid_step(490e-6) == pytest.approx(2e-6, rel=1e-14)
    with pytest.raises(InputError, match="R_max"):
        problem.grid_step(float("nan"))


def test_simulations_run_at_the_reference(problem):
    simulation = problem.simulate([5.0, 0.0, 4.0])
    assert simulation.ok
    assert simulation.radius[0] == pytest.approx(245e-6)
    np.testing.assert_array_equal(simulation.time, problem.camera.time)
    again = problem.simulate_many([[5.0, 0.0, 4.0], [4.5, 0.0, 4.0]], workers=2)
    np.testing.assert_array_equal(again[0].radius, simulation.radius)
    assert not np.array_equal(again[1].radius, simulation.radius)


def test_importing_a_problem_loads_no_torch_and_no_compiler():
    code = (
        "import sys, cavirheo.problem, cavirheo.training.dataset, cavirheo.training.recipe;"
        "sys.exit(bool({'torch', 'numba'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
