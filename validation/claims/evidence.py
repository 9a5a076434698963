"""Does the evidence find the law that made a shot? Simulated shots of several laws, each weighed under four.

Truths: NHKV, qKV with stiffening 0.5 and 1, Newtonian and Zener (relaxation time 1 to 10 us); log10 G 3 to 30 kPa,
log10 mu 20 to 200 mPa s, stretch 5 to 9, R_max 150 to 350 um; the camera of calibration.py with 0.5 % noise. Fits and
posteriors over 3 collapses, with the field's bubble, as the shots are. "Right": the law that `which-law` chooses, the
simplest that is not clearly worse than the best, is the true one, or one of fewer parameters while the true one cannot
be told from the best: Zener with a relaxation time that the curve cannot see is NHKV, and so is qkv of a stretch that
hardly strains. "Wrong certainty": the true law is not among those that cannot be told from the best.

The averages of `infer` are tried on its four laws in the real bubble, with 1 % noise. "Held": the true law has a weight
above 0.2, or a law of fewer parameters has the largest and the true one cannot be told from it. "Certain": a wrong law
has a weight above 0.95.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from cavirheo.inference.verify.evidence import rank_laws
from scipy.special import softmax

from cavirheo import Bubble, NeoHookeanKelvinVoigt, Newtonian, QuadraticKelvinVoigt, RadiusCurve, infer_many
from cavirheo.errors import SolverError
from cavirheo.inference import AUTO_LAWS
from cavirheo.inference.alternatives import DECISIVE
from cavirheo.inference.assumptions import Family
from cavirheo.physics.materials import Zener
from validation.claims.calibration import film
from validation.numbers import Number, Run, share

NOISE = 0.005
LAWS = ("newtonian", "nhkv", "qkv", "zener")
AVERAGED = {  # ranges of the parameters of the shots
    "shear_modulus": (3e3, 3e4), "viscosity": (0.02, 0.2), "reference_viscosity": (0.02, 0.2), "exponent": (0.4, 0.8),
    "stiffening": (0.03, 1.0),
}  # fmt: skip
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


def averaged(job: tuple[str, int]) -> dict:
    """The weights of the laws of one shot by `infer`, and their log evidences."""
    law, seed = job
    rng = np.random.default_rng([seed, AUTO_LAWS.index(law), 7])
    ranges = np.log10([AVERAGED[name] for name in Family(law).parameters])
    while True:
        values, stretch, top = rng.uniform(*ranges.T), rng.uniform(5.0, 9.0), rng.uniform(150e-6, 350e-6)
        bubble = Bubble("kinetic", 10.0 ** rng.uniform(-1.5, -0.5), confinement_damping=rng.uniform(0.0, 0.4))
        with suppress(SolverError):  # a gel that stiffens so much cannot be so large
            curve = film(Family(law).material(values), top, stretch, 0.01, rng, f"{law}, {seed}", bubble=bubble)[1]
            break
    answer = infer_many([curve], trust_input=True, workers=1)[0]
    logs = {name: part.evidence.log for name, part in answer.laws.items() if part.evidence} or {answer.material: 0.0}
    logs |= {rival.material: rival.evidence.log for rival in answer.others
             if rival.evidence and rival.bubble == answer.bubble and rival.material not in logs}  # fmt: skip
    weight = dict(zip(logs, softmax(list(logs.values())).tolist(), strict=True))
    return {"law": law, "weight": weight, "log": logs}


def held(row: dict) -> bool:
    """The true law counts, or a simpler one is the likeliest and not told from it."""
    law, weight = row["law"], row["weight"]
    likeliest = max(weight, key=weight.get)
    simpler = len(Family(likeliest).parameters) < len(Family(law).parameters)
    near = law in row["log"] and row["log"][likeliest] - row["log"][law] < DECISIVE
    return bool(weight.get(law, 0.0) > 0.2 or (simpler and near))


def certain(row: dict) -> bool:
    """A wrong law has nearly all the weight."""
    return bool(max(row["weight"].values()) > 0.95 > row["weight"].get(row["law"], 0.0))


def measure(run: Run) -> Iterator[Number]:
    rows = run.rows("evidence", one, [(truth, seed) for seed in range(run.count(2, 10)) for truth in TRUTHS])
    weighed = [row for row in rows if row["chosen"]]
    yield share("right_law", [right(row) for row in weighed])
    yield share("wrong_certainty", [row["truth"].split()[0] not in row["contenders"] for row in weighed])
    rows = run.rows("averages", averaged, [(law, seed) for seed in range(run.count(2, 25)) for law in AUTO_LAWS])
    yield share("average.held", [held(row) for row in rows])
    yield share("average.certain", [certain(row) for row in rows])
