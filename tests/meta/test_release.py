"""What is released: one version, a report for bugs, the manual page, shell completion."""

import re
import shutil
import subprocess
import sys
import tomllib

import pytest
from conftest import ROOT

import cavirheo
from cavirheo import verbs
from cavirheo.reporting.citation import references

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


@pytest.mark.repository
def test_the_version_is_written_once_and_the_citation_is_of_it_and_its_authors():
    places = ("*", *(f"{one}/**/*" for one in ("src", "docs", "packaging", "recipes", "validation", "examples")))
    kinds = (".py", ".md", ".toml", ".yaml", ".yml", ".cff", ".txt", ".html", "")
    paths = [path for place in places for path in ROOT.glob(place) if path.is_file() and path.suffix in kinds]
    written = rf"\bversion\b\W{{1,9}}{re.escape(PROJECT['version'])}\b"
    found = {path.name for path in paths if re.search(written, path.read_text("utf-8", "replace"))}
    assert found - {"CHANGELOG.md"} == {"pyproject.toml", "CITATION.cff"}
    assert cavirheo.__version__ == PROJECT["version"]
    citation = pytest.importorskip("yaml").safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert {key: PROJECT[key] for key in ("version", "license", "authors")}.items() <= citation.items()
    assert {*citation["keywords"]} <= {*PROJECT["keywords"]}
    sources = [dict(re.findall(r"(\w+) = \{(.+)\}", references()[key])) for key in ("Estrada2018", "Bu2025")]
    cited = {(one["title"], str(one["year"])) for one in citation["references"]}
    assert cited == {(source["title"], source["year"]) for source in sources}


@pytest.mark.repository
def test_the_hosted_space_installs_what_the_app_and_recordings_need():
    extras = PROJECT["optional-dependencies"]
    listed = (ROOT / "packaging" / "space" / "requirements.txt").read_text("utf-8").split()
    assert {*listed} == {*PROJECT["dependencies"], *extras["app"], *extras["video"]}


def test_shells_complete(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["cavirheo"])
    words = "cavirheo infer --bubble "
    surroundings = {"_CAVIRHEO_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": "3"}
    for name, value in surroundings.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SystemExit):
        verbs.main()
    assert {*capsys.readouterr().out.split()} == {"real", "field"}


@pytest.mark.repository
@pytest.mark.skipif(shutil.which("groff") is None, reason="no groff on this machine")
def test_the_manual_page_is_set_without_a_warning(tmp_path):
    page = tmp_path / "cavirheo.1"
    subprocess.run([sys.executable, ROOT / "packaging" / "manual.py", page], check=True)
    words = ["groff", "-man", "-Tutf8", "-ww", "-P-cbou", "-rLL=100n", page]
    done = subprocess.run(words, capture_output=True, encoding="utf-8", check=True)
    assert done.stderr == ""
    assert "--um-per-px" in done.stdout


@pytest.mark.repository
def test_the_examples_of_the_app_are_files_and_those_of_the_repository():
    for name in ("bubble.mp4", "soft_gel.csv", "stiff_gel.mat"):
        path = ROOT / "src/cavirheo/app/examples" / name
        assert not path.is_symlink()
        assert path.read_bytes() == (ROOT / "examples" / name).read_bytes()
