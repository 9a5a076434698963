"""The result of `evaluate` as Markdown, which is also what the command line prints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cavirheo.parameters import LOG10, about, natural_name

HEADINGS: dict[str, tuple[str, Callable[[float], str]]] = {
    "r2": ("R²", "{:.4f}".format),
    "r2_natural": ("R² of the natural value", "{:.4f}".format),
    "median_absolute_error": ("median error", "{:.3f}".format),
    "p90_absolute_error": ("90 % below", "{:.3f}".format),
    "rmse": ("RMSE", "{:.3f}".format),
    "bias": ("bias", "{:+.3f}".format),
    "median_relative_error": ("median relative error", "{:.1%}".format),
}


def markdown(result: Mapping[str, Any]) -> str:
    """Tables of an `evaluate` result: metrics, where the squared error sits, and robustness where it was asked for."""
    which = "the test part of its own training set" if result["part"] == "test" else "a set it was not trained on"
    text = [f"# {result['model']} on {result['curves']} curves, {which}", ""]
    text += ["Errors of log10 quantities are in decades.", ""]
    text += _metrics([(label(name), result["metrics"][name]) for name in result["outputs"]], "output")
    for name in result["outputs"]:
        text += ["", f"## Where the error of {label(name)} sits", ""]
        text += _table(
            ["true value of", "from", "to", "curves", "bias", "RMSE", "part of all squared error"],
            [
                [
                    *(label(parameter), f"{row['low']:g}", f"{row['high']:g}", str(row["curves"])),
                    *(_number(row["bias"], "{:+.3f}".format), _number(row["rmse"], "{:.3f}".format)),
                    f"{row['share']:.0%}",
                ]
                for parameter, rows in result["breakdown"][name]["by_parameter"].items()
                for row in rows
            ],
        )
    if robust := result["robustness"]:
        ways = {
            "network": f"network alone, {robust['curves']} curves",
            "network_same_curves": f"network alone, {robust['answers']} of them",
            "answer": f"answer of `cavirheo infer`, the same {robust['answers']}",
            "answer_ok": "of these, answers with the verdict ok",
        }
        for name in result["outputs"]:
            for way, title in ways.items():
                text += ["", f"## {label(name)} from worse recordings: {title}", ""]
                rows = [(row["recording"]["name"], (row[way]["metrics"] or {}).get(name)) for row in robust["rows"]]
                counts = ["answered", *(f"{row[way]['curves'] - row[way]['failed']}" for row in robust["rows"])]
                text += _metrics(rows, "recording", counts)
        text += ["", "## Verdicts on the answers", ""]
        kinds = sorted({kind for row in robust["rows"] for kind in row["answer"]["verdicts"]})
        text += _table(
            ["recording", *kinds],
            [
                [row["recording"]["name"], *(str(row["answer"]["verdicts"].get(kind, 0)) for kind in kinds)]
                for row in robust["rows"]
            ],
        )
    return "\n".join(text) + "\n"


def label(name: str) -> str:
    """A name in the prior's scale for people: log10_viscosity -> log10 viscosity (Pa s)."""
    words = natural_name(name).replace("_", " ")
    dimension = "" if about(name).unit == "1" else f" ({about(name).unit})"
    return f"{'log10 ' if name.startswith(LOG10) else ''}{words}{dimension}"


def _metrics(rows: Sequence[tuple[str, Mapping[str, float] | None]], first: str, last: Sequence[str] = ()) -> list[str]:
    """Lines of a table with a row of metrics for each name; `last` is one more column with its heading."""
    cells = [
        [name, *(_number(values[key] if values else None, form) for key, (_, form) in HEADINGS.items())]
        for name, values in rows
    ]
    head = [first, *(heading for heading, _ in HEADINGS.values())]
    if last:
        cells = [[*row, cell] for row, cell in zip(cells, last[1:], strict=True)]
        head.append(last[0])
    return _table(head, cells)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table whose columns also stand under each other in a terminal."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]

    def line(cells: Sequence[str]) -> str:
        padded = [cells[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(cells[1:], widths[1:], strict=True))]
        return "| " + " | ".join(padded) + " |"

    rule = "|" + "|".join(["-" * (widths[0] + 2), *("-" * (w + 1) + ":" for w in widths[1:])]) + "|"
    return [line(head), rule, *map(line, rows)]


def _number(value: float | None, form: Callable[[float], str]) -> str:
    return "-" if value is None else form(value)
