"""Simulated bubbles for the emulator: drawn over its whole domain, solved, and stored in the stretched time s."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, SolverError
from cavirheo.inference import emulator
from cavirheo.inference.assumptions import Family
from cavirheo.inference.emulator import INPUTS, NODES, S_END, STRETCHING, Bubbles, features
from cavirheo.physics.accuracy import DEFAULT, ROUGH, Accuracy
from cavirheo.physics.bubble import Bubble, Damage
from cavirheo.physics.laws import Material
from cavirheo.physics.media import Medium
from cavirheo.physics.simulate import simulate

DOMAIN: dict[str, Any] = {  # what the bubbles of a set are drawn from, and where their trajectories are stored
    "block": 16,  # bubbles of one law in one medium that are drawn together
    "usual_share": 0.55,  # of the blocks are gels or Newtonian liquids near water, most of the default law of `infer`
    "usual_elastic": {"": 0.10, "neo-hookean": 0.28, "fung": 0.62},
    "elastic": {"": 0.14, "neo-hookean": 0.30, "fung": 0.28, "quadratic": 0.08, "gent": 0.04, "mooney-rivlin": 0.04,
                "yeoh": 0.04, "linear": 0.04, "arruda-boyce": 0.04},
    "viscous": {"newtonian": 0.66, "power-law": 0.12, "carreau-yasuda": 0.08, "cross": 0.06, "herschel-bulkley": 0.04,
                "powell-eyring": 0.04},
    "arms": {"": 0.9, "ucm": 0.06, "maxwell": 0.04},
    "largest_stress": emulator.LARGEST_PULL,  # |S_el(R_max)|/p
    "largest_viscosity": 8.0,  # over p t_c
    "stretch": [1.05, 40.0, 1.5, 14.0],  # ends of the range, and of the usual one
    "max_radius": [*emulator.SIZES, 60e-6, 500e-6],  # m, likewise
    "accommodation": [0.01, 1.0],
    "field_share": 0.22,  # of the bubbles have equilibrium contents
    "walled_share": 0.5,  # of the bubbles have confinement inertia, and as many vapour above saturation
    "damaged_share": 0.08,  # of the blocks have damage by strain
    "inputs": INPUTS, "nodes": NODES, "s_end": S_END,
}  # fmt: skip
BLOCK: int = DOMAIN["block"]
LAWS: list[dict[str, float]] = [DOMAIN[part] for part in ("elastic", "viscous", "arms")]
USUAL_LAWS: list[dict[str, float]] = [DOMAIN["usual_elastic"], {"newtonian": 1.0}, {"": 1.0}]
ACCOMMODATIONS: tuple[float, float] = (DOMAIN["accommodation"][0], DOMAIN["accommodation"][1])
COARSE_INSTANTS, FINE_INSTANTS = 2400, 1200  # of a simulation: for the stretched time, and in it
COLUMNS: dict[str, tuple[Any, tuple[int, ...]]] = {  # of a set: dtype and shape of a row
    "inputs": (np.float32, (INPUTS,)),
    "time": (np.float32, (NODES,)),
    "radius": (np.float32, (NODES,)),
    "status": (object, ()),
}
VISCOSITIES = slice(
    2 * len(emulator.RADII), 2 * len(emulator.RADII) + len(emulator.RATES)
)  # of the inputs: log10 of the viscosity over p t_c
THIRD = 3  # collapses until the trajectory counts less


def _log_uniform(rng: np.random.Generator, low: float, high: float, size: int) -> Floats:
    return np.asarray(10.0 ** rng.uniform(np.log10(low), np.log10(high), size))


def _mixed(rng: np.random.Generator, ends: Sequence[float], size: int) -> Floats:
    """(size,) log-uniform numbers, two thirds of them in the usual range, the last two of the ends."""
    low, high, usual_low, usual_high = ends
    usually = rng.random(size) < 2.0 / 3.0
    return np.where(usually, _log_uniform(rng, usual_low, usual_high, size), _log_uniform(rng, low, high, size))


def draw_medium(rng: np.random.Generator, usual: bool) -> Medium:
    """A liquid or gel near water at atmospheric pressure, or, in a third of the draws that are not `usual`, far from
    it."""
    if rng.random() < 0.3:
        return Medium()
    if usual or rng.random() < 0.55:
        near = rng.uniform([940.0, 1400.0, 0.04, 80e3, 288.0], [1120.0, 1750.0, 0.078, 107e3, 313.0]).tolist()
        return Medium(*near)
    constants = dict(emulator.CONSTANTS)
    pressure = float(_log_uniform(rng, *constants.pop("pressure"), 1)[0])
    values = rng.uniform(*zip(*constants.values(), strict=True)).tolist()
    return Medium(pressure=pressure, **dict(zip(constants, values, strict=True)))


def draw(rng: np.random.Generator) -> Iterator[tuple[Floats, tuple[Material, Bubble, Medium, float, float, float]]]:
    """(inputs of the network, arguments of `solve`) of bubbles of one law in one medium; draws outside a law or the
    domain are left out."""
    usual = bool(rng.random() < DOMAIN["usual_share"])
    elastic, viscous, arm = (rng.choice(list(laws), p=list(laws.values())) for laws in (USUAL_LAWS if usual else LAWS))
    family = Family(" + ".join(filter(None, [elastic, viscous, arm])))
    medium = draw_medium(rng, usual)
    damaged = bool(elastic) and not usual and rng.random() < DOMAIN["damaged_share"]
    size = 12 * BLOCK
    bounds = family.bounds()
    x = rng.uniform(bounds[:, 0], bounds[:, 1], (size, len(bounds)))
    radius, stretch = _mixed(rng, DOMAIN["max_radius"], size), _mixed(rng, DOMAIN["stretch"], size)
    field = rng.random(size) < DOMAIN["field_share"]
    accommodation = np.where(field, np.inf, _log_uniform(rng, *ACCOMMODATIONS, size))
    damping = rng.random(size) ** 1.5 * (rng.random(size) < np.where(field, 0.2, 0.85))
    inertia, excess = rng.random((2, size)) ** 1.5 * (rng.random((2, size)) < DOMAIN["walled_share"])
    inertia *= emulator.LARGEST_CONFINEMENT
    excess *= emulator.LARGEST_EXCESS * medium.pressure
    modulus = 10.0 ** -(2.0 * rng.random(size)) if damaged else np.ones(size)
    widening = 10.0 ** rng.random(size) if damaged else np.ones(size)
    arrays = radius, stretch, accommodation, damping, inertia, excess, modulus, widening
    made = features(Bubbles(family.material(x), medium, *arrays))
    viscosity = 10.0 ** made.inputs[:, VISCOSITIES].max(axis=1)  # over p t_c
    usable = np.isfinite(made.inputs).all(axis=1) & (made.pull <= DOMAIN["largest_stress"])
    for i in np.flatnonzero(usable & (viscosity <= DOMAIN["largest_viscosity"])):
        try:
            material = family.material(x[i])
        except InputError:  # its parameters exclude each other
            continue
        damage = Damage(float(modulus[i]), float(widening[i])) if damaged else "none"
        options: dict[str, Any] = {} if field[i] else {"contents": "kinetic", "accommodation": float(accommodation[i])}
        options |= {"confinement_inertia": float(inertia[i]), "vapour_excess": float(excess[i])}
        model = Bubble(**options, damage=damage, confinement_damping=float(damping[i]))
        yield made.inputs[i], (material, model, medium, float(radius[i]), float(stretch[i]), float(made.unit[i]))


def solve(
    material: Material, model: Bubble, medium: Medium, max_radius: float, stretch: float, unit: float
) -> tuple[Floats, Floats]:
    """(NODES,) t/T and R/R_max at equal steps of s, of one bubble with T = `unit`, s. Raises SolverError, InputError.

    A rough simulation at equal times tells s; the accurate one is then made at times that lie evenly in s, so that a
    collapse is resolved."""

    def run(tau: Floats, accuracy: Accuracy) -> tuple[Floats, Floats]:
        shot: Any = {"max_radius": max_radius, "stretch": stretch, "medium": medium, "bubble": model}
        solved = simulate(material, time=tau * unit, accuracy=accuracy, unusual=True, **shot)
        return solved.radius / max_radius, solved.velocity * unit / max_radius

    tau = np.linspace(0.0, S_END, COARSE_INSTANTS)
    s = _stretched(tau, *run(tau, ROUGH))
    fine = np.interp(np.linspace(0.0, 1.04 * S_END, FINE_INSTANTS), s, tau)
    fine = np.unique(np.append(fine[fine < tau[-1]], min(fine[-1] * 1.02, tau[-1])))
    R, U = run(fine, DEFAULT)
    s = _stretched(fine, R, U)
    if s[-1] < S_END * (1.0 - 1e-9):
        raise SolverError("the trajectory ends too early")
    rate = R**STRETCHING  # dtau/ds
    nodes = np.linspace(0.0, S_END, NODES)
    return CubicHermiteSpline(s, fine, rate)(nodes), CubicHermiteSpline(s, R, U * rate)(nodes)


def _stretched(tau: Floats, R: Floats, U: Floats) -> Floats:
    """(n,) s at times tau (n,) from radius and velocity there, by Simpson's rule."""
    step = np.diff(tau)
    middle = np.maximum(0.5 * (R[1:] + R[:-1]) + step / 8.0 * (U[:-1] - U[1:]), 1e-3)
    pieces = step / 6.0 * (R[:-1] ** -STRETCHING + 4.0 * middle**-STRETCHING + R[1:] ** -STRETCHING)
    return np.concatenate([[0.0], np.cumsum(pieces)])


def simulated(seed: int, rows: range) -> dict[str, Any]:
    """The columns of bubbles `rows` of the set with this seed; rows starts at a whole block."""
    parts = [block(seed, number) for number in range(rows.start // BLOCK, -(-rows.stop // BLOCK))]
    return {name: np.concatenate([part[name] for part in parts])[: len(rows)] for name in COLUMNS}


def compared_end(radius: NDArray[Any]) -> NDArray[np.int64]:
    """(k,) index of the last node of trajectories (k, NODES) that counts in full: in the rebound that follows the third
    collapse, or the last of all."""
    inner = radius[:, 1:-1]
    low = (inner < radius[:, :-2]) & (inner <= radius[:, 2:]) & (inner < 0.97)
    collapses = np.cumsum(low, axis=1)
    third, second = ((collapses >= count).argmax(axis=1) + 1 for count in (THIRD, THIRD - 1))
    end = np.where(collapses[:, -1] >= THIRD, third + 0.6 * (third - second), NODES - 1)
    return np.minimum(end, NODES - 1).astype(np.int64)


def block(seed: int, number: int) -> dict[str, Any]:
    """The columns of block `number` of the set with this seed; it depends on both numbers alone. A bubble that was not
    solved has its row, of NaN."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
    made: dict[str, Any] = {name: np.full((BLOCK, *shape), np.nan) for name, (_, shape) in COLUMNS.items()}
    made["status"] = np.full(BLOCK, "not solved", dtype=object)
    for i, (inputs, shot) in enumerate(islice(draw(rng), BLOCK)):
        with suppress(InputError, SolverError):
            made["time"][i], made["radius"][i] = solve(*shot)
            made["inputs"][i], made["status"][i] = inputs, "ok"
    return made
