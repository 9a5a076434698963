"""Fixtures shared by all tests."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of published measurements, which are not part of the project; without it a test is skipped."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("CAVIRHEO_REAL_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"no real data in {folder} (set CAVIRHEO_REAL_DATA)")
    return folder
