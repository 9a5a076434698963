"""What programs rest on, frozen: public names, and the schema of every document.

python tests/meta/test_golden.py --write    makes the files in golden/ anew
"""

import inspect
import json
import re
import sys
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pytest

import cavirheo
from cavirheo.loading import KINDS

HERE = Path(__file__).resolve().parent / "golden"


def names() -> dict[str, Any]:
    """Every public name: its signature; of a class its members, too."""
    found: dict[str, Any] = {}
    for name in cavirheo.__all__:
        thing = getattr(cavirheo, name)
        found[name] = {"signature": _signature(thing)}
        if inspect.isclass(thing):
            members = [key for key in sorted(vars(thing)) if not key.startswith("_")]
            found[name]["members"] = {key: _signature(getattr(thing, key)) for key in members}
    return found


def _signature(thing: Any) -> str:
    try:
        return re.sub(r" at 0x[0-9a-f]+", "", str(inspect.signature(thing)))
    except (TypeError, ValueError):
        return type(thing).__name__


def schema() -> dict[str, Any]:
    """Of every document: the fields of each of its records, with their types."""
    found = {}
    for document in (resolve_name(kind) for kind, _ in KINDS.values()):
        whole = document.model_json_schema(by_alias=True)
        records = {document.__name__: whole, **whole.get("$defs", {})}
        found[document.__name__] = {
            record: {field: _kind(one) for field, one in sorted(content.get("properties", {}).items())}
            for record, content in sorted(records.items())
        }
    return found


def _kind(about: dict[str, Any]) -> str:
    """'number or null', 'array of Slope'."""
    if "anyOf" in about:
        return " or ".join(_kind(one) for one in about["anyOf"])
    if "$ref" in about:
        return str(about["$ref"]).rpartition("/")[2]
    inside = about.get("items") or about.get("additionalProperties")
    kind = str(about.get("type", about.get("const", "any")))
    return f"{kind} of {_kind(inside)}" if isinstance(inside, dict) and inside else kind


def kept(name: str) -> Any:
    return json.loads((HERE / f"{name}.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("make", [names, schema])
def test_what_programs_rest_on_is_as_it_was(make):
    assert make() == kept(make.__name__)


def main() -> None:
    made = {"names": names(), "schema": schema()}
    for name, content in made.items():
        text = json.dumps(content, ensure_ascii=False, indent=1)
        (HERE / f"{name}.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__" and "--write" in sys.argv:
    main()
