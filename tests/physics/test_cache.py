"""Compiled code on disk: damage, no place to write and several processes at once cost time and nothing else."""

import importlib.util
import sys
from pathlib import Path

import pytest
from numba.core import config

from cavirheo.physics import cache

KERNEL = """
from cavirheo.physics.cache import compiled
from one import ONE

@compiled
def one_more(x):
    return x + ONE

@compiled
def twice(x):
    return 2 * one_more(x)
"""


@pytest.fixture
def start(tmp_path, monkeypatch):
    """Loads the kernels as a new process does, and says whether the compiled code came from a file."""
    monkeypatch.setattr(config, "CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    (tmp_path / "kernel.py").write_text(KERNEL, encoding="utf-8")
    (tmp_path / "one.py").write_text("ONE = 1", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)

    def load() -> bool:
        sys.modules.pop("one", None)
        cache._source.cache_clear()
        cache._say.cache_clear()
        spec = importlib.util.spec_from_file_location("kernel", tmp_path / "kernel.py")
        monkeypatch.setitem(sys.modules, "kernel", module := importlib.util.module_from_spec(spec))
        spec.loader.exec_module(module)
        assert module.twice(20.0) == 42.0
        return sum(module.twice.stats.cache_hits.values()) == 1

    return load


def files(folder: Path) -> set[Path]:
    return {*folder.rglob("kernel.*.nbc")}


@pytest.mark.parametrize(("kept", "turned"), [(0, 0), (20, 0), (-1, 0), (None, 1)])
def test_a_damaged_file_is_made_anew(start, tmp_path, kept, turned):
    start()
    for file in files(tmp_path):
        content = bytearray(file.read_bytes())
        content[5000] ^= turned
        file.write_bytes(content[:kept])
    assert (start(), start()) == (False, True)


@pytest.mark.parametrize(("name", "text"), [("kernel.py", KERNEL + "# new"), ("one.py", "ONE = 1.")])
def test_code_of_another_source_or_constant_is_not_used_and_removed(start, tmp_path, name, text):
    start()
    old = files(tmp_path)
    (tmp_path / name).write_text(text, encoding="utf-8")
    assert not start()
    assert (len(files(tmp_path)), files(tmp_path) & old) == (2, set())


def test_without_a_folder_beside_the_source_that_of_the_user_is_used(start, tmp_path):
    (tmp_path / "__pycache__").write_text("a file, where the folder would be")
    assert (start(), start()) == (False, True)
    assert len(files(tmp_path / "home")) == 2
