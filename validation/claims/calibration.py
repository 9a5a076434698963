"""Do intervals hold the truth as often as they say, and switches as often as their probability? Simulated shots.

Truths: log10 G (500 Pa to 50 kPa), log10 mu (5 mPa s to 0.5 Pa s) and log10 stretch (4 to 11) uniform, R_max 100 to
400 um. Kinds: "real": a neo-Hookean gel, log10 of the accommodation (0.01 to 1) uniform, confinement inertia and
damping from squares of normals, as in the prior; "field": a gel with the field's bubble; "liquid": no modulus, the
real bubble; "thinning": a liquid with this viscosity at 1e5 1/s that thins (EXPONENTS), the real
bubble; "stiffening": Fung's spring that is 1.3 to 20 times as stiff at R_max, the real bubble. 100 frames over
4.07 t_c, each the mean of 15 instants within 0.3 of a frame; clock off by up to half a frame, radii by a scale and
R_max by a factor with 0.5 % standard deviation (cut at 1.5 %); 1 % of R_max noise. Simulated with PRECISE. Kind
"prior": law, bubble and stretch from the prior of the default family itself, whose probabilities of switches are
compared with them. Ways: "infer" (the default family), "nhkv" (`infer` by this law), "fit" (by this law; clock, scale
and R_max free).

What is printed counts: low <= truth <= high, of a bound its one end, and nothing of a value that is not known. The
truths of all kinds but "prior" are from narrower ranges than the priors, which costs coverage. "within": what is left
of an answer by "nhkv" if its prior is cut to the ranges and the bubble of the truths, and uniform there.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import truncnorm

from cavirheo import NeoHookeanKelvinVoigt, Newtonian, Posterior, RadiusCurve, fit_many, infer_many, simulate
from cavirheo.errors import SolverError
from cavirheo.inference.answer import DEPENDENT
from cavirheo.inference.assumptions import AUTO, Family, Options
from cavirheo.inference.emulator import LARGEST_PULL, features
from cavirheo.inference.experiment import DAMPING_SCALE, INERTIA_SCALE, MOST_ROOT, Experiment
from cavirheo.parameters import REFERENCE_RATE, USUAL_STRETCH
from cavirheo.physics.accuracy import PRECISE
from cavirheo.physics.bubble import FIELD, REAL, Bubble
from cavirheo.physics.laws import Fung, PowerLaw
from cavirheo.physics.materials import Material, Viscoelastic
from cavirheo.physics.media import WATER
from validation.numbers import Number, Run, coverage, share, statistic

RANGES = {"shear_modulus": (500.0, 5e4), "viscosity": (5e-3, 0.5), "stretch": (4.0, 11.0)}
EXPONENTS = 0.4, 0.9  # of a liquid that thins
WALLS = ("confinement_inertia", "confinement_damping")  # of the real bubble
LEVELS = (0.5, 0.9)
FIRST = 2000  # seed of the first shot: on those before it settings were chosen
KINDS = ("real", "field", "liquid", "stiffening", "prior", "thinning")  # of truths
OF_DEFAULT = ("prior", "thinning")  # asked of the default family alone
WAYS = ("infer", "nhkv", "fit")
BINS = (0.0, 0.2, 0.5, 0.8, 1.0)  # of the probability that is said of a switch
SWITCHES = ("liquid", "stiffening", "thinning", "field_bubble")
SETTINGS = {f"{way}_{kind}": (kind, way) for way in WAYS for kind in KINDS if way == "infer" or kind not in OF_DEFAULT}
SHOTS = 50, 300  # of a setting, in a quick and a full run
FROM_PRIOR = 900  # in a full run: a switch is rarely said to be 80 to 100 % probable
SHOWN = {"G": "shear_modulus", "mu": "viscosity", "stretch": "stretch"}
FRAMES, EXPOSURE, NOISE, BOUND = 100, 0.3, 0.01, 0.015
FEWEST = 20  # draws of an interval


def shot(seed: int, *, kind: str = "field", as_read: bool = False) -> tuple[dict[str, float], RadiusCurve]:
    """Truth by name, and the curve that the camera makes of it."""
    rng = np.random.default_rng([seed, 5, KINDS.index(kind)])
    while True:
        truth, law, bubble = of_the_prior(rng) if kind == "prior" else of_kind(kind, rng)
        top = float(rng.uniform(100e-6, 400e-6))  # R_max as measured
        try:
            camera, curve = film(law, top, truth["stretch"], NOISE, rng, f"shot {seed}", as_read=as_read, bubble=bubble)
        except SolverError:  # a gel so stiff cannot be so large
            continue
        return truth | camera, curve


def of_kind(kind: str, rng: np.random.Generator) -> tuple[dict[str, float], Material, Bubble]:
    """Truth by name, material and bubble."""
    truth = {name: float(10 ** rng.uniform(*np.log10(pair))) for name, pair in RANGES.items()}
    law: Material = NeoHookeanKelvinVoigt(truth["shear_modulus"], truth["viscosity"])
    if kind == "liquid":
        truth["shear_modulus"], law = 0.0, Newtonian(truth["viscosity"])
    if kind == "thinning":
        truth["shear_modulus"], law = 0.0, thinning(truth["viscosity"], float(rng.uniform(*EXPONENTS)))
    if kind == "stiffening":  # exp(stiffening x 2 stretch^2) at R_max
        truth["stiffening"] = float(rng.uniform(np.log(1.3), np.log(20.0)) / (2.0 * truth["stretch"] ** 2))
        law = Viscoelastic(Fung(truth["shear_modulus"], truth["stiffening"]), Newtonian(truth["viscosity"]))
    if kind == "field":
        return truth, law, FIELD
    bubble = real_bubble(rng)
    truth |= {"accommodation": float(bubble.accommodation), **{name: getattr(bubble, name) for name in WALLS}}
    return truth, law, bubble


def thinning(viscosity: float, exponent: float) -> Material:
    """A liquid with this viscosity, Pa s, at 1e5 1/s."""
    return PowerLaw(viscosity * REFERENCE_RATE ** (1.0 - exponent), exponent)


def real_bubble(rng: np.random.Generator) -> Bubble:
    accommodation = float(10 ** rng.uniform(-2.0, 0.0))
    inertia, damping = (truncnorm(0.0, MOST_ROOT).rvs(2, random_state=rng) ** 2).tolist()
    return Bubble(
        "kinetic",
        accommodation,
        confinement_inertia=INERTIA_SCALE * inertia,
        confinement_damping=DAMPING_SCALE * damping,
    )


@cache
def default_shot() -> Experiment:
    """A shot of the default family, which has its prior."""
    return Experiment(shot(FIRST)[1], Family(AUTO), WATER, Options(bubble=REAL))


def of_the_prior(rng: np.random.Generator) -> tuple[dict[str, float], Material, Bubble]:
    """As `of_kind`, from the prior of the default family; the switches are 0 or 1."""
    usual = default_shot()
    states = usual.prior().states(DEPENDENT)
    while True:
        state = states[rng.choice(len(states), p=np.exp([each.log_probability for each in states]))]
        x = state.to_x(rng.standard_normal((1, len(state.columns))))
        if features(usual.bubbles(x)).pull[0] <= LARGEST_PULL:  # others have no prior probability
            break
    x = x[0]
    truth = usual.all_values(x)
    bubble = usual.bubble_with(truth)
    switches = {
        "liquid": truth["shear_modulus"] == 0.0,
        "stiffening": truth["shear_modulus"] > 0.0 and truth["stiffening"] > 0.0,
        "thinning": truth["thinning"] > 0.0,
        "field_bubble": bubble == FIELD,
    }
    return (
        truth | {name: float(on) for name, on in switches.items()},
        usual.family.material(x[: usual.law_size]),
        bubble,
    )


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


def like_truths(answer: Posterior, truth: dict[str, float]) -> Posterior | None:
    """The answer with its draws that have the bubble of the truth and lie in RANGES, where log10 of the stretch is
    uniform; None if there are few."""
    draws = {name: answer.draws(name) for name in answer.parameters}
    inside = np.ones(len(answer.theta), dtype=bool)
    for name, (low, high) in RANGES.items():
        inside &= (low <= draws[name]) & (draws[name] <= high)
    if "accommodation" in draws:  # 1: the field's bubble
        inside &= (draws["accommodation"] < 1.0) == ("accommodation" in truth)
    if np.count_nonzero(inside) < FEWEST or answer.log_weight is None:
        return None
    middle, factor = USUAL_STRETCH
    flat = 0.5 * (np.log(draws["stretch"][inside] / middle) / np.log(factor)) ** 2
    return replace(answer, theta=answer.theta[inside], log_weight=answer.log_weight[inside] + flat)


def answered(curve: RadiusCurve, way: str, seed: int) -> Posterior:
    if way == "fit":
        return fit_many([curve], free=("t0", "scale", "rmax"), trust_input=True, seed=seed, workers=1)[0]
    law = None if way == "infer" else way
    return infer_many([curve], material=law, trust_input=True, seed=seed, workers=1)[0]


def one(job: tuple[int, str, str]) -> dict[str, Any]:
    """Verdict, switches, and by parameter the truth and the printed intervals; none where there is no posterior."""
    seed, kind, way = job
    truth, curve = shot(seed, kind=kind)
    began = time.process_time()
    answer = answered(curve, way, seed)
    told = answer.log_weight is not None
    asked = [name for name in SHOWN.values() if told and name in answer.parameters]
    if truth["shear_modulus"] == 0.0 and way != "infer":  # a law without the switch has a modulus
        asked = [name for name in asked if name != "shear_modulus"]
    like = like_truths(answer, truth) if told and way == "nhkv" and kind in ("real", "field") else None
    return {
        "verdict": answer.checks.verdict, "seconds": time.process_time() - began,
        "switches": dict(answer.switches), "effective": answer.diagnostics.effective_sample_size,
        "simulations": answer.diagnostics.simulations, "truth": {name: truth[name] for name in asked},
        "on": {name: truth[name] for name in SWITCHES if name in truth},
        "bounds": {name: answer.bound(name) for name in asked},
        "intervals": {name: [answer.interval(name, level) for level in LEVELS] for name in asked},
        "within": {name: like.interval(name) for name in asked} if like else {},
    }  # fmt: skip


def of_switches(rows: list[dict[str, Any]]) -> Iterator[Number]:
    """In bins of the probability that is said of a switch: its mean, and the share of shots of which it is true."""
    told = [row for row in rows if row["switches"]]
    for name in SWITCHES:
        said = np.array([row["switches"][name] for row in told])
        true = np.array([row["on"][name] for row in told])
        for low, high in pairwise(BINS):
            inside = (said >= low) & ((said < high) | (high == BINS[-1]))
            if np.any(inside):
                yield statistic(f"switch.{name}.{low:g}.said", said[inside], "1", np.mean, FIRST)
                yield share(f"switch.{name}.{low:g}.true", true[inside] > 0.5, FIRST)


def holds(row: dict[str, Any], name: str, level: int) -> bool | None:
    """Whether what is printed of a parameter holds; None if nothing is. Bounds are printed at 90 % alone."""
    truth, (low, high) = row["truth"][name], row["intervals"][name][level]
    bound = row["bounds"][name] if LEVELS[level] == LEVELS[-1] else None
    if bound == "undetermined":
        return None
    return bool((low <= truth or bound == "upper") and (truth <= high or bound == "lower"))


def of_setting(setting: str, rows: list[dict[str, Any]]) -> Iterator[Number]:
    """Coverage and width of the intervals of a setting, and what an answer takes."""
    for symbol, name in SHOWN.items():
        held = [row for row in rows if row["intervals"].get(name)]
        for k, level in enumerate(LEVELS if held else ()):
            hits = [hit for row in held if (hit := holds(row, name, k)) is not None]
            yield coverage(f"{setting}.{symbol}.{100 * level:.0f}", hits, level, seed=FIRST)
        ends = [row["intervals"][name][-1] for row in held if row["bounds"][name] is None]
        widths = [np.log10(high / low) for low, high in ends if low > 0.0]
        yield statistic(f"{setting}.{symbol}.width", widths, "decades", seed=FIRST)
        within = [(row["truth"][name], row["within"][name]) for row in rows if name in row["within"]]
        if within:
            hits = [low <= truth <= high for truth, (low, high) in within]
            yield coverage(f"{setting}.{symbol}.within", hits, LEVELS[-1], seed=FIRST)
    told = [row["verdict"] != "failed" for row in rows]
    yield share(f"{setting}.interval", told, FIRST)
    yield share(f"{setting}.ok", [row["verdict"] == "ok" for row in rows], FIRST)
    yield statistic(f"{setting}.simulations", [row["simulations"] or np.nan for row in rows], "1", seed=FIRST)
    yield statistic(f"{setting}.seconds", [row["seconds"] for row in rows], "s", seed=FIRST)


def measure(run: Run) -> Iterator[Number]:
    """How often central 50 and 90 % intervals hold the truth, their width in decades, and the switches."""
    for setting in [run.part] if run.part else SETTINGS:
        kind, way = SETTINGS[setting]
        quick, full = SHOTS
        count = run.count(quick, FROM_PRIOR if kind == "prior" else full)
        rows = run.rows("calibration", one, [(seed, kind, way) for seed in range(FIRST, FIRST + count)])
        yield from of_setting(setting, rows)
        if kind == "prior":
            yield from of_switches(rows)
