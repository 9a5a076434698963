"""Fixtures shared by all tests."""

import csv
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cavirheo import Bubble, InputError, Medium, verbs
from cavirheo.inference.network_files import TrainingProblem
from cavirheo.prior import Prior

LIQUID = {"log10_viscosity": [-4.0, 0.0], "stretch": [3.0, 11.0]}
PROBLEM = TrainingProblem("newtonian", Prior.uniform(LIQUID))
WATER = Medium()
FIELD, REAL = Bubble(), Bubble("kinetic", confinement_inertia="free", confinement_damping="free")
BDT = ("--model", "bdt-viscoelastic")  # a quick answer without an interval, where another is not looked at
ANSWER = "cavirheo.inference.analysis.Analysis.answer"  # what tests replace where nothing is to be inferred

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "examples" / "soft_gel.csv"
NEEDED = {  # a library of an extra, and the files of tests that need it
    "av": ["*test_video*"], "gradio": ["*test_app*"], "distributed": ["*test_cluster*"],
    "mkdocstrings_handlers": ["*test_site*"],
}  # fmt: skip
collect_ignore_glob = [glob for name, globs in NEEDED.items() if not find_spec(name) for glob in globs]
if not (ROOT / "docs").is_dir():  # the sdist, whose tests run from the wheel (tests/wheel.py)
    collect_ignore_glob += ["meta/test_document*.py", "meta/test_site.py"]


def slow(*case: object, **about: Any) -> Any:
    """A case of a table that is run by `make test-slow` alone."""
    return pytest.param(*case, marks=pytest.mark.slow, **about)


def rows_of(path: Path | str) -> list[dict[str, str]]:
    """Of a CSV file with titles."""
    with Path(path).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def contents(folder: Path) -> dict[str, bytes]:
    """Of every file in it and below."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@contextmanager
def refused(code: str, *words: str) -> Iterator[None]:
    """An InputError of this code is raised, and its message has these words."""
    with pytest.raises(InputError) as caught:
        yield
    assert caught.value.code == code
    assert [word for word in words if word not in str(caught.value)] == []


def error_of(call: Callable[..., object], *given: object, **settings: object) -> InputError:
    """The error, of one line, with which this call is refused."""
    with pytest.raises(InputError) as caught:
        call(*given, **settings)
    assert "\n" not in str(caught.value)
    return caught.value


def code_of(call: Callable[..., object], *given: object, **settings: object) -> str:
    """Its code."""
    return error_of(call, *given, **settings).code


def done(called: tuple[int, str, str]) -> str:
    """What a command printed that ended with status 0."""
    assert called[0] == 0, called[2]
    return called[1]


def refusal(called: tuple[int, str, str], *words: str) -> str:
    """The one line with these words that a command ended with, at status 2."""
    status, _, err = called
    assert (status, err.count("\n")) == (2, 1), err
    assert [word for word in words if word not in err] == []
    return err


def until(fine: Callable[[], bool], seconds: float = 20.0) -> None:
    """Wait until this is so."""
    end = time.monotonic() + seconds
    while not fine():
        assert time.monotonic() < end
        time.sleep(0.01)


LONGEST = (
    "test_truth", "test_app_browser", "test_app", "test_fit",
    "test_documentation", "test_population", "test_inference", "test_limits", "test_training", "test_corpus",
)  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first, so that none is left alone at the end of two processes; skipped: what lacks what it needs."""
    for item in items:
        if item.get_closest_marker("repository") and not (ROOT / "docs").is_dir():
            item.add_marker(pytest.mark.skip(reason="no repository beside the tests"))
    items.sort(key=lambda item: next((i for i, name in enumerate(LONGEST) if item.path.stem == name), len(LONGEST)))


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of published measurements, which are not part of the project; without it a test is skipped."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("CAVIRHEO_REAL_DATA") or default)
    if not folder.is_dir():
        pytest.skip(f"no real data in {folder} (set CAVIRHEO_REAL_DATA)")
    return folder


@pytest.fixture(scope="session")
def chromium() -> Iterator[object]:
    """A real browser; without one a test is skipped."""
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None or find_spec("playwright") is None:
        pytest.skip("needs playwright and a Chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        sandbox = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []  # Chromium refuses it to root
        browser = driver.chromium.launch(executable_path=program, args=sandbox)
        yield browser
        browser.close()


class Instant(list):
    """How many curves each batch of instant curves had; those of which `fails` (of theta) holds end half way."""

    def fails(self, theta: np.ndarray) -> np.ndarray:
        return np.zeros(len(theta), bool)

    def curves(self, problem: TrainingProblem, theta: np.ndarray) -> list[SimpleNamespace]:
        """Damped by the viscosity, and as fast as the modulus."""
        self.append(len(theta))
        of = dict(zip(problem.prior.names, theta.T, strict=True))
        decay = 0.5 * (of.get("log10_viscosity", np.zeros(len(theta))) + 3.0)
        speed = of.get("log10_shear_modulus", np.full(len(theta), 3.0)) - 2.0
        phase = problem.time / problem.time[-1]
        shape = (1 + 0.5 * np.cos(np.outer(speed, 3.0 * phase))) / 1.5 * np.exp(-np.outer(decay, phase))
        failed = self.fails(theta)
        shape[failed, len(phase) // 2 :] = np.nan
        status = np.where(failed, "the step size went to zero", "ok").tolist()
        curves = zip(problem.reference_max_radius * shape, status, strict=True)
        return [SimpleNamespace(radius=radius, status=ok) for radius, ok in curves]


@pytest.fixture
def instant(monkeypatch) -> Instant:
    """Instead of the simulations of training curves."""
    made = Instant()
    monkeypatch.setattr(TrainingProblem, "simulate_many", lambda self, theta, workers=None: made.curves(self, theta))
    return made


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """(exit status, stdout, stderr) of a command in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")

    def call(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["cavirheo", *map(str, words)])
        status = 0
        try:
            verbs.main()
        except SystemExit as stop:
            status = int(stop.code or 0)
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return call
