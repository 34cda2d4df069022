#!/usr/bin/env python3
"""Builds the fuzz targets and runs them in turn, one process at a time, and keeps a log of what was run.

    python3 fuzz/run.py [--slice SECONDS] [--rounds N] [--work FOLDER] [--no-build] [TARGET...]
    python3 fuzz/run.py --table [--work FOLDER]

`corpus`, `artifacts`, the programs and `log.csv` lie in FOLDER, which is `fuzz` unless given. A slice is a row of the
log: target, start and stop (UTC), executions, files added to the corpus, edges covered, peak memory, findings, commit.
Numbers come from what libFuzzer prints at the end of a slice; a slice that prints none is a row without them.
"""

import argparse
import csv
import datetime
import os
import pathlib
import re
import shutil
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
# One program runs every reader of the table of formats; an environment variable names it.
FORMATS = (HERE.parent / "src" / "io" / "formats.rs").read_text()
READERS = list(dict.fromkeys(re.findall(r'^ +target: "(\w+)"', FORMATS, re.MULTILINE))) + ["any"]
PROGRAMS = ["reader", "blocks", "write", "repair", "state", "springs", "pvd", "opensim", "scene"]
TARGETS = [*READERS, *PROGRAMS[1:]]
COLUMNS = ["target", "start", "stop", "executions", "added", "covered", "peak_mb", "findings", "commit"]
# The code is safe Rust: a sanitizer would find nothing more and take half of the speed.
BUILD = ["cargo", "+nightly", "fuzz", "build", "--sanitizer", "none"]


def commit():
    """The commit that is built; a plus where files differ from it."""
    git = lambda *words: subprocess.run(["git", *words], cwd=HERE, capture_output=True, text=True).stdout.strip()
    changed = git("status", "--porcelain", "--", "..", ":!log.csv")
    return git("rev-parse", "--short", "HEAD") + ("+" if changed else "")


def build(work):
    """Builds all targets and copies them, so that a later build does not change a program that runs."""
    programs = work / "programs"
    programs.mkdir(parents=True, exist_ok=True)
    subprocess.run(BUILD, cwd=HERE, check=True)
    built = HERE / "target" / "x86_64-unknown-linux-gnu" / "release"
    for name in PROGRAMS:
        # Under another name first: a program that runs cannot be written to.
        shutil.copy2(built / name, programs / f"{name}.new")
        (programs / f"{name}.new").replace(programs / name)
    (programs / "commit").write_text(commit())


def now():
    return datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")


def run(target, seconds, work):
    """Runs a target once and appends a row to the log; returns how many findings there were."""
    programs, artifacts, corpus = work / "programs", work / "artifacts" / target, work / "corpus" / target
    artifacts.mkdir(parents=True, exist_ok=True)
    corpus.mkdir(parents=True, exist_ok=True)
    program = programs / ("reader" if target in READERS else target)
    command = [
        program, f"-max_total_time={seconds}", "-max_len=4096", "-timeout=10", "-report_slow_units=1",
        "-rss_limit_mb=1024", "-print_final_stats=1", f"-artifact_prefix={artifacts}/",
    ]
    words = HERE / "dictionaries" / f"{target}.dict"
    if words.exists():
        command.append(f"-dict={words}")
    before = set(artifacts.iterdir())
    start = now()
    seeds = os.environ | {"PLIANT_SEEDS": str(corpus), "PLIANT_READER": target, "RUST_BACKTRACE": "0"}
    text = subprocess.run([*command, corpus], capture_output=True, text=True, errors="replace", env=seeds).stderr
    stop = now()
    found = sorted(set(artifacts.iterdir()) - before)
    number = lambda pattern: (re.findall(pattern, text) or [""])[-1]
    row = [
        target, start, stop, number(r"stat::number_of_executed_units:\s*(\d+)"),
        number(r"stat::new_units_added:\s*(\d+)"), number(r"cov: (\d+)"), number(r"stat::peak_rss_mb:\s*(\d+)"),
        len(found), (programs / "commit").read_text(),
    ]
    log = work / "log.csv"
    fresh = not log.exists()
    with log.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if fresh:
            writer.writerow(COLUMNS)
        writer.writerow(row)
    for path in found:
        what = re.search(r"panicked at .*\n(.*)|ERROR: libFuzzer: (.*)", text)
        print(f"{target}: {path}: {what[0] if what else 'slow'}", flush=True)
    return len(found)


def table(work):
    """Executions, hours and findings of each target, from the log."""
    total = {}
    with (work / "log.csv").open() as file:
        for row in csv.DictReader(file):
            time = [datetime.datetime.fromisoformat(row[key].rstrip("Z")) for key in ("start", "stop")]
            entry = total.setdefault(row["target"], [0, 0.0, 0, 0])
            entry[0] += int(row["executions"] or 0)
            entry[1] += (time[1] - time[0]).total_seconds() / 3600
            entry[2] = max(entry[2], int(row["covered"] or 0))
            entry[3] += int(row["findings"])
    print("| target | executions | hours | edges covered | findings |\n|---|---|---|---|---|")
    for target, (executions, hours, covered, findings) in total.items():
        print(f"| {target} | {executions:,} | {hours:.2f} | {covered:,} | {findings} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("targets", nargs="*", help="targets; all unless given")
    parser.add_argument("--slice", type=int, default=300, help="seconds of a slice")
    parser.add_argument("--rounds", type=int, default=0, help="how often all targets are run; 0: until stopped")
    parser.add_argument("--work", type=pathlib.Path, default=HERE)
    parser.add_argument("--no-build", action="store_true", help="run the programs of the last build")
    parser.add_argument("--table", action="store_true", help="print the sums of the log and run nothing")
    options = parser.parse_args()
    work = options.work.resolve()
    if options.table:
        table(work)
        return
    if not options.no_build:
        build(work)
    targets = options.targets or TARGETS
    if unknown := set(targets) - set(TARGETS):
        sys.exit(f"unknown: {', '.join(sorted(unknown))}; there are {', '.join(TARGETS)}")
    findings, rounds = 0, 0
    while options.rounds == 0 or rounds < options.rounds:
        findings += sum(run(target, options.slice, work) for target in targets)
        rounds += 1
    sys.exit(1 if findings else 0)


if __name__ == "__main__":
    main()
