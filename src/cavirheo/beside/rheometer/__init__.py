"""Oscillatory rheometry: strain and frequency sweeps -> linear range, plateau modulus and viscosity, beside bubbles."""
