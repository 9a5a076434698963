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
    signals = [number for number in _SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
    stopped = False

    def handle(number: int, frame: object) -> None:
        """The first signal ends the work, and finished answers are written; the second ends the process."""
        nonlocal stopped
        stopped = True
        for each in signals:
            signal.signal(each, _exit_at_once)
        raise KeyboardInterrupt

    for number in signals:
        signal.signal(number, _interrupt_loading)
    _open_streams()
    os.environ.setdefault("PYTHONSAFEPATH", "1")  # child processes import no modules from the current folder
    from cavirheo import parallel, verbs  # a third of a second, in which nothing can be lost
    from cavirheo.writing.terminal import say

    for number in signals:
        signal.signal(number, handle)
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


def _interrupt_loading(number: int, frame: object) -> None:
    with suppress(OSError):
        os.write(2, b"interrupted\n")
    os._exit(130)


def _exit_at_once(number: int, frame: object) -> None:
    if sys.stderr.isatty():
        os.write(2, b"\033[?25h")  # show the cursor again, which a progress bar hides
    os._exit(130)


if __name__ == "__main__":
    entry()
