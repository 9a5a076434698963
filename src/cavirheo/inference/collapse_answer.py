"""What collapse times say, as documents hold it."""

from __future__ import annotations

from pydantic import Field

from cavirheo.writing.document import Finite, Record


class CollapseValue(Record):
    """A parameter that collapse times give, SI.

    Attributes:
        value: the best.
        low: lower end of the 95 % interval by the scatter of the shots.
        high: its upper end.
        per_percent: change of the value if all t_1 were 1 % longer.
    """

    value: Finite = None
    low: Finite = None
    high: Finite = None
    per_percent: Finite = None


class CollapseEstimate(Record):
    """What n collapse times say, as it is written; null where a number was not found.

    An estimate that is not `identified` has the best fit if there is a single one, else null.

    Attributes:
        shear_modulus_Pa: G, Pa.
        viscosity_Pa_s: mu, Pa s.
        correlation: of the two.
        scatter: standard deviation of ln(t_1/t_model); null: not more shots than unknowns.
        identified: whether the shots give both values, or the one that is not known.
        at_bound: names of those at a bound of their range.
        downweighted: names of shots that count less than half.
        pairs: equally good (G in Pa, mu in Pa s), where not identified.
        message: what is wrong or to be known.
        measured: t_1/t_RC of each shot, not written here.
        model: t_1/t_RC of the model for each shot, not written here.
        weight: of each shot, at most 1, not written here.
    """

    shear_modulus_Pa: CollapseValue = CollapseValue()
    viscosity_Pa_s: CollapseValue = CollapseValue()
    correlation: Finite = None
    scatter: Finite = None
    identified: bool = False
    at_bound: list[str] = []
    downweighted: list[str] = []
    pairs: list[tuple[float, float]] = []
    message: str = ""
    measured: list[Finite] = Field(default=[], exclude=True)
    model: list[Finite] = Field(default=[], exclude=True)
    weight: list[float] = Field(default=[], exclude=True)

    @property
    def complete(self) -> bool:
        """Whether there is a number for both."""
        return self.shear_modulus_Pa.value is not None and self.viscosity_Pa_s.value is not None

    @property
    def start(self) -> tuple[float, float] | None:
        """(G, mu) for a fit of R(t) to begin with: the estimate, or the middle of the pairs, if any."""
        G, mu = self.shear_modulus_Pa.value, self.viscosity_Pa_s.value
        middle = self.pairs[len(self.pairs) // 2] if self.pairs else None
        return middle if G is None or mu is None else (G, mu)
