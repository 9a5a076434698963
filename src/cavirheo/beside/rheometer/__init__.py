"""Oscillatory rheometry: strain and frequency sweeps -> linear range, plateau modulus and viscosity, beside bubbles.

| module | does |
|---|---|
| read | exports of rheometers (TRIOS, RheoCompass, rSpace, Excel, plain tables) -> sweeps in SI |
| sweeps | one sweep -> its properties |
| document | all sweeps of one material, and the common table with bubbles: JSON, CSV, the terminal |
| picture | the sweeps with what was found in them (needs the [plot] extra) |
"""

from cavirheo.beside.rheometer.read import Sweep, read_sweeps
from cavirheo.beside.rheometer.sweeps import frequency_sweep, strain_sweep

__all__ = ["Sweep", "frequency_sweep", "read_sweeps", "strain_sweep"]
