"""What is released: one version, a report for bugs, the manual page, shell completion, the conda recipe."""

import re
import shutil
import subprocess
import sys
import tomllib

import jinja2
import pytest
from conftest import ROOT

import cavirheo
from cavirheo import verbs
from cavirheo.inference.model import card, shipped
from cavirheo.physics.media import MEDIA
from cavirheo.reporting.citation import references
from cavirheo.verbs import machine

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
in_repository = pytest.mark.repository


@in_repository
def test_the_version_is_written_once_and_the_citation_is_of_it_and_its_authors():
    places = ("*", *(f"{one}/**/*" for one in ("src", "docs", "packaging", "recipes", "benchmarks", "examples")))
    kinds = (".py", ".md", ".toml", ".yaml", ".yml", ".cff", ".txt", ".html", "")
    paths = [path for place in places for path in ROOT.glob(place) if path.is_file() and path.suffix in kinds]
    written = rf"\bversion\b\W{{1,9}}{re.escape(PROJECT['version'])}\b"
    found = {path.name for path in paths if re.search(written, path.read_text("utf-8", "replace"))}
    assert found - {"CHANGELOG.md"} == {"pyproject.toml", "CITATION.cff"}
    assert cavirheo.__version__ == PROJECT["version"]
    citation = pytest.importorskip("yaml").safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert {key: PROJECT[key] for key in ("version", "license", "authors")}.items() <= citation.items()
    assert {*citation["keywords"]} <= {*PROJECT["keywords"]}
    sources = [references()[key].fields for key in ("Estrada2018", "Bu2025")]
    cited = {(one["title"], str(one["year"])) for one in citation["references"]}
    assert cited == {(source["title"], source["year"]) for source in sources}


def test_a_bug_report_has_versions_extras_models_and_the_solver(run, monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    status, out, err = run("--version", "--verbose")
    assert (status, err) == (0, "")
    wanted = [cavirheo.__version__, sys.version.split()[0], "\nsolver ", "NUMBA_NUM_THREADS=1"]
    wanted += [f" {one.partition('>')[0]} " for one in PROJECT["dependencies"]]
    wanted += [f"\n[{extra}]" for extra in {*machine.required()} - {""}]
    wanted += [f"{name}, sha256 {card(path)['onnx']['sha256']}\n" for name, path in shipped().items()]
    assert [text for text in wanted if text not in out] == []


def test_a_bug_report_tells_what_is_not_as_it_was(monkeypatch, tmp_path):
    monkeypatch.setattr(machine, "requires", lambda _: ["numpy>=2", 'nonesuch>=1; extra == "plot"'])
    path = tmp_path / "posterior.onnx"
    for suffix in (".onnx", ".json"):
        shutil.copy(shipped()["posterior"].with_suffix(suffix), tmp_path)
    path.write_bytes(path.read_bytes() + b"x")
    monkeypatch.setattr("cavirheo.inference.model.shipped", lambda: {"posterior": path})
    said = machine.report()
    assert "[plot]    no nonesuch" in said
    assert "NOT the file that its card describes" in said


COMPLETED = {
    "in": {"infer"},
    "infer --um": {"--um-per-px"},
    "infer --material n": {"neo-hookean", "newtonian", "nhkv"},
    "fit --material fung+ne": {"fung+neo-hookean", "fung+newtonian"},
    "fit --material ogd": set(),  # cannot be fitted
    "which-law --laws nhkv,n": {"nhkv,neo-hookean", "nhkv,newtonian"},
    "which-law --bubble real,": {"real,field"},
    "infer --model ": {*shipped()},
    "fit --medium ": {*MEDIA},
}


def test_shells_complete(monkeypatch, capsys):
    """What bash offers after these words."""
    monkeypatch.setattr("sys.argv", ["cavirheo"])
    monkeypatch.setenv("_CAVIRHEO_COMPLETE", "complete_bash")
    found = {}
    for typed in COMPLETED:
        words = f"cavirheo {typed}"
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", str(len(words.split(" ")) - 1))
        with pytest.raises(SystemExit):
            verbs.main()
        found[typed] = {*capsys.readouterr().out.split()}
    assert found == COMPLETED


@in_repository
@pytest.mark.skipif(shutil.which("groff") is None, reason="no groff on this machine")
def test_the_manual_page_is_set_without_a_warning(tmp_path):
    page = tmp_path / "cavirheo.1"
    subprocess.run([sys.executable, ROOT / "packaging" / "manual.py", page], check=True)
    words = ["groff", "-man", "-Tutf8", "-ww", "-P-cbou", "-rLL=100n", page]
    done = subprocess.run(words, capture_output=True, encoding="utf-8", check=True)
    assert done.stderr == ""
    assert "--um-per-px" in done.stdout


@in_repository
def test_the_examples_of_the_app_are_files_and_those_of_the_repository():
    shipped_examples = [*(ROOT / "src/cavirheo/app/examples").glob("*.*")]
    ours = [path for path in shipped_examples if (ROOT / "examples" / path.name).exists()]
    assert {path.name for path in ours} == {"bubble.mp4", "soft_gel.csv", "stiff_gel.mat"}
    assert not any(path.is_symlink() for path in shipped_examples)
    assert all(path.read_bytes() == (ROOT / "examples" / path.name).read_bytes() for path in ours)


@in_repository
def test_the_conda_recipe_needs_what_the_package_needs():
    yaml = pytest.importorskip("yaml")
    folder = ROOT / "packaging" / "conda"
    page = (folder / "meta.yaml").read_text("utf-8")
    template = jinja2.Environment(undefined=jinja2.StrictUndefined).from_string(page)

    def load_file_data(path: str, from_recipe_dir: bool) -> dict:
        assert from_recipe_dir
        return tomllib.loads((folder / path).read_text("utf-8"))

    recipe = yaml.safe_load(template.render(load_file_data=load_file_data, PYTHON="python"))
    needs = [f"python {PROJECT['requires-python']}", *PROJECT["dependencies"]]
    assert recipe["requirements"]["run"] == needs
    assert recipe["package"]["version"] == PROJECT["version"]
    assert f"cavirheo = {PROJECT['scripts']['cavirheo']}" in recipe["build"]["entry_points"]
