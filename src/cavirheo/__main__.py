"""The command line as a program: the command `cavirheo`, and `python -m cavirheo`."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress

_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


def entry() -> None:
    """Run the command line, and exit at once by os._exit: a normal exit takes a third of a second for the compiled
    libraries, and waits for threads that still compute."""
    loaded = stopped = ended = False

    def handle(number: int, frame: object) -> None:
        """The first signal ends the work, and finished answers are written; the second ends the process."""
        nonlocal stopped
        if stopped or ended or not loaded:
            with suppress(OSError):
                show_cursor = "\033[?25h" if os.isatty(2) else ""  # a progress bar hides it
                os.write(2, (show_cursor + ("" if ended else "interrupted\n")).encode())
            os._exit(130)
        stopped = True
        raise KeyboardInterrupt

    for number in _SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handle)
    _open_streams()
    os.environ.setdefault("PYTHONSAFEPATH", "1")  # child processes import no modules from the current folder
    from cavirheo import parallel, verbs  # a third of a second, in which nothing can be lost
    from cavirheo.writing.terminal import say

    loaded = True
    status = 0
    try:
        verbs.main()
        sys.stdout.flush()
    except SystemExit as stop:
        status = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except BrokenPipeError:  # the reader of stdout has ended, as `head` does
        status = 1
    except BaseException as error:
        if stopped:  # an import or compiled code that is interrupted may raise any exception
            say("interrupted")
            status = 130
        elif isinstance(error, OSError):
            say(f"error: what was to be printed cannot be written: {error.strerror}")
            status = 2
        else:
            raise
    ended = True  # and the last line is said
    parallel.prepare_exit()
    with suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(status)


def _open_streams() -> None:
    """Open every closed standard stream, for child processes too, on os.devnull; outputs escape characters that their
    encoding lacks."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if not (stream := getattr(sys, name)):
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # os.open takes the lowest free number: this one
            setattr(sys, name, open(number, "w" if number else "r", closefd=False))  # noqa: SIM115  # until the end
        elif number:
            stream.reconfigure(errors="backslashreplace")


if __name__ == "__main__":
    entry()
