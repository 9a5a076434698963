"""Does the evidence find the law that made a shot? Simulated shots of several laws, each weighed under four.

Truths: NHKV, qKV with stiffening 0.5 and 1, Newtonian and Zener (relaxation time 1 to 10 us); log10 G 3 to 30 kPa,
log10 mu 20 to 200 mPa s, stretch 5 to 9, R_max 150 to 350 um; the camera of calibration.py with 0.5 % noise. Fits and
posteriors over 3 collapses, with the field's bubble, as the shots are. "Right": the law that `which-law` chooses, the
simplest that is not clearly worse than the best, is the true one, or one of fewer parameters while the true one cannot
be told from the best: Zener with a relaxation time that the curve cannot see is NHKV, and so is qkv of a stretch that
hardly strains. "Wrong certainty": the true law is not among those that cannot be told from the best.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cavirheo import NeoHookeanKelvinVoigt, Newtonian, QuadraticKelvinVoigt, RadiusCurve
from cavirheo.inference.assumptions import Family
from cavirheo.inference.which_law import rank_laws
from cavirheo.physics.materials import Zener
from validation.claims.calibration import film
from validation.numbers import Number, Run, share

NOISE = 0.005
LAWS = ("newtonian", "nhkv", "qkv", "zener")
TRUTHS = {
    "nhkv": lambda G, mu, tau: NeoHookeanKelvinVoigt(G, mu),
    "qkv 0.5": lambda G, mu, tau: QuadraticKelvinVoigt(G, mu, 0.5),
    "qkv 1": lambda G, mu, tau: QuadraticKelvinVoigt(G, mu, 1.0),
    "newtonian": lambda G, mu, tau: Newtonian(mu),
    "zener": Zener,
}


def shot(truth: str, seed: int) -> RadiusCurve:
    """A shot of this law as the camera sees it."""
    rng = np.random.default_rng([seed, list(TRUTHS).index(truth), 6])
    draw = rng.uniform(np.log10([3e3, 0.02, 1e-6]), np.log10([3e4, 0.2, 1e-5]))
    stretch, top = rng.uniform(5.0, 9.0), rng.uniform(150e-6, 350e-6)
    return film(TRUTHS[truth](*10**draw), top, stretch, NOISE, rng, f"{truth}, {seed}")[1]


def one(job: tuple[str, int]) -> dict:
    truth, seed = job
    ((found,), _) = rank_laws([shot(truth, seed)], LAWS, bubble="field", discrepancy=False, seed=seed, workers=1)
    return {"truth": truth, "chosen": found.chosen, "contenders": found.contenders}


def right(row: dict) -> bool:
    """The true law is chosen, or a simpler one from which it is not told."""
    law = row["truth"].split()[0]
    simpler = len(Family(row["chosen"]).parameters) < len(Family(law).parameters)
    return bool(row["chosen"] == law or (simpler and law in row["contenders"]))


def measure(run: Run) -> Iterator[Number]:
    rows = run.rows("evidence", one, [(truth, seed) for seed in range(run.count(2, 10)) for truth in TRUTHS])
    weighed = [row for row in rows if row["chosen"]]
    yield share("right_law", [right(row) for row in weighed])
    yield share("wrong_certainty", [row["truth"].split()[0] not in row["contenders"] for row in weighed])
