"""Oscillatory rheometry: sweeps -> linear range, plateau modulus and viscosity, beside bubbles."""

from cavirheo.companions.rheometer.read import read_sweeps
from cavirheo.companions.rheometer.sweeps import frequency_sweep, strain_sweep

__all__ = ["frequency_sweep", "read_sweeps", "strain_sweep"]
