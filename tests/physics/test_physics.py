"""The solver's parts: Jacobian, tableau, a second implementation, statuses. What is known exactly: test_limits.py."""

import numpy as np
import pytest

from cavirheo import Bubble, NeoHookeanKelvinVoigt, Newtonian, SolverError, simulate
from cavirheo.physics import simulate as forward
from cavirheo.physics import solver
from cavirheo.physics.accuracy import NO_SHELLS, wall_clustered
from cavirheo.physics.bubble import ACCOMMODATION, MOTIONS
from cavirheo.physics.driving import Pulse, Trace
from cavirheo.physics.elastic import Quadratic
from cavirheo.physics.materials import Maxwell, TotalRelaxation, Viscoelastic, parse
from cavirheo.physics.media import WATER
from cavirheo.physics.scales import dimensionless
from cavirheo.physics.table import read

GEL = NeoHookeanKelvinVoigt(5e3, 0.05)
TIME = np.linspace(0, 100e-6, 101)
ARMS = parse("neo-hookean(4e4) + newtonian(0.1) + ucm(0.3, 2e-6) + maxwell(0.1, 4e-5)")
GELS = [
    *map(parse, ("nhkv(4e4, 0.1)", "qkv(4e4, 0.1, 0.7)", "gent(4e4, 6) + newtonian(0.1)")),
    *map(parse, ("fung(2e4, 1.5) + carreau-yasuda(3, 0.01, 1e-5, 0.3)", "herschel-bulkley(500, 2, 0.5)")),
    ARMS,
    Viscoelastic(Quadratic(4e4, 0.7), Newtonian(0.1), [TotalRelaxation(0.3, 2e-6), Maxwell(0.1, 4e-5)]),
]
PULSE = Pulse(-3e6, 1e5, 2e-6)
WAYS = [dict(bubble=Bubble(motion=motion), driving=PULSE) for motion in MOTIONS]
WAYS += [
    dict(bubble=Bubble(exponent=1.4)),
    dict(bubble=Bubble("kinetic", ACCOMMODATION)),
    dict(bubble=Bubble("kinetic", 0.003, confinement_inertia=0.4)),
    dict(bubble=Bubble("kinetic", ACCOMMODATION, confinement_inertia=-0.2, motion="gilmore"), driving=PULSE),
]


@pytest.mark.parametrize(("material", "way"), [(g, {}) for g in GELS] + [(ARMS, way) for way in WAYS], ids=str)
@pytest.mark.parametrize("velocity", [-1.3, 0.2])
def test_analytic_jacobian(material, way, velocity):
    """The factors solve with the numerical derivative of the right-hand side, also by time."""
    rng = np.random.default_rng(3)
    numbers = dimensionless(material, WATER, 120e-6, 4.0, **way)
    grid = NO_SHELLS if numbers.polytropic else wall_clustered(24, 1e-3)
    M, R, p, t = grid.centre.size, 0.4, 2.0, 0.1
    moles = p * R**3 / (1 + 2 * (1 - grid.centre**3))
    memory = np.array([1.3, 5.2, -0.4])[: len(numbers.memory)]
    y = np.concatenate([moles, moles * (0.5 + 0.4 * grid.centre), [R, velocity, (p - numbers.base) * R**3], memory])

    def f(state, t=t):
        out, work = np.empty(y.size), [np.empty(M), np.empty(M), np.empty(M + 1), np.empty(M + 1)]
        return out, *solver.derivatives(t, state, numbers, grid, *work, out)

    _, p_dot, z = f(y)
    jacobian = np.empty((y.size, y.size))
    for j in range(y.size):
        step = np.zeros(y.size)
        step[j] = 1e-6 * max(abs(y[j]), 1e-3)
        jacobian[:, j] = (f(y + step)[0] - f(y - step)[0]) / (2 * step[j])
    factors = np.zeros((9, M)), np.zeros((6, M)), np.zeros((memory.size, 4)), np.zeros((5, 5)), np.zeros(5, np.int64)
    if M > 0:
        work = np.zeros((5, M)), np.zeros((7, M + 1))
        solver.eliminate(y, numbers, grid, p_dot, z, 50.0, *work, *factors[:2])
    couplings = solver.factorise(t, y, numbers, grid, p_dot, z, 50.0, *factors)
    u = rng.normal(size=y.size)
    r = 50.0 * u - jacobian @ u
    solver.back_substitute(r, M, *factors, couplings, np.zeros(5))
    assert np.max(np.abs(r - u)) < 1e-5
    by_time = (f(y, t + 1e-6)[0] - f(y, t - 1e-6)[0]) / 2e-6
    assert by_time[2 * M + 1] == pytest.approx(couplings[0], rel=1e-6, abs=1e-8)
    assert ("driving" in way) == (abs(couplings[0]) > 1e-2)


def test_a_failed_solve_says_so(monkeypatch):
    monkeypatch.setattr(forward, "MAX_STEPS", 20)
    with pytest.raises(SolverError, match="20 steps"):
        simulate(GEL, max_radius=2e-4, stretch=8.0, time=TIME)
    run = simulate(GEL, max_radius=2e-4, stretch=8.0, time=TIME, throw=False)
    assert not run.ok
    assert "20 steps" in run.status
    assert np.isnan(run.radius[-1])
    assert np.isfinite(run.radius[0])


def test_what_a_simulation_carries():
    """Stress, strain and rate at the wall are those of the laws; the contents are consistent with the pressure."""
    run = simulate(GEL, max_radius=150e-6, stretch=5.0, time=TIME, fields=True)
    assert run.equilibrium_radius == pytest.approx(30e-6)
    assert run.strain == pytest.approx(np.log(run.radius / 30e-6))
    assert run.strain_rate == pytest.approx(run.velocity / run.radius)
    stress = GEL.elastic.stress(run.radius / 30e-6) + GEL.viscous.stress(run.strain_rate)
    assert run.stress == pytest.approx(stress, rel=1e-9, abs=1e-6)
    inside = run.contents
    y, M = inside.position, 152
    assert inside.temperature.shape == inside.vapour.shape == (101, M + 1)
    assert np.all(np.diff(y) > 0)
    assert y[-1] == 1
    assert np.all(inside.temperature[:, -1] == WATER.temperature)
    saturated = 1 / (1 + 462 / 287 * (run.pressure / WATER.vapour_pressure - 1))  # Dalton at the wall, docs 3.1
    assert inside.vapour[:, -1] == pytest.approx(saturated, rel=1e-12)
    assert inside.temperature.max() > 1000
    # ideal gas: moles of gas, the integral of p (1-k)/(R_m T) over the volume, do not change
    k, T = inside.vapour[:, :-1], inside.temperature[:, :-1]
    mean = k * 462 + (1 - k) * 287
    shells = 3 / wall_clustered(M).inverse_volume
    gas = (run.pressure * run.radius**3) * ((1 - k) / (mean * T) @ shells)
    assert gas == pytest.approx(gas[0], rel=2e-4)  # interpolated between steps
    assert simulate(GEL, max_radius=150e-6, stretch=5.0, time=TIME).contents is None


@pytest.mark.parametrize(
    "pulse", [Pulse(-2e6, 1e6, 3e-6), Pulse(5e5, 2.5e5, 0.5e-6, 1.0), Pulse(-1e6, 1e6, -0.2e-6, 2.0)], ids=str
)
def test_the_table_of_a_pulse(pulse):
    """Value to 1e-8 of the amplitude; slope and curvature are its derivatives; nothing outside half a period."""
    t = np.linspace(0, 12e-6, 4801)
    value, slope, curvature = read(pulse.table(), t)
    assert np.max(np.abs(value - pulse.pressure(t))) < 1e-8 * abs(pulse.amplitude)
    h = 1e-11
    scale = abs(pulse.amplitude) * 2 * np.pi * pulse.frequency
    edge = np.abs(np.abs(t - pulse.centre) - 0.5 / pulse.frequency) < 1e-9  # where exponent 1 has its kink in slope
    rise = (read(pulse.table(), t + h)[0] - read(pulse.table(), np.maximum(t - h, 0))[0]) / (h + np.minimum(t, h))
    assert np.max(np.abs(slope - rise)[~edge]) < 1e-4 * scale
    bend = (read(pulse.table(), t + h)[1] - read(pulse.table(), np.maximum(t - h, 0))[1]) / (h + np.minimum(t, h))
    assert np.max(np.abs(curvature - bend)[~edge]) < 1e-3 * scale * 2 * np.pi * pulse.frequency
    assert pulse.pressure(pulse.centre) == pulse.amplitude
    assert read(pulse.table(), 1.0)[0] == 0


def test_a_trace_invents_nothing_and_is_held_at_its_ends():
    t, p = np.array([1e-6, 2e-6, 3e-6, 5e-6]), np.array([0.0, 1e5, 1e5, -4e5])
    table = Trace(t, p).table()
    assert read(table, t)[0] == pytest.approx(p)
    fine = read(table, np.linspace(0, 8e-6, 2001))[0]
    assert (fine.min(), fine.max()) == (pytest.approx(-4e5), pytest.approx(1e5))
    assert read(table, [0.0, 1.0])[0] == pytest.approx([0.0, -4e5])
