"""Oscillatory rheometry: strain and frequency sweeps -> linear range, plateau modulus and viscosity, beside bubbles.

| module | does |
|---|---|
| read | exports of rheometers (TRIOS, RheoCompass, rSpace, Excel, plain tables) -> sweeps in SI |
| sweeps | one sweep -> its properties |
| document | all sweeps of one material, and the common table with bubbles: JSON, CSV, the terminal |
| picture | the sweeps with what was found in them (needs the [plot] extra) |
"""
