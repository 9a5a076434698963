"""Fixtures shared by all tests."""

import importlib.util
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import pytest

from cavirheo import InputError, verbs
from cavirheo.messages import Message

BDT = ("--model", "bdt-viscoelastic")  # a quick answer without an interval, where another is not looked at

ROOT = Path(__file__).resolve().parents[1]
collect_ignore_glob = [] if importlib.util.find_spec("av") else ["*test_video*"]  # without the extra [video]
if not (ROOT / "docs").is_dir():  # the sdist, whose tests run from the wheel (tests/wheel.py)
    collect_ignore_glob += ["meta/test_document*.py", "meta/test_site.py"]


def load_benchmark(name: str) -> ModuleType:
    """A file of benchmarks/ as a module, whose name (`app`, `fit`) hides no other's."""
    path = ROOT / "benchmarks" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"benchmarks_{name}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def messages(*texts: str, code: str = "test") -> tuple[Message, ...]:
    """Messages with a sentence of their own each."""
    return tuple(Message(code, {"text": text}) for text in texts if text)


@contextmanager
def refused(code: str, *words: str) -> Iterator[None]:
    """An InputError of this code is raised, and its message has these words."""
    with pytest.raises(InputError) as caught:
        yield
    assert caught.value.code == code
    assert [word for word in words if word not in str(caught.value)] == []


def code_of(use: Callable[[], object]) -> str:
    """The code with which this is refused."""
    with pytest.raises(InputError) as caught:
        use()
    return caught.value.code


def refusal(called: tuple[int, str, str], *words: str) -> str:
    """The one line with these words that a command ended with, at status 2."""
    status, _, err = called
    assert (status, err.count("\n")) == (2, 1), err
    assert [word for word in words if word not in err] == []
    return err


LONGEST = (
    "test_app_browser", "test_app", "test_fit", "test_bubble_model", "test_posterior_network", "test_golden",
    "test_posterior", "test_documentation", "test_population", "test_inference", "test_doubts", "test_training",
    "test_corpus",
)  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first, so that none is left alone at the end of two processes; skipped: what lacks what it needs."""
    for item in items:
        if item.get_closest_marker("repository") and not (ROOT / "docs").is_dir():
            item.add_marker(pytest.mark.skip(reason="no repository beside the tests"))
        for mark in item.iter_markers("needs"):
            if importlib.util.find_spec(mark.args[0]) is None:
                item.add_marker(pytest.mark.skip(reason=f"needs {mark.args[0]}"))
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
    if program is None or importlib.util.find_spec("playwright") is None:
        pytest.skip("needs playwright and a Chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        sandbox = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []  # Chromium refuses it to root
        browser = driver.chromium.launch(executable_path=program, args=sandbox)
        yield browser
        browser.close()


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
