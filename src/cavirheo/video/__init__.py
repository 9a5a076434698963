"""Measure radius histories in recordings, and render recordings with a known history (`synthetic`)."""
