"""The documentation site builds without a warning, asks nothing of other machines, and holds what the code has."""

import html
import importlib
import json
import os
import re
import subprocess
import sys

import pytest
from conftest import ROOT

import cavirheo
from cavirheo import loading
from cavirheo.reporting.record import Result
from cavirheo.verbs import app

FETCHED = re.compile(  # what a browser would fetch from another machine for a page or a style sheet
    r"""(?:<(?:script|img|iframe|source)\b[^>]*?\bsrc=|<link\b[^>]*?\bhref=|@import\s+|url\()["']?((?:https?:)?//[^"')\s>]+)"""
)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the site, whose tutorials take minutes to run."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    surroundings = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    done = subprocess.run(command, cwd=ROOT, env=surroundings, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.slow
def test_every_page_of_the_repository_is_there_and_nothing_is_fetched_from_elsewhere(site):
    pages = [path for folder in ("docs", "validation") for path in (ROOT / folder).rglob("*.md")]
    there = [site / path.relative_to(ROOT).with_suffix(".html") for path in pages]
    there = [page.with_stem("index") if page.stem == "README" else page for page in there]
    assert [page for page in there if not page.exists()] == []
    files = [path for path in site.rglob("*") if path.suffix in (".html", ".css", ".svg")]
    texts = {path: path.read_text("utf-8") for path in files}
    assert [path for path, text in texts.items() if FETCHED.search(text)] == []
    scripts = [path for path, text in texts.items() if path.suffix == ".html" and "arithmatex" in text]
    assert scripts == []  # equations are set without any
    assert texts[site / "docs" / "method" / "physics.html"].count('display="block"') > 15


TUTORIALS = {path.stem for path in ROOT.glob("examples/tutorials/*.py")}


@pytest.mark.slow
def test_every_tutorial_is_a_page_with_its_script_and_its_notebook(site):
    folder = site / "examples" / "tutorials"
    listed = (site / "examples" / "index.html").read_text("utf-8")
    for stem in TUTORIALS:
        assert {path.suffix for path in folder.glob(f"{stem}.*")} == {".html", ".ipynb", ".py"}
        assert f"tutorials/{stem}.html" in listed
        cells = json.loads((folder / f"{stem}.ipynb").read_text("utf-8"))["cells"]
        said = "".join(one.get("text", "") for cell in cells for one in cell.get("outputs", ()))
        shown = html.unescape((folder / f"{stem}.html").read_text("utf-8"))
        assert [line for line in said.splitlines() if line.rstrip() not in shown] == []


@pytest.mark.slow
def test_the_reference_has_every_name_verb_and_field(site):
    pages = ("python", "commands", "result")
    python, commands, result = ((site / "reference" / f"{page}.html").read_text("utf-8") for page in pages)
    assert [name for name in cavirheo.__all__ if f'id="cavirheo.{name}"' not in python] == []
    assert [verb.name for verb in app.registered_commands if f'id="{verb.name}"' not in commands] == []
    assert [name for name in Result.model_json_schema()["$defs"] if f'id="{name.lower()}"' not in result] == []


def test_every_field_of_every_document_has_a_meaning(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    documents = importlib.import_module("documents")
    kinds = (documents.Result, *documents.others(), *documents.CARDS)
    records = {name: one for kind in kinds for name, one in documents.records(kind).items()}
    for name, one in records.items():
        assert [field for field, about in one["properties"].items() if not about["description"]] == [], name
        assert one["description"], name
    assert len(records) > 30


def test_the_page_of_file_formats_names_what_can_be_read_back():
    text = (ROOT / "docs" / "file-formats.md").read_text("utf-8")
    kinds = [kind.rpartition(".")[2] for kind, _ in loading.KINDS.values()]
    assert [name for name in (*loading.NAMES, *kinds, "Dataset") if f"`{name}`" not in text] == []
