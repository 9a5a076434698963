"""Fixtures shared by all tests."""

import os
import sys
from pathlib import Path

import pytest

from cavirheo import verbs


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of published measurements, which are not part of the project; without it a test is skipped."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("CAVIRHEO_REAL_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"no real data in {folder} (set CAVIRHEO_REAL_DATA)")
    return folder


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
