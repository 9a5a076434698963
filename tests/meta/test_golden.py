"""What programs and papers rest on, frozen: public names, the schema of every document, and a dozen answers.

The median of an answer may move by a quarter of its interval, the ends by 0.35 of it: a hundred effective draws tell
them no better, and processors that round in another way draw others. An interval of more than a factor of three counts
in logarithms. A value without an interval may move by 1 %. Of a parameter that may be exactly 0, its probability to be
0 counts alone, within 0.2: quantiles jump where it is near 5, 50 or 95 %.

    python tests/meta/test_golden.py --write    makes the files in golden/ anew
"""

import inspect
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pytest
from conftest import slow

import cavirheo
from cavirheo import Bubble, Medium, fit, infer, read_curves
from cavirheo.loading import KINDS
from cavirheo.parameters import BUBBLE, CAMERA

HERE = Path(__file__).resolve().parent / "golden"
ROOT = Path(__file__).resolve().parents[2]


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


def _of(verb: Callable[..., Any], name: str, number: int = 0, **how: Any) -> Callable[[], Any]:
    path = (HERE if name == "liquid.csv" else ROOT / "examples") / name
    return lambda: verb(read_curves(path)[number], **how)


ANSWERS: dict[str, Callable[[], Any]] = {
    "infer soft gel": _of(infer, "soft_gel.csv", 1),
    "infer soft gel, field's bubble": _of(infer, "soft_gel.csv", 1, bubble="field"),
    "fit liquid": _of(fit, "liquid.csv", material="newtonian", window=2, bubble="field"),
    "infer soft gel, other constants": _of(
        infer, "soft_gel.csv", 0, material="nhkv", medium=Medium(1050.0, 1550.0), stretch=8.5, window=2
    ),
    "infer soft gel, without walls": _of(infer, "soft_gel.csv", 2, material="nhkv", bubble=Bubble("kinetic")),
    "infer stiff gel": _of(infer, "stiff_gel.mat", 0),
    "infer stiff gel, paper's network": _of(infer, "stiff_gel.mat", 1, model="bdt-viscoelastic"),
    "infer liquid": _of(infer, "liquid.csv", material="newtonian"),
    "infer liquid, power law": _of(infer, "liquid.csv", material="power-law"),
    "fit soft gel": _of(fit, "soft_gel.csv", 1, bubble="field"),
}
NUISANCES = {*CAMERA, *BUBBLE} - {"stretch"}
LONG = "infer stiff gel", "infer liquid, power law"


def answer(name: str) -> dict[str, Any]:
    """Verdict, material, and of the stretch and each parameter of the material [5 %, 50 %, 95 %], its value alone, or
    {"zero": its probability}."""
    found = ANSWERS[name]()
    values: dict[str, Any] = {"verdict": found.checks.verdict, "material": found.material}
    for parameter in [name for name in found.parameters if name not in NUISANCES]:
        zero = float(found.weights @ (found.draws(parameter) == 0.0)) if len(found.theta) > 1 else 0.0
        if zero > 0.0:
            values[parameter] = {"zero": round(zero, 3)}
            continue
        middle, ends = found.median(parameter), found.interval(parameter)
        shown = [middle] if ends is None else [ends[0], middle, ends[1]]
        values[parameter] = [float(f"{value:.6g}") for value in shown]
    return values


def kept(name: str) -> Any:
    return json.loads((HERE / f"{name}.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("make", [names, schema])
def test_what_programs_rest_on_is_as_it_was(make):
    assert make() == kept(make.__name__)


@pytest.mark.parametrize("name", [slow(name) if name in LONG else name for name in ANSWERS])
def test_an_answer_is_as_it_was(name):
    old, new = kept("answers")[name], answer(name)
    assert new.keys() == old.keys()
    for parameter, values in old.items():
        if isinstance(values, str):
            assert new[parameter] == values
        elif isinstance(values, dict) or isinstance(new[parameter], dict):
            before, after = (one["zero"] if isinstance(one, dict) else 0.0 for one in (values, new[parameter]))
            assert abs(after - before) <= 0.2, (parameter, new[parameter], values)
        else:
            before, after = np.array(values), np.array(new[parameter])
            if before[-1] > 3.0 * before[0] > 0.0:
                before, after = np.log(before), np.log(after)
            width = before[-1] - before[0]
            rooms = width * np.array([0.35, 0.25, 0.35]) if width else 0.01 * abs(before)
            assert np.all(np.abs(after - before) <= rooms), (parameter, new[parameter], values)


def main() -> None:
    made = {"names": names(), "schema": schema(), "answers": {name: answer(name) for name in ANSWERS}}
    for name, content in made.items():
        text = json.dumps(content, ensure_ascii=False, indent=1)
        text = re.sub(r"\[\s+([^][{}]*?)\s+\]", lambda found: f"[{' '.join(found[1].split())}]", text)  # a line each
        (HERE / f"{name}.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__" and "--write" in sys.argv:
    main()
