"""Studies on workers of Dask, measured on this machine. Needs the package (pip install './python[cluster]').

python3 benches/cluster.py tasks              tasks a second of the scheduler
python3 benches/cluster.py rows               time of one row of a study, and bytes of its result
python3 benches/cluster.py runs [N]           N combinations (1000), serial and on two workers
python3 benches/cluster.py kills [N]          N combinations (1000) on two workers, one of which is killed every 20 s
"""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path

import pliant
from distributed import Client, LocalCluster

#: Frames of a combination: a second or more.
FRAMES = 300
#: Seconds between two kills.
KILL_EVERY = 20.0

SCENE = """scene = "cube"
frames = [1]
[set]
"frames" = {frames}
[vary]
"solver.xpbd.substeps" = {substeps}
"muscle.0.material.stretch" = {stiffness}
"""


def study(folder: Path, count: int, frames: int) -> pliant.Study:
    """A study of `count` combinations."""
    across = max(1, count // 10)
    text = SCENE.format(
        frames=frames,
        substeps=list(range(40, 40 + across)),
        stiffness=json.dumps([f"{300 + 10 * k} N/m" for k in range(10)]),
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "study.toml").write_text(text)
    return pliant.study(folder / "study.toml")


def cluster() -> LocalCluster:
    return LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1")


def tasks() -> None:
    with cluster() as workers, Client(workers) as client:
        client.gather(client.map(lambda k: k, range(100), pure=False))
        for count in (1000, 5000):
            begun = time.monotonic()
            client.gather(client.map(lambda k: k, range(count), pure=False))
            print(f"{count} tasks: {count / (time.monotonic() - begun):.0f} a second")


def rows(folder: Path) -> None:
    for count in (10, 1000, 10000):
        own = study(folder / str(count), count, 2)
        begun = time.monotonic()
        listed = own.runs(folder / "none")
        dry = time.monotonic() - begun
        out = folder / f"out-{count}"
        begun = time.monotonic()
        pliant.command("study", own.file, f"--row={len(listed) // 2}", f"--out={out}", "--threads=1")
        one = time.monotonic() - begun
        size = next((out / "runs").iterdir()).stat().st_size
        print(f"{count} combinations: listed in {dry:.2f} s; one row, of two frames, in {one:.2f} s; {size} bytes")


def killing(workers: LocalCluster, done: threading.Event, killed: list[int]) -> None:
    draw = random.Random(1)
    while not done.wait(KILL_EVERY):
        pids = [w.process.pid for w in workers.workers.values() if w.process is not None and w.process.pid]
        if pids:
            killed.append(draw.choice(pids))
            os.kill(killed[-1], signal.SIGKILL)


def without_times(file: Path) -> dict[str, object]:
    run = json.loads(file.read_text())
    run["numbers"].pop("time_s")
    return run


def distributed(own: pliant.Study, out: Path, killed: list[int] | None) -> float:
    """Time of a study on two workers [s]; with a list, they are killed, and the list gets their numbers."""
    done = threading.Event()
    with cluster() as workers, Client(workers) as client:
        killer = threading.Thread(target=killing, args=(workers, done, killed))
        begun = time.monotonic()
        if killed is not None:
            killer.start()
        own.run(client, out=out)
        took = time.monotonic() - begun
        done.set()
        if killed is not None:
            killer.join()
    return took


def runs(folder: Path, count: int) -> None:
    own = study(folder, count, FRAMES)
    begun = time.monotonic()
    own.run(out=folder / "serial", threads=1)
    serial = time.monotonic() - begun
    print(f"serial: {serial:.0f} s, {serial / count:.2f} s each", flush=True)
    took = distributed(own, folder / "two", None)
    files = sorted((folder / "serial" / "runs").iterdir())
    same = all(without_times(f) == without_times(folder / "two" / "runs" / f.name) for f in files)
    print(f"two workers: {took:.0f} s, {serial / took:.2f} times as fast, equal but for times: {same}", flush=True)
    assert same


def kills(folder: Path, count: int) -> None:
    own = study(folder, count, FRAMES)
    killed: list[int] = []
    took = distributed(own, folder / "killed", killed)
    files = list((folder / "killed" / "runs").iterdir())
    print(f"killed every {KILL_EVERY:.0f} s: {took:.0f} s, {len(killed)} kills, {len(files)} files", flush=True)
    # Some of them again, alone.
    draw = random.Random(2)
    for row in draw.sample(own.runs(folder / "killed"), 20):
        pliant.command("study", own.file, f"--row={row['row']}", f"--out={folder / 'again'}", "--threads=1")
    again = list((folder / "again" / "runs").iterdir())
    same = all(without_times(f) == without_times(folder / "killed" / "runs" / f.name) for f in again)
    print(f"{len(again)} of them run again alone: equal but for times: {same}", flush=True)
    assert same and len(files) == len({row["key"] for row in own.runs(folder / "killed")})


if __name__ == "__main__":
    what = sys.argv[1] if len(sys.argv) > 1 else ""
    with tempfile.TemporaryDirectory() as scratch:
        if what == "tasks":
            tasks()
        elif what == "rows":
            rows(Path(scratch))
        elif what in ("runs", "kills"):
            job = runs if what == "runs" else kills
            job(Path(scratch), int(sys.argv[2]) if len(sys.argv) > 2 else 1000)
        else:
            sys.exit(__doc__)
