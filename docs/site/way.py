"""The picture of docs/architecture.md: which package takes which type, drawn from the imports (docs/way.svg).

    python docs/site/way.py

Packages and types are those of the two tables of the page, in their order. A lane begins at the package in which its
type is defined; a dot is a package that imports it.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "cavirheo"
PAGE, PICTURE = ROOT / "docs" / "architecture.md", ROOT / "docs" / "way.svg"
LEFT, TOP, ACROSS, DOWN = 130, 40, 84, 26  # margins, and distances of lanes and of rows, px
STYLE = "text{font:13px sans-serif;fill:#222}.lane{stroke:#8fb1cc;stroke-width:3}.row{stroke:#e4e4e4}"
STYLE += ".home{fill:#fff;stroke:#1f5f8b;stroke-width:3}.dot{fill:#1f5f8b}"


def types() -> dict[str, str]:
    """Name of each type that travels -> the module that defines it, below src/cavirheo."""
    return dict(re.findall(r"^\| `(\w+)` \| .* \| `([\w/]+\.py)` \|$", PAGE.read_text("utf-8"), re.MULTILINE))


def packages() -> list[str]:
    """In the order of the page: each imports only those before it. The command line imports all."""
    rows = re.findall(r"^\| ((?:`\w+/?` ?)+)\| ", PAGE.read_text("utf-8"), re.MULTILINE)
    return [name for row in rows for name in re.findall(r"\w+", row)]


def package(path: Path) -> str:
    """The package, or the module beside the packages, of a file."""
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


def takers() -> dict[str, set[str]]:
    """Type -> packages that import it."""
    taken: dict[str, set[str]] = {name: set() for name in types()}
    for path in SOURCE.rglob("*.py"):
        imports = [node for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.ImportFrom)]
        for name in {alias.name for node in imports for alias in node.names} & taken.keys():
            taken[name].add(package(path))
    return taken


def drawn() -> str:
    """The picture as SVG."""
    homes, taken = types(), takers()
    rows = [name for name in packages() if any(name in those for those in taken.values())]
    at = {name: TOP + DOWN * (k + 1) for k, name in enumerate(rows)}
    width, height = LEFT + ACROSS * len(homes), TOP + DOWN * (len(rows) + 1)
    parts = [f'<line class="row" x1="{LEFT}" x2="{width}" y1="{y}" y2="{y}"/>' for y in at.values()]
    parts += [f'<text x="{LEFT - 20}" y="{y + 4}" text-anchor="end">{name}</text>' for name, y in at.items()]
    for k, (name, module) in enumerate(homes.items()):
        x, home = LEFT + ACROSS * (k + 0.5), at[package(SOURCE / module)]
        ends = [at[one] for one in taken[name] if one in at]
        parts += [f'<text x="{x}" y="{TOP - 12}" text-anchor="middle">{name}</text>']
        parts += [f'<line class="lane" x1="{x}" x2="{x}" y1="{min(home, *ends)}" y2="{max(home, *ends)}"/>']
        parts += [f'<circle class="dot" cx="{x}" cy="{y}" r="5"/>' for y in sorted({*ends} - {home})]
        parts += [f'<circle class="home" cx="{x}" cy="{home}" r="6"/>']
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}"><style>{STYLE}</style>'
    )
    return "\n".join([head, f'<rect width="{width}" height="{height}" fill="#fff"/>', *parts, "</svg>\n"])


if __name__ == "__main__":
    PICTURE.write_text(drawn(), "utf-8")
