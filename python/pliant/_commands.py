"""The commands as functions: each runs in a process of its own, so that Ctrl-C ends it with closed files."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from . import _pliant

#: `file:line:column: error[E052]: text`, where place and code can be missing.
_PLACED = re.compile(r"^(?P<file>.*?)(?::(?P<line>\d+))?(?::(?P<column>\d+))?: error\[(?P<code>E\d+)\]: ", re.MULTILINE)
#: Exit codes that have results: done, and a check that failed.
_WITH_RESULTS = (0, 1)


class Killed(_pliant.PliantError):
    """A signal ended the process of a command, as where memory runs out."""


class Result:
    """What a command computed.

    Attributes:
        summary: the content of summary.json, as `docs/summary.md` describes it.
        folder: the folder of the results.
        passed: True if no check failed.
        log: what the command wrote for people.
    """

    def __init__(self, summary: dict[str, Any], folder: Path, passed: bool, log: str) -> None:
        self.summary = summary
        self.folder = folder
        self.passed = passed
        self.log = log

    @property
    def failed(self) -> list[dict[str, Any]]:
        """The checks that failed."""
        return [v for v in self.summary.get("verdicts", []) if v.get("passed") is False]

    def path(self, name: str) -> Path:
        """A file of the results."""
        return self.folder / name

    def _repr_html_(self) -> str:
        state = "passed" if self.passed else f"{len(self.failed)} checks failed"
        link = f'<a href="{self.folder / "report.html"}">report</a>'
        return f"<b>{self.summary.get('kind', '')} {self.summary.get('name', '')}</b>: {state} {link}"

    def __repr__(self) -> str:
        state = "passed" if self.passed else f"{len(self.failed)} checks failed"
        return f"<pliant.Result {self.summary.get('kind', '')} {self.summary.get('name', '')}: {state}>"


def _error(text: str) -> _pliant.PliantError:
    """The error that a command printed, with its code and place."""
    text = text.strip()
    error = _pliant.PliantError(text)
    found = _PLACED.search(text)
    error.code = found["code"] if found else None
    error.line = int(found["line"]) if found and found["line"] else None
    error.column = int(found["column"]) if found and found["column"] else None
    return error


def _option(name: str, value: Any) -> list[str]:
    option = "--" + name.rstrip("_").replace("_", "-")
    if value is None or value is False:
        return []
    if value is True:
        return [option]
    if isinstance(value, Mapping):
        # Changes of a scene, one option for each.
        return [word for key, item in value.items() for word in (option, f"{key}={_text(item)}")]
    if isinstance(value, (list, tuple)):
        return [word for item in value for word in (option, _text(item))]
    # With `=` a value can begin with a minus.
    return [f"{option}={_text(value)}"]


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return os.fspath(value) if isinstance(value, os.PathLike) else str(value)


def command(
    *arguments: str | os.PathLike[str], progress: bool = False, bound: bool = False
) -> subprocess.CompletedProcess[str]:
    """Runs the command line `pliant` and returns what it printed.

    Args:
        arguments: the words after `pliant`.
        progress: also show notes and progress while it runs.
        bound: the command ends at once where this process dies, also by a kill.

    Raises:
        PliantError: bad usage or input (exit code 2).
        KeyboardInterrupt: Ctrl-C; the command has closed its files.
    """
    words = [sys.executable, "-m", "pliant", *map(_text, arguments)]
    environment = {**os.environ, "PLIANT_PARENT": str(os.getpid())} if bound else None
    process = subprocess.Popen(
        words,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        # A name of a file can have any bytes.
        encoding="utf-8",
        errors="replace",
        start_new_session=True,
        env=environment,
    )
    notes: list[str] = []
    printed: list[str] = []

    def follow() -> None:
        assert process.stderr is not None
        for line in process.stderr:
            notes.append(line)
            if progress:
                # What cannot be shown must not stop the command, which waits for its reader.
                with contextlib.suppress(Exception):
                    sys.stderr.write(line)

    def collect() -> None:
        assert process.stdout is not None
        printed.append(process.stdout.read())

    # Both at once: a full pipe would stop the command.
    readers = [threading.Thread(target=follow), threading.Thread(target=collect)]
    for reader in readers:
        reader.start()
    try:
        code = process.wait()
    except BaseException:
        # Also for SystemExit of a notebook's kernel: the command ends as on Ctrl-C.
        process.send_signal(signal.SIGINT)
        process.wait()
        raise
    finally:
        for reader in readers:
            reader.join()
    text = "".join(notes)
    if code in (130, 143):
        raise KeyboardInterrupt
    if code < 0:
        name = signal.Signals(-code).name
        raise Killed(f"{name} ended the command {words[3]}; where memory ran out, give it more, or run fewer at once")
    if code not in _WITH_RESULTS:
        raise _error(text)
    return subprocess.CompletedProcess(words, code, "".join(printed), text)


def _result(name: str, positional: Sequence[Any], options: Mapping[str, Any], progress: bool) -> Result:
    options = dict(options)
    if options.get("out") is None:
        stem = Path(_text(positional[0])).stem if positional else name
        options["out"] = Path("pliant-out") / (stem if name == "run" else f"{stem}-{name}")
    words = [name, "--json"]
    for option, value in options.items():
        words += _option(option, value)
    done = command(*words, *map(_text, positional), progress=progress)
    if not done.stdout.strip():
        raise _error(done.stderr)
    return Result(json.loads(done.stdout), Path(_text(options["out"])), done.returncode == 0, done.stderr)


def run(scene: str | os.PathLike[str] = "hip", *, progress: bool = False, **options: Any) -> Result:
    """Runs a scene to its last frame: `pliant run`.

    Options are those of the command with `_` for `-`: frames=10, set={"effects.contact": "off"},
    out="results", accuracy="1 %", motion="walk.mot".
    """
    return _result("run", [scene], options, progress)


def moment_arms(scene: str | os.PathLike[str] = "hip", *, progress: bool = False, **options: Any) -> Result:
    """Lengths and moment arms of muscles: `pliant moment-arms`.

    Options: joint="hip", to="60deg"; or osim="model.osim", coordinate="hip_flexion_r=hip".
    """
    return _result("moment-arms", [scene], options, progress)


def fibres(mesh: str | os.PathLike[str], *, progress: bool = False, **options: Any) -> Result:
    """Fibres of a muscle between two areas: `pliant fibres`."""
    return _result("fibres", [mesh], options, progress)


def morph(first: str | os.PathLike[str], second: str | os.PathLike[str], *, progress: bool = False, **options: Any) -> Result:
    """A blend of two closed surfaces: `pliant morph`."""
    return _result("morph", [first, second], options, progress)


def implant(*meshes: str | os.PathLike[str], progress: bool = False, **options: Any) -> Result:
    """Skin over an implant: `pliant implant`."""
    return _result("implant", list(meshes), options, progress)


def springs(*files: str | os.PathLike[str], progress: bool = False, **options: Any) -> Result:
    """A system of springs: `pliant springs`."""
    return _result("springs", list(files), options, progress)


def accuracy(scene: str | os.PathLike[str] = "hip", *, progress: bool = False, **options: Any) -> Result:
    """Error over time of the solvers on a scene: `pliant accuracy`."""
    return _result("accuracy", [scene], options, progress)


def check(mesh: str | os.PathLike[str], **options: Any) -> dict[str, Any]:
    """Examines a mesh: `pliant check`. Returns its report."""
    words = ["check", "--json"]
    for option, value in options.items():
        words += _option(option, value)
    report: dict[str, Any] = json.loads(command(*words, mesh).stdout)
    return report
