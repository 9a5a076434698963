"""The package's two own exceptions; their messages say what was given, what was expected, and how to mend it."""


class InputError(ValueError):
    """What the user gave cannot be used (a file, a curve, an option)."""


class SolverError(RuntimeError):
    """A simulation did not reach its end time; the message is the status of the solve."""
