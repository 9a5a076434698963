"""What every law and every material is to the solver: its parts."""

from __future__ import annotations

from typing import Any


class Law:
    """A material without any stress; a law overrides the part that it is, a composite all parts that it has."""

    @property
    def name(self) -> str:
        return type(self).__name__

    @property
    def elastic(self) -> Any:
        """Elastic | None: the spring (physics/elastic.py)."""
        return None

    @property
    def viscous(self) -> Any:
        """Viscous | None: the dashpot (physics/viscous.py)."""
        return None

    @property
    def memory(self) -> tuple[Any, ...]:
        """Maxwell arms (physics/memory.py)."""
        return ()
