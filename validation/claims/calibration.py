"""Do intervals hold the truth as often as they say? Simulated shots drawn from the prior.

Truth: NHKV, log10 G (500 Pa to 50 kPa), log10 mu (5 mPa s to 0.5 Pa s) and log10 stretch (4 to 11) uniform, R_max
100 to 400 um; of the real bubble also log10 of the accommodation (0.01 to 1) uniform and the confinement damping from
the half of a normal, as in the prior. 100 frames over 4.07 t_c, each the mean of 15 instants within 0.3 of a frame;
clock off by up to half a frame, radii by a scale and R_max by a factor with 0.5 % standard deviation (cut at 1.5 %);
1 % of R_max noise. Simulated with PRECISE. What the truth or the answer does not have is not counted. As read: R_max
and its time come off the noisy frames, as for a file, instead of as drawn. The ways: `infer`, `fit` and `--verify
full`, all within the ranges of the truth, because a truth from a narrower range than the prior's is no test of the
interval where the curve says little; `fit` with clock, scale and R_max free. "four_laws": the part of NHKV in the
average over the laws of the default, each of which has fewer draws than one law alone.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from cavirheo.inference.posterior_network import network_of
from cavirheo.inference.verify import verify
from scipy.stats import truncnorm

from cavirheo import NeoHookeanKelvinVoigt, RadiusCurve, fit, simulate
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.experiment import BOUND_SCALES, ZETA, Experiment
from cavirheo.physics.accuracy import PRECISE
from cavirheo.physics.bubble import BUBBLES, FIELD, Bubble
from cavirheo.physics.materials import Material
from cavirheo.physics.media import WATER
from cavirheo.posterior import Posterior
from cavirheo.prior import Prior
from validation.numbers import Number, Run, coverage, statistic

RANGES = {"shear_modulus": (500.0, 5e4), "viscosity": (5e-3, 0.5), "stretch": (4.0, 11.0)}
OF_BUBBLE = {"field": RANGES, "real": {**RANGES, "accommodation": (0.01, 1.0)}}  # ranges of its parameters
ADDED = "confinement_damping"  # of the real bubble: half-normal
LEVELS = (0.5, 0.9)
FIRST = 2000  # seed of the first shot: on those before it settings were chosen
SETTINGS = {  # bubble of the shots, of the answer, way, R_max as read, discrepancy; shots of a quick and a full run
    "infer": (("real", "real", "infer", False, False), 40, 300),
    "fit": (("real", "real", "fit", False, False), 48, 300),
    "full": (("real", "real", "full", False, False), 32, 100),
    "four_laws": (("real", "real", "laws", False, False), 20, 300),
    "infer_as_read": (("real", "real", "infer", True, True), 32, 200),
    "field_infer": (("field", "real", "infer", False, False), 0, 300),
    "field_infer_field": (("field", "field", "infer", False, False), 0, 300),
    "field_fit_field": (("field", "field", "fit", False, False), 0, 300),
    "field_full_field": (("field", "field", "full", False, False), 0, 100),
}
SHOWN = {
    "G": "shear_modulus",
    "mu": "viscosity",
    "stretch": "stretch",
    "accommodation": "accommodation",
    "damping": ADDED,
}
FRAMES, EXPOSURE, NOISE, BOUND = 100, 0.3, 0.01, 0.015


def shot(seed: int, *, simulated: str = "field", as_read: bool = False) -> tuple[dict[str, float], RadiusCurve]:
    """Truth by name, and the curve that the camera makes of it; simulated: name of the bubble."""
    rng = np.random.default_rng([seed, 5])
    ranges = OF_BUBBLE[simulated]
    truth = {name: float(10 ** rng.uniform(*np.log10(pair))) for name, pair in ranges.items()}
    top = float(rng.uniform(100e-6, 400e-6))  # R_max as measured
    law = NeoHookeanKelvinVoigt(truth["shear_modulus"], truth["viscosity"])
    bubble = FIELD
    if simulated == "real":
        truth[ADDED] = float(ZETA * truncnorm(0.0, BOUND_SCALES).rvs(random_state=rng))
        bubble = Bubble("kinetic", truth["accommodation"], confinement_damping=truth[ADDED])
    camera, curve = film(
        law, top, truth["stretch"], NOISE, rng, f"shot {seed}", as_read=as_read, bubble=bubble
    )  # fmt: skip
    return truth | camera, curve


def film(
    law: Material,
    top: float,
    stretch: float,
    noise: float,
    rng: np.random.Generator,
    name: str,
    *,
    as_read: bool = False,
    exposure: float = EXPOSURE,
    bubble: Bubble = FIELD,
) -> tuple[dict[str, float], RadiusCurve]:
    """The nuisances by name, and the curve of measured R_max `top` that a camera with them makes of a bubble."""
    frame = 4.07 * WATER.time_scale(top) / (FRAMES - 1)
    scale, factor = 1.0 + BOUND / 3.0 * truncnorm(-3, 3).rvs(2, random_state=rng)
    t0 = rng.uniform(-0.5, 0.5) * frame
    camera = {"time_origin": t0, "radius_scale": float(scale), "max_radius_factor": float(factor)}
    time = frame * np.arange(FRAMES)
    instants = np.abs(time[:, None] - t0 + exposure * frame * (np.arange(15) - 7.0) / 15.0).ravel()
    order = np.argsort(instants)
    seen = np.empty_like(instants)
    top_true = top * scale * factor
    run = simulate(law, max_radius=top_true, stretch=stretch, time=instants[order], bubble=bubble, accuracy=PRECISE)
    seen[order] = run.radius / scale
    radius = seen.reshape(FRAMES, 15).mean(axis=1) + noise * top * rng.standard_normal(FRAMES)
    meta, maximum = {"name": name, "exposure_s": exposure * frame}, None if as_read else (0.0, top)
    return camera, RadiusCurve(time, np.maximum(radius, 1e-3 * top), meta=meta, maximum=maximum)


def rank(answer: Posterior, name: str, truth: float) -> float:
    """Posterior probability below the truth: uniform over shots if the posterior is calibrated."""
    return float(np.sum(answer.weights[answer.draws(name) < truth]))


@contextmanager
def narrowed(ranges: Mapping[str, tuple[float, float]]) -> Iterator[None]:
    """A prior of these ranges, of the parameters that a law has, also for `fit`, which takes none."""
    whole = Experiment.prior

    def prior(self: Experiment, given: Mapping[str, Sequence[float]] | None = None) -> Prior:
        return whole(self, given or {name: pair for name, pair in ranges.items() if name in self.names})

    try:
        Experiment.prior = prior
        yield
    finally:
        Experiment.prior = whole


def one(job: tuple[int, str, str, str, bool, bool]) -> dict:
    """Posterior probability below the truth, and 90 % interval, of each parameter; none where there is no posterior."""
    seed, simulated, name, way, as_read, discrepancy = job
    truth, curve = shot(seed, simulated=simulated, as_read=as_read)
    bubble, ranges = BUBBLES[name], OF_BUBBLE[name]
    # as drawn, the clock is known to half a frame; read off the frames it is not, and the default range is wider
    bound = None if as_read else 0.5 * float(np.median(np.diff(curve.time)))
    how: dict[str, Any] = {"ranges": ranges, "discrepancy": discrepancy, "t0_bound": bound, "workers": 1, "seed": seed}
    alone: dict[str, Any] = {"bubble": bubble, "others": False, "workers": 1}
    began = time.process_time()
    if way == "fit":
        alone |= {"free": ("t0", "scale", "rmax")}
        with narrowed(ranges):
            answer = fit(curve, trust_input=True, seed=seed, **alone)
    elif way in ("infer", "laws"):
        law = "nhkv" if way == "infer" else "auto"
        starts = Analysis(material=law, bubble=bubble, trust_input=True).starts(curve)
        with narrowed(how.pop("ranges")):
            answer = verify(curve, starts, level="auto", network=network_of(), **how)
        answer = answer.laws.get("nhkv", answer)
    else:
        answer = verify(curve, fit(curve, window="all", **alone), scale_bound=BOUND, **how)
    row: dict[str, Any] = {"verdict": answer.checks.verdict, "seconds": time.process_time() - began}
    told = answer.log_weight is not None
    asked = [n for n in SHOWN.values() if n in truth and n in answer.parameters and told]
    row["ranks"] = {n: rank(answer, n, truth[n]) for n in asked}
    row["intervals"] = {n: answer.interval(n, LEVELS[-1]) for n in asked}
    return row


def measure(run: Run) -> Iterator[Number]:
    """How often central 50 and 90 % intervals of each parameter hold the truth, and their width in decades."""
    for setting, (how, quick, full) in SETTINGS.items():
        if run.part not in ("", setting):
            continue
        n = run.count(quick, full)
        rows = run.rows("calibration", one, [(seed, *how) for seed in range(FIRST, FIRST + n)])
        for symbol, name in SHOWN.items():
            ranks = np.array([row["ranks"][name] for row in rows if name in row["ranks"]])
            if not len(ranks):
                continue
            for level in LEVELS:
                yield coverage(f"{setting}.{symbol}.{100 * level:.0f}", np.abs(ranks - 0.5) <= 0.5 * level, level)
            ends = [row["intervals"][name] for row in rows if row["intervals"].get(name)]
            if name != ADDED:
                yield statistic(f"{setting}.{symbol}.width", [np.log10(high / low) for low, high in ends], "decades")
        if rows:
            yield statistic(f"{setting}.seconds", [row["seconds"] for row in rows], "s")
