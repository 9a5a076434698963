"""What is released: one version, a report for bugs, the manual page, shell completion, the conda recipe."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import jinja2
import pytest

import cavirheo
from cavirheo.inference import LEVELS
from cavirheo.inference.law import ABLE
from cavirheo.inference.model import card, shipped
from cavirheo.physics.bubble import BUBBLES, CONTENTS
from cavirheo.physics.media import MEDIA
from cavirheo.reporting.sources import BDT, IMR
from cavirheo.verbs import app, completion, versions

ROOT = Path(__file__).parent.parent
ABOUT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PROJECT = ABOUT["project"]
in_repository = pytest.mark.repository


@in_repository
def test_the_version_is_written_once():
    folders = ("src", "docs", "packaging", "recipes", "benchmarks", "examples", ".")
    files = [path for folder in folders for path in (ROOT / folder).glob("*" if folder == "." else "**/*")]
    kinds = (".py", ".md", ".toml", ".yaml", ".yml", ".cff", ".txt", ".html", "")
    written = rf"\bversion\b\W{{1,9}}{re.escape(PROJECT['version'])}\b"
    found = {path.name for path in files if path.is_file() and path.suffix in kinds and path.name != "CHANGELOG.md"
             and re.search(written, path.read_text("utf-8", errors="replace"))}  # fmt: skip
    assert found == {"pyproject.toml", "CITATION.cff"}  # of the latter, the next test
    assert cavirheo.__version__ == PROJECT["version"]


@in_repository
def test_the_citation_is_of_this_version_and_its_authors():
    yaml = pytest.importorskip("yaml")
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert citation["version"] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]
    assert citation["authors"] == PROJECT["authors"]
    assert {*citation["keywords"]} <= {*PROJECT["keywords"]}
    sources = {source.title: source for source in (IMR, BDT)}
    for reference in citation["references"]:
        source = sources.pop(reference["title"])
        assert [one["family-names"] for one in reference["authors"]] == re.findall(r"([A-Z]\w+),", source.authors)
        assert str(reference["year"]) == source.year
        assert source.doi == reference.get("doi", "")
        assert reference.get("journal") or reference["url"].endswith(source.where.removeprefix("arXiv:"))
    assert not sources


@in_repository
def test_the_classifiers_are_the_pythons_that_are_tried():
    known = [one.rpartition(" ")[2] for one in PROJECT["classifiers"] if re.search(r"Python :: 3\.\d+$", one)]
    (tried,) = re.findall(r"tests/wheel\.py ([\d. ]+)$", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert known == tried.split()
    assert PROJECT["requires-python"] == f">={known[0]}"


def test_a_bug_report_has_versions_extras_models_and_the_solver(run, monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    status, out, err = run("--version", "--verbose")
    assert (status, err) == (0, "")
    assert out.startswith(f"cavirheo  {cavirheo.__version__} in ")
    assert sys.version.split()[0] in out
    for wanted in PROJECT["dependencies"]:
        assert f" {wanted.partition('>')[0]} " in out
    assert {extra for extra in PROJECT["optional-dependencies"] if f"\n[{extra}]" in out} == {*versions.wanted()} - {""}
    for name, path in shipped().items():
        assert f"{name}, sha256 {card(path)['onnx']['sha256']}\n" in out
    assert re.search(r"\nsolver +(compiled, kept in /|not compiled yet)", out)
    assert "NUMBA_NUM_THREADS=1" in out


def test_a_bug_report_tells_what_is_not_as_it_was(monkeypatch, tmp_path):
    monkeypatch.setattr(versions, "requires", lambda _: ["numpy>=2", 'nonesuch>=1; extra == "plot"'])
    path = tmp_path / "posterior.onnx"
    for suffix in (".onnx", ".json"):
        shutil.copy(shipped()["posterior"].with_suffix(suffix), tmp_path)
    path.write_bytes(path.read_bytes() + b"x")
    monkeypatch.setattr("cavirheo.inference.model.shipped", lambda: {"posterior": path})
    said = versions.report()
    assert "[plot]    no nonesuch" in said
    assert "NOT the file that its card describes" in said


def test_the_solver_is_seen_where_it_is_kept(tmp_path, monkeypatch):
    from cavirheo.physics import cache, solver

    monkeypatch.setattr(solver.integrate._cache, "folders", [tmp_path])
    assert versions._solver().startswith("not compiled yet")
    (tmp_path / f"solver.integrate.{solver.integrate._cache.source}.0.nbc").touch()
    assert versions._solver() == f"compiled, kept in {tmp_path}"
    (tmp_path / "solver.integrate.anothersource.0.nbc").touch()
    assert len(cache.kept(solver.integrate)) == 1


@pytest.mark.parametrize("words", [("--verbose",), ("--verbose", "models")])
def test_verbose_alone_is_refused(run, words):
    status, _, err = run(*words)
    assert status == 2
    assert "--verbose goes with --version" in err


def completed(typed: str) -> list[str]:
    """What bash offers after these words."""
    about = {"_CAVIRHEO_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(len(typed.split(" ")) - 1)}
    done = subprocess.run([sys.executable, "-m", "cavirheo"], env=os.environ | about, capture_output=True, text=True)
    return done.stdout.split()


def test_shells_complete_commands_and_options():
    assert completed("cavirheo in") == ["infer"]
    assert {"compare", "collapse-time", "cite", "cluster"} <= {*completed("cavirheo c")}
    assert completed("cavirheo infer --um") == ["--um-per-px"]


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("cavirheo infer --material n", {"neo-hookean", "newtonian", "nhkv"}),
        ("cavirheo infer --material au", {"auto"}),
        ("cavirheo fit --material fung+ne", {"fung+neo-hookean", "fung+newtonian"}),
        ("cavirheo fit --material ogd", set()),  # cannot be fitted
        ("cavirheo simulate --material ogd", {"ogden"}),
        ("cavirheo which-law --laws nhkv,n", {"nhkv,neo-hookean", "nhkv,newtonian"}),
        ("cavirheo which-law --bubble real,", {"real,field"}),
        ("cavirheo infer --model ", {*shipped()}),
        ("cavirheo evaluate po", {"posterior"}),
        ("cavirheo fit --medium ", {*MEDIA}),
        ("cavirheo infer --verify ", {*LEVELS}),
        ("cavirheo infer --bubble ", {*BUBBLES, "auto"}),
        ("cavirheo simulate --contents ", {*CONTENTS}),
    ],
)
def test_shells_complete_values(typed, offered):
    assert {*completed(typed)} == offered


def test_the_laws_that_shells_offer_are_those_that_can_be_fitted():
    assert completion.sum_names("") == ABLE
    assert completion.many_law_names(" nhkv, ge") == [" nhkv, gent"]


def test_help_and_completion_import_no_compiler_and_no_network():
    code = "import sys; sys.argv = ['cavirheo', 'infer', '--help']; from cavirheo.verbs import app, completion\n"
    code += "app(standalone_mode=False); completion.law_names(''); completion.medium_names('')\n"
    code += "completion.model_names('')\n"
    code += "print(sorted({'numba', 'onnxruntime', 'scipy.optimize', 'matplotlib', 'torch'} & {*sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.fixture(scope="module")
def manual() -> str:
    spec = spec_from_file_location("manual", ROOT / "packaging" / "manual.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.page()


@in_repository
def test_the_manual_page_has_every_command_and_status(manual):
    for verb in app.registered_commands:
        name = verb.name.replace("-", r"\-")
        assert f'.SS "cavirheo {name} ' in manual
    table = (ROOT / "docs/how-to/command-line.md").read_text("utf-8").split("## Exit status")[1].split("##")[0]
    assert re.findall(r"^\| (\d+)", table, re.MULTILINE) == re.findall(r"^\.B (\d+)$", manual, re.MULTILINE)
    assert manual.isascii()


@in_repository
@pytest.mark.skipif(shutil.which("groff") is None, reason="no groff on this machine")
def test_the_manual_page_is_set_without_a_warning(manual):
    words = ["groff", "-man", "-Tutf8", "-ww", "-P-cbou", "-rLL=100n"]
    done = subprocess.run(words, input=manual, capture_output=True, encoding="utf-8", check=True)
    assert done.stderr == ""
    assert "--um-per-px" in done.stdout
    assert "cavirheo - material properties of soft matter" in " ".join(done.stdout.split())


@in_repository
def test_the_examples_of_the_app_are_files_and_those_of_the_repository():
    shipped_examples = [*(ROOT / "src/cavirheo/app/examples").glob("*.*")]
    ours = [path for path in shipped_examples if (ROOT / "examples" / path.name).exists()]
    assert {path.name for path in ours} == {"bubble.mp4", "soft_gel.csv", "stiff_gel.mat"}
    assert not any(path.is_symlink() for path in shipped_examples)
    assert all(path.read_bytes() == (ROOT / "examples" / path.name).read_bytes() for path in ours)


@in_repository
def test_the_conda_recipe_needs_what_the_package_needs():
    template = jinja2.Environment(undefined=jinja2.StrictUndefined).from_string(
        (ROOT / "packaging" / "conda" / "meta.yaml").read_text("utf-8")
    )

    def load_file_data(path: str, from_recipe_dir: bool) -> dict:
        assert from_recipe_dir
        return tomllib.loads((ROOT / "packaging" / "conda" / path).read_text("utf-8"))

    recipe = template.render(load_file_data=load_file_data, PYTHON="python")
    needs = recipe.split("  run:\n")[1].split("\n\n")[0]
    listed = [line.strip().removeprefix("- ") for line in needs.splitlines()]
    assert listed == [f"python {PROJECT['requires-python']}", *PROJECT["dependencies"]]
    assert f'version: "{PROJECT["version"]}"' in recipe
    assert f"cavirheo = {PROJECT['scripts']['cavirheo']}" in recipe
    yaml = pytest.importorskip("yaml")
    assert yaml.safe_load(recipe)["requirements"]["run"] == listed


def test_measuring_without_the_extra_says_what_to_install(run, monkeypatch):
    monkeypatch.setattr("cavirheo.video.frames.find_spec", lambda _: None)
    status, _, err = run("measure", "nowhere.mp4")
    assert status == 2
    assert err.count("\n") == 1
    assert 'pip install "cavirheo[video]"' in err
