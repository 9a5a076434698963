"""Thousands of recordings and large training sets: rows and answers stay on the disk, and nothing is unpickled."""

import os
import pickle
import re
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
from answers import KnownAnalysis
from conftest import EXAMPLE, ROOT, refused

from cavirheo import InputError, Posterior, read_curves
from cavirheo.parallel import Threads
from cavirheo.posterior import Checks
from cavirheo.prior import Prior
from cavirheo.problem import TrainingProblem
from cavirheo.training.dataset import generate, load, survey, write_hdf5
from cavirheo.workflow import analyse
from cavirheo.workflow.analyse import Unfinished
from cavirheo.workflow.store import keep, read_kept

PROBLEM = TrainingProblem("newtonian", Prior.uniform({"log10_viscosity": [-4.0, 0.0], "stretch": [3.0, 11.0]}))


def test_a_set_on_the_disk_is_the_set_in_memory(tmp_path):
    generate(PROBLEM, 6, tmp_path / "set", seed=1, progress=False)
    here, there = load(tmp_path / "set"), load(tmp_path / "set", tmp_path)
    assert not there.radius.flags.owndata  # mapped to a file without a name
    assert [path.name for path in tmp_path.iterdir()] == ["set"]
    assert here.sha256 == there.sha256
    np.testing.assert_array_equal(here.radius, there.radius[:])
    np.testing.assert_array_equal(here.theta, there.theta)


def test_a_single_bit_that_changed_is_noticed(tmp_path):
    generate(PROBLEM, 6, tmp_path, seed=1, progress=False)
    (path,) = tmp_path.glob("*.h5")
    with h5py.File(path) as file:
        place = file["radius"].id.get_chunk_info(0).byte_offset
    content = bytearray(path.read_bytes())
    content[place + 5] ^= 1
    path.write_bytes(content)
    for read in (load, survey):
        with refused("dataset.unreadable", "delete it and generate again"):
            read(tmp_path)


def known(curve, begun=None, failing=()):
    verdict = "failed" if curve.name in failing else "ok"
    theta = np.full((3 if verdict == "ok" else 0, 1), curve.max_radius) + (begun.theta if begun else 0.0)
    return Posterior(("stretch",), ("1",), theta, Checks(verdict), "nhkv", "verified")


@pytest.mark.parametrize("executor", [None, Threads(2)])
def test_of_many_answers_none_is_held_that_can_be_read_again(tmp_path, monkeypatch, executor):
    curves = read_curves(EXAMPLE)
    analysis = KnownAnalysis(of=partial(known, failing=(curves[2].name,)))
    few = Unfinished(tmp_path / "few", visible=False, executor=executor).answers(curves, analysis)
    monkeypatch.setattr(analyse, "HELD", 3)
    kept = Unfinished(tmp_path / "many", visible=False, executor=executor)
    many = kept.answers(curves, analysis)
    assert many.indices == few.indices == list(range(len(curves)))
    assert [i for i in many.indices if many[i] is many[i]] == [2]  # the failed one, which has no file
    for mine, theirs in zip(many, few, strict=True):
        np.testing.assert_array_equal(mine.theta, theirs.theta)
    kept.remove()
    with refused("unfinished.gone"):
        many[0]


def test_answers_begin_with_those_that_are_kept(tmp_path):
    curves = read_curves(EXAMPLE)
    two = Unfinished(tmp_path, visible=False)
    begun = two.answers(curves, KnownAnalysis(of=known))
    for curve, answer in zip(curves, two.answers(curves, KnownAnalysis(of=known, seed=1), begun), strict=True):
        np.testing.assert_array_equal(answer.theta, np.full((3, 1), 2.0 * curve.max_radius))


class Trap:
    """Whose pickle makes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def test_nothing_is_unpickled_from_a_kept_answer_or_a_training_set(tmp_path):
    sprung = tmp_path / "sprung"
    pickle.loads(pickle.dumps(Trap(sprung)))
    assert sprung.is_dir()  # as it would be
    sprung.rmdir()
    answer = Posterior(("stretch",), ("1",), np.ones((3, 1)), Checks("ok"), "nhkv", "verified")
    keep(tmp_path / "a.npz", answer)
    with np.load(tmp_path / "a.npz") as file:
        arrays = [file[name] for name in file.files]
    trap = np.array([Trap(sprung)] * 3, dtype=object)
    np.savez(tmp_path / "a.npz", arrays[0], trap, allow_pickle=True)
    assert read_kept(tmp_path / "a.npz", Posterior) is None
    generate(PROBLEM, 3, tmp_path / "set", seed=1, progress=False)
    (path,) = (tmp_path / "set").glob("*.h5")
    with h5py.File(path) as file:
        head, radius = dict(file.attrs), {"data": file["radius"][:]}
        status = {"data": file["status"][:], "dtype": h5py.string_dtype()}
    theta = {"data": np.frombuffer(pickle.dumps(Trap(sprung)), np.uint8)}
    write_hdf5(path, head, {"theta": theta, "radius": radius, "status": status})
    with pytest.raises(InputError):
        load(tmp_path / "set")
    assert not sprung.exists()


@pytest.mark.repository
def test_only_what_this_machine_compiled_itself_is_unpickled():
    """dask does so between driver and workers, which trust each other."""
    words = r"\b(import|from) (pickle|cloudpickle|dill|joblib|shelve|marshal)\b|allow_pickle=True|torch\.load"
    sources = (ROOT / "src").rglob("*.py")
    assert [path.name for path in sources if re.search(words, path.read_text("utf-8"))] == ["cache.py"]
