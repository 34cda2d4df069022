"""Studies in parts, and on workers of Dask that die."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

import pliant
from pliant._study import _Store

STUDY = """scene = "cube"
frames = [1, 4]
[set]
"frames" = 4
[vary]
"solver.xpbd.substeps" = [5, 6, 7, 8, 9, 10]
"""


LONGER = STUDY.replace('"frames" = 4', '"frames" = 600').replace("[5, 6, 7, 8, 9, 10]", "[40, 41, 42, 43, 44, 45]")


@pytest.fixture
def study(tmp_path: Path) -> pliant.Study:
    file = tmp_path / "small.toml"
    file.write_text(STUDY)
    return pliant.study(file)


def without_times(folder: Path) -> dict[str, Any]:
    """The kept runs without their times, and the table without its columns of times."""
    kept: dict[str, Any] = {}
    for file in sorted((folder / "runs").glob("*.json")):
        run = json.loads(file.read_text())
        numbers = run.get("numbers", run)
        numbers.pop("time_s", None)
        kept[file.name] = run
    rows = (folder / "study.csv").read_text().splitlines()
    names = rows[0].split(",")
    timed = [k for k, name in enumerate(names) if "time" in name]
    kept["study.csv"] = [[c for k, c in enumerate(row.split(",")) if k not in timed] for row in rows]
    kept["sheet.png"] = (folder / "sheet.png").read_bytes()
    return kept


def test_parts_give_what_one_run_gives(study: pliant.Study, tmp_path: Path) -> None:
    serial = study.run(out=tmp_path / "serial")
    assert serial.summary["kind"] == "study"
    parts = [
        subprocess.Popen([sys.executable, "-m", "pliant", "study", str(study.file), "--shard", f"{k}/3", "--out", str(tmp_path / "parts")])
        for k in (1, 2, 3)
    ]
    assert [part.wait() for part in parts] == [0, 0, 0]
    assert all(row["state"] == "finished" for row in study.runs(tmp_path / "parts"))
    study.run(out=tmp_path / "parts")
    assert without_times(tmp_path / "serial") == without_times(tmp_path / "parts")
    # The runs of others belong to the folder now: a fresh run removes them.
    pliant.command("study", study.file, "--fresh", f"--out={tmp_path / 'parts'}")
    with pytest.raises(pliant.PliantError, match="no run"):
        pliant.command("study", study.file, "--only", "nothing", f"--out={tmp_path / 'parts'}")


def test_a_store_keeps_whole_files(study: pliant.Study, tmp_path: Path) -> None:
    pytest.importorskip("fsspec")
    store = _Store(f"file://{tmp_path / 'store'}")
    file = tmp_path / "a.json"
    file.write_text('{"key": ""}')
    assert not store.has("a")
    store.put(file, "a")
    store.put(file, "a")
    assert store.has("a") and [p.name for p in (tmp_path / "store").iterdir()] == ["a.json"]
    (tmp_path / "runs").mkdir()
    # A damaged copy is replaced, and a part of a result in the store does not count.
    (tmp_path / "runs" / "a.json").write_text("{")
    (tmp_path / "store" / "b.json").write_text('{"key')
    assert not store.has("b")
    store.fetch(tmp_path / "runs", ["a", "b"])
    assert [p.name for p in (tmp_path / "runs").iterdir()] == ["a.json"]
    assert (tmp_path / "runs" / "a.json").read_text() == file.read_text()


def cluster(workers: int = 2) -> Any:
    """A scheduler and workers on loopback, without a dashboard."""
    distributed = pytest.importorskip("distributed")
    return distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    )


def test_workers_that_die_lose_nothing(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    file = tmp_path / "longer.toml"
    file.write_text(LONGER)
    study = pliant.study(file)
    study.run(out=tmp_path / "serial")
    with cluster() as scheduler, distributed.Client(scheduler) as client:
        done = threading.Event()
        killed = []

        def kill() -> None:
            """Kills a worker at random every second, four times."""
            draw = random.Random(1)
            for _ in range(4):
                if done.wait(1.0):
                    return
                pids = [w.process.pid for w in scheduler.workers.values() if w.process is not None and w.process.pid]
                if pids:
                    killed.append(draw.choice(pids))
                    try:
                        os.kill(killed[-1], signal.SIGKILL)
                    except ProcessLookupError:
                        pass

        killer = threading.Thread(target=kill)
        killer.start()
        study.run(client, out=tmp_path / "dask")
        done.set()
        killer.join()
    assert killed
    assert without_times(tmp_path / "serial") == without_times(tmp_path / "dask")


def test_another_version_on_a_worker_is_refused_by_name(study: pliant.Study, tmp_path: Path) -> None:
    from pliant._study import run_one

    with pytest.raises(pliant.PliantError, match="another version of pliant"):
        run_one([str(study.file)], (0, "key"), str(tmp_path), None, 1, "0" * 32)


def test_runs_through_an_object_store(study: pliant.Study, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    pytest.importorskip("s3fs")
    server_module = pytest.importorskip("moto.server")
    server = server_module.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    try:
        host, port = server.get_host_and_port()
        os.environ.update(
            AWS_ACCESS_KEY_ID="x", AWS_SECRET_ACCESS_KEY="x", AWS_DEFAULT_REGION="us-east-1", AWS_ENDPOINT_URL=f"http://{host}:{port}"
        )
        import s3fs

        s3fs.S3FileSystem().mkdir("runs")
        study.run(out=tmp_path / "serial")
        with cluster() as scheduler, distributed.Client(scheduler) as client:
            study.run(client, out=tmp_path / "s3", store="s3://runs/small")
        assert without_times(tmp_path / "serial") == without_times(tmp_path / "s3")
        # What is in the store is not computed again.
        shutil.rmtree(tmp_path / "s3")
        begun = time.monotonic()
        with cluster() as scheduler, distributed.Client(scheduler) as client:
            study.run(client, out=tmp_path / "s3", store="s3://runs/small")
        assert time.monotonic() - begun < 120
        assert without_times(tmp_path / "serial") == without_times(tmp_path / "s3")
    finally:
        server.stop()
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_DEFAULT_REGION", "AWS_ENDPOINT_URL"):
            os.environ.pop(name, None)
