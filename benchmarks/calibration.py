"""Do intervals hold the truth as often as they say? Simulated shots drawn from the prior.

    python benchmarks/calibration.py OUT.jsonl [-n 300] [--first 0] [--as-read] [--discrepancy] [--workers 2]  # of full
    python benchmarks/calibration.py OUT.jsonl [-n 300] --default [...]    # of `infer`, as it is
    python benchmarks/calibration.py OUT.jsonl [-n 300] --fit [...]        # of `fit`
    python benchmarks/calibration.py OUT.jsonl --truth field --bubble real # field's bubbles answered with the real one
    python benchmarks/calibration.py OUT.jsonl -n 0          # the tables of what is there

Truth: NHKV, log10 G (500 Pa to 50 kPa), log10 mu (5 mPa s to 0.5 Pa s) and log10 stretch (4 to 11) uniform, R_max
100 to 400 um; with --truth real (the default) also log10 of the accommodation (0.01 to 1) uniform and the confinement
damping from the half of a normal, as in the prior. 100 frames over 4.07 t_c, each the mean of 15 instants within 0.3
of a frame; clock off by up to half a frame, radii by a scale and R_max by a factor with 0.5 % standard deviation (cut
at 1.5 %); 1 % of R_max noise. Simulated with PRECISE. --bubble is that of the answer, the truth's unless told; what
the truth or the answer does not have is not counted. --as-read takes R_max and its time off the noisy frames, as for a
file, instead of as drawn; --discrepancy leaves the default discrepancy on, which these shots do not have. --default is
the answer of `infer` within the same ranges: a truth from a narrower range than the prior's is no test of the interval
where the curve says little. --fit: that of `fit` within the same ranges, clock, scale and R_max free. --end 1.6 ends
the recording soon after the first collapse. Shots have the seeds FIRST to FIRST + n - 1. One line a shot is added to
OUT.jsonl, also for other settings; a later call goes on, and prints a table for each setting.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2, kstest, truncnorm

from cavirheo import NeoHookeanKelvinVoigt, RadiusCurve, fit, simulate
from cavirheo.inference.experiment import LARGEST, ZETA, Experiment
from cavirheo.inference.network_answer import Networked
from cavirheo.inference.posterior_model import load_posterior
from cavirheo.inference.verify import verify
from cavirheo.physics.accuracy import PRECISE
from cavirheo.physics.bubble import BUBBLES, FIELD, Bubble
from cavirheo.physics.materials import Material
from cavirheo.physics.media import WATER
from cavirheo.posterior import Posterior

RANGES = {"shear_modulus": (500.0, 5e4), "viscosity": (5e-3, 0.5), "stretch": (4.0, 11.0)}
OF_BUBBLE = {"field": RANGES, "real": {**RANGES, "accommodation": (0.01, 1.0)}}  # ranges of its parameters
ADDED = "confinement_damping"  # of the real bubble: half-normal
CAMERA = ("time_origin", "radius_scale", "max_radius_factor")
DECADES = (*OF_BUBBLE["real"],)  # of which the width of an interval is given in decades
LEVELS = (0.5, 0.9)
SETTINGS = ("simulated", "bubble", "way", "as_read", "discrepancy", "end")
WAYS = {"full": "--verify full", "default": "infer", "fit": "fit"}
FRAMES, EXPOSURE, NOISE, BOUND = 100, 0.3, 0.01, 0.015
BINS = 10
ALARM = 0.001  # p-value below which a rank histogram is not that of a calibrated posterior


def shot(
    seed: int, *, simulated: str = "field", as_read: bool = False, end: float = np.inf
) -> tuple[dict[str, float], RadiusCurve]:
    """Truth by name, and the curve that the camera makes of it; simulated: name of the bubble."""
    rng = np.random.default_rng([seed, 5])
    ranges = OF_BUBBLE[simulated]
    truth = {name: float(10 ** rng.uniform(*np.log10(pair))) for name, pair in ranges.items()}
    top = float(rng.uniform(100e-6, 400e-6))  # R_max as measured
    law = NeoHookeanKelvinVoigt(truth["shear_modulus"], truth["viscosity"])
    bubble = FIELD
    if simulated == "real":
        truth[ADDED] = float(ZETA * truncnorm(0.0, LARGEST).rvs(random_state=rng))
        bubble = Bubble("kinetic", truth["accommodation"], confinement_damping=truth[ADDED])
    camera, curve = film(
        law, top, truth["stretch"], NOISE, rng, f"shot {seed}", as_read=as_read, end=end, bubble=bubble
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
    end: float = np.inf,
    bubble: Bubble = FIELD,
) -> tuple[dict[str, float], RadiusCurve]:
    """The nuisances by name, and the curve of measured R_max `top` that a camera with them makes of a bubble, up to
    `end` t_c."""
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
    seen_until = time < end * WATER.time_scale(top)
    radius = np.maximum(radius, 1e-3 * top)
    return camera, RadiusCurve(time[seen_until], radius[seen_until], meta=meta, maximum=maximum)


def rank(answer: Posterior, name: str, truth: float) -> float:
    """Posterior probability below the truth: uniform over shots if the posterior is calibrated."""
    draws = answer.draws(name)
    log_weight = np.zeros(len(draws)) if answer.log_weight is None else answer.log_weight
    weight = np.exp(log_weight - np.max(log_weight))
    return float(np.sum(weight[draws < truth]) / np.sum(weight))


@contextmanager
def narrowed(ranges: Mapping[str, tuple[float, float]]) -> Iterator[None]:
    """A prior of these ranges also for `fit`, which takes none."""
    whole = Experiment.prior
    try:
        Experiment.prior = lambda self, given=None: whole(self, given or ranges)
        yield
    finally:
        Experiment.prior = whole


def coverage(ranks: np.ndarray, level: float) -> float:
    """Share of truths within the central interval of this level."""
    return float(np.mean(np.abs(np.asarray(ranks) - 0.5) <= 0.5 * level))


def calibrated(ranks: np.ndarray) -> tuple[bool, float, float]:
    """Whether ranks may be uniform, with the p-values of the histogram (chi squared, 10 bins) and of Kolmogorov and
    Smirnov. Talts et al. 2018, arXiv:1804.06788."""
    counts, _ = np.histogram(ranks, bins=BINS, range=(0.0, 1.0))
    expected = len(ranks) / BINS
    p_bins = float(chi2.sf(np.sum((counts - expected) ** 2) / expected, BINS - 1))
    p_ks = float(kstest(ranks, "uniform").pvalue)
    return min(p_bins, p_ks) >= ALARM, p_bins, p_ks


def one(job: tuple[int, str, str, str, bool, bool, float]) -> dict:
    seed, simulated, name, way, as_read, discrepancy, end = job
    truth, curve = shot(seed, simulated=simulated, as_read=as_read, end=end)
    bubble, ranges = BUBBLES[name], OF_BUBBLE[name]
    # as drawn, the clock is known to half a frame; read off the frames it is not, and the default range is wider
    bound = None if as_read else 0.5 * float(np.median(np.diff(curve.time)))
    how: dict[str, Any] = {"ranges": ranges, "discrepancy": discrepancy, "t0_bound": bound, "workers": 1, "seed": seed}
    alone: dict[str, Any] = {"bubble": bubble, "others": False, "workers": 1}
    began = time.process_time()
    if way == "fit":
        alone |= {"free": ("t0", "scale", "rmax"), "windows": False}
        with narrowed(ranges):
            answer = fit(curve, trust_input=True, seed=seed, **alone)
    elif way == "default":
        network = load_posterior()
        start = Networked(network, bubble=bubble, trust_input=True, checked=False)
        answer = verify(curve, start.infer(curve), level="auto", network=network, **how)
    else:
        answer = verify(curve, fit(curve, window="all", **alone), scale_bound=BOUND, **how)
    about = answer.diagnostics
    row = {"seed": seed, **dict(zip(SETTINGS, job[1:], strict=True)), "truth": truth}
    row |= {"verdict": answer.checks.verdict, "message": answer.checks.message}
    row |= {"seconds": time.process_time() - began, "ess": about.effective_sample_size, "tail": about.tail_index}
    row |= {"p_value": (about.predictive or {}).get("p_value"), "simulations": about.simulations}
    row["few"] = answer.provenance.get("few_simulations")
    # R_max and its time as read are not those that the truth of clock and factor is about
    asked = [n for n in truth if n in answer.parameters and not (as_read and n in CAMERA)]
    told = answer.log_weight is not None
    row["ranks"] = {n: rank(answer, n, truth[n]) for n in asked} if told else None
    row["intervals"] = {n: answer.interval(n, LEVELS[-1]) for n in answer.parameters} if told else None
    row["median"] = {n: answer.median(n) for n in answer.parameters} if len(answer.theta) else None
    return row


def tables(rows: list[dict]) -> str:
    """That of each setting, under a sentence that says which bubble was simulated and with which it was answered."""
    parts, settings = [], dict.fromkeys(tuple(row[name] for name in SETTINGS) for row in rows)
    for setting in settings:
        simulated, bubble, way, as_read, discrepancy, end = setting
        told = f"Simulated: {BUBBLES[simulated].title}; answered by {WAYS[way]} with the {BUBBLES[bubble].title}"
        told = told.replace("the field's bubble", "the field's")
        told += ", R_max as read" * as_read + ", discrepancy allowed for" * discrepancy
        told += f", recordings end at {end:g} t_c" if np.isfinite(end) else ""
        parts.append(f"{told}.\n\n{table([row for row in rows if tuple(row[n] for n in SETTINGS) == setting])}")
    return "\n\n".join(parts)


def width(name: str, pairs: Sequence[Sequence[float] | None]) -> str:
    """The median width of the intervals, in decades or as it is."""
    ends = np.array([pair for pair in pairs if pair is not None])
    if not len(ends):
        return ""
    if name in DECADES:
        return f"{np.median(np.log10(ends[:, 1] / ends[:, 0])):.3g} decades"
    return f"{np.median(ends[:, 1] - ends[:, 0]):.3g}"


def table(rows: list[dict]) -> str:
    """Of the shots of one setting: the share of truths within intervals, its standard error if they are right, and
    the median width of the 90 % intervals."""
    with_one = [row for row in rows if row["ranks"]]
    lines = [f"{len(rows)} shots, {len(with_one)} with an interval", ""]
    heads = [*(f"{level:.0%}" for level in LEVELS), "median width", "p (histogram)", "p (KS)", "ranks in tenths"]
    lines += [f"| | {' | '.join(heads)} |", "|---" * (1 + len(heads)) + "|"]
    for name in dict.fromkeys(name for row in with_one for name in row["ranks"]):
        ours = [row for row in with_one if name in row["ranks"]]
        values = np.array([row["ranks"][name] for row in ours])
        _, p_bins, p_ks = calibrated(values)
        counts = " ".join(map(str, np.histogram(values, bins=BINS, range=(0, 1))[0]))
        held = [f"{coverage(values, one):.1%} ± {100 * np.sqrt(one * (1 - one) / len(values)):.1f}" for one in LEVELS]
        cells = [*held, width(name, [row["intervals"][name] for row in ours]), f"{p_bins:.2f}", f"{p_ks:.2f}", counts]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    ess = np.array([row["ess"] for row in rows if row["ess"] is not None])
    seconds = np.array([row["seconds"] for row in rows])
    p = np.array([row["p_value"] for row in rows if row["p_value"] is not None])
    lines += [""]
    lines += [f"effective size: 5 % {np.quantile(ess, 0.05):.0f}, median {np.median(ess):.0f}"] if len(ess) else []
    lines += [
        f"CPU seconds a shot, fit included: median {np.median(seconds):.1f}, 95 % {np.quantile(seconds, 0.95):.1f}"
    ]
    runs = [row["simulations"] for row in rows if row["simulations"]]
    lines += [f"simulations: median {np.median(runs):.0f}"] if runs else []
    few = [bool(row["few"]) for row in rows if row["few"] is not None]
    lines += [f"few simulations were enough: {np.mean(few):.1%}"] if few else []
    lines += [f"predictive check below 1 %: {np.mean(p < 0.01):.1%}"] if len(p) else []
    lines += [f"verdicts: { {v: sum(r['verdict'] == v for r in rows) for v in sorted({r['verdict'] for r in rows})} }"]
    return "\n".join(lines)


def resumed(out: Path, jobs: dict[tuple, Any], names: tuple[str, ...], one: Callable, workers: int) -> list[dict]:
    """Rows of all jobs, those in the file first: a job is done if a row has its key under these names."""
    rows = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    done = {tuple(row[name] for name in names) for row in rows}
    with ProcessPoolExecutor(workers) as pool, out.open("a") as file:
        for row in pool.map(one, [job for key, job in jobs.items() if key not in done]):
            file.write(json.dumps(row) + "\n")
            file.flush()
            rows.append(row)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("-n", type=int, default=300)
    parser.add_argument("--first", type=int, default=0, help="seed of the first shot")
    parser.add_argument("--truth", choices=BUBBLES, default="real", help="bubble that is simulated")
    parser.add_argument("--bubble", choices=BUBBLES, help="bubble of the answer  [default: that of the truth]")
    parser.add_argument("--as-read", action="store_true")
    parser.add_argument("--discrepancy", action="store_true")
    parser.add_argument("--default", dest="way", action="store_const", const="default", default="full")
    parser.add_argument("--fit", dest="way", action="store_const", const="fit")
    parser.add_argument("--end", type=float, default=np.inf, help="t_c after which nothing is recorded")
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    how = (given.truth, given.bubble or given.truth, given.way, given.as_read, given.discrepancy, given.end)
    seeds = range(given.first, given.first + given.n)
    jobs: dict[tuple, Any] = {(seed, *how): (seed, *how) for seed in seeds}
    print(tables(resumed(given.out, jobs, ("seed", *SETTINGS), one, given.workers)))


if __name__ == "__main__":
    main()
