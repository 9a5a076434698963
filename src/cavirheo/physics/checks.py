"""The domains that parameters of a law can have; each function raises InputError naming what was given."""

from __future__ import annotations

from math import inf

from cavirheo.errors import InputError


def finite(**values: float) -> None:
    for name, value in values.items():
        if not -inf < value < inf:
            raise InputError(f"{name} must be finite, got {value!r}")


def not_negative(**values: float) -> None:
    for name, value in values.items():
        if not 0 <= value < inf:
            raise InputError(f"{name} must be finite and not negative, got {value!r}")


def positive(**values: float) -> None:
    for name, value in values.items():
        if not 0 < value < inf:
            raise InputError(f"{name} must be finite and positive, got {value!r}")
