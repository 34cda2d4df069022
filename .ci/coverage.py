#!/usr/bin/env python3
"""Measures which lines of the readers the tests reach: a row for each file of src/io, without its test module.

    python3 .ci/coverage.py [--mutations] [--data FOLDER] [--missed]

It needs cargo-llvm-cov. Without --data no test sees the measured data; --mutations adds tests/mutations.rs, --missed lists
the lines that were not reached. Below 95 % in any file it ends with 1.
"""

import argparse
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
LEAST = 95
# Their input is cut or changed: a line that only they reach is run, but what it gives is not looked at.
RANDOM = ["every_prefix", "every_truncation", "changed_files"]


def llvm_cov(*words, data):
    environment = {**os.environ, "PLIANT_DATA": data}
    subprocess.run(["cargo", "llvm-cov", *words], cwd=ROOT, env=environment, check=True, stdout=sys.stderr)


def measure(arguments):
    """Runs the tests and returns the report in the format of lcov."""
    data = str(pathlib.Path(arguments.data).resolve()) if arguments.data else "no-such-folder"
    llvm_cov("clean", "--profraw-only", data=data)
    skipped = [] if arguments.mutations else [word for name in RANDOM for word in ("--skip", name)]
    llvm_cov("--no-report", "--lib", "--", "io::", *skipped, data=data)
    tests = ["io", "bad", "memory"] + ["mutations"] * arguments.mutations
    chosen = [word for name in tests for word in ("--test", name)]
    llvm_cov("--no-report", *chosen, "--", *skipped, data=data)
    report = ROOT / "target" / "coverage.lcov"
    llvm_cov("report", "--lcov", "--output-path", str(report), data=data)
    return report.read_text()


def lines(report):
    """How often each line was run, by file of src/io, down to the test module at the end of the file."""
    counts, name, end = {}, None, 0
    for record in report.splitlines():
        key, _, value = record.partition(":")
        if key == "SF":
            path = pathlib.Path(value)
            name = str(path.relative_to(ROOT)) if path.is_relative_to(ROOT / "src" / "io") else None
            if name:
                source = path.read_text().splitlines()
                end = source.index("#[cfg(test)]") + 1 if "#[cfg(test)]" in source else len(source) + 1
        elif key == "DA" and name:
            line, count = (int(number) for number in value.split(",")[:2])
            if line < end:
                counts.setdefault(name, {})[line] = count
    return counts


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mutations", action="store_true")
    parser.add_argument("--data")
    parser.add_argument("--missed", action="store_true")
    arguments = parser.parse_args()
    worst, all_reached, all_lines = 100, 0, 0
    print("| file | lines | reached | % |\n|---|---|---|---|")
    for name, counts in sorted(lines(measure(arguments)).items()):
        missed = [line for line, count in sorted(counts.items()) if count == 0]
        reached = len(counts) - len(missed)
        share = 100 * reached / len(counts)
        worst, all_reached, all_lines = min(worst, share), all_reached + reached, all_lines + len(counts)
        print(f"| `{name}` | {len(counts)} | {reached} | {share:.1f} |")
        if arguments.missed:
            for line in missed:
                print(f"    {line}: {(ROOT / name).read_text().splitlines()[line - 1]}")
    print(f"| all | {all_lines} | {all_reached} | {100 * all_reached / all_lines:.1f} |")
    return int(worst < LEAST)


if __name__ == "__main__":
    sys.exit(main())
