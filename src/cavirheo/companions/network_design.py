"""Where a posterior network is least sure: what it leaves of the parameters beside what the recordings tell.

Recordings are simulated over the network's training (R_max, law, stretch, frame rate) and read by the network alone.
Its 90 % intervals are set beside those that the frames allow (inference/design.py): a ratio of 1 is all that can be
had. The third of a parameter's range with the largest mean ratio is where a recipe draws more curves.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from scipy.stats.qmc import Halton

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, SolverError, require
from cavirheo.inference.design import Setting, expected
from cavirheo.inference.law import Family
from cavirheo.inference.network_answer import Networked
from cavirheo.inference.posterior_network import PosteriorModel
from cavirheo.parallel import each
from cavirheo.parameters import PARAMETERS, RADIUS
from cavirheo.physics.bubble import FIELD
from cavirheo.physics.media import WATER
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Record

PARTS = 3  # of each range
FRAMES_PER_TIME = (8.0, 40.0)  # frames in a t_c
FRAMES, NOISE = 128, 0.01
FEWEST = 30  # recordings, below which thirds mean nothing


class WeakRange(Record):
    """A third of the range of a parameter.

    Attributes:
        parameter: by natural name.
        low: lower end of the third, SI.
        high: its upper end, SI.
        recordings: how many were simulated there.
        width_ratio: geometric mean over recordings and the law's parameters of the network's 90 % interval
            (decades) over
            that which the frames allow.
        error: standard error of this ratio, a factor.
        inside_90: share of truths within the network's intervals.
    """

    parameter: str
    low: float
    high: float
    recordings: int
    width_ratio: float
    error: float
    inside_90: float


class NetworkDesign(Document):
    """Where a posterior network is least sure.

    Attributes:
        model: name of the network.
        material: the law.
        recordings: how many were simulated and read.
        unreadable: how many more could not be read.
        ranges: thirds of the range of each parameter.
        worst: index of the range of which a recipe should draw more.
    """

    kind: Literal["network-design"] = "network-design"
    model: str
    material: str
    recordings: int
    unreadable: int
    ranges: list[WeakRange]
    worst: int

    @property
    def said(self) -> str:
        worst = self.ranges[self.worst]
        where = f"{worst.parameter} {digits.significant(worst.low)} to {digits.significant(worst.high)}"
        return f"widest beside what the frames allow: {where}, {worst.width_ratio:.2f} times (all: {self.overall:.2f})"

    @property
    def overall(self) -> float:
        """The ratio over all recordings."""
        mine = [one for one in self.ranges if one.parameter == self.ranges[0].parameter]
        return float(np.exp(np.average(np.log([m.width_ratio for m in mine]), weights=[m.recordings for m in mine])))


def network_design(
    model: PosteriorModel,
    material: str = "nhkv",
    *,
    recordings: int = 120,
    seed: int = 0,
    workers: int | None = None,
    done: Callable[[], None] | None = None,
    **head: Any,
) -> NetworkDesign:
    """Simulate recordings over the training of the network, let it read them, and find the ranges where it is weak;
    `head`: command, date, notes.

    Raises:
        InputError: the network does not know the law, or too few recordings were asked for or could be read.
    """
    message = f"the network {model.name} was not trained on {material} with the field's bubble"
    require(model.knows(material, FIELD), message, "design.law")
    require(recordings >= FEWEST, f"at least {FEWEST} recordings, got {recordings}", "design.draws")
    family = Family(material)
    low, high = (1e-6 * end for end in model.card.trained["max_radius_um"])
    radii = max(low, RADIUS.low), min(high, RADIUS.high)
    searched = {"max_radius": np.log10(radii), **{name: PARAMETERS[name].searched for name in family.parameters}}
    searched |= {"stretch": PARAMETERS["stretch"].searched, "frames_per_time": np.log10(FRAMES_PER_TIME)}
    ends = np.array(list(searched.values()), dtype=float)
    points = ends[:, 0] + np.ptp(ends, axis=1) * Halton(len(ends), seed=seed).random(recordings)
    reader, size = Networked(model, material, checked=False), len(family.parameters)

    def one(k: int) -> tuple[float, float] | None:
        """log of the ratio of widths, and the share of parameters within; None: it cannot be read."""
        radius, stretch, rate = 10.0 ** points[k, 0], 10.0 ** points[k, -2], 10.0 ** points[k, -1]
        setting = Setting(radius, rate / WATER.time_scale(radius), relative_noise=NOISE, frames=FRAMES)
        try:
            curve, truth = setting.film(family, points[k, 1:-2], stretch, seed=seed + k, bubble=FIELD)
            allowed = expected(curve, truth, family, bubble=FIELD).half_width
        except (InputError, SolverError, np.linalg.LinAlgError):
            return None
        answer = reader.infer(curve)
        if len(answer.theta) < 2:
            return None
        low, high = np.quantile(answer.theta[:, :size], [0.05, 0.95], axis=0)
        inside = (low <= points[k, 1:-2]) & (points[k, 1:-2] <= high)
        return float(np.mean(np.log(0.5 * (high - low) / allowed))), float(np.mean(inside))

    pairs = each(one, range(recordings), workers, (lambda *_: done()) if done else None)
    read = np.array([k for k, pair in enumerate(pairs) if pair is not None], dtype=int)
    message = f"{len(read)} of {recordings} recordings could be read: too few"
    require(len(read) >= FEWEST // 2, message, "design.unreadable")
    values = np.array([pair for pair in pairs if pair is not None])
    rows = [row for i, name in enumerate(searched) for row in _thirds(name, ends[i], points[read, i], values)]
    of_material = [i for i, row in enumerate(rows) if row.parameter != "frames_per_time"]
    return NetworkDesign(
        model=model.name,
        material=material,
        recordings=len(read),
        unreadable=recordings - len(read),
        ranges=rows,
        worst=max(of_material, key=lambda i: rows[i].width_ratio / rows[i].error),
        **({"command": "cavirheo design"} | head),
    )


def _thirds(name: str, ends: Floats, at: Floats, values: Floats) -> list[WeakRange]:
    """Of a parameter whose log10 is `at` (n,); values: (n, 2) as found."""
    edges = np.linspace(ends[0], ends[1], PARTS + 1)
    place = np.clip(np.digitize(at, edges[1:-1]), 0, PARTS - 1)
    rows = []
    for part in range(PARTS):
        inside = values[place == part]
        if len(inside) > 2:
            ratio, share = inside.T
            third = WeakRange(
                parameter=name,
                low=10.0 ** edges[part],
                high=10.0 ** edges[part + 1],
                recordings=len(inside),
                width_ratio=float(np.exp(np.mean(ratio))),
                error=float(np.exp(np.std(ratio, ddof=1) / np.sqrt(len(ratio)))),
                inside_90=float(np.mean(share)),
            )
            rows.append(third)
    return rows


def recipe(document: NetworkDesign, model: PosteriorModel, share: float = 0.5) -> str:
    """TOML of a training set of the network's kinds, of which this share is drawn from the worst range."""
    worst, card = document.ranges[document.worst], model.card
    laws = dict.fromkeys(law for law, _ in card.kinds)
    bubbles = dict.fromkeys(bubble for _, bubble in card.kinds)
    radii, trained = card.trained["max_radius_um"], card.training.model_dump()
    return f"""\
# {document.said}
# Shares of laws and bubbles are equal: a network's card does not have them.
[posterior]
laws = {{ {", ".join(f'"{law}" = {1 / len(laws):.4g}' for law in laws)} }}
bubbles = {{ {", ".join(f"{name} = {1 / len(bubbles):.4g}" for name in bubbles)} }}
max_radius_um = [{radii[0]:g}, {radii[1]:g}]

[posterior.more]
share = {share:g}
{worst.parameter} = [{worst.low:.6g}, {worst.high:.6g}] # SI

[data]
n = {trained.get("curves", 120_000)}
seed = 8

[training]
samples = {trained.get("samples", 16_000_000)}

[export]
name = "{document.model}-more"
"""


def print_table(document: NetworkDesign) -> None:
    """A line per third of each range, then the worst."""
    console = terminal.console()
    heads = ["from", "to", "recordings", "width over\nwhat is allowed", "truth inside\n90 %"]
    table = terminal.table("parameter, SI", heads, title=f"{document.model}, {document.material}")
    for k, weak in enumerate(document.ranges):
        row = [digits.significant(weak.low), digits.significant(weak.high), str(weak.recordings)]
        row += [f"{weak.width_ratio:.2f} ×/÷ {weak.error:.2f}", f"{100 * weak.inside_90:.0f} %"]
        table.add_row(weak.parameter, *row, style="bold" if k == document.worst else "")
    console.print(table)
    console.print(document.said)
