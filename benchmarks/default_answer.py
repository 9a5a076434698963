"""The default answer on simulated recordings: how often it has an interval, whether that holds the truth, how it
compares with `full`, and how many simulations it takes. No curve of the training is used.

python benchmarks/default_answer.py OUT [-n 40] [--kind calibration|prior|early|liquid] [--full]

OUT.jsonl keeps a line per recording: the same call goes on where it stopped. OUT.md is the table.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from cavirheo import RadiusCurve
from cavirheo.inference import infer_many
from cavirheo.inference.law import Family
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


def measure(kind: str, number: int, full: bool) -> dict | None:
    made = recording(kind, number)
    if made is None:
        return None
    curve, law, truth = made
    line: dict = {"kind": kind, "number": number, "truth": truth}
    for level in ("none", "auto", *(["full"] if full else [])):
        began, processor = time.perf_counter(), time.process_time()
        answer = infer_many([curve], material=law, verify=level, trust_input=True)[0]
        told = answer.diagnostics
        line[level] = {
            "verdict": answer.checks.verdict, "seconds": time.perf_counter() - began,
            "processor": time.process_time() - processor, "simulations": told.simulations,
            "worth": told.effective_sample_size, "few": answer.provenance.get("few_simulations"),
            "evidence": answer.evidence.log if answer.evidence else None,
            "intervals": {
                name: [*(answer.interval(name, 0.5) or (None, None)), *(answer.interval(name) or (None, None))]
                for name in answer.parameters if name in truth
            },
            "medians": {name: answer.median(name) for name in answer.parameters if name in truth},
        }  # fmt: skip
    return line


def table(lines: list[dict]) -> str:
    rows = ["| recordings | n | few simulations enough | interval | 50 % | 90 % | median simulations | processor s |"]
    rows.append("|---" * 8 + "|")
    for kind in KINDS:
        for level in ("none", "auto", "full"):
            some = [line for line in lines if line["kind"] == kind and level in line]
            given = [line for line in some if any(v[3] for v in line[level]["intervals"].values())]
            if not some:
                continue
            held = {"50": [], "90": []}
            for line in given:
                for name, (a, b, low, high) in line[level]["intervals"].items():
                    if low is not None and name != "stretch":
                        held["50"].append(a <= line["truth"][name] <= b)
                        held["90"].append(low <= line["truth"][name] <= high)
            few = [bool(line[level]["few"]) for line in some]
            runs = [line[level]["simulations"] or 0 for line in some]
            busy = [line[level]["processor"] for line in some]
            share = f"{np.mean(few):.0%}" if level == "auto" else ""
            rows.append(
                f"| {kind}, {level} | {len(some)} | {share} | {len(given) / len(some):.0%} | {np.mean(held['50']):.0%} "
                f"| {np.mean(held['90']):.0%} | {np.median(runs):.0f} | {np.median(busy):.1f} |"
            )
    both = [line for line in lines if "full" in line and line["auto"]["few"]]
    ratios, heights = [], []
    for line in both:
        for name, (*_, low, high) in line["auto"]["intervals"].items():
            *_, a, b = line["full"]["intervals"][name]
            if None not in (low, high, a, b) and name != "stretch":
                ratios.append(np.log(high / low) / np.log(b / a))
        if line["full"]["evidence"] is not None:
            heights.append(abs(line["auto"]["evidence"] - line["full"]["evidence"]))
    if ratios:
        rows += [
            "",
            f"Width of the 90 % interval over that of `full` ({len(both)} recordings signed within few simulations, G "
            f"and µ): median {np.median(ratios):.2f}, {np.mean(np.abs(np.array(ratios) - 1.0) < 0.15):.0%} "
            f"within 0.85 to 1.15. Log evidence within 0.2 of `full`: {np.mean(np.array(heights) < 0.2):.0%}.",
        ]
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("-n", type=int, default=40)
    parser.add_argument("--kind", choices=KINDS, action="append")
    parser.add_argument("--full", action="store_true")
    given = parser.parse_args()
    kept = given.out.with_suffix(".jsonl")
    lines = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    for kind in given.kind or KINDS:
        done = {line["number"] for line in lines if line["kind"] == kind}
        number, count = 0, len(done)
        while count < given.n:
            if number not in done and (line := measure(kind, number, given.full)):
                lines.append(line)
                count += 1
                with kept.open("a") as file:
                    file.write(json.dumps(line) + "\n")
            number += 1
        given.out.with_suffix(".md").write_text(table(lines))
    print(table(lines))
