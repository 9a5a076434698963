"""Training: it learns, it resumes exactly, and what is exported is what was trained; networks and recipes that are
damaged or hostile are refused in one line."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from broken_models import BROKEN, FRAMES, sound
from broken_recipes import RECIPES, RIGHT
from conftest import ROOT, code_of, error_of

from cavirheo.inference.bdt import network_of
from cavirheo.inference.emulator import emulator
from cavirheo.inference.network_files import TrainingProblem, path_of, shipped
from cavirheo.inference.network_files import card as read_card
from cavirheo.training.dataset import generate, load
from cavirheo.training.recipe import PointRecipe, read_recipe

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
epochs = 30
batch = 22
lr = 0.1
[export]
name = "tiny"
"""


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
        read = emulator if read_card(path)["kind"] == "emulator" else network_of
        assert read(name).sha256 == read_card(path)["weights"]["sha256"]


@pytest.mark.parametrize("name", RECIPES)
def test_broken_recipe(tmp_path, name):
    content, named = RECIPES[name]
    (tmp_path / "r.toml").write_bytes(content)
    assert named in str(error_of(read_recipe, tmp_path / "r.toml")).removeprefix(str(tmp_path))


@pytest.fixture
def recipe(tmp_path) -> PointRecipe:
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


def changed(recipe: PointRecipe, **settings) -> PointRecipe:
    return recipe.model_copy(update={"training": recipe.training.model_copy(update=settings)})


@pytest.mark.train
class TestTorch:
    @pytest.fixture(autouse=True)
    def _torch(self):
        self.torch = pytest.importorskip("torch")
        self.training, self.networks = (import_module(f"cavirheo.training.{name}") for name in ("train", "networks"))
        self.train = self.training.train

    def test_the_network_of_the_paper(self):
        recipe = read_recipe(ROOT / "recipes" / "bdt-viscoelastic.toml")
        network = self.networks.BubbleTransformer(recipe)
        assert sum(p.numel() for p in network.parameters()) == 153_090  # counted by hand
        assert {m.eps for m in network.modules() if isinstance(m, self.torch.nn.LayerNorm)} == {1e-6}
        assert {m.p for m in network.modules() if isinstance(m, self.torch.nn.Dropout)} == {0.1}
        assert network(self.torch.rand(3, 100)).shape == (3, 2)

    def test_learns(self, recipe, data, tmp_path):
        """And leaves the random numbers of the caller alone. The card says what the file that ships answers."""
        self.torch.manual_seed(1)
        expected = self.torch.rand(3)
        self.torch.manual_seed(1)
        path = self.train(changed(recipe, epochs=60), data, tmp_path / "run", **CPU)
        assert self.torch.equal(self.torch.rand(3), expected)
        card, made = read_card(path), load(data)
        losses = card["history"]
        assert len(losses["train"]) == len(losses["validation"]) == 60
        assert losses["train"][-1] < 0.2 * losses["train"][0]
        assert card["training"]["best_validation_loss"] == pytest.approx(min(losses["validation"]), rel=1e-4)
        assert card["data"]["failures"] == {"the step size went to zero": 2}
        assert sum(card["data"][part] for part in ("train", "validation", "test")) == 98
        test = made.split(recipe.training.seed)["test"]
        answers = network_of(str(path))(made.columns["radius"][test])
        assert self.networks.metrics(recipe.outputs, made.truth(recipe.outputs)[test], answers) == card["metrics"]
        assert card["metrics"]["log10_shear_modulus"]["r2"] > 0.5
        assert TrainingProblem.from_dict(card["problem"]).id == card["problem_id"] == recipe.problem.id
        assert {one["name"]: one["unit"] for one in card["outputs"]} == dict(zip(recipe.outputs, UNITS, strict=True))

    @pytest.mark.parametrize("kind", ["point", "emulator"])
    def test_a_run_that_was_cut_ends_with_the_same_weights(self, kind, request, tmp_path, monkeypatch):
        recipe, data = request.getfixturevalue("curves" if kind == "point" else "bubbles")
        whole = self.train(recipe, data, tmp_path / "whole", **CPU)
        task = self.networks.PointTask if kind == "point" else self.networks.EmulatorTask
        steps, loss_of = [], task.loss

        def cut(training, rows, step, total):
            if step == total // 2 + 1:
                raise KeyboardInterrupt
            return loss_of(training, rows, step, total)

        monkeypatch.setattr(task, "loss", cut)
        with pytest.raises(KeyboardInterrupt):
            self.train(recipe, data, tmp_path / "cut", **CPU)
        assert not (tmp_path / "cut" / "tiny.npz").exists()
        self.torch.manual_seed(99)  # whatever happened in between must not matter
        monkeypatch.setattr(task, "loss", lambda run, rows, step, n: steps.append(step) or loss_of(run, rows, step, n))
        resumed = self.train(recipe, data, tmp_path / "cut", **CPU)
        assert steps == list(range(len(steps), 2 * len(steps)))  # the second half of the epochs
        assert resumed.read_bytes() == whole.read_bytes()
        self.train(recipe, data, tmp_path / "cut", **CPU)
        assert steps == list(range(len(steps), 2 * len(steps)))  # a finished run is not trained again
        assert resumed.read_bytes() == whole.read_bytes()

    @pytest.fixture
    def curves(self, recipe, data):
        return changed(recipe, warmup_steps=3), data

    @pytest.fixture
    def bubbles(self, tmp_path):
        """A recipe for an emulator, and 64 bubbles."""
        path = tmp_path / "emulator.toml"
        path.write_text(EMULATOR)
        recipe = read_recipe(path)
        generate(recipe.problem, recipe.data.n, tmp_path / "bubbles", seed=1, progress=False)
        return recipe, tmp_path / "bubbles"

    def test_what_is_not_of_a_run_is_refused(self, recipe, data, tmp_path, monkeypatch):
        with monkeypatch.context() as patch:
            forward = self.networks.Forward.__call__
            patch.setattr(self.networks.Forward, "__call__", lambda *given: forward(*given) + 2e-3)
            with pytest.raises(RuntimeError, match=r"0\.002"):
                self.train(recipe, data, tmp_path / "run", **CPU)
        assert not list((tmp_path / "run").glob("*.npz"))  # no file of a network that answers otherwise
        other = recipe.model_copy(update={"prior": recipe.prior | {"stretch": (3.0, 10.0)}})
        other.__dict__.pop("problem", None)
        assert code_of(self.train, other, data, tmp_path / "other", **CPU) == "training.another_problem"
        another = changed(recipe, lr=0.02)
        assert "training.lr" in str(error_of(self.train, another, data, tmp_path / "run", **CPU))

    def test_an_emulator_is_trained_and_exported(self, bubbles, tmp_path):
        recipe, data = bubbles
        path = self.train(recipe, data, tmp_path / "run", **CPU)
        card = read_card(path)
        losses, errors = card["history"]["train"], card["errors"]
        assert losses[-1] < 0.7 * losses[0]
        assert 0.0 < errors["median"] <= errors["p90"] <= errors["p95"] <= errors["p99"] < 1.0
        assert 46 <= card["data"]["train"] + card["data"]["test"] <= 54  # ten for validation; some cannot be solved
        trajectories = emulator(str(path)).trajectories(load(data).columns["inputs"][load(data).ok])
        assert np.abs(trajectories[:, 0] - 1.0).max() < 0.5  # R/R_max, which begins at 1
        wide = recipe.model_copy(update={"network": recipe.network.model_copy(update={"components": 60})})
        assert code_of(self.train, wide, data, tmp_path / "wide", **CPU) == "training.few"
        assert code_of(self.train, recipe, tmp_path, tmp_path / "none", **CPU) == "dataset.none"
