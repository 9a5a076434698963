"""Training: it learns, it resumes exactly, and what is exported is what was trained."""

import json
from datetime import date
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from broken_recipes import RIGHT
from conftest import ROOT, code_of, error_of

import cavirheo
from cavirheo.inference.model import card as read_card
from cavirheo.inference.model import predict
from cavirheo.prior import Prior, TrainingProblem
from cavirheo.training import evaluate as judge
from cavirheo.training.dataset import generate, load
from cavirheo.training.evaluate import breakdown, metrics
from cavirheo.training.recipe import Recipe, read_recipe

CPU, UNITS = {"device": "cpu", "threads": 1}, ("Pa", "Pa s")
SMALL = "width = 16\nposition = 8\nheads = 2\nfeed_forward = 16\nlayers = 1\ndropout = 0.1"
TINY = RIGHT.replace("width = 16", SMALL).replace("lr = 0.01", "lr = 0.01\nseed = 5")


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
        "bias": 0.1, "rmse": 0.1, "median_absolute_error": 0.1, "median_relative_error": 10**0.1 - 1,
        "r2": 1 - 0.01 / truth[:, 0].var(),
        "r2_natural": 1 - np.mean((natural * (10**0.1 - 1)) ** 2) / natural.var(),
    }  # fmt: skip
    assert {name: G[name] for name in by_hand} == pytest.approx(by_hand)
    assert found["stretch"]["r2"] == 1.0
    far = metrics(["stretch"], np.arange(1.0, 12.0)[:, None], np.ones((11, 1)))["stretch"]
    assert far["p90_absolute_error"] == pytest.approx(9.0)
    assert code_of(metrics, ["stretch"], truth, truth) == "metrics.shape"


def test_breakdown_finds_the_error_where_it_is():
    prior = Prior.uniform({"log10_viscosity": (-3.0, 0.0), "stretch": (3.0, 11.0)})
    theta = np.array([[-3.0, 3.0], [-2.9, 10.9], [-1.5, 4.0], [0.0, 11.0]])
    error = np.array([[0.3], [-0.3], [0.1], [0.0]])
    found = breakdown(["log10_viscosity"], prior, theta, error)["log10_viscosity"]
    assert [[row["curves"] for row in rows] for rows in found.values()] == [[2, 1, 1], [2, 0, 0, 2]]
    low, nothing = found["log10_viscosity"][0], found["stretch"][1]
    assert (low["low"], low["high"]) == (-3.0, -2.0)
    assert (low["rmse"], low["bias"], low["share"]) == pytest.approx((0.3, 0.0, 0.18 / 0.19))
    assert (nothing["rmse"], nothing["bias"], nothing["share"]) == (None, None, 0.0)


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
        network = self.networks.BubbleTransformer(recipe.network, 100, 2)
        assert sum(p.numel() for p in network.parameters()) == 153_090  # counted by hand
        assert {m.eps for m in network.modules() if isinstance(m, self.torch.nn.LayerNorm)} == {1e-6}
        assert {m.p for m in network.modules() if isinstance(m, self.torch.nn.Dropout)} == {0.1}
        assert network(self.torch.rand(3, 100)).shape == (3, 2)

    def test_learns(self, recipe, data, tmp_path):
        """And leaves the random numbers of the caller alone."""
        self.torch.manual_seed(1)
        expected = self.torch.rand(3)
        self.torch.manual_seed(1)
        result = self.train(changed(recipe, epochs=20), data, tmp_path / "run", **CPU)
        assert self.torch.equal(self.torch.rand(3), expected)
        lines = [json.loads(line) for line in (tmp_path / "run" / "history.jsonl").read_text().splitlines()]
        assert [line["epoch"] for line in lines] == list(range(1, 21))
        assert lines[-1]["train"] < 0.2 * lines[0]["train"]
        assert min(line["validation"] for line in lines) == result["best_validation_loss"]
        assert result["data"]["failures"] == {"the step size went to zero": 2}
        assert sum(result["data"][part] for part in ("train", "validation", "test")) == 98
        test = np.load(tmp_path / "run" / "test.npz")
        assert metrics(recipe.outputs, test["truth"], test["predicted"]) == result["metrics"]
        assert result["metrics"]["log10_shear_modulus"]["r2"] > 0.5
        split = load(data).split(recipe.training.seed)
        np.testing.assert_allclose(test["truth"], load(data).theta[split["test"]][:, :2], atol=1e-5)

    @pytest.mark.parametrize("schedule", ["constant", "cosine"])
    def test_resumes_to_the_same_weights(self, recipe, data, tmp_path, monkeypatch, schedule):
        recipe = changed(recipe, schedule=schedule, warmup_steps=3)
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
        assert recipe.training.learning_rate(1000, 40) == 0.01
        cosine = changed(recipe, schedule="cosine", warmup_steps=10, epochs=4).training
        rates = [cosine.learning_rate(step, 40) for step in range(40)]
        assert (rates[0], rates[20], np.argmax(rates)) == (pytest.approx(0.001), pytest.approx(0.005), 9)
        assert rates[-1] < 1e-4

    def answers(self, run, radius):
        with self.torch.inference_mode():
            return self.export.load_model(run / "best.safetensors")(self.torch.from_numpy(radius)).numpy()

    def test_a_posterior_network_that_answers_otherwise_is_not_exported(self, tmp_path, monkeypatch):
        recipe = read_recipe(ROOT / "recipes" / "posterior.toml")
        network = self.networks.PosteriorNetwork(len(recipe.problem.kinds), recipe.network)
        self.export.write_tensors(tmp_path / "best.safetensors", network.state_dict(), {"loss": np.nan})
        assert self.export.read_tensors(tmp_path / "best.safetensors")[1] == {"loss": None}  # JSON has no NaN
        monkeypatch.setattr(self.networks, "write_posterior", lambda network, path: path.write_bytes(b"weights"))
        other = SimpleNamespace(run=lambda *_: (None, np.full(64, 1e3), None))
        monkeypatch.setattr(self.export, "onnx_session", lambda _: other)
        result = recipe.settings() | {"kind": "training"}
        (tmp_path / "result.json").write_text(json.dumps(result))
        with pytest.raises(RuntimeError, match="differ"):
            self.export.export(recipe, tmp_path, tmp_path / "models")
        assert list((tmp_path / "models").iterdir()) == []

    def test_exported_model_is_the_trained_one(self, recipe, data, instant, tmp_path, monkeypatch):
        """And is judged on what it was not trained on."""
        pytest.importorskip("onnxscript")
        run, models = tmp_path / "run", tmp_path / "models"
        assert code_of(self.export.export, recipe, run, models) == "export.unfinished"
        result = self.train(recipe, data, run, **CPU)
        with monkeypatch.context() as patch:
            patch.setattr(self.networks, "write_onnx", lambda model, frames, path: path.write_bytes(b"weights"))
            patch.setattr(self.export, "predict", lambda path, radius: self.answers(run, radius) + 2e-3)
            with pytest.raises(RuntimeError, match=r"0\.002"):
                self.export.export(recipe, run, models)
        assert list(models.iterdir()) == []  # of a model that answers otherwise
        other = recipe.model_copy(update={"prior": recipe.prior | {"stretch": (3.0, 10.0)}})
        other.__dict__.pop("problem", None)
        assert code_of(self.train, other, data, tmp_path / "other", **CPU) == "training.another_problem"
        another = changed(recipe, lr=0.02)
        assert "training.lr" in str(error_of(self.train, another, data, run, **CPU))
        assert "training.lr" in str(error_of(self.export.export, another, run, models))
        path = self.export.export(recipe, run, models, card_date=date(2026, 1, 2))
        radius = np.random.default_rng(0).random((600, 20), dtype=np.float32)
        expected = self.answers(run, radius)
        np.testing.assert_allclose(predict(path, radius), expected, atol=1e-4)  # 512 and 88 at a time
        np.testing.assert_allclose(predict(path, radius[:1]), expected[:1], atol=1e-4)
        assert str(Path(judge.__file__).parent).encode() not in path.read_bytes()
        card = read_card(path)
        assert TrainingProblem.from_dict(card["problem"]).id == card["problem_id"] == recipe.problem.id
        assert {one["name"]: one["unit"] for one in card["outputs"]} == dict(zip(recipe.outputs, UNITS, strict=True))
        assert card["metrics"] == result["metrics"]
        assert (card["data"]["failures"], card["date"]) == ({"the step size went to zero": 2}, "2026-01-02")
        assert card["history"]["train"] == pytest.approx(result["history"]["train"], rel=1e-4)
        trained = cavirheo.load(run)
        assert (trained.kind, trained.metrics, trained.outputs) == ("training", result["metrics"], list(recipe.outputs))
        found = judge.evaluate(path, data)
        assert (found["part"], found["curves"]) == ("test", result["data"]["test"])
        for name, values in result["metrics"].items():
            assert found["metrics"][name] == pytest.approx(values, abs=1e-4)
        earlier = instant.curves  # of a later solver: other bytes, the same bubbles
        later = lambda run: SimpleNamespace(radius=run.radius * 1.001, status=run.status)  # noqa: E731
        instant.curves = lambda *given: list(map(later, earlier(*given)))
        for name, n, seed, part in (("fresh", 50, 9, "all"), ("again", 100, 0, "test")):
            generate(recipe.problem, n, tmp_path / name, seed=seed, progress=False)
            assert judge.evaluate(path, tmp_path / name)["part"] == part
        generate(recipe.problem, 60, tmp_path / "fewer", progress=False)
        assert code_of(judge.evaluate, path, tmp_path / "fewer") == "evaluate.trained_on"
