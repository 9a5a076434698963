"""Parameters -> Simulation."""
