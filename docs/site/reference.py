"""The reference, made from the code when the site is built: public names, verbs with their options, documents."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import documents
import names
import typer
from markup import escaped, table

import cavirheo
from cavirheo.parameters import PARAMETERS
from cavirheo.reporting.record import Result
from cavirheo.verbs import app

MODELS = Path(cavirheo.__file__).parent / "models"


def pages() -> dict[str, str]:
    """Path -> content of every page and file made here."""
    return {
        **{f"reference/{name}.md": "".join(python(page)) for name, page in names.PAGES.items()},
        "reference/commands.md": "".join(commands()),
        "reference/result.md": "".join(documents.result()),
        "reference/result.schema.json": json.dumps(documents.schema(Result), indent=1),
        "src/cavirheo/models/index.md": "".join(models()),
    }


def python(page: names.Page) -> Iterator[str]:
    """Public names in groups, by mkdocstrings; those that `import cavirheo` does not give stand with their room."""
    yield f"# {page.title}\n{page.said} Values are SI.\n\n"
    for group in page.groups:
        yield f"## {group.title}\n{group.said}\n\n"
        for name in group.whole:
            room, _, last = name.rpartition(".")
            options = {
                "heading_level": 3,
                "toc_label": last,
                "show_root_full_path": room != "cavirheo",
                "show_attribute_values": last not in ("LAWS", "PARAMETERS"),
            }
            yield f"::: {name}\n    options: {json.dumps(options)}\n\n"
            if last == "PARAMETERS":
                yield from parameters()


def parameters() -> Iterator[str]:
    """The parameters of all laws and shots."""
    rows = (
        (
            f"`{name}`",
            escaped(one.symbol),
            escaped(one.unit),
            "" if one.search_range is None else span(*one.search_range),
        )
        for name, one in PARAMETERS.items()
    )
    yield table(("name", "symbol", "unit", "searched by a fit, prior of a posterior"), rows)


def span(low: float, high: float) -> str:
    """From two log10."""
    return f"{10**low:.3g} to {10**high:.3g}"


def commands() -> Iterator[str]:
    """Every verb with its arguments and options, as `--help` has them."""
    whole: Any = typer.main.get_command(app)  # type: ignore[attr-defined]
    yield "# Command line\n`cavirheo COMMAND --help` says the same. "
    yield "[Exit statuses](../docs/how-to/command-line.md#exit-status).\n\n"
    for name, verb in whole.commands.items():
        context = verb.make_context(name, [], resilient_parsing=True)
        usage = " ".join(verb.collect_usage_pieces(context))
        yield f"## {name}\n{escaped(verb.help)}\n\n```\ncavirheo {name} {usage}\n```\n\n"
        for title, rows in verb.panels(context).items():
            yield f"\n**{title}**\n\n"
            yield table(("name", "meaning"), ((f"`{what}`", escaped(means)) for what, means in rows))


def models() -> Iterator[str]:
    """The networks that come with the package, each with its card."""
    yield "# Shipped networks\nEach network is a file of arrays; its card says what it was trained on and how.\n\n"
    for card in sorted(MODELS.glob("*.json")):
        yield f"## {card.stem}\n```json\n{card.read_text('utf-8').strip()}\n```\n\n"
