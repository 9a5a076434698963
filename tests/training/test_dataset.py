"""Training sets: the same bytes however they are made, nothing lost, nothing mixed."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import code_of, refused

from cavirheo.inference.bins import END, SCALARS
from cavirheo.inference.latent import COORDINATES
from cavirheo.prior import Prior
from cavirheo.problem import TrainingProblem
from cavirheo.training import dataset
from cavirheo.training.dataset import generate, load
from cavirheo.training.recordings import NODES, STEPS, TOP, CurveStore, film


@pytest.fixture
def problem() -> TrainingProblem:
    return TrainingProblem("newtonian", Prior.uniform({"log10_viscosity": [-4.0, 0.0], "stretch": [3.0, 11.0]}))


def violent(theta: np.ndarray) -> np.ndarray:
    return theta[:, 1] > 9.0


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_failures_are_kept_and_counted(problem, instant, tmp_path):
    instant.fails = violent
    made = generate(problem, 90, tmp_path, seed=3, progress=False)
    data = load(tmp_path)
    failed = violent(data.theta)
    assert 10 < failed.sum() < 40  # the test would prove nothing otherwise
    assert made.failures == data.failures == {"the step size went to zero": failed.sum()}
    assert made.curves == len(data.theta) == 90
    np.testing.assert_array_equal(data.theta, problem.prior.sample(90, 3))
    np.testing.assert_array_equal(data.ok, ~failed)
    assert np.isnan(data.radius[failed, 50:]).all()
    assert np.isfinite(data.radius[failed, :50]).all()
    assert data.radius[0, 0] == 1.0
    assert data.problem.id == problem.id
    assert code_of(load, tmp_path.parent) == "dataset.none"
    assert code_of(generate, problem, 30, tmp_path, shard=(0, 2), progress=False) == "dataset.shard"


def test_a_curve_that_is_not_finite_is_a_failure_whatever_it_says(problem, monkeypatch, tmp_path):
    broken = SimpleNamespace(radius=np.r_[np.inf, np.ones(99)], status="ok")
    monkeypatch.setattr(TrainingProblem, "simulate_many", lambda self, theta, workers: [broken] * len(theta))
    assert list(generate(problem, 3, tmp_path, progress=False).failures.values()) == [3]


def test_same_bytes_for_any_partition(problem, instant, tmp_path):
    generate(problem, 90, tmp_path / "one", seed=3, progress=False)
    for part in (3, 1, 2):
        generate(problem, 90, tmp_path / "three", seed=3, shard=(part, 3), progress=False)
    assert files(tmp_path / "one") == files(tmp_path / "three")
    assert len(files(tmp_path / "one")) == 5


def test_a_killed_run_goes_on_to_the_same_bytes(problem, instant, monkeypatch, tmp_path):
    generate(problem, 90, tmp_path / "whole", seed=3, progress=False)
    simulate = TrainingProblem.simulate_many
    instant.clear()

    def killed_in_the_third_file(self, theta, **options):
        if len(instant) == 7:
            raise KeyboardInterrupt
        return simulate(self, theta, **options)

    with monkeypatch.context() as patch:
        patch.setattr(TrainingProblem, "simulate_many", killed_in_the_third_file)
        with pytest.raises(KeyboardInterrupt):
            generate(problem, 90, tmp_path / "cut", seed=3, workers=1, progress=False)
    (tmp_path / "cut" / ".shard-00002.h5.part.h5").write_bytes(b"half a file")
    with refused("dataset.incomplete"):
        load(tmp_path / "cut")
    instant.clear()
    made = generate(problem, 90, tmp_path / "cut", seed=3, progress=False)
    assert (made.written, made.skipped, made.simulated, sum(instant)) == (3, 2, 50, 50)
    assert files(tmp_path / "cut") == files(tmp_path / "whole")
    assert made.failures == load(tmp_path / "whole").failures


def test_other_settings_do_not_mix(problem, instant, tmp_path):
    generate(problem, 30, tmp_path, seed=3, progress=False)
    other = TrainingProblem("newtonian", Prior.uniform({"log10_viscosity": [-4.0, 0.0], "stretch": [3.0, 10.0]}))
    before = files(tmp_path)
    for what, n, seed, wanted in (("seed", 30, 4, problem), ("total", 31, 3, problem), ("problem", 30, 3, other)):
        with refused(f"dataset.another_{what}"):
            generate(wanted, n, tmp_path, seed=seed, progress=False)
        assert files(tmp_path) == before


def test_split_is_a_partition_that_no_parameter_decides(problem, instant, tmp_path):
    generate(problem, 400, tmp_path, seed=3, progress=False)
    data = load(tmp_path)
    parts = data.split(seed=3)  # the seed of the data on purpose
    together = np.sort(np.concatenate(list(parts.values())))
    np.testing.assert_array_equal(together, np.flatnonzero(data.ok))
    for name, share in (("train", 0.8), ("validation", 0.1), ("test", 0.1)):
        assert abs(len(parts[name]) / len(together) - share) < 0.05, name
    for indices in parts.values():
        assert abs(data.theta[indices, 0].mean() + 2.0) < 5 * (4 / 12**0.5) / len(indices) ** 0.5
    assert not np.array_equal(parts["test"], data.split(seed=4)["test"])
    np.testing.assert_array_equal(parts["test"], data.split(seed=3)["test"])


def test_a_set_is_surveyed_while_it_grows(problem, instant, tmp_path):
    instant.fails = violent
    generate(problem, 90, tmp_path, seed=3, shard=(1, 2), progress=False)
    half = dataset.survey(tmp_path)
    assert (half.curves, half.total, half.files, half.lacking) == (50, 90, 3, 2)
    generate(problem, 90, tmp_path, seed=3, progress=False)
    whole = dataset.survey(tmp_path)
    assert (whole.curves, whole.lacking, sum(whole.statuses.values())) == (90, 0, 90)
    assert whole.statuses["ok"] == 90 - sum(load(tmp_path).failures.values()) < 90
    assert whole.size == sum(map(len, files(tmp_path).values()))
    assert whole.sha256 != half.sha256
    generate(problem, 90, tmp_path / "again", seed=3, workers=1, progress=False)
    assert dataset.survey(tmp_path / "again").sha256 == whole.sha256


def test_an_exposure_does_not_move_the_clock():
    """A frame's time is the middle of its exposure: R_max is read as often too early as too late."""
    place = np.linspace(0, STEPS, NODES).astype(np.uint16)
    t = place * (END / STEPS)
    radius = np.where(t < 0.9, (1 - np.minimum(t / 0.93, 1) ** 2) ** 0.4, 0.2 + 0.4 * np.abs(np.sin(2.5 * (t - 0.9))))
    n, kept = 4000, np.round(radius * 65535 / TOP).astype(np.uint16)
    nothing = np.zeros((n, len(COORDINATES)), np.float32), np.zeros(n, np.uint8)
    one = CurveStore(np.tile(place, (n, 1)), np.tile(kept, (n, 1)), *nothing, np.full(n, 2.5e-4, np.float32))
    seen = film(one, np.arange(n), seed=3)
    exposure, late = seen.inputs[:, -SCALARS + 2], seen.inputs[:, -1]  # over the frame interval; 1 without growth
    origin = seen.z[(late == 0) & (exposure > 0.3), COORDINATES.index("time_origin")]
    assert len(origin) > 200
    assert abs(np.mean(origin)) < 0.1  # 0.02 is its standard error
