"""Errors that are planted in a copy of the package, one at a time: each must be caught by the tests that are named.

python tests/nightly/planted_errors.py [words of names or tests ...]

Signs, units, steps too far and guards that are missing, over all rooms of the package. The exit status is the number of
errors that no test caught.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]


class Planted(NamedTuple):
    """file: below src/cavirheo. old occurs there once, and becomes new. tests: stems of the modules that catch it."""

    name: str
    file: str
    old: str
    new: str
    tests: list[str]


<<<<<<< HEAD
def planted() -> list[Planted]:
    """Of the table beside this file, in which \\n stands for the end of a line."""
    _, *rows = Path(__file__).with_suffix(".tsv").read_text(encoding="utf-8").splitlines()
    cells = [row.replace(r"\n", "\n").split("\t") for row in rows]
    return [Planted(name, file, old, new, tests.split()) for name, file, old, new, tests in cells]


PLANTED = planted()
=======
PLANTED = (
    Planted("mooney-rivlin curvature sign", "physics/laws.py",
            "+ 12 * self.C2 * q2 * q2", "- 12 * self.C2 * q2 * q2", ("test_materials",)),
    Planted("fung twice as stiff", "physics/laws.py",
            "self.shear_modulus / 2 * np.exp(", "self.shear_modulus * np.exp(", ("test_materials",)),
    Planted("wall twice as near", "physics/bubble.py",
            "0.5 * max_radius / self.wall_distance", "max_radius / self.wall_distance", ("test_bubble_model",)),
    Planted("damage by strain, exponent's sign", "physics/scales.py",
            "** a, (1 + b) * u", "** a, (1 - b) * u", ("test_limits",)),
    Planted("polytropic gas with half the exponent", "physics/solver.py",
            "z, p_dot = 0.0, -3 * numbers", "z, p_dot = 0.0, -1.5 * numbers", ("test_limits",)),
    Planted("ultrasound in cycles, not radians", "physics/media.py",
            "n, omega = self.exponent, 2 * pi * self.frequency", "n, omega = self.exponent, self.frequency",
            ("test_limits",)),
    Planted("constants of no liquid are taken", "physics/media.py",
            "if not unusual:", "if False:", ("test_python",)),
    Planted("discrepancy's step variance", "inference/noise.py",
            "gain = -np.expm1(-2.0 * np.diff(time)", "gain = -np.expm1(-1.0 * np.diff(time)", ("test_experiment",)),
    Planted("an atom of the prior is twice as likely", "prior.py",
            "np.where(whole < self.zero, -np.inf, x)", "np.where(whole < 2.0 * self.zero, -np.inf, x)",
            ("test_machine",)),
    Planted("prior taken from the log posterior", "inference/weigh.py",
            "self.noise.log_density(residuals) + log_normal(u)", "self.noise.log_density(residuals) - log_normal(u)",
            ("test_machine",)),
    Planted("correction of the emulator, sign", "inference/weigh.py",
            "residuals + correction(u)", "residuals - correction(u)", ("test_machine",)),
    Planted("slope of the correction, sign", "inference/weigh.py",
            "np.asarray(mean + np.clip(y", "np.asarray(mean - np.clip(y", ("test_machine",)),
    Planted("evidence without the mean weight", "inference/weigh.py",
            "log_weight, draws.log_evidence + log_mean,", "log_weight, draws.log_evidence,", ("test_machine",)),
    Planted("models count alike", "inference/weigh.py",
            "_combined(parts, evidences - whole, whole)", "_combined(parts, np.zeros(len(parts)), whole)",
            ("test_machine",)),
    Planted("a model's prior is left out", "inference/weigh.py",
            "log_normal(u) + self.log_prior", "log_normal(u)", ("test_machine",)),
    Planted("a ridge bends the wrong way", "inference/sample.py",
            "z -= _quadratic(z) @ self.bend", "z += _quadratic(z) @ self.bend", ("test_machine",)),
    Planted("climb without the pull of the prior", "inference/sample.py",
            "return gradients + u, curvatures", "return gradients, curvatures", ("test_machine",)),
    Planted("clock of emulated frames, sign", "inference/emulator.py",
            "offsets[c] - origin[a]", "offsets[c] + origin[a]", ("test_experiment",)),
    Planted("the factor of R_max is left out of emulated frames", "inference/experiment.py",
            "factor[:, None] * emulator.radius", "emulator.radius", ("test_experiment",)),
    Planted("draws are not weighed", "inference/weigh.py",
            "log_weight = np.log(count) + gain", "log_weight = np.zeros(len(at))",
            ("test_machine",)),
    Planted("flattened draws count as if they were not", "inference/weigh.py",
            "gain = log_posterior - log_quick", "gain = log_posterior - log_quick / FLATTENED", ("test_machine",)),
    Planted("an interval ends later above than below", "posterior.py",
            "from_above = -np.quantile(-values, np.round(1.0 - level, 12)",
            "from_above = np.quantile(values, level + 0.02",
            ("test_machine",)),
    Planted("the first draws are simulated", "inference/weigh.py",
            "return rng.permutation(picked)[:count]", "return np.arange(count)", ("test_machine",)),
    Planted("the first of a few draws are of one part", "inference/weigh.py",
            "return rng.permutation(picked)[:count]", "return picked[:count]", ("test_machine",)),
    Planted("parts count alike", "inference/weigh.py",
            "_combined(parts, np.log(share), log_evidence)", "_combined(parts, np.zeros(len(parts)), log_evidence)",
            ("test_machine",)),
    Planted("effective size without squares", "inference/sample.py",
            "np.sum(weight) ** 2 / np.sum(weight**2)", "np.sum(weight)", ("test_machine",)),
    Planted("unit of an emulated time", "inference/emulator.py",
            "RAYLEIGH * t_c * longer / np.sqrt(1.0 + pull)", "RAYLEIGH * t_c / np.sqrt(1.0 + pull)", ("test_machine",)),
    Planted("the field's bubble keeps its damping", "inference/experiment.py",
            "np.where(fields, 0.0, values[name])", "values[name]",
            ("test_experiment",)),
    Planted("switches without the weights of the draws", "inference/answer.py",
            "weight = weight / np.sum(weight)\n    columns", "weight = 0 * weight + 1 / len(weight)\n    columns",
            ("test_truth",)),
    Planted("a switch's prior is counted once for each shot", "inference/population/switches.py",
            "(share + least) / prior", "share + least", ("test_population",)),
    Planted("a doubtful shot has a vote", "inference/population/switches.py",
            "if not only_trusted or answer.checks.verdict in TRUSTED]", "]", ("test_population",)),
    Planted("collapse time's change with scale, sign", "inference/collapse_time.py",
            "100.0 * (longer - G)", "100.0 * (G - longer)", ("test_collapse_time",)),
    Planted("interval of a collapse time with half of its probability outside", "inference/collapse_time.py",
            "stdtrit(free, 0.95)", "stdtrit(free, 0.75)", ("test_collapse_time",)),
    Planted("scale's factors upside down", "inference/input_warnings.py",
            "if ratio < 1.0 else (1.0", "if ratio > 1.0 else (1.0", ("test_inference",)),
    Planted("prior counted once for each shot", "inference/population/hierarchy.py",
            "log_weight - logsumexp(log_weight) - log_prior", "log_weight - logsumexp(log_weight)",
            ("test_population",)),
    Planted("shots that scatter agree", "inference/population/__init__.py",
            "axis=0) > before", "axis=0) < before", ("test_population",)),
    Planted("noise of a curve is overestimated", "landmarks.py",
            "np.diff(radius, 3))) / np.sqrt(20.0)", "np.diff(radius, 3))) / np.sqrt(6.0)", ("test_curve",)),
    Planted("scale given later leaves the deviations", "curve.py",
            '"radius_std": self.radius_std * scale', '"radius_std": self.radius_std', ("test_curve",)),
    Planted("diameters taken for radii", "io/curves.py",
            'lambda diameter: 0.5 * diameter', 'lambda diameter: 1.0 * diameter', ("test_reading",)),
    Planted("rows of -1000 are frames", "io/curves.py",
            "column[~empty]", "column", ("test_reading",)),
    Planted("declared shapes without a limit", "io/hdf5.py",
            "require(size <= limits.SAMPLES,", "require(size <= limits.SAMPLES or True,", ("test_hostile",)),
    Planted("numbers from other files are read", "io/hdf5.py",
            "require(not (item.external or item.is_virtual)", "require(not (item.is_virtual)", ("test_hostile",)),
    Planted("region of a film turned", "video/measurement.py",
            "[chosen, y : y + height, x : x + width]", "[chosen, x : x + width, y : y + height]",
            ("test_video",)),
    Planted("motion blur corrected the wrong way", "video/track.py",
            "np.sqrt(radius**2 + curvature) + motion", "np.sqrt(radius**2 + curvature) - motion", ("test_video",)),
    Planted("first frame of a span is one late", "video/measurement.py",
            "time[first - 1 : last], region", "time[first - 1 : last] + time[1], region",
            ("test_video",)),
    Planted("a cell that begins with @", "errors.py", "'*[=+@", "'*[=+", ("test_reports",)),
    Planted("standard deviation over n", "writing/document.py", "ddof=1", "ddof=0", ("test_rheometer",)),
    Planted("a file of the user's is replaced", "writing/document.py",
            "require(bool(self.listed_entry(name)), foreign", "require(True, foreign", ("test_outputs",)),
    Planted("another run's answers are replaced", "writing/document.py",
            "if self._claim and not self._claim.replace:", "if False:", ("test_outputs",)),
    Planted("a bound has a median", "writing/document.py",
            "if self.bound is not None:", "if False:", ("test_one_number",)),
    Planted("error relative to our own value", "reporting/comparison.py",
            "abs(middle - expected) / expected", "abs(middle - expected) / middle",
            ("test_compare",)),
    Planted("a second value of one set counts", "companions/published_values.py",
            "expect(quantity not in values,", "expect(True,", ("test_compare",)),
    Planted("viscosity without its frequency", "companions/rheometer.py",
            "np.log(sweep.loss))) / at", "np.log(sweep.loss)))", ("test_rheometer",)),
    Planted("Hz taken for rad/s", "companions/rheometer.py",
            '"Hz": 2 * math.pi, "hz"', '"Hz": 1.0, "hz"', ("test_rheometer",)),
    Planted("failed answers are kept for ever", "workflow/store.py",
            "answer, file=to_file)", "answer, file=True)", ("test_outputs",)),
    Planted("a worker with other code is taken", "workflow/cluster.py",
            " if worker != required]", " if False]", ("test_cluster",)),
    Planted("a file that is still written is read", "watch.py",
            " if before.get(path) == self._seen[path])", ")", ("test_watch",)),
    Planted("one recording in two files counts twice", "io/shots.py",
            "return list(first.values()), remarks", "return curves, remarks", ("test_watch", "test_outputs")),
    Planted("any file of the machine is uploaded", "app/page.py",
            "not all(path.is_relative_to(folder) for path in paths)", "not paths", ("test_app",)),
    Planted("split of a training set leaves out curves", "training/dataset.py",
            "[round(0.8 * n), round(0.9 * n)]", "[round(0.8 * n), round(0.8 * n) + 1]", ("test_dataset",)),
    Planted("draws of all rounds are weighed by the last mixture", "inference/sample.py",
            "log_sum(self.densities + np.log(np.array(self.sizes) / len(self.u))[:, None], axis=0)",
            "self.densities[-1]", ("test_machine",)),
    Planted("Student's t is drawn without the root", "inference/sample.py",
            "np.sqrt(FREEDOM / rng.chisquare(FREEDOM, count))", "(FREEDOM / rng.chisquare(FREEDOM, count))",
            ("test_machine",)),
    Planted("a bent distribution has another integral", "inference/sample.py",
            "0.5 * d * np.log(FREEDOM * np.pi)", "0.5 * d * np.log(np.pi)", ("test_machine",)),
    Planted("slope of the frames, sign", "inference/sample.py",
            "(missed[:, None, :] - found.reshape(m, d, -1))", "(found.reshape(m, d, -1) - missed[:, None, :])",
            ("test_machine",)),
    Planted("error of an evidence as of one draw", "inference/sample.py",
            "np.std(weight) / np.sqrt(len(value)) / mean", "np.std(weight) / mean", ("test_machine",)),
    Planted("a linear correction of the emulator without its mean", "inference/weigh.py",
            "np.asarray(mean + np.clip(y", "np.asarray(np.clip(y", ("test_machine",)),
    Planted("the field's bubble in an answer has half of its vapour", "inference/answer.py",
            'theta[field, names.index("accommodation")] = 1.0', 'theta[field, names.index("accommodation")] = 0.5',
            ("test_truth",)),
    Planted("a trade leaves the other bound", "inference/answer.py",
            "\"lower\" if moved > 0.0", "\"lower\" if moved < 0.0", ("test_machine",)),
    Planted("replicates of the check are not refitted", "inference/answer.py",
            "statistics(noise - (noise @ fitted.T) @ J.T)", "statistics(noise)", ("test_experiment",)),
    Planted("change of a parameter with the scale, sign", "inference/answer.py",
            "products += worth * pair[0, 1]", "products -= worth * pair[0, 1]", ("test_population",)),
    Planted("a batch of simulations counts as one", "inference/answer.py",
            "self.simulations += len(x)", "self.simulations += 1", ("test_truth",)),
    Planted("the emulator is told another damping", "inference/emulator.py",
            "bubbles.damping, np.sqrt(bubbles.damping)]", "bubbles.damping, bubbles.damping]", ("test_machine",)),
    Planted("viscosity at rest is left out of its mean", "inference/emulator.py",
            "np.column_stack([below, pieces])", "np.column_stack([0 * below, pieces])", ("test_machine",)),
    Planted("stress of a compressed wall, sign", "inference/emulator.py",
            "np.hstack([nothing, above]) - np.hstack([below, nothing])",
            "np.hstack([nothing, above]) + np.hstack([below, nothing])", ("test_machine",)),
    Planted("emulated radius between its nodes", "inference/emulator.py",
            "3 * (r1 - r0) - 2 * sr0 - sr1", "3 * (r1 - r0) - sr0 - sr1", ("test_experiment",)),
    Planted("density of the noise has another integral", "inference/noise.py",
            "np.log(2.0 * np.pi * GAMMA_A)", "np.log(2.0 * np.pi)", ("test_experiment",)),
    Planted("discrepancy of the clock without its unit", "inference/noise.py",
            "np.broadcast_to(velocity * scale, self.size)", "np.broadcast_to(velocity, self.size)",
            ("test_experiment",)),
    Planted("slope of the density is of white noise of known size", "inference/noise.py",
            "self.power / (GAMMA_A + 0.5 * product[:, d, d])", "self.power / GAMMA_A", ("test_experiment",)),
    Planted("no shot is an outlier", "inference/population/hierarchy.py",
            "(P_OUTLIER, OUTLIER_STD**2)", "(P_OUTLIER, 0.0)", ("test_population",)),
    Planted("viscosity changes with the frame rate as G does", "inference/population/systematic.py",
            "else over_scale - 1.0", "else over_scale", ("test_population",)),
    Planted("errors that all shots share are left out", "inference/population/__init__.py",
            "centre=centre + shift,", "centre=centre,", ("test_population",)),
    Planted("one modulus of all shots is too likely", "inference/population/switches.py",
            "float(log_sum(log_ratio)) - np.log(POINTS)", "float(log_sum(log_ratio))", ("test_population",)),
    Planted("one shot in two files counts twice", "inference/population/__init__.py",
            "elif draws in unique:", "elif False:", ("test_population",)),
    Planted("heaps that are wide are two materials", "inference/population/heaps.py",
            "max(APART, CLEAR * width)", "APART", ("test_population",)),
)  # fmt: skip
>>>>>>> f242888f (watch looks, reads and answers in steps; one store of answers by keys; which-law takes the options of infer; simulate takes a material with its numbers)


def caught(error: Planted, copy: Path) -> list[str]:
    """Stems of the test files that fail with this error in the copy of src."""
    path = copy / "cavirheo" / error.file
    right = path.read_text(encoding="utf-8")
    if right.count(error.old) != 1:
        raise SystemExit(f"{error.name}: {error.file} has {right.count(error.old)} times {error.old!r}, not once")
    words = [sys.executable, "-m", "pytest", "--maxfail=1", "-p", "no:cacheprovider", "-m", "not slow and not hostile"]
    how = {"cwd": ROOT, "env": os.environ | {"PYTHONPATH": str(copy)}, "capture_output": True, "text": True}
    path.write_text(right.replace(error.old, error.new), encoding="utf-8")
    ended = {stem: subprocess.run([*words, *ROOT.glob(f"tests/**/{stem}.py")], **how) for stem in error.tests}
    path.write_text(right, encoding="utf-8")
    for stem, done in ended.items():
        if done.returncode not in (0, 1, 5):  # 5: its tests are slow ones
            raise SystemExit(f"{stem} did not run: {done.stdout[-500:]}{done.stderr[-500:]}")
    return [stem for stem, done in ended.items() if done.returncode == 1]


def main() -> int:
    wanted = sys.argv[1:]
    chosen = [one for one in PLANTED if not wanted or any(w in one.tests or w in one.name for w in wanted)]
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "src"
        shutil.copytree(ROOT / "src", copy)
        for error in chosen:
            began, found = time.monotonic(), caught(error, copy)
            missed += not found
            said = f"caught by {', '.join(found)}" if found else f"MISSED by {', '.join(error.tests)}"
            print(f"{error.name}: {said} ({time.monotonic() - began:.0f} s)", flush=True)
    print(f"{len(chosen) - missed} of {len(chosen)} caught")
    return missed


if __name__ == "__main__":
    sys.exit(main())
