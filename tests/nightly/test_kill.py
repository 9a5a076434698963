"""Killed at random moments: what was answered is there, the same command completes it, and nothing is doubled."""

import json
import random
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import EXAMPLE
from files import write_curve

from cavirheo import read_curves
from cavirheo.workflow import Store

SHOTS, KILLS = 12, 8
OTHERWISE = ("seconds", "source", "group_source")


def call(folder: Path, more: int = 0, wait: float | None = None) -> int | None:
    """The exit status; None if it was killed: `wait` seconds after so many `more` answers were kept."""
    files = sorted(path.name for path in folder.glob("shot*.csv"))
    enough = len(kept(folder)) + more
    with (folder.parent / "said").open("w") as said:
        command = [sys.executable, "-m", "cavirheo", "infer", *files, "-o", "out"]
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=said)
    while wait is not None and process.poll() is None and len(kept(folder)) < enough:
        time.sleep(0.02)
    try:
        return process.wait(wait)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return None


def kept(folder: Path) -> set[str]:
    return {path.stem for path in (folder / "out").glob("unfinished/*.npz")}


def answers(folder: Path) -> list[dict]:
    """The rows of its document, without times and places."""
    rows = json.loads((folder / "out" / "result.json").read_text())["curves"]
    return [{key: value for key, value in row.items() if key not in OTHERWISE} for row in rows]


@pytest.mark.slow
def test_killed_at_random_moments(tmp_path):
    (curve, *_) = read_curves(EXAMPLE)
    whole, folder = tmp_path / "whole" / "here", tmp_path / "killed" / "here"
    for place in (whole, folder):
        place.mkdir(parents=True)
        for k in range(SHOTS):
            write_curve(place / f"shot{k:02d}.csv", replace(curve, radius=curve.radius * (1 + 4e-3 * k)))
    assert call(whole) == 0, (whole.parent / "said").read_text()
    chance, before = random.Random(0), set[str]()
    for _ in range(KILLS):
        more = chance.randint(0, 2 * SHOTS // KILLS)
        if call(folder, more, chance.uniform(0.0, 1.0)) is not None or (before and not kept(folder)):
            break  # all was written
        now = kept(folder)
        assert before <= now  # what was answered is there
        before = now
        assert all(map(Store(folder / "out" / "unfinished").get, before))
        for path in (folder / "out").rglob("*.json"):
            json.loads(path.read_text())
    assert before
    assert call(folder) == 0, (folder.parent / "said").read_text()
    assert answers(folder) == answers(whole)
    assert not kept(folder)
