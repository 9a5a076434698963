"""Models, recipes and training sets that are damaged or hostile: each is refused in one line, and nothing hangs."""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from broken_recipes import RECIPES, RIGHT

from cavirheo.errors import InputError
from cavirheo.inference import session
from cavirheo.inference.bdt import Amortised
from cavirheo.inference.graph import check_graph
from cavirheo.inference.model import Network, card, path_of, shipped
from cavirheo.inference.posterior_network import INPUTS, PosteriorModel
from cavirheo.physics.media import BU2026
from cavirheo.prior import Prior
from cavirheo.problem import FrameGrid, TrainingProblem
from cavirheo.training import dataset
from cavirheo.training.evaluate import evaluate
from cavirheo.training.recipe import read_recipe

try:
    import broken_models as made
except ModuleNotFoundError:  # onnx comes with the extra [train]
    made = None
needs_onnx = pytest.mark.skipif(made is None, reason="needs onnx")
BROKEN = made.BROKEN if made else {}
CODES = {  # the reason by which each is refused
    "empty": "graph.damaged", "truncated": "graph.damaged", "with_a_length_beyond_the_end": "graph.damaged",
    "with_a_loop": "graph.operator", "nested_deeply": "graph.operator", "with_a_function": "graph.functions",
    "with_an_operator_of_its_own": "graph.operator", "with_random_numbers": "graph.operator",
    "with_external_data": "graph.elsewhere", "with_external_data_in_a_constant": "graph.elsewhere",
    "with_a_ring": "graph.order", "shaped_by_values": "graph.shape", "with_two_inputs": "graph.order",
    "expanded_to_a_terabyte": "model.memory", "of_text_answers": "model.fails", "of_opset_999": "model.fails",
    "of_nan_weights": "model.fails", "of_four_outputs_that_claims_two": "model.fails",
    "card_nested_deeply": "files.json", "card_of_20_mb": "files.size", "card_of_many_frames": "model.card",
    "card_of_the_prior_infinite": "model.card", "card_of_one_output": "model.fails",
    "card_of_another_file": "model.changed", "a_pipe": "model.missing", "a_folder": "model.missing",
    "of_6_gb": "files.size", "with_a_name_of_300_letters": "model.missing", "a_link_to_zeros": "model.missing",
    "with_an_operator_of_microsoft": "graph.operator", "ranged": "model.memory", "of_other_frames": "model.fails",
    "with_sizes_that_overflow": "model.fails", "with_a_tensor_cut_short": "model.fails",
    "of_nan_for_some_curves": "model.fails", "card_of_an_output_twice": "model.card",
    "card_of_a_later_schema": "model.card", "card_of_the_problem_a_list": "model.card",
    "card_of_the_material_unknown": "model.card", "card_of_a_name_a_path": "model.card",
    "card_of_a_name_that_rings": "model.card", "without_a_card": "model.missing",
}  # fmt: skip


def refused(call, *given, **settings) -> InputError:
    with pytest.raises(InputError) as caught:
        call(*given, **settings)
    assert "\n" not in str(caught.value)
    return caught.value


# models


@needs_onnx
def test_a_right_model_of_a_stranger_is_run(tmp_path):
    network = Network(made.sound(tmp_path))
    assert network(np.ones((600, made.FRAMES))).shape == (600, 2)


@needs_onnx
@pytest.mark.parametrize("name", CODES)
def test_broken_model(tmp_path, name):
    assert refused(Network, BROKEN[name](tmp_path)).code == CODES[name]


@needs_onnx
def test_a_model_that_never_ends_is_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(session, "SECONDS", 1.0)
    assert refused(Network, BROKEN["slow"](tmp_path)).code == "model.time"


@needs_onnx
def test_a_model_of_a_part_of_its_law_does_not_answer_shots(tmp_path):
    content = made.graph(
        [made.node("Slice", "linear zero one one", "out")],
        [made.numbers("zero", [0], np.int64), made.numbers("one", [1], np.int64)],
        outputs=[made.shown("theta", made.FLOAT, ["batch", 1])], last="out",
    ).SerializeToString()  # fmt: skip
    about = made.card(content)
    about["outputs"] = about["outputs"][:1]
    network = Network(made.put(tmp_path, content, about))
    assert refused(Amortised, network).code == "model.outputs"


def test_shipped_models_are_of_the_allowed_parts(monkeypatch):
    monkeypatch.setattr("cavirheo.inference.model.try_out", lambda *_: pytest.fail("a shipped model was tried out"))
    for name, path in shipped().items():
        if card(path)["kind"] == "point":
            check_graph(path.read_bytes())
            assert Network(path).name == name
        else:
            check_graph(path.read_bytes(), INPUTS)
            assert PosteriorModel(path).name == name


# recipes


@pytest.mark.parametrize("name", RECIPES)
def test_broken_recipe(tmp_path, name):
    content, named = RECIPES[name]
    (tmp_path / "r.toml").write_bytes(content)
    assert named in str(refused(read_recipe, tmp_path / "r.toml")).removeprefix(str(tmp_path))


def test_a_recipe_that_is_no_file(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(1 << 30)
    codes = {".": "files.kind", "pipe": "files.kind", "huge": "files.size", "x" * 300: "files.unreadable"}
    assert {name: refused(read_recipe, tmp_path / name).code for name in codes} == codes
    assert refused(read_recipe, "/dev/zero").code == "files.kind"
    assert refused(read_recipe, "nul\0l").code == "files.unreadable"


# training sets

PROBLEM = TrainingProblem("newtonian", Prior.uniform({"log10_viscosity": [-4.0, 0.0], "stretch": [3.0, 11.0]}))


@pytest.fixture
def fake(monkeypatch):
    """Small shards of instant curves."""

    def simulate_many(self, theta, *, workers=None):
        radius = self.reference_max_radius * np.exp(-self.grid.time / 1e-4 * 10 ** np.minimum(theta[:, :1], 0.0))
        return [type("Run", (), {"radius": row, "status": "ok"}) for row in radius]

    monkeypatch.setattr(TrainingProblem, "simulate_many", simulate_many)
    monkeypatch.setattr(dataset, "SHARD", 20)


@pytest.fixture
def shards(fake, tmp_path) -> Path:
    dataset.generate(PROBLEM, 50, tmp_path / "set", progress=False)
    return tmp_path / "set"


def replaced(name, make):
    def change(file):
        kept = file[name][:] if name != "status" else file[name].asstr()[:]
        del file[name]
        make(file, name, kept)

    return change


def attribute(name, value):
    return lambda file: file.attrs.__setitem__(name, value)


def elsewhere(file, name, kept):
    with h5py.File(Path(file.filename).with_name("other"), "w") as other:
        other["radius"] = kept
    file[name] = h5py.ExternalLink("other", "radius")


SHARDS = {
    "no theta": replaced("theta", lambda *_: None),
    "no status": replaced("status", lambda *_: None),
    "theta of a row less": replaced("theta", lambda f, n, kept: f.create_dataset(n, data=kept[1:])),
    "theta of a column more": replaced("theta", lambda f, n, kept: f.create_dataset(n, data=np.c_[kept, kept])),
    "theta of integers": replaced("theta", lambda f, n, kept: f.create_dataset(n, data=kept.astype(int))),
    "theta a group": replaced("theta", lambda f, n, kept: f.create_group(n)),
    "theta not finite": replaced("theta", lambda f, n, kept: f.create_dataset(n, data=kept * np.nan)),
    "radius of text": replaced("radius", lambda f, n, kept: f.create_dataset(n, data=kept.astype("S8"))),
    "radius one number": replaced("radius", lambda f, n, kept: f.create_dataset(n, data=1.0)),
    "radius not finite": replaced("radius", lambda f, n, kept: f.create_dataset(n, data=kept * np.inf)),
    "radius of another file": replaced("radius", elsewhere),
    "radius of a petabyte": replaced(
        "radius", lambda f, n, kept: f.create_dataset(n, (10**12, 100), "f4", chunks=(10, 100))
    ),
    "status of numbers": replaced("status", lambda f, n, kept: f.create_dataset(n, data=np.zeros(len(kept)))),
    "no problem": lambda file: file.attrs.__delitem__("problem"),
    "problem no JSON": attribute("problem", "{"),
    "problem a list": attribute("problem", "[]"),
    "problem nested deeply": attribute("problem", "[" * 20_000),
    "problem an array": attribute("problem", np.arange(5)),
    "problem of another law": attribute("problem", json.dumps(PROBLEM.to_dict() | {"material": "honey"})),
    "seed text": attribute("seed", "one"),
    "seed an array": attribute("seed", np.arange(3)),
    "total huge": attribute("total", 2**62),
    "total zero": attribute("total", 0),
    "total text": attribute("total", "all"),
    "start of another file": attribute("start", 20),
    "start text": attribute("start", "zero"),
}


@pytest.mark.parametrize("name", SHARDS)
def test_broken_shard(shards, name):
    with h5py.File(shards / "shard-00000.h5", "a") as file:
        SHARDS[name](file)
    said = refused(dataset.load, shards)
    assert said.code.startswith(("dataset.", "problem.", "limits."))
    assert "shard-" in str(said)


@pytest.mark.parametrize("size", [0, 7, 100, 1000, 3000])
def test_a_shard_cut_short(shards, size):
    os.truncate(shards / "shard-00001.h5", size)
    assert refused(dataset.load, shards).code == "dataset.unreadable"


def test_a_shard_that_is_no_file(shards):
    (shards / "shard-00001.h5").unlink()
    os.mkfifo(shards / "shard-00001.h5")
    assert refused(dataset.load, shards).code == "dataset.unreadable"


def test_a_file_beside_the_set_is_not_read_as_a_part_of_it(shards):
    shutil.copy(shards / "shard-00001.h5", shards / "shard-00001 (copy).h5")
    assert refused(dataset.load, shards).code == "dataset.foreign"
    (shards / "shard-00001 (copy).h5").unlink()
    (shards / "shard-00000.h5").replace(shards / "kept")
    shutil.copy(shards / "shard-00001.h5", shards / "shard-00000.h5")
    assert refused(dataset.load, shards).code == "dataset.shape"


def test_a_set_that_does_not_fit_is_refused_before_it_is_made(fake, tmp_path, monkeypatch):
    said = refused(dataset.generate, PROBLEM, 10**12, tmp_path, progress=False)
    assert (said.code, list(tmp_path.iterdir())) == ("dataset.size", [])
    refused(dataset.generate, PROBLEM, 10**40, tmp_path, progress=False)
    assert dataset.generate(PROBLEM, 10**8, tmp_path, shard=(1, 10**7), progress=False).curves == 20
    dataset.generate(PROBLEM, 20, tmp_path / "small", progress=False)
    monkeypatch.setattr(os, "sysconf", lambda name: 10)
    assert refused(dataset.load, tmp_path / "small").code == "dataset.size"


# a model and a set that is not of its problem


@needs_onnx
def test_a_model_is_judged_on_its_own_problem_only(fake, tmp_path, monkeypatch):
    monkeypatch.setattr("cavirheo.inference.model.try_out", lambda *_: None)
    path, problem = made.sound(tmp_path), Network(made.sound(tmp_path)).problem
    low, high = problem.prior.bounds("stretch")
    narrow, wide = (
        Prior.uniform(made.PRIOR | {"log10_viscosity": [-3 - more, more], "stretch": [low, high]}) for more in (-1, 1)
    )
    linear = Prior.uniform({"shear_modulus": [1e3, 1e6], **{name: made.PRIOR[name] for name in list(made.PRIOR)[1:]}})
    others = {
        "medium": replace(problem, medium=BU2026),
        "camera": replace(problem, grid=FrameGrid(frames=21)),
        "reference_max_radius": replace(problem, reference_max_radius=100e-6),
        "prior": replace(problem, prior=linear),
        "material": PROBLEM,
    }
    for what, other in others.items():
        dataset.generate(other, 10, tmp_path / what, seed=7, progress=False)
        said = refused(evaluate, path, tmp_path / what)
        assert (said.code, what in str(said)) == ("evaluate.problem", True)
    for name, prior, outside in (("same", problem.prior, 0), ("narrow", narrow, 0), ("wide", wide, 4)):
        dataset.generate(replace(problem, prior=prior), 10, tmp_path / name, seed=7, progress=False)
        notes = evaluate(path, tmp_path / name)["notes"]
        assert len(notes) == (name != "same")
        assert all(f"{outside} of 10 curves" in note for note in notes)
    same_water = replace(problem, medium=replace(problem.medium, name="ours"))
    dataset.generate(same_water, 10, tmp_path / "ours", seed=7, progress=False)
    assert evaluate(path, tmp_path / "ours")["curves"] == 10


def test_the_liquid_s_model_is_not_judged_on_gels(fake, run):
    dataset.generate(Network(path_of("bdt-viscoelastic")).problem, 5, "gels", progress=False)
    status, out, err = run("evaluate", "bdt-viscous", "gels")
    assert (status, out) == (2, "")
    assert "newtonian" in err


@needs_onnx
def test_an_evaluation_needs_no_matplotlib(fake, tmp_path, monkeypatch):
    path = made.sound(tmp_path)
    dataset.generate(Network(path).problem, 5, tmp_path / "set", seed=7, progress=False)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    found = evaluate(path, tmp_path / "set", tmp_path / "out")
    assert json.loads((tmp_path / "out" / "metrics.json").read_text()) == found
    assert "matplotlib" in (tmp_path / "out" / "evaluation.md").read_text()


# the command line


@pytest.fixture
def small(tmp_path) -> Path:
    (tmp_path / "small.toml").write_text(RIGHT.replace("n = 100", "n = 20").replace("width = 16", "width = 8"))
    return tmp_path / "small.toml"


def one_line(status: int, out: str, err: str) -> str:
    assert (status, out) == (2, "")
    (line,) = (line for line in err.splitlines() if line.strip())
    assert line.startswith("error: ")
    return line


@pytest.mark.train
@pytest.mark.slow
def test_wrong_words_and_places_of_generate_and_train(fake, small, run, tmp_path):
    pytest.importorskip("torch")
    assert run("generate", small, "-o", "data")[0] == 0
    (tmp_path / "file").write_text("mine")
    for out in ("file", "file/inside", "/proc/nowhere"):
        for words in (("generate", small), ("train", small, "data")):
            assert out in one_line(*run(*words, "-o", out))
        assert out in one_line(*run("evaluate", "bdt-viscous", "data", "-o", out)) or out
    assert (tmp_path / "file").read_text() == "mine"
    for device in ("foo", "cuda:99", "meta", ""):
        assert repr(device) in one_line(*run("train", small, "data", "-o", "run", "--device", device))
    one_line(*run("generate", small, "-o", "much", "-n", 10**12))
    one_line(*run("generate", small, "-o", "data", "--seed", 2**70))
    one_line(*run("train", small, "nothing", "-o", "run"))
    wild = small.with_name("wild.toml")
    wild.write_text(small.read_text().replace("lr = 0.01", "lr = 1e30"))
    assert "lower lr" in one_line(*run("train", wild, "data", "-o", "wild", "--threads", 1))


@pytest.mark.train
@pytest.mark.slow
def test_a_damaged_run_is_named(fake, small, run, tmp_path):
    pytest.importorskip("onnxscript")
    assert run("generate", small, "-o", "data")[0] == 0
    words = ("train", small, "data", "-o", "run", "--threads", 1)
    assert run(*words)[0] == 0
    whole = tmp_path / "whole"
    (tmp_path / "run").replace(whole)
    result = json.loads((whole / "result.json").read_text())
    for name, content in {
        "result.json": [b"", b"{", b"[]", b"{}", b"\xff", json.dumps(result | {"data": 5, "metrics": []}).encode()],
        "last.safetensors": [b"", b"\xff" * 100, (whole / "best.safetensors").read_bytes()],
        "test.npz": [b"", b"PK\x03\x04", (whole / "tiny.onnx").read_bytes()],
        "best.safetensors": [b"", (whole / "last.safetensors").read_bytes()],
    }.items():
        for bad in content:
            shutil.rmtree(tmp_path / "run", ignore_errors=True)
            shutil.copytree(whole, tmp_path / "run")
            (tmp_path / "run" / name).write_bytes(bad)
            line = one_line(*run(*words))
            assert name in line or bad == b"{}"
    (tmp_path / "run" / "last.safetensors").unlink()
    os.mkfifo(tmp_path / "run" / "last.safetensors")
    one_line(*run(*words))


def test_training_says_what_is_not_installed(small, run, monkeypatch):
    for name in ("torch", "onnx", "onnxscript", "safetensors"):
        with monkeypatch.context() as patch:
            for loaded in ("train", "export", "network", "loop", "point_training", "posterior_training"):
                patch.delitem(sys.modules, f"cavirheo.training.{loaded}", raising=False)
                patch.delattr(f"cavirheo.training.{loaded}", raising=False)
            patch.setitem(sys.modules, name, None)
            assert "[train]" in one_line(*run("train", small, "data", "-o", "run"))


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "cavirheo", *map(str, words)]


@pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")
@pytest.mark.parametrize("most", [0, 3000])
def test_a_full_disk(small, tmp_path, most):
    """HDF5 itself would end the process."""
    import resource

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    words = command("generate", small, "-o", tmp_path / "data", "-n", 20)
    done = subprocess.run(words, capture_output=True, text=True, check=False, preexec_fn=limit)
    one_line(done.returncode, done.stdout, done.stderr)
    assert list((tmp_path / "data").iterdir()) == []


def until_killed(words: list[str], seconds: float) -> bool:
    """Whether the command had to be killed."""
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        return bool(process.wait(seconds))
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return True


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["generate", "train"])
def test_killed_at_random_moments(small, tmp_path, verb):
    """The rerun completes it to what one call would have given: the same bytes, but for the seconds it took."""
    count, early, late = (4000, 0.1, 0.3) if verb == "generate" else (200, 0.3, 0.6)
    sets = {name: command("generate", small, "-n", count, "-o", tmp_path / name) for name in ("one", "two")}
    calls = sets
    if verb == "train":
        pytest.importorskip("torch")
        subprocess.run(sets["one"], check=True)
        small.write_text(small.read_text().replace("epochs = 4", "epochs = 50"))
        words = command("train", small, tmp_path / "one", "--threads", 1, "-o")
        calls = {name: [*words, str(tmp_path / f"run {name}")] for name in sets}
    began = time.monotonic()
    subprocess.run(calls["one"], check=True)
    longest, chance, killed = time.monotonic() - began, random.Random(0), 0
    for _ in range(10):
        killed += until_killed(calls["two"], chance.uniform(early, late) * longest)
    assert killed >= 3
    subprocess.run(calls["two"], check=True)
    one, two = (contents(Path(words[-1])) for words in calls.values())
    assert one.keys() == two.keys()
    timed = ("result.json", "history.jsonl", "last.safetensors", "tiny.json")
    assert {name: one[name] == two[name] for name in one if name not in timed} == dict.fromkeys(
        (name for name in one if name not in timed), True
    )
    if verb == "train":
        cards = [json.loads(found["tiny.json"]) for found in (one, two)]
        for card in cards:
            del card["training"]["seconds"]
        assert cards[0] == cards[1]
