"""`python -m pliant` is the command `pliant`."""

import os
import signal
import sys

from . import main


def die_with(parent: int) -> None:
    """Ends this process where the one that started it dies, so that a lost worker leaves no work behind."""
    if sys.platform.startswith("linux"):
        import ctypes

        # PR_SET_PDEATHSIG
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    if os.getppid() != parent:
        sys.exit(1)


# Python's own handler would wait for the end of the command. Commands that close their files have handlers of their own.
signal.signal(signal.SIGINT, signal.SIG_DFL)
if os.environ.get("PLIANT_PARENT"):
    die_with(int(os.environ.pop("PLIANT_PARENT")))
sys.exit(main())
