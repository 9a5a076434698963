"""Networks, recipes and training sets that are damaged or hostile: each is refused in one line, and nothing hangs."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from broken_models import BROKEN, FRAMES, sound
from broken_recipes import RECIPES, RIGHT
from conftest import PROBLEM, code_of, error_of, refusal

from cavirheo.inference.bdt import network_of
from cavirheo.inference.cards import card, path_of, shipped
from cavirheo.inference.emulator import emulator
from cavirheo.training import dataset
from cavirheo.training.recipe import read_recipe


@pytest.mark.parametrize("name", BROKEN)
def test_broken_model(tmp_path, name):
    code, write = BROKEN[name]
    path = write(tmp_path)
    assert code_of(lambda: network_of(str(path))(np.ones((1, FRAMES)))) == code


def test_a_model_is_named_by_its_file_or_its_folder(tmp_path):
    path = sound(tmp_path)
    np.savez(tmp_path / "test.npz", inputs=np.ones(3))  # without a card: it is none
    assert path_of(str(tmp_path)) == path_of(str(path)) == path
    assert np.isfinite(network_of(str(tmp_path))(np.ones((2, FRAMES)))).all()
    for name in ("honey", "network.onnx", str(tmp_path / "nowhere"), ""):
        assert code_of(path_of, name) == "model.unknown"
    assert code_of(network_of, "emulator") == code_of(emulator, str(path)) == "model.kind"


def test_shipped_networks_are_those_of_their_cards():
    for name, path in shipped().items():
        read = emulator if card(path)["kind"] == "emulator" else network_of
        assert read(name).sha256 == card(path)["weights"]["sha256"]


@pytest.mark.parametrize("name", RECIPES)
def test_broken_recipe(tmp_path, name):
    content, named = RECIPES[name]
    (tmp_path / "r.toml").write_bytes(content)
    assert named in str(error_of(read_recipe, tmp_path / "r.toml")).removeprefix(str(tmp_path))


@pytest.fixture
def shards(instant, tmp_path) -> Path:
    dataset.generate(PROBLEM, 1100, tmp_path / "set", progress=False)
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
    said = error_of(dataset.load, shards)
    assert said.code.startswith(code)
    assert "shard-" in str(said)


def test_a_set_that_does_not_fit_is_refused_before_it_is_made(instant, tmp_path, monkeypatch):
    said = error_of(dataset.generate, PROBLEM, 10**12, tmp_path, progress=False)
    assert (said.code, list(tmp_path.iterdir())) == ("dataset.size", [])
    error_of(dataset.generate, PROBLEM, 10**40, tmp_path, progress=False)
    dataset.generate(PROBLEM, 20, tmp_path / "small", progress=False)
    with monkeypatch.context() as full:  # what is there needs no space again
        full.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=0))
        assert dataset.generate(PROBLEM, 20, tmp_path / "small", progress=False).simulated == 0


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
