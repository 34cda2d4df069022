"""Verified, fast deformation of soft tissue.

Two ways lead to results. `load` makes a simulation that steps frame by frame, with positions as arrays.
`run`, `study`, `moment_arms`, `fibres`, `morph`, `implant`, `springs`, `check` and `accuracy` run the
commands of the same names and return their results; numbers are those of the commands to the bit.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from ._pliant import (
    DIGEST,
    Dual,
    PliantError,
    __version__,
    check_constraint,
    mesh_health,
    minimise,
    project,
    read_mesh,
)

if TYPE_CHECKING:
    from ._commands import (
        Result,
        accuracy,
        check,
        command,
        fibres,
        implant,
        moment_arms,
        morph,
        run,
        springs,
    )
    from ._frames import Frame, Simulation, load
    from ._study import Study, study

#: Modules of the names that are loaded when they are first used: a command needs none of them, and starts sooner.
_LATER = {
    **dict.fromkeys(
        ["Result", "accuracy", "check", "command", "fibres", "implant", "moment_arms", "morph", "run", "springs"], "_commands"
    ),
    **dict.fromkeys(["Frame", "Simulation", "load"], "_frames"),
    **dict.fromkeys(["Study", "study"], "_study"),
}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_LATER[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__


__all__ = [
    "DIGEST",
    "Dual",
    "Frame",
    "PliantError",
    "Result",
    "Simulation",
    "Study",
    "__version__",
    "accuracy",
    "check",
    "check_constraint",
    "command",
    "fibres",
    "implant",
    "load",
    "main",
    "mesh_health",
    "minimise",
    "moment_arms",
    "morph",
    "project",
    "read_mesh",
    "run",
    "springs",
    "study",
]


def main() -> int:
    """The command line `pliant` of this package."""
    import signal
    import sys

    signal.signal(signal.SIGINT, signal.SIG_DFL)

    from . import _pliant

    return _pliant.command(["pliant", *sys.argv[1:]])
