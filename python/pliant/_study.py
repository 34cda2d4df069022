"""Parameter studies, on one machine or on any cluster that Dask reaches.

The unit is a combination of the study. Its key is a hash of all that its result depends on, the version of the
library among them. The store is the folder of kept runs, and it is the only truth: a combination whose file is
there with the right key is done, wherever it was computed and however often.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from . import _pliant
from ._commands import Killed, Result, _option, _result, command

#: File systems that show a file when it is complete.
OBJECT_STORES = frozenset(["s3", "s3a", "gs", "gcs", "abfs", "az", "adl", "oci", "memory"])
#: How often a combination is begun again whose worker died under it.
MOST_RESTARTS = 20


class Study:
    """A study file; `study` makes one.

    Attributes:
        file: the study file.
        set: changes of the scene of all runs.
    """

    def __init__(self, file: str | os.PathLike[str], set: Mapping[str, Any] | None = None) -> None:
        self.file = Path(file).absolute()
        self.set = dict(set) if set else {}

    def _words(self) -> list[str]:
        return [str(self.file), *_option("set", self.set)]

    def runs(self, out: str | os.PathLike[str] | None = None) -> list[dict[str, Any]]:
        """The combinations with their keys, states ("to run", "finished") and expected times [s]."""
        words = ["study", *self._words(), "--dry-run", "--json", *_option("out", out)]
        rows: list[dict[str, Any]] = json.loads(command(*words).stdout)["study"]["rows"]
        return rows

    def run(
        self,
        client: Any | None = None,
        *,
        out: str | os.PathLike[str],
        store: str | None = None,
        threads: int | None = None,
        progress: bool = False,
    ) -> Result:
        """Runs what is missing, and makes the table and the sheet.

        Args:
            client: a `distributed.Client`; without one, all runs are on this machine.
            out: folder of the results. Workers write its `runs` themselves, unless there is a `store`.
            store: an fsspec address such as "s3://bucket/study", for workers that do not see `out`.
            threads: threads of each run on a worker [1].
            progress: also show each finished run.

        Raises:
            PliantError: the study is wrong, a worker has another version of Pliant, or a run failed.
        """
        out = Path(out).absolute()
        if client is not None:
            self._distribute(client, out, store, threads or 1, progress)
        options = {"out": out, "set": self.set}
        if client is None and threads is not None:
            options["threads"] = threads
        return _result("study", [self.file], options, progress)

    def _distribute(self, client: Any, out: Path, store: str | None, threads: int, progress: bool) -> None:
        kept = _Store(store) if store is not None else None
        runs = out / "runs"
        runs.mkdir(parents=True, exist_ok=True)
        if kept is not None:
            kept.fetch(runs, [row["key"] for row in self.runs(out) if row["state"] != "finished"])
        listed = self.runs(out)
        # References have no row, and are run with a combination that has them. One whose combinations are all there is run by
        # the last call.
        missing = [row for row in listed if row["state"] != "finished" and row["row"] is not None]
        # Equal combinations have one key, and are one task.
        rows = {row["key"]: row for row in missing}
        longest = sorted(rows.values(), key=lambda row: -row["expected_s"])
        words = self._words()
        restarts: dict[str, int] = {}
        # A client that still holds a task of an earlier call, such as one that failed, would return its old result.
        call = uuid.uuid4().hex[:8]

        def submit(key: str) -> Any:
            name = f"{key}-{call}-{restarts.get(key, 0)}"
            return client.submit(
                run_one, words, (rows[key]["row"], key), str(out), store, threads, _pliant.DIGEST, key=name, pure=False, retries=0
            )

        of = {}
        for row in longest:
            of[submit(row["key"])] = row["key"]
        try:
            self._follow(of, rows, restarts, submit, progress)
        finally:
            # After an error or Ctrl-C the rest would go on.
            client.cancel(list(of))
        if kept is not None:
            kept.fetch(runs, [row["key"] for row in self.runs(out) if row["state"] != "finished"])

    def _follow(
        self,
        of: dict[Any, str],
        rows: dict[str, dict[str, Any]],
        restarts: dict[str, int],
        submit: Callable[[str], Any],
        progress: bool,
    ) -> None:
        """Waits for all tasks, and begins those again whose worker or process died."""
        from distributed import as_completed
        from distributed.scheduler import KilledWorker

        results = as_completed(list(of))  # type: ignore[no-untyped-call]
        done = 0
        for future in results:
            key = of.pop(future)
            error = future.exception() if future.status == "error" else None
            if isinstance(error, (KilledWorker, Killed)) or future.status in ("lost", "cancelled"):
                # The scheduler gives up a task whose workers died three times; the store knows better.
                restarts[key] = restarts.get(key, 0) + 1
                if restarts[key] > MOST_RESTARTS:
                    message = f"{rows[key]['label']}: its worker or its process was killed {restarts[key]} times; does it need more memory?"
                    raise _pliant.PliantError(message)
                again = submit(key)
                of[again] = key
                results.add(again)  # type: ignore[no-untyped-call]
                continue
            if error is not None:
                raise error
            done += 1
            if progress:
                print(f"[{done}/{len(rows)}] {rows[key]['label']} on {future.result()['host']}")

    def __repr__(self) -> str:
        return f"<pliant.Study {self.file.name}>"


def study(file: str | os.PathLike[str], set: Mapping[str, Any] | None = None) -> Study:
    """A parameter study: `pliant study`.

    >>> pliant.study("press.toml").run(client, out="results")
    """
    return Study(file, set)


def run_one(
    words: list[str], row: tuple[int, str], out: str, store: str | None, threads: int, digest: str
) -> dict[str, Any]:
    """Runs one combination, by its row and key, on a worker, and keeps its result. Returns what `study_part` tells."""
    number, key = row
    if digest != _pliant.DIGEST:
        import socket

        message = (
            f"the worker {socket.gethostname()} has another version of pliant ({_pliant.DIGEST}) than the client ({digest}): "
            "install the same wheel on both"
        )
        error = _pliant.PliantError(message)
        error.code = None
        raise error
    folder = Path(out)
    scratch: str | None = None
    if store is not None:
        if _Store(store).has(key):
            return {"host": None, "found": 1, "computed": 0}
        scratch = tempfile.mkdtemp(prefix="pliant-")
        folder = Path(scratch)
    try:
        arguments = ["study", *words, f"--row={number}", "--json", f"--out={folder}", f"--threads={threads}"]
        begun = time.monotonic()
        try:
            summary = json.loads(command(*arguments, bound=True).stdout)["study_part"]
        except KeyboardInterrupt:
            # A worker that is told to end, as by its batch system, ends its process in the same way.
            raise Killed("the process of the run was told to end") from None
        if key not in summary["keys"]:
            message = "the worker reads another scene or other files than the client: the paths of a study must be the same on both"
            raise _pliant.PliantError(message)
        if store is not None:
            for done in summary["keys"]:
                _Store(store).put(folder / "runs" / f"{done}.json", done)
        summary["wall_s"] = time.monotonic() - begun
        return dict(summary)
    finally:
        if scratch is not None:
            shutil.rmtree(scratch, ignore_errors=True)


class _Store:
    """Kept runs at an address of fsspec."""

    def __init__(self, address: str) -> None:
        import fsspec

        self.files, self.root = fsspec.core.url_to_fs(address)

    def _path(self, key: str) -> str:
        return f"{self.root.rstrip('/')}/{key}.json"

    def has(self, key: str) -> bool:
        """True if the whole result is there: a file system can hold a part of one."""
        self.files.invalidate_cache()
        try:
            return "key" in json.loads(self.files.cat_file(self._path(key)))
        except (OSError, ValueError):
            return False

    def put(self, file: Path, key: str) -> None:
        """Writes a result. Object stores show it when it is complete; other systems need a rename."""
        target = self._path(key)
        protocols = self.files.protocol if isinstance(self.files.protocol, (list, tuple)) else [self.files.protocol]
        self.files.makedirs(self.root, exist_ok=True)
        if OBJECT_STORES.intersection(protocols):
            self.files.put_file(str(file), target)
            return
        part = f"{target}.{os.getpid()}-{time.time_ns()}"
        self.files.put_file(str(file), part)
        self.files.mv(part, target)

    def fetch(self, folder: Path, keys: list[str]) -> None:
        """Copies the results of these keys into a folder, also over files that are damaged."""
        for key in keys:
            if self.has(key):
                part = folder / f"{key}.{os.getpid()}"
                self.files.get_file(self._path(key), str(part))
                part.replace(folder / f"{key}.json")
