"""The training problem: prior, identity, and the way between a shot and the reference scale. Training sets: the same
bytes however they are made, nothing lost, nothing mixed; damaged or hostile ones are refused in one line. Nothing is
unpickled."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from broken_recipes import RIGHT
from conftest import LIQUID, PROBLEM, ROOT, WATER, code_of, contents, error_of, refusal, refused
from scipy.stats import kstest

from cavirheo import NeoHookeanKelvinVoigt, Newtonian, read_curves
from cavirheo.inference.network_files import TrainingProblem
from cavirheo.physics.media import BU2026
from cavirheo.prior import Prior, uniforms
from cavirheo.training.dataset import generate, load
from cavirheo.training.trajectories import BLOCK, block

RANGES = {"log10_shear_modulus": [3.0, 6.0], "log10_viscosity": [-3.0, 0.0], "stretch": [3.0, 11.0]}
GEL = TrainingProblem("nhkv", Prior.uniform(RANGES))


def test_draws_are_fixed_for_all_time():
    """A change would silently change every training set."""
    np.testing.assert_allclose(uniforms(1, 0, 2), [0.3035680343067586, 0.8487087496857769], rtol=1e-15)


def test_prior_is_uniform_and_independent():
    theta = GEL.prior.sample(4000, seed=3)
    unit = (theta - GEL.prior.low) / (GEL.prior.high - GEL.prior.low)
    assert 0 <= unit.min() < unit.max() <= 1
    assert min(kstest(column, "uniform").pvalue for column in unit.T) > 1e-3
    assert np.abs(np.corrcoef(unit.T) - np.eye(3)).max() < 0.06


def of(material="nhkv", **ranges) -> TrainingProblem:
    return TrainingProblem(material, Prior.uniform(RANGES | ranges))


def test_identity_changes_with_every_part():
    assert TrainingProblem.from_dict(GEL.to_dict()).id == GEL.id
    others = [
        replace(GEL, medium=BU2026),
        replace(GEL, medium=replace(WATER, conductivity_slope=5.4e-5)),
        replace(GEL, frames=101),
        replace(GEL, reference_max_radius=246e-6),
        of(stretch=[3.0, 10.0]),
        replace(GEL, prior=Prior.uniform(dict(reversed(RANGES.items())))),
    ]
    assert len({GEL.id, *(other.id for other in others)}) == 7


def test_scale_keeps_cauchy_and_reynolds():
    medium, shot = replace(WATER, density=1060.0, pressure=90e3), 80e-6
    found = GEL.to_shot({"shear_modulus": 5e3, "viscosity": 0.05, "stretch": 7.0}, shot, medium)
    modulus, time = 90e3 / 101325, 80 / 245 * np.sqrt(1060 / 998 * 101325 / 90e3)
    expected = {"shear_modulus": 5e3 * modulus, "viscosity": 0.05 * modulus * time, "stretch": 7.0}
    assert found == pytest.approx(expected, rel=1e-12)


def test_simulations_are_of_the_material_at_the_reference():
    assert GEL.material([5.0, -1.0, 4.0]) == NeoHookeanKelvinVoigt(1e5, 0.1)
    assert PROBLEM.material([-2.0, 7.0]) == Newtonian(0.01)
    (one,) = GEL.simulate_many([[5.0, 0.0, 4.0]])
    again, other = GEL.simulate_many([[5.0, 0.0, 4.0], [4.5, 0.0, 4.0]], workers=2)
    assert (one.ok, one.radius[0]) == (True, pytest.approx(245e-6))
    np.testing.assert_array_equal(one.time, GEL.time)
    np.testing.assert_array_equal(again.radius, one.radius)
    assert not np.array_equal(other.radius, one.radius)


def violent(theta: np.ndarray) -> np.ndarray:
    return theta[:, 1] > 9.0


def test_failures_are_kept_and_counted(instant, tmp_path):
    instant.fails = violent
    made = generate(PROBLEM, 1100, tmp_path, seed=3, progress=False)
    data = load(tmp_path)
    failed = violent(data.columns["theta"])
    assert 200 < failed.sum() < 400  # the test would prove nothing otherwise
    assert made.failures == data.origin["failures"] == {"the step size went to zero": failed.sum()}
    assert made.curves == len(data) == 1100
    np.testing.assert_array_equal(data.columns["theta"], PROBLEM.prior.sample(1100, 3))
    np.testing.assert_array_equal(data.ok, ~failed)
    missing = np.arange(100) >= np.full((failed.sum(), 1), 50)
    np.testing.assert_array_equal(np.isnan(data.columns["radius"][failed]), missing)
    assert (data.columns["radius"][0, 0], data.problem.id) == (1.0, PROBLEM.id)
    assert code_of(load, tmp_path.parent) == "dataset.none"


def test_a_curve_that_is_not_finite_is_a_failure_whatever_it_says(instant, tmp_path):
    instant.curves = lambda _, theta: [SimpleNamespace(radius=np.r_[np.inf, np.ones(99)], status="ok")] * len(theta)
    assert list(generate(PROBLEM, 3, tmp_path, progress=False).failures.values()) == [3]


def test_a_killed_run_goes_on_to_the_same_bytes(instant, tmp_path):
    def killed_in_the_third_file(theta):
        if len(instant) == 3:
            raise KeyboardInterrupt
        return np.zeros(len(theta), bool)

    generate(PROBLEM, 1700, tmp_path / "whole", seed=3, progress=False)
    instant.clear()
    instant.fails = killed_in_the_third_file
    with pytest.raises(KeyboardInterrupt):
        generate(PROBLEM, 1700, tmp_path / "cut", seed=3, workers=1, progress=False)
    (tmp_path / "cut" / ".part-shard-00002.h5").write_bytes(b"half a file")
    assert code_of(load, tmp_path / "cut") == "dataset.incomplete"
    instant.clear()
    del instant.fails
    made = generate(PROBLEM, 1700, tmp_path / "cut", seed=3, progress=False)
    assert made.simulated == 1220  # in six of eight files
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")
    assert made.failures == load(tmp_path / "whole").origin["failures"]


def test_other_settings_do_not_mix(instant, tmp_path):
    generate(PROBLEM, 30, tmp_path, seed=3, progress=False)
    other = TrainingProblem("newtonian", Prior.uniform(LIQUID | {"stretch": [3.0, 10.0]}))
    before = contents(tmp_path)
    with refused("reading.training_set", "`cavirheo generate`"):
        read_curves(next(tmp_path.glob("*.h5")))
    for what, n, seed, wanted in (("seed", 30, 4, PROBLEM), ("total", 31, 3, PROBLEM), ("problem", 30, 3, other)):
        assert code_of(generate, wanted, n, tmp_path, seed=seed, progress=False) == f"dataset.another_{what}"
        assert contents(tmp_path) == before


def test_split_is_a_partition_that_no_parameter_decides(instant, tmp_path):
    generate(PROBLEM, 400, tmp_path, seed=3, progress=False)
    data = load(tmp_path)
    parts = data.split(seed=3)  # the seed of the data on purpose
    together = np.sort(np.concatenate(list(parts.values())))
    np.testing.assert_array_equal(together, np.flatnonzero(data.ok))
    for name, share in (("train", 0.8), ("validation", 0.1), ("test", 0.1)):
        assert abs(len(parts[name]) / len(together) - share) < 0.05, name
    for indices in parts.values():
        assert abs(data.columns["theta"][indices, 0].mean() + 2.0) < 5 * (4 / 12**0.5) / len(indices) ** 0.5
    assert not np.array_equal(parts["test"], data.split(seed=4)["test"])
    np.testing.assert_array_equal(parts["test"], data.split(seed=3)["test"])


def test_a_block_of_bubbles_is_one_whatever_was_made_before():
    bubbles, again = block(1, 3), block(1, 3)
    np.testing.assert_array_equal(bubbles["radius"], again["radius"])
    ok = bubbles["status"] == "ok"
    assert np.count_nonzero(ok) > BLOCK // 2
    assert np.isfinite(bubbles["inputs"][ok]).all()
    np.testing.assert_allclose(bubbles["radius"][ok, 0], 1.0, atol=1e-6)
    np.testing.assert_allclose(bubbles["time"][ok, 0], 0.0, atol=1e-6)
    assert (np.diff(bubbles["time"][ok], axis=1) > 0.0).all()


def test_a_single_bit_that_changed_is_noticed(tmp_path):
    generate(PROBLEM, 6, tmp_path / "set", seed=1, progress=False)
    (path,) = tmp_path.glob("set/*.h5")
    with h5py.File(path) as file:
        place = file["radius"].id.get_chunk_info(0).byte_offset
    content = bytearray(path.read_bytes())
    content[place + 5] ^= 1
    path.write_bytes(content)
    with refused("dataset.unreadable", "delete it and generate again"):
        load(path.parent)


@pytest.mark.repository
def test_only_what_this_machine_compiled_itself_is_unpickled():
    """dask does so between driver and workers, which trust each other."""
    words = r"\b(import|from) (pickle|cloudpickle|dill|joblib|shelve|marshal)\b|allow_pickle=True|torch\.load"
    sources = (ROOT / "src").rglob("*.py")
    assert [path.name for path in sources if re.search(words, path.read_text("utf-8"))] == ["cache.py"]


# --- damaged and hostile sets, and a disk that is full


@pytest.fixture
def shards(instant, tmp_path) -> Path:
    generate(PROBLEM, 1100, tmp_path / "set", progress=False)
    return tmp_path / "set"


def stored(name, make):
    """Instead of the data set `name` a link, or what create_dataset makes of the settings that `make` gives of it."""

    def damage(path):
        with h5py.File(path, "a") as file:
            new = make(file[name][:] if name != "status" else file[name].asstr()[:])
            del file[name]
            if isinstance(new, dict):
                file.create_dataset(name, **new)
            elif new:
                file[name] = new

    return damage


PETABYTE = {"shape": (10**12, 100), "dtype": "f4", "chunks": (10, 100)}
SHARDS = {  # what is done to one of three files, and the code by which their set is refused
    "no theta": (stored("theta", lambda kept: None), "dataset."),
    "theta of a column more": (stored("theta", lambda kept: {"data": np.c_[kept, kept]}), "dataset."),
    "radius of text": (stored("radius", lambda kept: {"data": kept.astype("S8")}), "dataset."),
    "radius of another file": (stored("radius", lambda kept: h5py.ExternalLink("other", "radius")), "dataset."),
    "radius of a petabyte": (stored("radius", lambda kept: PETABYTE), "limits."),
    "cut short": (lambda path: os.truncate(path, 1000), "dataset.unreadable"),
    "a pipe": (lambda path: (path.unlink(), os.mkfifo(path)), "dataset.unreadable"),
    "in another's place": (lambda path: shutil.copy(path, path.with_name("shard-00001.h5")), "dataset.shape"),
}


@pytest.mark.parametrize("name", SHARDS)
def test_broken_shard(shards, name):
    damage, code = SHARDS[name]
    damage(shards / "shard-00000.h5")
    said = error_of(load, shards)
    assert said.code.startswith(code)
    assert "shard-" in str(said)


def test_a_set_that_does_not_fit_is_refused_before_it_is_made(instant, tmp_path, monkeypatch):
    said = error_of(generate, PROBLEM, 10**12, tmp_path, progress=False)
    assert (said.code, list(tmp_path.iterdir())) == ("dataset.size", [])
    error_of(generate, PROBLEM, 10**40, tmp_path, progress=False)
    generate(PROBLEM, 20, tmp_path / "small", progress=False)
    with monkeypatch.context() as full:  # what is there needs no space again
        full.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=0))
        assert generate(PROBLEM, 20, tmp_path / "small", progress=False).simulated == 0


@pytest.fixture
def small(tmp_path) -> Path:
    (tmp_path / "small.toml").write_text(RIGHT.replace("n = 100", "n = 20").replace("width = 16", "width = 8"))
    return tmp_path / "small.toml"


@pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")
@pytest.mark.parametrize("most", [0, 3000])
def test_a_full_disk(small, tmp_path, most):
    """HDF5 itself would end the process."""
    import resource

    PROBLEM.simulate_many([[-2.0, 5.0]])  # what is compiled is kept before the disk is full

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    words = [sys.executable, "-m", "cavirheo", "generate", small, "-o", tmp_path / "data", "-n", "20"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, preexec_fn=limit)
    refusal((done.returncode, done.stdout, done.stderr))
    assert list((tmp_path / "data").iterdir()) == []
