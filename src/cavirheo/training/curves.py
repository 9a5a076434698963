"""Curves that a posterior network is trained on: simulated once, filmed anew each time that they are shown.

A curve is stored as R/R_max at 512 of 2,401 regular times to t* = 6, most of them where it bends.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.inference.bins import END
from cavirheo.inference.latent import COORDINATES, damping, to_latent, z_index
from cavirheo.inference.law import Family
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.accuracy import ROUGH
from cavirheo.physics.bubble import FIELD, Bubble
from cavirheo.physics.media import WATER
from cavirheo.physics.simulate import simulate
from cavirheo.prior import uniforms
from cavirheo.training.recipe import PosteriorTable, sampled_parameters
from cavirheo.training.shards import Layout, Rows

PER_FILE = 1000
NODES = 512
STEPS = 2400  # regular times
TOP = 1.1  # R/R_max of the largest number that is stored


@dataclass(frozen=True)
class CurveStore:
    """Many curves. time, radius: (n, NODES) as whole numbers, perhaps on the disk; z: (n, 9); kind: (n,) index of
    law and bubble; max_radius: (n,) m."""

    time: NDArray[np.uint16]
    radius: NDArray[np.uint16]
    z: NDArray[np.float32]
    kind: NDArray[np.uint8]
    max_radius: NDArray[np.float32]


COLUMNS: dict[str, tuple[Any, tuple[int, ...]]] = {
    "time": (np.uint16, (NODES,)),
    "radius": (np.uint16, (NODES,)),
    "z": (np.float32, (len(COORDINATES),)),
    "kind": (np.uint8, ()),
    "max_radius": (np.float32, ()),
}


def curves_layout(table: PosteriorTable) -> Layout:
    """Curves of a posterior network; those whose simulation failed are left out and counted. 1.2 kB each, from 2.1."""
    problem = json.dumps(table.model_dump(mode="json", exclude_none=True), sort_keys=True)
    low, high = table.max_radius_um
    summary = [f"{law}: {share:.0%} of the curves" for law, share in sorted(table.laws.items())]
    summary += [f"bubble {name}: {share:.0%}" for name, share in sorted(table.bubbles.items())]
    summary.append(f"R_max {low:g} to {high:g} um")
    return Layout(problem, PER_FILE, COLUMNS, partial(simulated_curves, table), summary)


def simulated_curves(table: PosteriorTable, seed: int, block: range) -> Rows:
    """Columns of those of these curves whose simulation did not fail."""
    curves = [curve for index in block if (curve := simulated_curve(table, seed, index)) is not None]
    columns = zip(*curves, strict=True) if curves else [()] * len(COLUMNS)
    return {
        name: np.array(values, kind).reshape(-1, *shape)
        for (name, (kind, shape)), values in zip(COLUMNS.items(), columns, strict=True)
    }


def simulated_curve(table: PosteriorTable, seed: int, index: int) -> tuple[Any, ...] | None:
    """Curve `index`: (time, radius, z, kind, max_radius), or None if its simulation failed."""
    draws = uniforms(seed, index, 9)
    shares = np.cumsum([share for *_, share in table.kinds])
    kind = int(np.searchsorted(shares, draws[0] * shares[-1], side="right"))
    law, bubble_name, _ = table.kinds[kind]
    family, names = Family(law), sampled_parameters(law, bubble_name)
    bounds = np.array([PARAMETERS[name].searched for name in names])
    low, high = (1e-6 * end for end in table.max_radius_um)
    log10 = bounds[:, 0] + draws[2 : 2 + len(names)] * (bounds[:, 1] - bounds[:, 0])
    max_radius = float(low * (high / low) ** draws[1])
    z = to_latent(names, log10[None])[0]
    bubble = FIELD
    if bubble_name == "real":
        z[z_index("confinement_damping")] = ndtri(draws[8])
        damped = float(damping(z[z_index("confinement_damping")]))
        bubble = Bubble("kinetic", float(10.0 ** log10[-1]), confinement_damping=damped)
    law_size = len(family.parameters)
    stretch = float(10.0 ** log10[law_size])
    times = np.linspace(0.0, END, STEPS + 1) * WATER.time_scale(max_radius)
    material = family.material(log10[:law_size])
    settings: dict[str, Any] = {"time": times, "bubble": bubble, "accuracy": ROUGH, "throw": False}
    try:
        run = simulate(material, max_radius=max_radius, stretch=stretch, **settings)
    except InputError:
        return None
    if not run.ok or not np.isfinite(run.radius).all():
        return None
    radius = run.radius / max_radius
    chosen = nodes(radius)
    return chosen, np.round(np.clip(radius[chosen] / TOP, 0.0, 1.0) * 65535), z, kind, max_radius


def nodes(radius: Floats) -> NDArray[np.int64]:
    """(NODES,) indices, ascending and different, of a curve (STEPS + 1,) between which straight lines follow it."""
    bend = np.zeros(STEPS + 1)
    bend[1:-1] = np.abs(np.diff(radius, 2))
    bend = np.maximum(bend, np.maximum(np.roll(bend, 1), np.roll(bend, -1)))
    density = np.sqrt(bend)
    density /= np.sum(density) + 1e-12
    # never more than one of a time: what is above is given to the others
    share = 0.3 / (STEPS + 1) + 0.7 * density
    for _ in range(6):
        share = np.minimum(share, 1.0 / NODES)
        share /= np.sum(share)
    filled = np.cumsum(share) * (NODES - 1)
    chosen = np.unique(np.concatenate([[0, STEPS], np.searchsorted(filled, np.arange(1, NODES - 1))]))
    chosen = chosen[chosen <= STEPS]
    if len(chosen) < NODES:
        free = np.setdiff1d(np.arange(STEPS + 1), chosen)
        more = free[np.argsort(-share[free], kind="stable")[: NODES - len(chosen)]]
        chosen = np.sort(np.concatenate([chosen, more]))
    return chosen
