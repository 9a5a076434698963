"""The documents, from the classes that write them: every field with its type and what it means.

The meaning of a field stands once: below the field, or under `Attributes:` in the docstring of its class.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Collection, Iterator
from inspect import cleandoc, getsource
from itertools import pairwise
from pkgutil import resolve_name
from typing import Any

from markup import prose, table
from pydantic import BaseModel

from cavirheo import loading, posterior
from cavirheo.inference.network_files import EmulatorCard, ModelCard
from cavirheo.physics import bubble, media
from cavirheo.reporting.record import Result
from cavirheo.writing.document import Document

Schema = dict[str, Any]
CARDS = (ModelCard, EmulatorCard)
RESULT = "../reference/result.md"  # the page of `result`, from that of `formats`

MISSING = "A key that is not always there may be missing in a document of an older version, or where it is empty."


def result() -> Iterator[str]:
    """The fields of result.json and of everything in it."""
    yield "# result.json\nSchema 1, from the objects that write it; as [JSON Schema](result.schema.json).\n"
    yield f"Numbers are SI, and finite or null. Keys may be added, none is renamed. {MISSING}\n\n"
    for name, one in records(Result).items():
        yield f"## {name}\n"
        yield from section(one)


def formats() -> Iterator[str]:
    """The fields of all other documents and of cards; a record that result.json has, too, is described there."""
    known, head = {*records(Result)} - {"Result"}, {*records(Document)["Document"]["properties"]}
    yield "\n## Fields\nFrom the objects that write the documents, which all begin with the head.\n"
    yield f"Those of `result.json` have [their own page]({RESULT}). {MISSING}\n\n### Head\n"
    yield from section(records(Document)["Document"])
    for kind in (*others(), *CARDS):
        for name, one in records(kind).items():
            if name not in known:
                yield f"{'###' if name == kind.__name__ else '####'} {name.strip('_')}\n"
                yield from section(one, head if kind not in CARDS else (), known)


def others() -> list[type[Document]]:
    """The documents that `cavirheo.load` gives, but for result.json."""
    kinds = [resolve_name(kind) for kind, _ in loading.KINDS.values()]
    return [kind for kind in kinds if kind is not Result]


def records(kind: type[BaseModel]) -> dict[str, Schema]:
    """The schema of a document and of every record in it, by name, each after that which it is named in first."""
    whole = schema(kind)
    found, new = {kind.__name__: whole}, [kind.__name__]
    while new:
        named = re.findall(r'"#/\$defs/(\w+)"', json.dumps(found[new.pop(0)]["properties"]))
        later = {name: whole["$defs"][name] for name in named if name not in found}
        found, new = found | later, [*new, *later]
    return found


def schema(kind: type[BaseModel]) -> Schema:
    """JSON Schema of a document, each field with its meaning as `description`; without what is not written."""
    whole = kind.model_json_schema()
    modules = (posterior, bubble, media)
    known = (*below(BaseModel), *(thing for module in modules for thing in vars(module).values()))
    classes = {one.__name__: one for one in known if isinstance(one, type)}
    for name, one in {kind.__name__: whole, **whole.get("$defs", {})}.items():
        one["description"], said = meanings(classes[name])
        if name == "CurveRecord":  # its other fields are those of an answer
            said = meanings(posterior.Posterior)[1] | meanings(posterior.Checks)[1] | said
        fields = getattr(classes[name], "model_fields", {})
        keys = {str(about.validation_alias or field): field for field, about in fields.items()}
        hidden = {key for key, field in keys.items() if fields[field].exclude}
        one["properties"] = {key: about for key, about in one["properties"].items() if key not in hidden}
        for key, about in one["properties"].items():
            about["description"] = said.get(keys.get(key, key), "")
    return whole


def below(kind: type) -> Iterator[type]:
    """All classes made from one."""
    for one in kind.__subclasses__():
        yield from (one, *below(one))


def meanings(kind: type) -> tuple[str, dict[str, str]]:
    """(what the docstring of a class says besides, what it and those of its bases say of each field)."""
    fields: dict[str, str] = {}
    said = ""
    for base in reversed(kind.__mro__):
        if base.__module__.startswith("cavirheo."):
            said, found = attributes(vars(base).get("__doc__") or "")
            fields |= found | below_fields(base)
    return said, fields


def below_fields(kind: type) -> dict[str, str]:
    """The text below each field of a class."""
    (whole,) = ast.parse(getsource(kind)).body
    found: dict[str, str] = {}
    for field, text in pairwise(getattr(whole, "body", ())):
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
            found[ast.unparse(field.target)] = " ".join(str(ast.literal_eval(text.value)).split())
    return found


def attributes(docstring: str) -> tuple[str, dict[str, str]]:
    """(the rest, what stands under `Attributes:` by name) of a docstring."""
    text = cleandoc(docstring)
    block = re.search(r"^Attributes:\n((?: +[^\n]*(?:\n|$)|\n(?= ))*)", text, re.MULTILINE)
    if block is None:
        return text, {}
    found = re.findall(r"^    (\w+): (.*(?:\n     +.*)*)", block[1], re.MULTILINE)
    rest = f"{text[: block.start()].strip()}\n\n{text[block.end() :].strip()}".strip()
    return rest, {name: " ".join(told.split()) for name, told in found}


def section(one: Schema, without: Collection[str] = (), elsewhere: Collection[str] = ()) -> Iterator[str]:
    """A record: what it is, and its fields; records `elsewhere` are on the page of result.json."""
    yield f"{prose(one['description'])}\n\n"
    needed = one.get("required", [])
    rows = (
        (f"`{field}`", type_of(about, elsewhere), prose(about["description"]), "yes" if field in needed else "")
        for field, about in one["properties"].items()
        if field not in without
    )
    yield table(("field", "type", "meaning", "always there"), rows)


def type_of(about: Schema, elsewhere: Collection[str] = ()) -> str:
    """The type of a field in words, with links to the records that it holds."""

    def inner(one: Schema) -> str:
        return type_of(one, elsewhere)

    if "$ref" in about:
        name = about["$ref"].rpartition("/")[2]
        return f"[{name.strip('_')}]({RESULT if name in elsewhere else ''}#{name.strip('_').lower()})"
    if "anyOf" in about:
        return " or ".join(map(inner, about["anyOf"]))
    if "enum" in about or "const" in about:
        return ", ".join(f"`{json.dumps(value)}`" for value in about.get("enum", [about.get("const")]))
    if about.get("type") == "array":
        if "prefixItems" in about:
            return f"list of ({', '.join(map(inner, about['prefixItems']))})"
        return f"list of {inner(about.get('items', {}))}"
    if isinstance(values := about.get("additionalProperties"), dict):
        return f"object of {inner(values)} by name"
    return about.get("type", "any")
