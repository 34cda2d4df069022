#!/usr/bin/env python3
"""Counts instructions of fixed work under callgrind and compares them with benches/instructions.csv.

    python3 benches/instructions.py             fails if a count is more than 5 % off
    python3 benches/instructions.py --accept    writes the counts of this commit

Says "skipped" and succeeds where valgrind is not installed, the processor has no AVX2, or the counts are those of another
compiler. The tasks are those of benches/instructions.rs; only what its function `counted` calls is counted, on one thread, with
one lane and with four. Standard library only.
"""

import argparse
import csv
import json
import pathlib
import platform
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
COUNTS = ROOT / "benches" / "instructions.csv"
# A change of a few instructions in a hundred is noise of hashing and allocation, or of no interest.
ALLOWED = 0.05
TASKS = [("sweep", "1"), ("sweep", "4"), ("step", "1"), ("step", "4"), ("contact", "4"), ("factor", "4"), ("solve", "4")]


def skip(why):
    print(f"skipped: {why}")
    sys.exit(0)


def compiler():
    return subprocess.run(["rustc", "--version"], capture_output=True, text=True, check=True).stdout.strip()


def executable():
    """Builds the bench; cargo says where it put it."""
    command = ["cargo", "bench", "--bench", "instructions", "--no-run", "--message-format", "json"]
    out = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout
    for line in out.splitlines():
        message = json.loads(line)
        if message.get("executable") and message["target"]["name"] == "instructions":
            return message["executable"]
    sys.exit("cargo named no executable")


def count(program, task, lanes):
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "counts"
        callgrind = ["valgrind", "--tool=callgrind", "--toggle-collect=*counted*", f"--callgrind-out-file={out}"]
        done = subprocess.run(callgrind + [program, task, lanes], capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"{task} with {lanes} lanes failed:\n{done.stderr[-2000:]}")
        totals = re.findall(r"^(?:summary|totals): (\d+)", out.read_text(), re.MULTILINE)
    found = max(map(int, totals), default=0)
    if found == 0:
        sys.exit(f"{task} with {lanes} lanes: nothing was counted, is `counted` still a function of its own?")
    return found


def committed():
    if not COUNTS.exists():
        return "", {}
    with COUNTS.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return (rows[0]["compiler"] if rows else ""), {(r["task"], r["lanes"]): int(r["instructions"]) for r in rows}


def write(found, by):
    with COUNTS.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["task", "lanes", "instructions", "compiler"])
        table.writerows([task, lanes, number, by] for (task, lanes), number in found.items())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--accept", action="store_true", help="write the counts of this commit")
    args = parser.parse_args()
    if shutil.which("valgrind") is None:
        skip("valgrind is not installed")
    if platform.machine() != "x86_64" or " avx2 " not in pathlib.Path("/proc/cpuinfo").read_text():
        skip("the counts are of a processor with AVX2")
    by, (known_by, known) = compiler(), committed()
    if not args.accept and known_by != by:
        skip(f"counted with {known_by or 'nothing yet'}, here is {by}: --accept counts again")
    program = executable()
    found, wrong = {}, 0
    for key in TASKS:
        found[key] = count(program, *key)
        before = known.get(key)
        change = found[key] / before - 1 if before else 0.0
        off = before is None or abs(change) > ALLOWED
        wrong += off
        told = f"{change:+.2%} of {before:,}{'  <-- more than 5 % off' if off else ''}" if before else "new"
        print(f"{key[0]:8} {key[1]} lanes {found[key]:>15,}  {told}", flush=True)
    if args.accept:
        write(found, by)
    elif wrong:
        sys.exit(f"{wrong} counts are off: look why, then --accept")


if __name__ == "__main__":
    main()
