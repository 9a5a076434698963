"""Training: it learns, it resumes exactly, and what is exported is what was trained."""

import json
from datetime import date
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from broken_recipes import RIGHT
from conftest import ROOT, code_of, error_of

import cavirheo
from cavirheo.inference.bdt import network_of
from cavirheo.inference.cards import card as read_card
from cavirheo.inference.emulator import INPUTS, emulator
from cavirheo.prior import TrainingProblem
from cavirheo.training.dataset import generate, load
from cavirheo.training.recipe import Recipe, read_recipe
from cavirheo.training.scores import metrics

CPU, UNITS = {"device": "cpu", "threads": 1}, ("Pa", "Pa s")
SMALL = "width = 16\nposition = 8\nheads = 2\nfeed_forward = 16\nlayers = 1\ndropout = 0.1"
TINY = RIGHT.replace("width = 16", SMALL).replace("lr = 0.01", "lr = 0.01\nseed = 5")

EMULATOR = """
[emulator]
[data]
n = 64
seed = 1
[network]
width = 16
depth = 1
components = 12
[training]
samples = 2400
batch = 40
rate = 0.1
[export]
name = "tiny"
"""


@pytest.fixture
def recipe(tmp_path) -> Recipe:
    path = tmp_path / "tiny.toml"
    path.write_text(TINY)
    return read_recipe(path)


@pytest.fixture
def data(recipe, instant, tmp_path) -> Path:
    """100 curves, of which two fail."""
    bad = recipe.problem.prior.sample(100, 0)[[3, 7], 0]
    instant.fails = lambda theta: np.isin(theta[:, 0], bad)
    generate(recipe.problem, 100, tmp_path / "data", progress=False)
    return tmp_path / "data"


def changed(recipe: Recipe, **settings) -> Recipe:
    return recipe.model_copy(update={"training": recipe.training.model_copy(update=settings)})


def test_recipe_names_its_medium(tmp_path):
    path = tmp_path / "medium.toml"
    for given, density in (('"bu2026"', 1000.0), ("{density = 1010.0}", 1010.0), ('{name = "bu2026"}', 1000.0)):
        path.write_text(TINY.replace("frames = 20", f"frames = 20\nmedium = {given}"))
        assert read_recipe(path).problem.medium.density == density


def test_metrics_of_known_errors():
    truth = np.column_stack([np.linspace(3, 6, 50), np.linspace(3, 11, 50)])
    found = metrics(["log10_shear_modulus", "stretch"], truth, truth + np.array([0.1, 0.0]))
    G, natural = found["log10_shear_modulus"], 10 ** truth[:, 0]
    by_hand = {
        "median_absolute_error": 0.1, "median_relative_error": 10**0.1 - 1,
        "r2": 1 - 0.01 / truth[:, 0].var(),
        "r2_natural": 1 - np.mean((natural * (10**0.1 - 1)) ** 2) / natural.var(),
    }  # fmt: skip
    assert {name: G[name] for name in by_hand} == pytest.approx(by_hand)
    assert found["stretch"]["r2"] == 1.0
    assert code_of(metrics, ["stretch"], truth, truth) == "metrics.shape"


@pytest.mark.train
class TestTorch:
    @pytest.fixture(autouse=True)
    def _torch(self):
        self.torch = pytest.importorskip("torch")
        pytest.importorskip("safetensors")
        self.export, self.networks = (import_module(f"cavirheo.training.{name}") for name in ("train", "networks"))
        self.train = self.export.train

    def test_the_network_of_the_paper(self):
        recipe = read_recipe(ROOT / "recipes" / "bdt-viscoelastic.toml")
        network = self.networks.BubbleTransformer.of(recipe)
        assert sum(p.numel() for p in network.parameters()) == 153_090  # counted by hand
        assert {m.eps for m in network.modules() if isinstance(m, self.torch.nn.LayerNorm)} == {1e-6}
        assert {m.p for m in network.modules() if isinstance(m, self.torch.nn.Dropout)} == {0.1}
        assert network(self.torch.rand(3, 100)).shape == (3, 2)

    def test_learns(self, recipe, data, tmp_path):
        """And leaves the random numbers of the caller alone."""
        self.torch.manual_seed(1)
        expected = self.torch.rand(3)
        self.torch.manual_seed(1)
        result = self.train(changed(recipe, epochs=60), data, tmp_path / "run", **CPU)
        assert self.torch.equal(self.torch.rand(3), expected)
        lines = [json.loads(line) for line in (tmp_path / "run" / "history.jsonl").read_text().splitlines()]
        assert [line["epoch"] for line in lines] == list(range(1, 61))
        assert lines[-1]["train"] < 0.2 * lines[0]["train"]
        assert min(line["validation"] for line in lines) == result["best_validation_loss"]
        assert result["data"]["failures"] == {"the step size went to zero": 2}
        assert sum(result["data"][part] for part in ("train", "validation", "test")) == 98
        test = np.load(tmp_path / "run" / "test.npz")
        assert metrics(recipe.outputs, test["truth"], test["predicted"]) == result["metrics"]
        assert result["metrics"]["log10_shear_modulus"]["r2"] > 0.5
        split = load(data).split(recipe.training.seed)
        np.testing.assert_allclose(test["truth"], load(data).theta[split["test"]][:, :2], atol=1e-5)

    def test_resumes_to_the_same_weights(self, recipe, data, tmp_path, monkeypatch):
        recipe = changed(recipe, warmup_steps=3)
        whole = self.train(recipe, data, tmp_path / "whole", **CPU)
        kind = self.export.PointTraining
        steps, loss_of = [], kind.loss

        def cut(training, step):
            if step == 2 * training.validation_interval + 1:
                raise KeyboardInterrupt
            return loss_of(training, step)

        monkeypatch.setattr(kind, "loss", cut)
        with pytest.raises(KeyboardInterrupt):
            self.train(recipe, data, tmp_path / "cut", **CPU)
        assert not (tmp_path / "cut" / "result.json").exists()
        self.torch.manual_seed(99)  # whatever happened in between must not matter
        monkeypatch.setattr(kind, "loss", lambda run, step: steps.append(step) or loss_of(run, step))
        resumed = self.train(recipe, data, tmp_path / "cut", **CPU)
        assert steps == list(range(max(steps) // 2 + 1, max(steps) + 1))  # of the last two of four epochs
        assert resumed["metrics"] == whole["metrics"]
        for name in ("last.safetensors", "best.safetensors"):
            ours, theirs = (self.export.read_tensors(tmp_path / run / name)[0] for run in ("whole", "cut"))
            assert ours.keys() == theirs.keys()
            assert all(self.torch.equal(ours[key], theirs[key]) for key in ours)
        before, done = (tmp_path / "cut" / "result.json").read_bytes(), len(steps)
        self.train(recipe, data, tmp_path / "cut", **CPU)
        assert len(steps) == done  # a finished run is not trained, nor its test part looked at, again
        assert (tmp_path / "cut" / "result.json").read_bytes() == before

    def test_learning_rate(self, recipe):
        cosine = changed(recipe, warmup_steps=10).training
        rates = [cosine.learning_rate(step, 40) for step in range(40)]
        assert (rates[0], rates[20], np.argmax(rates)) == (pytest.approx(0.001), pytest.approx(0.005), 9)
        assert rates[-1] < 1e-4

    def answers(self, recipe, run, inputs):
        with self.torch.inference_mode():
            return (
                self.export.load_network(recipe, run / "best.safetensors")
                .answers(self.torch.from_numpy(inputs))
                .numpy()
            )

    def test_exported_model_is_the_trained_one(self, recipe, data, tmp_path, monkeypatch):
        run, models = tmp_path / "run", tmp_path / "models"
        assert code_of(self.export.export, recipe, run, models) == "export.unfinished"
        result = self.train(recipe, data, run, **CPU)
        with monkeypatch.context() as patch:
            forward = self.export.Forward.__call__
            patch.setattr(self.export.Forward, "__call__", lambda *given: forward(*given) + 2e-3)
            with pytest.raises(RuntimeError, match=r"0\.002"):
                self.export.export(recipe, run, models)
        assert not models.exists()  # no file of a network that answers otherwise
        other = recipe.model_copy(update={"prior": recipe.prior | {"stretch": (3.0, 10.0)}})
        other.__dict__.pop("problem", None)
        assert code_of(self.train, other, data, tmp_path / "other", **CPU) == "training.another_problem"
        another = changed(recipe, lr=0.02)
        assert "training.lr" in str(error_of(self.train, another, data, run, **CPU))
        assert "training.lr" in str(error_of(self.export.export, another, run, models))
        path = self.export.export(recipe, run, models, card_date=date(2026, 1, 2))
        radius = np.random.default_rng(0).random((600, 20), dtype=np.float32)
        expected = self.answers(recipe, run, radius)
        np.testing.assert_allclose(network_of(str(path))(radius), expected, atol=1e-4)
        card = read_card(path)
        assert TrainingProblem.from_dict(card["problem"]).id == card["problem_id"] == recipe.problem.id
        assert {one["name"]: one["unit"] for one in card["outputs"]} == dict(zip(recipe.outputs, UNITS, strict=True))
        assert card["metrics"] == result["metrics"]
        assert (card["data"]["failures"], card["date"]) == ({"the step size went to zero": 2}, "2026-01-02")
        assert card["history"]["train"] == pytest.approx(result["history"]["train"], rel=1e-4)
        trained = cavirheo.load(run)
        assert (trained.kind, trained.metrics, trained.outputs) == ("training", result["metrics"], list(recipe.outputs))

    @pytest.fixture
    def bubbles(self, tmp_path):
        """A recipe for an emulator, and 64 bubbles."""
        path = tmp_path / "emulator.toml"
        path.write_text(EMULATOR)
        recipe = read_recipe(path)
        generate(recipe.problem, recipe.data.n, tmp_path / "bubbles", seed=1, progress=False)
        return recipe, tmp_path / "bubbles"

    def test_an_emulator_is_trained_resumed_and_exported(self, bubbles, tmp_path, monkeypatch):
        recipe, data = bubbles
        kind = self.export.EmulatorTraining
        monkeypatch.setattr(kind, "validation_interval", 20)
        whole = self.train(recipe, data, tmp_path / "whole", **CPU)
        assert whole["history"]["train"][-1] < 0.7 * whole["history"]["train"][0]
        loss_of = kind.loss

        def cut(training, step):
            if step == 30:
                raise KeyboardInterrupt
            return loss_of(training, step)

        with monkeypatch.context() as patch:
            patch.setattr(kind, "loss", cut)
            with pytest.raises(KeyboardInterrupt):
                self.train(recipe, data, tmp_path / "cut", **CPU)
        self.torch.manual_seed(99)
        resumed = self.train(recipe, data, tmp_path / "cut", **CPU)
        assert resumed["errors"] == whole["errors"]
        ours, theirs = (self.export.read_tensors(tmp_path / run / "last.safetensors")[0] for run in ("whole", "cut"))
        assert all(self.torch.equal(ours[key], theirs[key]) for key in ours)
        path = self.export.export(recipe, tmp_path / "whole", tmp_path / "models")
        card, inputs = read_card(path), np.random.default_rng(0).standard_normal((5, INPUTS)).astype(np.float32)
        expected = self.answers(recipe, tmp_path / "whole", inputs)
        np.testing.assert_allclose(emulator(str(path)).trajectories(inputs), expected, atol=1e-3)
        assert (card["kind"], card["errors"]) == ("emulator", whole["errors"])
        errors = card["errors"]
        assert 0.0 < errors["median"] <= errors["p90"] <= errors["p95"] <= errors["p99"] < 1.0
        assert 56 <= card["data"]["train"] + card["data"]["test"] <= 64  # some bubbles cannot be solved
        wide = recipe.model_copy(update={"network": recipe.network.model_copy(update={"components": 60})})
        self.export.write_tensors(tmp_path / "nan.safetensors", {}, {"loss": np.nan})
        assert self.export.read_tensors(tmp_path / "nan.safetensors")[1] == {"loss": None}  # JSON has no NaN
        assert code_of(self.train, wide, data, tmp_path / "wide", **CPU) == "training.few"
