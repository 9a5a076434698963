"""cavirheo: material properties of soft matter from the radius history of a laser-made bubble."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    __version__: str
    from cavirheo.companions.design import Rig as Rig
    from cavirheo.companions.design import design as design
    from cavirheo.curve import RadiusCurve as RadiusCurve
    from cavirheo.errors import InputError as InputError
    from cavirheo.errors import SolverError as SolverError
    from cavirheo.inference import fit as fit
    from cavirheo.inference import fit_many as fit_many
    from cavirheo.inference import infer as infer
    from cavirheo.inference import infer_many as infer_many
    from cavirheo.inference.population import CommonErrors as CommonErrors
    from cavirheo.inference.population import Population as Population
    from cavirheo.inference.population import population as population
    from cavirheo.inference.what_if import predict_radius as predict_radius
    from cavirheo.io import measure as measure
    from cavirheo.io import read_curves as read_curves
    from cavirheo.loading import load as load
    from cavirheo.physics.bubble import Bubble as Bubble
    from cavirheo.physics.materials import NeoHookeanKelvinVoigt as NeoHookeanKelvinVoigt
    from cavirheo.physics.materials import Newtonian as Newtonian
    from cavirheo.physics.materials import QuadraticKelvinVoigt as QuadraticKelvinVoigt
    from cavirheo.physics.media import Medium as Medium
    from cavirheo.physics.simulate import Simulation as Simulation
    from cavirheo.physics.simulate import simulate as simulate
    from cavirheo.physics.simulate import simulate_many as simulate_many
    from cavirheo.posterior import Posterior as Posterior
    from cavirheo.reporting.documents import table as table

_NAMES = {  # public names, by module
    "companions.design": "design Rig",
    "curve": "RadiusCurve",
    "errors": "InputError SolverError",
    "inference": "fit fit_many infer infer_many",
    "inference.population": "CommonErrors population Population",
    "inference.what_if": "predict_radius",
    "io": "measure read_curves",
    "loading": "load",
    "physics.bubble": "Bubble",
    "physics.materials": "NeoHookeanKelvinVoigt Newtonian QuadraticKelvinVoigt",
    "physics.media": "Medium",
    "physics.simulate": "simulate simulate_many Simulation",
    "posterior": "Posterior",
    "reporting.documents": "table",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that reading a file or --help does not import the solver."""
    if name == "__version__":
        from importlib.metadata import version

        return version("cavirheo")
    if name not in _HOME:
        raise AttributeError(f"module 'cavirheo' has no attribute {name!r}")
    return getattr(importlib.import_module(f"cavirheo.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    """The public names, imported or not, without the submodules that have been imported."""
    return sorted([*__all__, "__version__", *(name for name in globals() if name.startswith("__"))])
