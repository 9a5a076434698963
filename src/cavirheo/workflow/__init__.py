"""Answers of many curves: where they are kept, and who computes them."""
