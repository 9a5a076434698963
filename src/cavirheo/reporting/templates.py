"""The templates of the report and of the app, by jinja2, which escapes all text from files and command lines."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from cavirheo.reporting import advice
from cavirheo.writing import digits

if TYPE_CHECKING:
    from jinja2 import Template


@cache
def template(name: str, package: str = "cavirheo.reporting") -> Template:
    """The template of this file name in the folder of a package."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader(package, ""),
        autoescape=not name.endswith(".txt"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        finalize=digits.printable,
    )
    environment.globals.update(advice=advice, digits=digits)
    return environment.get_template(name)
