"""Measure radius histories in recordings."""
