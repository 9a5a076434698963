"""Every command, path, link, name and snippet of the documentation exists and works."""

import contextlib
import io
import pkgutil
import re
import runpy
import shlex
import tomllib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import typer
from conftest import ANSWER, ROOT

import cavirheo
from cavirheo import read_curves, verbs

PAGES = sorted(path for where in ("", "docs/**/", "validation/**/") for path in ROOT.glob(f"{where}*.md"))
FOLDERS = "src|tests|docs|validation|examples|recipes|packaging"
COMMAND: Any = typer.main.get_command(verbs.app)  # type: ignore[attr-defined]
HELP = {text for parameter in COMMAND.params for text in parameter.opts} | {"--help"}  # of every verb or of none
OPTIONS = {
    name: {text for parameter in verb.params for text in (*parameter.opts, *parameter.secondary_opts)} | HELP
    for name, verb in COMMAND.commands.items()
}
EXTRAS = set(tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"])
TARGETS = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text("utf-8"), flags=re.MULTILINE))
OF_VALIDATION = {
    option
    for path in (*ROOT.glob("validation/**/*.py"), ROOT / "tests/meta/test_golden.py")
    for option in re.findall(r'"(--[\w-]+)"', path.read_text("utf-8"))
}


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def blocks(text: str, *languages: str) -> list[str]:
    """The content of fenced blocks of these languages ("" for none)."""
    found = re.findall(r"^```(\w*)\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    return [content for language, content in found if language in languages]


def broken_command(line: str) -> str:
    """What is wrong with a whole command line of a block, which must be accepted as it stands, but for its files."""
    unknown: Any = ""
    match shlex.split(line, comments=True):
        case ["make", *targets]:
            unknown = {*targets} - TARGETS
        case ["pip", "install", *_]:
            unknown = {*re.findall(r"\[(\w+)\]", line)} - EXTRAS
        case ["python", "-m", module, *_]:
            unknown = find_spec(module) is None
        case ["python", script, *_]:
            unknown = not any((place / script).exists() for place in (ROOT, ROOT / "packaging" / "space"))
        case ["cavirheo", verb, *words]:
            try:
                COMMAND.commands[verb].make_context(verb, words)
            except Exception as error:
                unknown = error
    return f"{line}: {unknown}" if unknown else ""


def broken_code(code: str) -> Iterator[str]:
    """Inline code: a part of a command, a path, a name. Options are those of the verb that it names, or of any."""
    words = re.findall(r"[^\s,]+", code.removeprefix("cavirheo "))
    if code.startswith("cavirheo ") and words[0] not in {*OPTIONS, *HELP}:
        yield f"verb {words[0]}"
    if code.startswith(("make ", "pip ", "python ")):
        yield broken_command(code)
    known = OPTIONS.get(words[0] if words else "") or set().union(*OPTIONS.values(), OF_VALIDATION)
    yield from (f"option {word} in {code}" for word in re.findall(r"--[a-z][\w-]*", code) if word not in known)
    is_path = re.fullmatch(r"[\w.-]+/[\w./-]+\.(py|toml|md|css|js)", code)
    if is_path and not any((folder / code).exists() for folder in (ROOT, ROOT / "src" / "cavirheo")):
        yield f"path {code}"
    for dotted in re.findall(r"(?<![\w/.-])cavirheo(?:\.[A-Za-z_]\w*)+", code):
        try:
            pkgutil.resolve_name(dotted)
        except (ImportError, AttributeError):
            yield f"name {dotted}"


def problems(text: str) -> list[str]:
    """What a page says that does not exist; broken links end the build of the site (test_site.py)."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    lines = re.findall(r"^(?:cavirheo|make|pip|python) .*", "".join(blocks(text, "")), re.MULTILINE)
    found = [*map(broken_command, lines), *re.findall(r"^(?:<{7}|>{7}) .*", text, re.MULTILINE)]  # an unfinished merge
    found += [wrong for code in re.findall(r"`([^`\n]+)`", prose) for wrong in broken_code(code)]
    paths = re.findall(rf"(?<![\w/.-])(?:{FOLDERS})/[\w./-]*\w", text)
    return [wrong for wrong in (*found, *(path for path in paths if not (ROOT / path).exists())) if wrong]


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_what_a_page_names_exists(page):
    assert problems(page.read_text("utf-8")) == []


def test_the_page_of_commands_has_every_verb():
    text = (ROOT / "docs" / "which-command.md").read_text("utf-8")
    assert [verb for verb in OPTIONS if not re.search(rf"[`/ ]{verb}[`,]", text)] == []


SNIPPET = re.compile(r"^```python\n(.*?)^```(?:\n```text\n(.*?)^```)?", re.DOTALL | re.MULTILINE)  # with its output
NUMBER = re.compile(r"\d+(?:\.\d+)?")
ANSWERS: dict[str, Any] = {}  # several pages ask the same of the same file
INFERRED = pkgutil.resolve_name(ANSWER)


def answer_once(analysis, curve, **options):
    key = analysis.key(curve)
    if key not in ANSWERS:
        ANSWERS[key] = INFERRED(analysis, curve, **options)
    return ANSWERS[key]


def first_shot(*words, **options):
    return read_curves(*words, **options)[:1]


def snippets() -> Iterator[Any]:
    """But for one that needs a running app (tests/app/test_app.py)."""
    for page in PAGES:
        for code, shown in SNIPPET.findall(page.read_text("utf-8")):
            if "Client(" not in code:
                yield pytest.param(code, shown, id=name(page))


@pytest.mark.parametrize(("code", "shown"), [*snippets()])
def test_snippets_run(code, shown, monkeypatch):
    monkeypatch.setattr(ANSWER, answer_once)
    if not shown:
        monkeypatch.setattr(cavirheo, "read_curves", first_shot)
    monkeypatch.chdir(ROOT)
    with contextlib.redirect_stdout(io.StringIO()) as said:
        exec(compile(code, "snippet", "exec", dont_inherit=True), {})
    if shown:  # the page shows what it printed
        assert NUMBER.sub("0", said.getvalue()) == NUMBER.sub("0", shown)
        numbers = [[float(one) for one in NUMBER.findall(text)] for text in (said.getvalue(), shown)]
        assert numbers[0] == pytest.approx(numbers[1], rel=0.03)


EXAMPLES = {  # script: what it prints; the slow ones below
    "simulate_any_law": r"zener.* ok",
    "your_own_arrays": r"G [78]\d{3} Pa \(true 8000\)",
}
LONG = {
    "infer_a_file": r"soft_gel\[1\]: R_max 267 um, G 6[0-6]\d\d Pa, mu 0\.0(29|3[0-2])",
    "fit_a_window": r"(?s)2 collapses:.*G: 3\.\d+e\+04 Pa.*3 collapses:.*G: 3\.\d+e\+04 Pa",
    "measure_a_video": r"R_max 250\.\d um.* 7\d frames ok.*G (9[89]|10[01])\d\d Pa \(true 10000\)",
    "group_to_table": r"stiff_gel: 5 shots, ok\nG (29|30|31)\d\d\d \[",
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
