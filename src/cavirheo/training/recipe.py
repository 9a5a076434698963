"""Recipe: one TOML file that says how a shipped model is made, from the problem to the name of the export.

Its sections are the fields of `Recipe`. [prior] holds one [low, high] for each parameter of the material and for the
stretch; `medium` is a name, or a table whose values replace those of the `name` in it; [network] may be left out.
"""

from __future__ import annotations

import tomllib
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt, PositiveFloat, PositiveInt, ValidationError

from cavirheo.errors import InputError, require
from cavirheo.physics.media import medium
from cavirheo.prior import Prior
from cavirheo.problem import FrameGrid, TrainingProblem


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ProblemTable(_Section):
    material: str
    medium: str | dict[str, float | str] = "water"
    reference_max_radius_um: PositiveFloat = 245.0
    frame_interval_us: PositiveFloat = 1.0
    frames: PositiveInt = 100


class DataTable(_Section):
    n: PositiveInt
    seed: NonNegativeInt = 0


class NetworkTable(_Section):
    """Sizes of the Bubble Dynamics Transformer; two choices that its description leaves open are marked."""

    outputs: tuple[str, ...] = ()  # names in the prior's scale; empty: all parameters but the stretch
    position: PositiveInt = 64  # learned embedding of the sample's place in the curve
    width: PositiveInt = 64
    heads: PositiveInt = 8
    head_width: PositiveInt = 8  # open: 64 over 8 heads; 64 per head is the other reading
    feed_forward: PositiveInt = 128
    activation: Literal["relu", "softplus", "gelu"] = "relu"  # open: of the feed-forward layers
    layers: PositiveInt = 2
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.1
    norm_epsilon: PositiveFloat = 1e-6


class TrainingTable(_Section):
    epochs: PositiveInt = 100
    batch: PositiveInt = 32
    lr: PositiveFloat = 1e-3  # Adam
    seed: NonNegativeInt = 0
    schedule: Literal["constant", "cosine"] = "constant"  # of the learning rate; cosine falls to 0 at the end
    warmup_steps: NonNegativeInt = 0
    dropout_epochs: PositiveInt | None = None  # without dropout afterwards; None leaves answers 3 to 7 % off scale


class ExportTable(_Section):
    name: str = Field(pattern=r"^[a-z0-9][a-z0-9.-]*$")


class Recipe(_Section):
    problem_table: ProblemTable = Field(alias="problem")
    prior: dict[str, tuple[float, float]]
    data: DataTable
    network: NetworkTable = NetworkTable()
    training: TrainingTable = TrainingTable()
    export: ExportTable

    @cached_property
    def problem(self) -> TrainingProblem:
        """Raises InputError where the physics does not accept the values."""
        table = self.problem_table
        changed = {"name": table.medium} if isinstance(table.medium, str) else table.medium
        constants: dict[str, Any] = {"name": "water"} | changed
        try:
            liquid = medium(**constants)
        except TypeError as error:
            raise InputError(f"[problem] medium: {error}", "recipe.medium") from error
        grid = FrameGrid(table.frame_interval_us / 1e6, table.frames)
        prior, reference = Prior.uniform(self.prior), table.reference_max_radius_um / 1e6
        return TrainingProblem(table.material, prior, liquid, grid, reference)

    @property
    def outputs(self) -> tuple[str, ...]:
        """What the network answers, in the order of its outputs. Raises InputError: one without a prior."""
        unknown = ", ".join(name for name in self.network.outputs if name not in self.prior)
        message = f"[network] outputs: {unknown} has no prior; it has {', '.join(self.prior)}"
        require(not unknown, message, "recipe.outputs")
        return self.network.outputs or tuple(name for name in self.prior if name != "stretch")

    def settings(self) -> dict[str, Any]:
        """All that decides the trained weights apart from the data: plain data for JSON."""
        return {
            "problem": self.problem.to_dict(),
            "outputs": list(self.outputs),
            "network": self.network.model_dump(mode="json", exclude={"outputs"}),
            "training": self.training.model_dump(mode="json", exclude_none=True),
        }


def read_recipe(path: str | Path) -> Recipe:
    """The recipe in a TOML file.

    Raises:
        InputError: not readable, not TOML, an unknown key, or a value missing or refused; all are named.
    """
    try:
        recipe = Recipe.model_validate(tomllib.loads(Path(path).read_text(encoding="utf-8")))
        _ = recipe.problem, recipe.outputs
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path} is not valid TOML: {error}", "recipe.syntax") from error
    except ValidationError as error:
        raise InputError(f"{path} cannot be used:\n{_explained(error)}", "recipe.value") from error
    except InputError as error:
        raise error.within(f"{path} cannot be used") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read the recipe {path}: {error}", "recipe.missing") from error
    return recipe


def _explained(error: ValidationError) -> str:
    """One line for each refused entry: where, what was given, what was expected."""
    lines = []
    for item in error.errors():
        said = {"extra_forbidden": "unknown key", "missing": item["msg"]}
        where, what = ".".join(map(str, item["loc"])), f"{item['msg']}, got {item['input']!r}"
        lines.append(f"  {where}: {said.get(item['type'], what)}")
    return "\n".join(lines)
