"""Which files of the repository are pages of the site: each at its own path, so that every link is right in both.

mkdocs takes pages from one folder; here they are README and its neighbours, docs/, the examples, and what
docs/site/reference.py makes of the code. Python-Markdown wants an empty line above a list or a table where
GitHub does not; it is put there. Equations are LaTeX in the files, which GitHub sets, and MathML in the site, which
browsers set without a script or a font from elsewhere.
"""

from __future__ import annotations

import ast
import hashlib
import html
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import documents
import reference
import tutorial
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
KEPT = (
    "*.md",
    "LICENSE",
    "CITATION.cff",
    "docs/*.md",
    "docs/*/*.md",
    "docs/*.png",
    "docs/*.svg",
    "docs/*/*.png",
    "docs/site/*.css",
    "docs/site/*.js",
    "validation/*.py",
    "validation/*.json",
    "validation/*/*.md",
    "validation/*/*.png",
    "examples/*.*",
    "examples/tutorials/*.py",
)
ORDER = ("gel", "notebook", "liquid", "own_law", "cluster", "app")
FENCE = re.compile(r"^(```.*?^```$)", re.DOTALL | re.MULTILINE)
START_OF_BLOCK = re.compile(r"(?<=\n)(?![-|#>\s]|\d+\. )([^\n]+\n)(?=- |\d+\. |\|)")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Headings have the anchors that they have as files."""
    config.mdx_configs["toc"]["slugify"] = slug
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """The pages and pictures of the repository instead of those of docs/ alone, beside what the theme brings."""
    theme = [file for file in files if file.src_dir != config.docs_dir]
    made = {**tutorials(), **reference.pages()}
    kept = {str(path.relative_to(ROOT)): path for pattern in KEPT for path in ROOT.glob(pattern)} | executed()
    return Files(
        [
            *theme,
            *(File.generated(config, name, abs_src_path=str(path)) for name, path in sorted(kept.items())),
            *(File.generated(config, name, content=text) for name, text in made.items()),
        ]
    )


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links to folders lead to their pages; lists and tables stand apart from the line above. The page of file formats
    ends with every field of every document."""
    if page.file.src_uri == "docs/file-formats.md":
        markdown += "".join(documents.formats())
    parts = FENCE.split(markdown)
    return "".join(text if text.startswith("```") else _prose(text, Path(page.file.src_uri).parent) for text in parts)


def on_page_content(content: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Equations that pymdownx.arithmatex marked become MathML, a display with its number."""

    def display(found: re.Match[str]) -> str:
        latex, _, number = html.unescape(found[1]).partition(r"\tag")
        return (
            f'<div class="equation">{convert(latex.strip(), display="block")}<span>{number.strip("{} ")}</span></div>'
        )

    content = re.sub(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', display, content, flags=re.DOTALL)
    inline = r'<span class="arithmatex">\\\((.*?)\\\)</span>'
    return re.sub(inline, lambda found: convert(html.unescape(found[1])), content, flags=re.DOTALL)


def _prose(text: str, folder: Path) -> str:
    def to(link: re.Match[str]) -> str:
        return f"]({link[1]}/index.md)" if (ROOT / folder / link[1]).is_dir() else link[0]

    return re.sub(r"\]\(([\w./-]+)\)", to, START_OF_BLOCK.sub(r"\1\n", text))


def slug(heading: str, separator: str) -> str:
    """What a link may name after #, as GitHub writes it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", separator)


def executed() -> dict[str, Path]:
    """Page, notebook and pictures of each tutorial, which was run; anew only if it or the package has changed.

    With CAVIRHEO_TUTORIALS=unrun they are there without output, for a look at the rest of the site within seconds.
    """
    scripts = sorted(ROOT.glob("examples/tutorials/*.py"))
    if os.environ.get("CAVIRHEO_TUTORIALS") == "unrun":
        folder = ROOT / "build" / "tutorials" / "unrun"
        for script in scripts:
            tutorial.write(list(tutorial.cells(script.read_text("utf-8"))), script.stem, folder)
        pages = [folder / f"{script.stem}{ending}" for script in scripts for ending in (".md", ".ipynb")]
        return {f"examples/tutorials/{path.name}": path for path in pages}
    source = b"".join(path.read_bytes() for path in sorted(ROOT.glob("src/cavirheo/**/*.py")))
    runner, found = Path(__file__).with_name("tutorial.py"), {}
    for script in scripts:
        digest = hashlib.sha256(source + runner.read_bytes() + script.read_bytes()).hexdigest()[:16]
        folder = ROOT / "build" / "tutorials" / f"{script.stem}-{digest}"
        if not (folder / f"{script.stem}.ipynb").exists():
            surroundings = os.environ | {"PYTHONPATH": str(ROOT / "src")}
            subprocess.run([sys.executable, runner, script, folder], check=True, env=surroundings, timeout=900)
        found |= {f"examples/tutorials/{path.name}": path for path in sorted(folder.iterdir())}
    return found


def tutorials() -> dict[str, str]:
    """A page for each short example, and one that lists these and the tutorials."""
    made = {f"examples/{path.stem}.md": "".join(_tutorial(path)) for path in sorted(ROOT.glob("examples/*.py"))}
    made.pop("examples/make_examples.md")  # it made the shots that the others read
    lines = [f"- [{text.splitlines()[0][2:]}]({Path(name).name})\n" for name, text in made.items()]
    taught = [
        f"- [{path.read_text('utf-8').splitlines()[1].removeprefix('# # ')}](tutorials/{stem}.md)\n"
        for stem in ORDER
        if (path := ROOT / "examples" / "tutorials" / f"{stem}.py")
    ]
    head = "# Tutorials\nEach shows what its code printed and drew when it was run, and is a notebook, too.\n\n"
    short = "\n## Short scripts\nThey run as they are, on shots that come with them.\n\n"
    return {"examples/index.md": head + "".join(taught) + short + "".join(lines), **made}


def _tutorial(path: Path) -> Iterator[str]:
    source = path.read_text("utf-8")
    said = ast.get_docstring(ast.parse(source)) or ""
    code = source.split('"""', 2)[2].lstrip()
    yield f"# {path.stem.replace('_', ' ').capitalize()}\n{said}\n\n"
    yield f"```python\n{code}```\n\nRun it: `python examples/{path.name}` ([the file]({path.name})).\n"
