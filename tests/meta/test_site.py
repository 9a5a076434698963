"""The documentation site builds without a warning, asks nothing of other machines, and holds what the code has."""

import importlib
import os
import pkgutil
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


@pytest.fixture(scope="module", params=["unrun", pytest.param("run", marks=pytest.mark.slow)])
def site(request, tmp_path_factory):
    """The folder of the site; its tutorials take minutes to run, and without what they print the rest takes seconds."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    surroundings = os.environ | {"PYTHONPATH": str(ROOT / "src"), "CAVIRHEO_TUTORIALS": request.param}
    done = subprocess.run(command, cwd=ROOT, env=surroundings, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_nothing_is_fetched_from_elsewhere(site):
    files = [path for path in site.rglob("*") if path.suffix in (".html", ".css", ".svg")]
    fetched = {str(path.relative_to(site)): FETCHED.findall(path.read_text("utf-8")) for path in files}
    assert {name: addresses for name, addresses in fetched.items() if addresses} == {}
    assert len(fetched) > 60


def test_every_page_of_the_repository_is_there(site):
    pages = [path for folder in ("docs", "benchmarks", "validation") for path in (ROOT / folder).rglob("*.md")]
    names = {path: "index" if path.stem == "README" else path.stem for path in pages}
    missing = [path for path in pages if not (site / path.relative_to(ROOT)).with_name(f"{names[path]}.html").exists()]
    assert missing == []


def test_equations_are_set_without_a_script(site):
    assert (site / "docs" / "method" / "physics.html").read_text("utf-8").count('display="block"') > 15
    assert [path for path in site.rglob("*.html") if "arithmatex" in path.read_text("utf-8")] == []


def test_every_tutorial_is_a_page_with_its_script_and_its_notebook(site, request):
    folder, stems = site / "examples" / "tutorials", [path.stem for path in ROOT.glob("examples/tutorials/*.py")]
    listed = (site / "examples" / "index.html").read_text("utf-8")
    for stem in stems:
        assert {path.suffix for path in folder.glob(f"{stem}.*")} == {".html", ".ipynb", ".py"}
        assert f"tutorials/{stem}.html" in listed
    assert bool([*folder.glob("*-[0-9]*.png")]) == ("[run]" in request.node.name)  # what they draw


def test_the_reference_has_every_name_verb_and_field(site):
    python, commands, result = (
        (site / "reference" / f"{page}.html").read_text("utf-8") for page in ("python", "commands", "result")
    )
    assert [name for name in cavirheo.__all__ if f'id="cavirheo.{name}"' not in python] == []
    assert [verb.name for verb in app.registered_commands if f'id="{verb.name}"' not in commands] == []
    assert [name for name in Result.model_json_schema()["$defs"] if f'id="{name.lower()}"' not in result] == []


def test_what_pages_and_examples_import_is_in_the_reference(site):
    paths = [ROOT / "README.md", *ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/**/*.py")]
    code = "\n".join(path.read_text("utf-8") for path in paths)
    imports = re.findall(r"^from (cavirheo[\w.]*) import ([\w, ]+)$", code, re.MULTILINE)
    wanted = {f"{module}.{name.strip()}" for module, names in imports for name in names.split(",")}
    pages = "\n".join(page.read_text("utf-8") for page in site.glob("reference/*.html"))
    listed = {*re.findall(r'\bid="(cavirheo\.[\w.]+)"', pages)}
    there = {id(pkgutil.resolve_name(name)) for name in listed}
    missing = {name for name in wanted - listed if id(pkgutil.resolve_name(name)) not in there}
    assert {name for name in missing if not any(other.startswith(f"{name}.") for other in listed)} == set()
    assert len(wanted) >= 20


@pytest.fixture
def documents(monkeypatch):
    """docs/site/documents.py, which makes the pages of documents."""
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    return importlib.import_module("documents")


def test_every_field_of_every_document_has_a_meaning(documents):
    kinds = (documents.Result, *documents.others(), *documents.CARDS)
    records = {name: one for kind in kinds for name, one in documents.records(kind).items()}
    without = {
        f"{name}.{field}"
        for name, one in records.items()
        for field, about in one["properties"].items()
        if not about["description"]
    }
    assert without == set()
    assert [name for name, one in records.items() if not one["description"]] == []
    assert len(records) > 40


def test_a_docstring_says_no_more_than_there_is(documents):
    """A field that was renamed keeps no line of its own."""
    kinds = [cavirheo.Posterior, *documents.below(documents.BaseModel)]
    kinds = [kind for kind in kinds if kind.__module__.startswith("cavirheo.")]
    told = {kind: documents.attributes(vars(kind).get("__doc__") or "")[1] for kind in kinds}
    wrong = {(kind.__name__, name) for kind, said in told.items() for name in said if name not in kind.__annotations__}
    assert wrong - {("Slope", name) for name in ("median", "q05", "q95")} == set()  # it says what those of its base are


def test_the_page_of_file_formats_names_what_can_be_read_back(site, documents):
    text = (ROOT / "docs" / "file-formats.md").read_text("utf-8")
    kinds = [kind.rpartition(".")[2] for kind, _ in loading.KINDS.values()]
    assert [name for name in (*loading.NAMES, *kinds, "Dataset") if f"`{name}`" not in text] == []
    page = (site / "docs" / "file-formats.html").read_text("utf-8")
    shown = [*documents.others(), *documents.CARDS]
    assert [kind.__name__ for kind in shown if f'id="{kind.__name__.lower()}"' not in page] == []
    assert "max_radius_px" in page
