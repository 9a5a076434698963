"""The default answer on simulated recordings: how often it has an interval, whether that holds the truth, and how many
simulations it takes. No curve of the training is used. Simulated recordings are of
the field's bubble and answered with it; validation/claims/calibration.py has those of the real one.

python benchmarks/default_answer.py OUT [-n 40] [--kind calibration|prior|early|liquid]
python benchmarks/default_answer.py OUT --real FOLDER [-n 100] [--bubble field] [--material auto]     # real sets

OUT.jsonl keeps a line per recording: the same call goes on where it stopped. OUT.md is the table.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo import RadiusCurve, read_curves
from cavirheo.inference import infer_many
from cavirheo.inference.assumptions import Family
from cavirheo.physics.simulate import simulate
from cavirheo.prior import uniforms

STREAM = 77  # of the random numbers: apart from those of the training
KINDS = ("calibration", "prior", "early", "liquid")


def recording(kind: str, number: int) -> tuple[RadiusCurve, str, dict[str, float]] | None:
    """A curve, its law and the truth; None where the bubble has no collapse to be seen or cannot be simulated."""
    draw = uniforms(KINDS.index(kind), number, 12, STREAM)

    def between(i: int, low: float, high: float) -> float:
        return float(low * (high / low) ** draw[i])

    law = "newtonian" if kind == "liquid" else "nhkv"
    truth = {"shear_modulus": between(0, 1e3, 1e5), "viscosity": between(1, 0.01, 0.3), "stretch": between(2, 4, 10)}
    radius, frame, noise, frames = between(3, 1e-4, 4e-4), 1e-6, 0.01, 100
    if kind == "prior":
        truth = {"shear_modulus": between(0, 1e2, 1e6), "viscosity": between(1, 1e-3, 1), "stretch": between(2, 2, 12)}
        radius, noise = between(3, 30e-6, 600e-6), between(5, 0.002, 0.04)
        frame, frames = radius / 1e-4 * between(4, 2e-7, 1e-6), 60 + int(140 * draw[6])
    if kind == "liquid":
        truth = {"viscosity": between(1, 0.002, 0.3), "stretch": between(2, 4, 12)}
    values = [np.log10(truth[name]) for name in Family(law).parameters]
    late = frame * (draw[7] - 0.5)
    times = np.maximum(frame * np.arange(frames) + late, 0.0)
    try:
        run = simulate(
            Family(law).material(np.array(values)), max_radius=radius, stretch=truth["stretch"], time=np.sort(times)
        )
    except Exception:  # not a bubble that can be simulated: another number
        return None
    rng = np.random.default_rng([STREAM, number])
    seen = run.radius + noise * radius * rng.standard_normal(frames)
    seen[seen < 0.02 * radius] = np.nan
    time_of = frame * np.arange(frames)
    if kind == "early":
        keep = time_of < 1.6 * radius * np.sqrt(998.0 / 101325.0)
        time_of, seen = time_of[keep], seen[keep]
    curve = RadiusCurve(time_of, seen, meta={"name": f"{kind}{number}"})
    try:
        fine = len(curve.collapse_times()) > 0
    except Exception:
        return None
    return (curve, law, truth) if fine else None


def measure(kind: str, number: int) -> dict | None:
    made = recording(kind, number)
    if made is None:
        return None
    curve, law, truth = made
    began, processor = time.perf_counter(), time.process_time()
    answer = infer_many([curve], material=law, bubble="field", trust_input=True, workers=1)[0]
    told = answer.diagnostics
    return {
        "kind": kind, "number": number, "truth": truth,
        "verdict": answer.checks.verdict, "seconds": time.perf_counter() - began,
        "processor": time.process_time() - processor, "simulations": told.simulations,
        "worth": told.effective_sample_size, "evidence": answer.evidence.log if answer.evidence else None,
        "intervals": {
            name: [*(answer.interval(name, 0.5) or (None, None)), *(answer.interval(name) or (None, None))]
            for name in answer.parameters if name in truth
        },
        "medians": {name: answer.median(name) for name in answer.parameters if name in truth},
    }  # fmt: skip


REAL = {  # files of the sets of one material each, as FOLDER has them
    "alginate": "paam_alginate_0p3/*.mat", "stiff PA": "pa_stiff/RofT_shifted_20_shots.mat",
    "agarose 0.5 %": "agarose_0p5/Rt_nondim_exp.mat", "agarose 2.5 %": "agarose_2p5/Rt_nondim_exp.mat",
    "PEGDA S3": "pegda_S3/*.mat", "PEGDA S4": "pegda_S4/*.mat",
    "PEG 40 %": "peg8000_40wv/*.mat", "PEG 10 %": "peg8000_10wv/*.mat",
}  # fmt: skip
LAW = ("shear_modulus", "viscosity")
GAUSSIAN_90 = 3.29  # standard deviations from the lower to the upper end of a 90 % interval


def answered(curve: RadiusCurve, **options: Any) -> dict:
    """What `infer` says of a measured curve."""
    began = time.perf_counter()
    (answer,) = infer_many([curve], **options)
    drawn = answer.parameters if len(answer.theta) > 1 else []
    return {
        "seconds": time.perf_counter() - began,
        "verdict": answer.checks.verdict,
        "rmse": answer.checks.rmse_over_rmax,
        "material": answer.material,
        "bubble": answer.bubble.name,
        "rebound": len(curve.collapse_times()) > 0,
        "intervals": {one: answer.interval(one) for one in drawn},
        "bounds": {one: answer.bound(one) for one in drawn},
        "medians": {one: answer.median(one) for one in answer.parameters},
    }


def real(folder: Path, out: Path, n: int, **options: Any) -> list[str]:
    """The answers of at most n shots of each set, kept in OUT.jsonl; then `real_table`."""
    kept = out.with_suffix(".jsonl")
    lines = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    done = {(line["set"], line["shot"]) for line in lines}
    for name, pattern in REAL.items():
        curves = [one for file in sorted(folder.glob(pattern)) for one in read_curves(file) if not one.unusable]
        for number, curve in enumerate(curves[:: max(len(curves) // n, 1)][:n]):
            if (name, number) in done:
                continue
            line = {"set": name, "shot": number, **answered(curve, **options)}
            lines.append(line)
            with kept.open("a") as file:
                file.write(json.dumps(line) + "\n")
            print(name, number, line["verdict"], f"{line['rmse'] or np.nan:.3f}, {line['seconds']:.1f} s", flush=True)
    return real_table(lines)


def real_table(lines: list[dict]) -> list[str]:
    """A row for each set. Scatter over width: standard deviation of log10 of the medians over the median standard
    deviation that the shots' own intervals state, of shots whose interval is bounded by the curve on both sides."""
    heads = ["set", "shots", "ok", "bound", "other verdicts", "RMSE, %", "G, kPa", "µ, Pa s"]
    heads += ["scatter over width of G", "of µ", "s a shot"]
    rows = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for name in dict.fromkeys(line["set"] for line in lines):
        mine = [line for line in lines if line["set"] == name]
        verdicts = Counter(line["verdict"] for line in mine)
        rest = ", ".join(f"{verdict} {k}" for verdict, k in verdicts.items() if verdict not in ("ok", "bound"))
        cells = [name, str(len(mine)), str(verdicts["ok"]), str(verdicts["bound"]), rest]
        cells.append(f"{100 * np.median([line['rmse'] for line in mine if line['rmse']]):.2f}")
        ratios = []
        for parameter, factor in zip(LAW, (1e-3, 1.0), strict=True):
            bounded = [line for line in mine if line["verdict"] in ("ok", "bound")]
            bounded = [line for line in bounded if line["bounds"].get(parameter, "failed") is None]
            ends = [(line["medians"][parameter], line["intervals"][parameter]) for line in bounded]
            logs = np.log10([median for median, _ in ends])
            widths = [np.log10(pair[1] / pair[0]) / GAUSSIAN_90 for _, pair in ends]
            several = len(ends) > 2
            values = factor * 10**logs
            cells.append(f"{np.median(values):.3g} ± {np.std(values, ddof=1):.2g} ({len(ends)})" if several else "")
            ratios.append(f"{np.std(logs, ddof=1) / np.median(widths):.2g}" if several else "")
        cells += [*ratios, f"{np.median([line['seconds'] for line in mine]):.1f}"]
        rows.append("| " + " | ".join(cells) + " |")
    seen = [line for line in lines if line["rebound"]]
    good = sum(line["verdict"] in ("ok", "bound") for line in seen)
    return [*rows, "", f"{good} of {len(seen)} shots with a rebound are ok or bound."]


def table(lines: list[dict]) -> str:
    rows = ["| recordings | n | interval | 50 % | 90 % | median simulations | processor s |", "|---" * 7 + "|"]
    for kind in KINDS:
        some = [line for line in lines if line["kind"] == kind]
        given = [line for line in some if any(v[3] for v in line["intervals"].values())]
        held = {"50": [], "90": []}
        for line in given:
            for name, (a, b, low, high) in line["intervals"].items():
                if low is not None and name != "stretch":
                    held["50"].append(a <= line["truth"][name] <= b)
                    held["90"].append(low <= line["truth"][name] <= high)
        runs, busy = [line["simulations"] or 0 for line in some], [line["processor"] for line in some]
        if given:
            rows.append(
                f"| {kind} | {len(some)} | {len(given) / len(some):.0%} | {np.mean(held['50']):.0%} "
                f"| {np.mean(held['90']):.0%} | {np.median(runs):.0f} | {np.median(busy):.1f} |"
            )
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("-n", type=int, default=40)
    parser.add_argument("--kind", choices=KINDS, action="append")
    parser.add_argument("--real", type=Path)
    parser.add_argument("--bubble")
    parser.add_argument("--material")
    given = parser.parse_args()
    if given.real:
        options = {"bubble": given.bubble, "material": given.material}
        text = "\n".join(real(given.real, given.out, given.n, **options)) + "\n"
        given.out.with_suffix(".md").write_text(text)
        sys.exit(print(text))
    kept = given.out.with_suffix(".jsonl")
    lines = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    for kind in given.kind or KINDS:
        done = {line["number"] for line in lines if line["kind"] == kind}
        number, count = 0, len(done)
        while count < given.n:
            if number not in done and (line := measure(kind, number)):
                lines.append(line)
                count += 1
                with kept.open("a") as file:
                    file.write(json.dumps(line) + "\n")
            number += 1
        given.out.with_suffix(".md").write_text(table(lines))
    print(table(lines))
