"""Answers of many curves: where they are stored, and which machines compute them."""
