"""Every command, path, link, name and snippet of the documentation exists and works."""

import contextlib
import importlib
import io
import re
import runpy
import shlex
import tomllib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import typer
from conftest import ROOT

import cavirheo
from cavirheo import read_curves, verbs
from cavirheo.inference.analysis import Analysis
from cavirheo.workflow.store import Store

PAGES = sorted(
    [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("benchmarks/*.md"), *ROOT.glob("validation/**/*.md")]
)
FOLDERS = "src|tests|docs|benchmarks|validation|examples|recipes|packaging"
COMMAND: Any = typer.main.get_command(verbs.app)  # type: ignore[attr-defined]
HELP = {text for parameter in COMMAND.params for text in parameter.opts} | {"--help"}  # of every verb or of none
OPTIONS = {
    name: {text for parameter in verb.params for text in (*parameter.opts, *parameter.secondary_opts)} | HELP
    for name, verb in COMMAND.commands.items()
}
EXTRAS = set(tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"])
TARGETS = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text("utf-8"), flags=re.MULTILINE))
OF_BENCHMARKS = {
    option
    for path in (*ROOT.glob("benchmarks/*.py"), *ROOT.glob("validation/**/*.py"), ROOT / "tests/meta/test_golden.py")
    for option in re.findall(r'"(--[\w-]+)"', path.read_text("utf-8"))
}


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def blocks(text: str, *languages: str) -> list[str]:
    """The content of fenced blocks of these languages ("" for none)."""
    found = re.findall(r"^```(\w*)\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    return [content for language, content in found if language in languages]


def broken_command(line: str) -> Iterator[str]:
    """A whole command line of a block: it must be accepted as it stands, but for its files."""
    words = shlex.split(line, comments=True)
    if words[:1] == ["make"]:
        yield from (f"make {word}" for word in words[1:] if word not in TARGETS)
    elif words[:2] == ["pip", "install"]:
        yield from (f"extra [{extra}]" for extra in re.findall(r"\[(\w+)\]", line) if extra not in EXTRAS)
    elif words[:2] == ["python", "-m"]:
        places = [ROOT / word.replace(".", "/") for word in words[2:3]]
        runs = [place.with_suffix(".py").exists() or (place / "__main__.py").exists() for place in places]
        yield from (f"module {word}" for word, here in zip(words[2:3], runs, strict=True) if not here)
    elif words[:1] == ["python"]:
        places = (ROOT, ROOT / "packaging" / "space")
        yield from (f"script {word}" for word in words[1:2] if not any((place / word).exists() for place in places))
    elif words[:1] == ["cavirheo"]:
        if words[1] not in OPTIONS:
            yield f"verb {words[1]}"
            return
        try:
            COMMAND.commands[words[1]].make_context(words[1], words[2:])
        except Exception as error:
            yield f"{line}: {error}"


def broken_code(code: str) -> Iterator[str]:
    """Inline code: a part of a command, a path, a name. Options are those of the verb that it names, or of any."""
    words = re.findall(r"[^\s,]+", code.removeprefix("cavirheo "))
    if code.startswith("cavirheo ") and words[0] not in {*OPTIONS, *HELP}:
        yield f"verb {words[0]}"
    if code.startswith(("make ", "pip ", "python ")):
        yield from broken_command(code)
    known = OPTIONS.get(words[0] if words else "") or set().union(*OPTIONS.values(), OF_BENCHMARKS)
    for word in words:
        if re.match(r"--[a-z]", word) and word.partition("=")[0] not in known:
            yield f"option {word} in {code}"
    is_path = re.fullmatch(r"[\w.-]+/[\w./-]+\.(py|toml|md|css|js)", code)
    if is_path and not any((folder / code).exists() for folder in (ROOT, ROOT / "src" / "cavirheo")):
        yield f"path {code}"
    for dotted in re.findall(r"(?<![\w/.-])cavirheo(?:\.[A-Za-z_]\w*)+", code):
        if not resolves(dotted):
            yield f"name {dotted}"


def resolves(dotted: str) -> bool:
    here: Any = importlib.import_module("cavirheo")
    for part in dotted.split(".")[1:]:
        if not hasattr(here, part):
            try:
                importlib.import_module(f"{here.__name__}.{part}")
            except (ImportError, AttributeError):
                return False
        here = getattr(here, part)
    return True


def problems(text: str) -> list[str]:
    """What a page says that does not exist; broken links end the build of the site (test_site.py)."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    found: list[str] = []
    for line in "".join(blocks(text, "")).splitlines():
        found += broken_command(line) if re.match(r"(cavirheo|make|pip|python) ", line) else ()
    for code in re.findall(r"`([^`\n]+)`", prose):
        found += broken_code(code)
    paths = re.findall(rf"(?<![\w/.-])(?:{FOLDERS})/[\w./-]*\w", text)
    found += [f"merge that nobody ended: {line}" for line in re.findall(r"^(?:<{7}|>{7}) .*", text, re.MULTILINE)]
    return found + [f"path {path}" for path in paths if not (ROOT / path).exists()]


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_what_a_page_names_exists(page):
    assert problems(page.read_text("utf-8")) == []


@pytest.mark.parametrize(
    "planted",
    [
        "`cavirheo guess FILE`",
        "`fit --laws nhkv`",
        "`cavirheo.posterior.Posteriors`",
        "`physics/nothing.py`",
        "src/cavirheo/gone.py",
        "`make nothing`",
        "```\ncavirheo infer a.csv --windows 2\n```",
        "```\ncavirheo infer a.csv --window two\n```",
        "```\npip install '.[nothing]'\n```",
        "```\npython -m validation.nothing\n```",
    ],
)
def test_a_planted_mistake_is_found(planted):
    assert len(problems(f"# Page\n{planted}\n")) >= 1


def test_every_page_begins_with_its_title_and_the_page_of_commands_has_every_verb():
    assert [name(page) for page in PAGES if not re.match(r"# \S.*\n(?!#)", page.read_text("utf-8"))] == []
    text = (ROOT / "docs" / "which-command.md").read_text("utf-8")
    assert [verb for verb in OPTIONS if not re.search(rf"[`/ ]{verb}[`,]", text)] == []


SNIPPET = re.compile(r"^```python\n(.*?)^```(?:\n```text\n(.*?)^```)?", re.DOTALL | re.MULTILINE)  # with its output
SNIPPETS = [(page, *found) for page in PAGES for found in SNIPPET.findall(page.read_text("utf-8"))]
NUMBER = re.compile(r"\d+(?:\.\d+)?")


STORE = Store()  # several pages ask the same of the same file


def answer_once(analysis, curve, begun=None, answer=Analysis.answer, **options):
    work = partial(answer, analysis, curve, begun, **options)
    return work() if begun else STORE.once(analysis.key(curve), work)


def first_shot(*words, **options):
    return read_curves(*words, **options)[:1]


FIVE_FITS = "docs/coming-from.md"
CASES = [
    pytest.param(*case, id=name(case[0]), marks=[pytest.mark.slow] * (name(case[0]) == FIVE_FITS)) for case in SNIPPETS
]


@pytest.mark.parametrize(("page", "code", "shown"), CASES)
def test_snippets_run(page, code, shown, monkeypatch):
    """As they stand; where a page shows no output, with the first shot of a file."""
    monkeypatch.setattr(Analysis, "answer", answer_once)
    if not shown:
        monkeypatch.setattr(cavirheo, "read_curves", first_shot)
    program = compile(code, name(page), "exec", dont_inherit=True)
    if "Client(" in code:
        pytest.skip("needs a running app; tests/meta/test_documented_commands.py starts it")
    monkeypatch.chdir(ROOT)
    with contextlib.redirect_stdout(io.StringIO()) as said:
        exec(program, {})
    if shown:  # the page shows what it printed
        assert NUMBER.sub("0", said.getvalue()) == NUMBER.sub("0", shown)
        numbers = [[float(one) for one in NUMBER.findall(text)] for text in (said.getvalue(), shown)]
        assert numbers[0] == pytest.approx(numbers[1], rel=0.03)


EXAMPLES = {  # script: what it prints; the slow ones below
    "infer_a_file": r"soft_gel\[1\]: R_max 267 um, G 6[0-6]\d\d Pa, mu 0\.0(29|3[0-2])",
    "simulate_any_law": r"zener.* ok",
    "your_own_arrays": r"G [78]\d{3} Pa \(true 8000\)",
}
LONG = {
    "fit_a_window": r"(?s)shear_modulus: 3\.\d+e\+04 Pa.*shear_modulus, viscosity: [+-]0\.\d\d.*  1: G \d{5} Pa",
    "measure_a_video": r"R_max 250\.\d um.* 7\d frames ok.*G (9[89]|10[01])\d\d Pa \(true 10000\)",
    "group_to_table": r"stiff_gel: 5 shots, G 30\d\d\d ± ",
    "posterior_interval": r"draws are worth \d{3,} independent ones",
    "compare_laws": r"chosen: nhkv",
}


@pytest.mark.parametrize("script", [*EXAMPLES, *(pytest.param(script, marks=pytest.mark.slow) for script in LONG)])
def test_examples_run(script, monkeypatch, tmp_path, capsys):
    path = ROOT / "examples" / f"{script}.py"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    if script in EXAMPLES:
        monkeypatch.setattr(cavirheo, "read_curves", first_shot)
    runpy.run_path(str(path), run_name="__main__")
    assert re.search((EXAMPLES | LONG)[script], capsys.readouterr().out)
    assert {one.stem for one in path.parent.glob("*.py")} == {*EXAMPLES, *LONG, "make_examples"}
