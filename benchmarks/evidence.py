"""Does the evidence find the law that made a shot? Simulated shots of several laws, each weighed under four.

    python benchmarks/evidence.py OUT.jsonl [-n 10] [--discrepancy] [--workers 1]
    python benchmarks/evidence.py OUT.jsonl -n 0             # the table of what is there

Truths: NHKV, qKV with stiffening 0.5 and 1, Newtonian and Zener (relaxation time 1 to 10 us); log10 G 3 to 30 kPa,
log10 mu 20 to 200 mPa s, stretch 5 to 9, R_max 150 to 350 um; the camera of benchmarks/calibration.py with 0.5 %
noise. Fits and posteriors over 3 collapses, with the field's bubble, as the shots are. "Right": the law that
`which-law` chooses, the simplest that is not clearly worse than the best, is the true one, or one of fewer parameters.
"Wrong": it is another. Zener with a relaxation time that the curve cannot see is NHKV, and qkv of a stretch that hardly
strains is NHKV, so a simpler law is not an error if the true one is among those that cannot be told from the best. One
line a shot is added to OUT.jsonl; a later call goes on.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from calibration import film, resumed

from cavirheo import NeoHookeanKelvinVoigt, Newtonian, QuadraticKelvinVoigt, RadiusCurve
from cavirheo.inference.law import Family
from cavirheo.inference.verify.evidence import rank_laws
from cavirheo.physics.materials import Zener

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


def one(job: tuple[str, int, bool]) -> dict:
    truth, seed, discrepancy = job
    ((found,), _) = rank_laws([shot(truth, seed)], LAWS, bubble="field", discrepancy=discrepancy, seed=seed, workers=1)
    return {
        "truth": truth,
        "seed": seed,
        "log_evidence": found.log_evidence,
        "error": found.error,
        "contenders": found.contenders,
        "chosen": found.chosen,
        "ess": {law: answer.diagnostics.effective_sample_size for law, answer in found.answers.items()},
        "verdict": {law: answer.checks.verdict for law, answer in found.answers.items()},
        "rmse": {law: answer.checks.rmse_over_rmax for law, answer in found.answers.items()},
    }


def judged(row: dict) -> str:
    """ "true", "simpler" (and the true law not told from it), or "wrong"."""
    law = row["truth"].split()[0]
    if row["chosen"] == law:
        return "true"
    simpler = len(Family(row["chosen"]).parameters) < len(Family(law).parameters)
    return "simpler" if simpler and law in row["contenders"] else "wrong"


def table(rows: list[dict]) -> str:
    lines = [
        "| truth | shots | true law | simpler, as good | wrong | best by evidence alone | chosen |",
        "|---|" + "---|" * 6,
    ]
    for truth in TRUTHS:
        ours = [row for row in rows if row["truth"] == truth and row["chosen"]]
        counts = {kind: sum(judged(row) == kind for row in ours) for kind in ("true", "simpler", "wrong")}
        best = sum(max(known, key=known.get) == truth.split()[0] for row in ours if (known := {
            law: value for law, value in row["log_evidence"].items() if value is not None}))  # fmt: skip
        chosen = [row["chosen"] for row in ours]
        names = ", ".join(f"{law} {chosen.count(law)}" for law in LAWS if law in chosen)
        lines.append(f"| {truth} | {len(ours)} | {' | '.join(str(n) for n in counts.values())} | {best} | {names} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("-n", type=int, default=10, help="shots of each law")
    parser.add_argument("--discrepancy", action="store_true")
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    jobs = {(t, seed): (t, seed, given.discrepancy) for seed in range(given.n) for t in TRUTHS}
    rows = resumed(given.out, jobs, ("truth", "seed"), one, given.workers)
    print(table(rows))


if __name__ == "__main__":
    main()
