"""Oscillatory rheometry: strain and frequency sweeps -> linear range, plateau modulus and viscosity, beside bubbles.

| module | does |
|---|---|
| read | exports of rheometers (TRIOS, RheoCompass, rSpace, Excel, plain tables) -> sweeps in SI |
| sweeps | one sweep -> its properties |
| document | all sweeps of one material: rheometer.json, rheometer.csv; the common table with bubbles, table.csv |
| table | the terminal |
| picture | the sweeps with what was found in them (needs the [plot] extra) |
"""
