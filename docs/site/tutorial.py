"""A script in cells, run: its page with what it printed and drew, and the same as a notebook.

    python docs/site/tutorial.py examples/tutorials/liquid.py build/liquid

A cell begins with `# %%` (code) or `# %% [markdown]` (text, commented); a line `run("COMMAND", shell=True, check=True)`
(of subprocess, so that the script runs as it is) is of the shell, as in a notebook `!COMMAND`. Nothing that a page
shows as output was written by hand.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

SHELL = re.compile(r'^run\("(.*)", shell=True, check=True\)$', re.MULTILINE)
IMPORT = "from subprocess import run\n"  # is for these lines alone
WIDTH = "100"  # columns of a table in the terminal, and of a page


class Cell(NamedTuple):
    """`kind`: "markdown" or "code"; `output` and `pictures` (PNG) are there once it has run."""

    kind: str
    text: str
    output: str = ""
    pictures: tuple[bytes, ...] = ()


def cells(script: str) -> Iterator[Cell]:
    """Of a script in the percent format; what stands above the first mark is left out."""
    parts = re.split(r"^# %%(?: \[(markdown)\])?[^\n]*\n", script, flags=re.MULTILINE)
    for kind, text in zip(parts[1::2], parts[2::2], strict=True):
        if kind:
            yield Cell(kind, re.sub(r"^# ?", "", text, flags=re.MULTILINE).strip())
        else:
            yield Cell("code", text.replace(IMPORT, "").strip())


def run(cell: Cell, names: dict[str, Any]) -> Cell:
    """The cell with what it printed, the value of its last expression, and the figure if that is one. Raises whatever
    its code raises, and RuntimeError for a command that fails."""
    if cell.kind != "code":
        return cell
    if SHELL.match(cell.text):
        return cell._replace(output="".join(map(_shell, SHELL.findall(cell.text))))
    body = ast.parse(cell.text).body
    last = body.pop() if isinstance(body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(io.StringIO()) as said:
        exec(compile(ast.Module(body, []), "cell", "exec"), names)
        value = eval(compile(ast.Expression(last.value), "cell", "eval"), names) if last else None
    if hasattr(value, "savefig"):
        value.savefig(file := io.BytesIO(), format="png", dpi=max(110, value.dpi))
        return cell._replace(output=said.getvalue(), pictures=(file.getvalue(),))
    return cell._replace(output=said.getvalue() + ("" if value is None else f"{value!r}\n"))


def _shell(command: str) -> str:
    how: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    done = subprocess.run(command, shell=True, **how)
    if done.returncode:
        raise RuntimeError(f"{command}: exit status {done.returncode}\n{done.stdout}")
    return "\n".join(line.rstrip() for line in str(done.stdout).splitlines()) + "\n"


def page(found: list[Cell], stem: str) -> str:
    """Markdown; pictures are beside it as STEM-1.png, ..."""
    made, count = [], 0
    for cell in found:
        if cell.kind == "markdown":
            made.append(cell.text)
            continue
        shell, code = SHELL.match(cell.text), SHELL.sub(r"\1", cell.text)
        made.append(f"```{'' if shell else 'python'}\n{code}\n```")
        if cell.output:
            made.append(f"```text\n{cell.output.rstrip()}\n```")
        for _ in cell.pictures:
            count += 1
            made.append(f"![What the cell above draws]({stem}-{count}.png)")
    links = f"[The script]({stem}.py), [the notebook]({stem}.ipynb). What follows a block of code is its output."
    title, mark, rest = made[0].partition("\n\n")
    made[:1] = [title, links, rest] if mark else [title, links]
    return "\n\n".join(made) + "\n"


def notebook(found: list[Cell]) -> str:
    """nbformat 4.5, with the outputs."""
    made = []
    for number, cell in enumerate(found):
        text = SHELL.sub(r"!\1", cell.text)
        one: dict[str, Any] = {"id": f"cell-{number}", "cell_type": cell.kind, "metadata": {}, "source": text}
        if cell.kind == "code":
            shown = [{"image/png": base64.b64encode(content).decode()} for content in cell.pictures]
            said = [{"output_type": "stream", "name": "stdout", "text": cell.output}] if cell.output else []
            drawn = [{"output_type": "display_data", "data": data, "metadata": {}} for data in shown]
            one |= {"execution_count": None, "outputs": [*said, *drawn]}
        made.append(one)
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    whole = {"cells": made, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(whole, indent=1, ensure_ascii=False) + "\n"


def write(found: list[Cell], stem: str, folder: Path) -> None:
    """Page, notebook and pictures of these cells; of cells that were not run, without what they would show."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{stem}.md").write_text(page(found, stem), "utf-8")
    (folder / f"{stem}.ipynb").write_text(notebook(found), "utf-8")
    for number, content in enumerate((content for cell in found for content in cell.pictures), 1):
        (folder / f"{stem}-{number}.png").write_bytes(content)


def main(script: Path, folder: Path) -> None:
    """Run the cells in an empty folder, and write page, notebook and pictures."""
    parts = list(cells(script.read_text("utf-8")))
    names: dict[str, Any] = {"__name__": "__main__"}
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    os.environ |= {"PATH": path, "COLUMNS": WIDTH, "MPLBACKEND": "Agg"}
    with tempfile.TemporaryDirectory() as empty, contextlib.chdir(empty):
        found = [run(cell, names) for cell in parts]
    write(found, script.stem, folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute(), Path(sys.argv[2]).absolute())
