"""Verbs of the command line that are more than a call, and what all verbs share."""
