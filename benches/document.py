#!/usr/bin/env python3
"""Runs the benches and writes docs/benchmarks.md, and tables of other documents, from what they print.

    python3 benches/document.py                 all of it, about a quarter of an hour
    python3 benches/document.py --only step     some benches; the others keep their numbers, with date and commit
    python3 benches/document.py --resume        what was not measured at this commit yet
    python3 benches/document.py --write         no run: the document again from benches/results.json
    python3 benches/document.py --check         no run: whether the document is what --write would write

Benches print lines of three kinds, and criterion leaves its estimates in files:

    RESULT key number unit          NOTE key text          ROW table | cell | cell |

All is kept in benches/results.json. The text is benches/benchmarks.template.md, in which [[key|.2f]] is a number, [[a / b|.1f]]
and [[a + b]] are computed, [[kept key <= 2]] is yes or no, [[rows table]] are rows, [[when bench]] is date and commit, and
[[machine]], [[growth]] and [[instructions]] are tables. What is not measured is written as a dash. Standard library only.
"""

import argparse
import datetime
import json
import operator
import os
import pathlib
import platform
import re
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benches" / "results.json"
TEMPLATE = ROOT / "benches" / "benchmarks.template.md"
COUNTS = ROOT / "benches" / "instructions.csv"
DOCUMENT = ROOT / "docs" / "benchmarks.md"
# Documents that are written by hand but for some tables.
WITH_TABLES = [ROOT / "docs" / "morphing.md", ROOT / "docs" / "accuracy.md"]
TABLE = re.compile(r"(<!-- rows (\S+): `python3 benches/document\.py --only (\S+)` -->\n).*?(<!-- end of rows -->)", re.DOTALL)
PEERS = ["cargo", "run", "--release", "--manifest-path", "benches/peers/Cargo.toml"]
DASH = "–"
SCENES = {
    "hip": "hip",
    "press": "press",
    "gluteus": "examples/right-hip-gluteus-maximus.toml",
    "right-hip": "examples/right-hip.toml",
}


def bench(name):
    return ["cargo", "bench", "--bench", name]


COMMANDS = {
    "scenes": None,
    "step": bench("step"),
    "constraints": bench("constraints"),
    "equilibrium": bench("equilibrium"),
    "work_precision": bench("work_precision"),
    "accuracy": bench("accuracy"),
    "closest": bench("closest"),
    "contact": bench("contact"),
    "fibres": bench("fibres"),
    "health": bench("health"),
    "hierarchy": bench("hierarchy"),
    "lattice": bench("lattice"),
    "morph": bench("morph"),
    "morphing": None,
    "read": bench("read"),
    "peers": PEERS,
    "pose": PEERS + ["--bin", "pose"],
    "peers-read": PEERS + ["--bin", "read"],
    "readers": None,
    "pbd": [sys.executable, "benches/peers/pbd.py"],
    "viewer": bench("viewer"),
}


def said(*command):
    """What a command prints, or nothing where it fails."""
    try:
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def first(path, name):
    try:
        for line in pathlib.Path(path).read_text().splitlines():
            if line.startswith(name):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return ""


def machine():
    flags = first("/proc/cpuinfo", "flags").split()
    lanes = "8 lanes (AVX-512)" if "avx512f" in flags else "4 lanes (AVX2)" if "avx2" in flags else "1 lane"
    kilobytes = first("/proc/meminfo", "MemTotal").split()
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    return {
        "processor": first("/proc/cpuinfo", "model name") or platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "lanes": lanes,
        "memory": f"{int(kilobytes[0]) / 2**20:.0f} GiB" if kilobytes else "",
        "rustc": said("rustc", "--version"),
        "load": round(load, 1),
    }


def commit():
    changed = any(
        not line.endswith(("benches/results.json", "docs/benchmarks.md"))
        for line in said("git", "status", "--porcelain").splitlines()
    )
    return said("git", "rev-parse", "--short=7", "HEAD") + ("+" if changed else "")


def slug(text):
    return "-".join(word for word in re.split("[^a-z0-9]+", text.lower()) if word)


def parse(text):
    """Numbers, notes and rows of what a bench printed."""
    found = {"numbers": {}, "notes": {}, "rows": {}}
    for line in text.splitlines():
        kind, _, rest = line.partition(" ")
        if kind == "RESULT":
            key, value, unit = rest.split()
            found["numbers"][key] = [float(value), unit]
        elif kind == "NOTE":
            key, _, note = rest.partition(" ")
            found["notes"][key] = note
        elif kind == "ROW":
            table, _, cells = rest.partition(" ")
            found["rows"].setdefault(table, []).append(cells)
    return found


def estimates(since):
    """Medians [ms] that criterion left in its files after a time."""
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    numbers = {}
    for path in (target / "criterion").glob("**/new/estimates.json"):
        about = path.with_name("benchmark.json")
        if path.stat().st_mtime < since or not about.exists():
            continue
        names = json.loads(about.read_text())
        key = ".".join(slug(names[k]) for k in ("group_id", "function_id", "value_str") if names.get(k))
        numbers["criterion." + key] = [json.loads(path.read_text())["median"]["point_estimate"] / 1e6, "ms"]
    return numbers


def scenes():
    """Runs each scene and takes its numbers from summary.json."""
    found = {"numbers": {}, "notes": {}, "rows": {}}
    subprocess.run(["cargo", "build", "--release"], cwd=ROOT, check=True)
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    for name, scene in SCENES.items():
        if scene.endswith(".toml") and "PLIANT_DATA" not in os.environ:
            print(f"skipped: {scene} needs the measured data, in PLIANT_DATA")
            continue
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder) / "run"
            command = [target / "release" / "pliant", "run", scene, "--out", out]
            # Exit code 1 is a promise that is not kept: a result like any other.
            if subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL).returncode not in (0, 1):
                sys.exit(f"{scene} could not be run")
            summary = json.loads((out / "summary.json").read_text())
        found["numbers"][f"scenes.{name}.total"] = [summary["time_s"], "s"]
        found["numbers"][f"scenes.{name}.frame"] = [summary["times"]["frame_median_s"] * 1e3, "ms"]
        found["numbers"][f"scenes.{name}.frames"] = [summary["frames"], "1"]
        substeps = re.search(r"substeps (\d+)", summary["muscles"]["solver"])
        found["notes"][f"scenes.{name}.substeps"] = substeps.group(1) if substeps else DASH
        muscles = summary["muscles"]["muscles"]
        for key, of, form in [
            ("vertices", "vertices", ","), ("not-converged", "frames_not_converged", ","),
            ("volume", "volume_error_max", ".1e"), ("inside", "vertices_inside_bones_max", ","),
            ("bone-inside", "bone_vertices_inside_max", ","), ("apart", "distance_from_start_rms_m", "mm"),
            ("stretch-end", "edge_stretch_rms_end", ".4f"), ("stretch-worst", "edge_stretch_rms_worst", ".1%"),
        ]:
            show = lambda v: f"{v * 1e3:.2g}" if form == "mm" else format(v, form)
            values = list(dict.fromkeys(show(m[of]) for m in muscles)) if key in SAME else [show(m[of]) for m in muscles]
            found["notes"][f"scenes.{name}.{key}"] = ", ".join(values).replace("%", " %")
    return found


# Said once where all muscles agree.
SAME = ("not-converged", "inside", "bone-inside", "stretch-end")


# Surfaces of the body's folder and what else is said: one row of docs/morphing.md each.
MORPHS = [
    ("muscles/Gluteus_medius_muscle.r.obj", "muscles-fine/gluteus_medius.obj", []),
    ("muscles/Short_head_of_biceps_brachii.r.obj", "muscles/Gracilis_muscle.r.obj", []),
    ("bones/Femur.r.obj", "bones/Tibia.r.obj", []),
    ("bones/Femur.r.obj", "bones/Tibia.r.obj", ["--blend", "laplacian"]),
    ("bones/Radius.r.obj", "bones/Ulna.r.obj", []),
]
REGISTRATIONS = [
    ("muscles/Gluteus_medius_muscle.r.obj", "muscles-fine/gluteus_medius.obj", []),
    ("muscles/Gluteus_medius_muscle.r.obj", "muscles-fine/gluteus_medius.obj", ["--non-rigid"]),
]


def morphing():
    """Morphs and registers real bodies and takes rows from summary.json and measures.csv."""
    found = {"numbers": {}, "notes": {}, "rows": {}}
    if "PLIANT_DATA" not in os.environ:
        print("skipped: morphing needs the measured data, in PLIANT_DATA")
        return found
    body = pathlib.Path(os.environ["PLIANT_DATA"]) / "body"
    subprocess.run(["cargo", "build", "--release"], cwd=ROOT, check=True)
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))

    def run(what, a, b, more):
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder) / "run"
            command = [target / "release" / "pliant", what, body / a, body / b, "--json", "--out", out, *more]
            done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
            if done.returncode != 0:
                sys.exit(f"{what} of {a} and {b}: exit code {done.returncode}")
            measures = out / "measures.csv"
            return json.loads(done.stdout)[what], measures.read_text().splitlines() if measures.exists() else []

    called = lambda what, a, b, more: "`" + " ".join(["pliant", what, a.split("/")[1], b.split("/")[1], *more]) + "`"
    for a, b, more in MORPHS:
        summary, measures = run("morph", a, b, more)
        volume = {float(t): float(v) for t, v, _ in (line.split(",") for line in measures[1:])}
        # That of a body whose size is the mean of both.
        like = ((volume[0.0] ** (1 / 3) + volume[1.0] ** (1 / 3)) / 2) ** 3
        times, ends = summary["times"], max(summary[k]["end_error"] for k in "ab")
        found["rows"].setdefault("morphing.found", []).append(
            f"| {called('morph', a, b, more)} | {summary['a']['vertices']:,} and {summary['b']['vertices']:,} "
            f"| {summary['vertices']:,} | {summary['flipped_a'] + summary['flipped_b']} | {ends:.0e} | {volume[0.5] / like:.3f} "
            f"| {times['map_a_s'] + times['map_b_s']:.2f} | {times['align_s']:.2f} | {times['merge_s']:.2f} | {times['blend_s']:.2f} |"
        )
    for a, b, more in REGISTRATIONS:
        summary, _ = run("register", a, b, more)
        times = summary["times"]
        found["rows"].setdefault("morphing.registered", []).append(
            f"| {called('register', a, b, more)} | {summary['inlier_share']:.0%} | {summary['residual']['rms'] / summary['size']:.2%} "
            f"| {times['start_s']:.2f} | {times['icp_s']:.2f} | {times['bend_s']:.2f} |".replace("%", " %")
        )
    return found


def readers():
    """Other programs' readers, where Python has them."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(PEERS + ["--bin", "read", "--", folder], cwd=ROOT, check=True)
        text = said(sys.executable, "benches/peers/read.py", folder)
    return parse(text)


def measure(name):
    begin = time.time()
    if name == "scenes":
        found = scenes()
    elif name == "readers":
        found = readers()
    elif name == "morphing":
        found = morphing()
    else:
        print("$", " ".join(COMMANDS[name]), flush=True)
        run = subprocess.run(COMMANDS[name], cwd=ROOT, stdout=subprocess.PIPE, text=True)
        sys.stdout.write(run.stdout)
        if run.returncode != 0:
            sys.exit(f"{name} failed: nothing of it is kept")
        found = parse(run.stdout)
        found["numbers"].update(estimates(begin))
    if not any(found.values()):
        print(f"{name} gave nothing: what is known of it stays")
        return None
    found["about"] = {"date": datetime.date.today().isoformat(), "commit": commit(), "seconds": round(time.time() - begin)}
    found["about"].update(machine())
    return found


HEADS = {
    "accuracy": "| scene | target | real error | stated error | time [s] | cheapest fixed steps: time [s] | ratio |",
    "morphing.found": "| command | vertices | in common | flipped | ends missed by | volume halfway | maps [s] | alignment [s] | merge [s] "
    "| 25 shapes [s] |",
    "morphing.registered": "| command | vertices on B | rms over the size | start [s] | closest points [s] | bending [s] |",
}


class Document:
    """The template with what is known."""

    def __init__(self, results):
        self.results = results
        self.numbers, self.notes, self.rows, self.missing = {}, {}, {}, []
        for found in results.values():
            self.numbers.update({k: v[0] for k, v in found.get("numbers", {}).items()})
            self.notes.update(found.get("notes", {}))
            self.rows.update(found.get("rows", {}))

    def value(self, text):
        """A number: a key, a plain number, or two of them with an operation between."""
        for sign, act in ((" / ", operator.truediv), (" + ", operator.add), (" - ", operator.sub), (" * ", operator.mul)):
            if sign in text:
                a, b = (self.value(part) for part in text.rsplit(sign, 1))
                return None if a is None or b is None or (act is operator.truediv and b == 0) else act(a, b)
        text = text.strip()
        if text in self.numbers:
            return self.numbers[text]
        return float(text) if re.fullmatch(r"-?[0-9.]+(e-?[0-9]+)?", text) else None

    def fill(self, match):
        text = match.group(1)
        word, _, rest = text.partition(" ")
        if word == "when" and rest in COMMANDS:
            about = self.results.get(rest, {}).get("about")
            return f"{about['date']}, commit {about['commit']}" if about else "not measured yet"
        if text in ("machine", "growth", "instructions"):
            return getattr(self, text)()
        if word == "rows":
            rows = self.rows.get(rest)
            if not rows:
                self.missing.append(text)
            return "\n".join(rows or [DASH])
        if word == "kept":
            value, sign, bound = re.fullmatch(r"(.+) (<=|>=) (\S+)", rest).groups()
            found = self.value(value)
            if found is None:
                return DASH
            return "yes" if (found <= float(bound) if sign == "<=" else found >= float(bound)) else "**no**"
        key, _, form = text.partition("|")
        if key in self.notes:
            return self.notes[key]
        found = self.value(key)
        if found is None:
            self.missing.append(text)
            return DASH
        return format(round(found) if form.endswith("d") else found, form or ".3g")

    def machine(self):
        """Benches by the machine they were measured on."""
        groups = {}
        for name in COMMANDS:
            about = self.results.get(name, {}).get("about")
            if about:
                what = tuple(about.get(k) or DASH for k in ("processor", "cores", "lanes", "memory", "rustc"))
                groups.setdefault((what, about["date"], about["commit"]), []).append(name)
        lines = ["| benches | processor | cores | lanes | memory | compiler | date | commit |", "|" + "---|" * 8]
        for (what, date, at), names in groups.items():
            lines.append("| " + " | ".join([", ".join(names), *map(str, what), date, at]) + " |")
        return "\n".join(lines)

    def growth(self):
        """Least times of ever larger meshes."""
        sizes = sorted(int(key.rsplit(".", 1)[1]) for key in self.numbers if key.startswith("step.growth.sweep."))
        lines = ["| vertices | sweep | factor | solve |", "|---|---|---|---|"]
        for n in sizes:
            times = (self.numbers.get(f"step.growth.{what}.{n}") for what in ("sweep", "factor", "solve"))
            lines.append(f"| {n:,} | " + " | ".join(DASH if t is None else f"{t:.3g}" for t in times) + " |")
        powers = (self.fill(re.match(r"(.+)", f"step.exponent.{what}|.2f")) for what in ("sweep", "factor"))
        lines.append("| exponent | " + " | ".join(powers) + " | |")
        return "\n".join(lines)

    def instructions(self):
        """The counts that are committed."""
        lines = ["| task | lanes | instructions |", "|---|---|---|"]
        for line in COUNTS.read_text().splitlines()[1:] if COUNTS.exists() else []:
            task, lanes, number, _ = line.split(",")
            lines.append(f"| {task} | {lanes} | {int(number):,} |")
        return "\n".join(lines)

    def with_tables(self, text):
        """A document with the rows between its comments, and when they were measured."""

        def table(match):
            begin, rows, bench, end = match.groups()
            about = self.results.get(bench, {}).get("about")
            when = f"Measured {about['date']}, commit {about['commit']}, on {about['cores']} cores." if about else "Not measured yet."
            head, lines = HEADS[rows], self.rows.get(rows, [])
            if not lines:
                self.missing.append(rows)
            cells = "|" + "---|" * (head.count("|") - 1)
            return begin + "\n".join([head, cells, *lines, "", when, end])

        return TABLE.sub(table, text)

    def text(self):
        return re.sub(r"\[\[(.+?)\]\]", self.fill, TEMPLATE.read_text())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="benches, separated by commas: " + ", ".join(COMMANDS))
    parser.add_argument("--skip", default="", help="benches that keep their older numbers")
    parser.add_argument("--resume", action="store_true", help="only what was not measured at this commit")
    parser.add_argument("--write", action="store_true", help="run nothing")
    parser.add_argument("--check", action="store_true", help="run nothing, compare")
    args = parser.parse_args()
    only, skip = ([n for n in text.split(",") if n] for text in (args.only, args.skip))
    unknown = [n for n in only + skip if n not in COMMANDS]
    if unknown:
        parser.error(f"no such bench: {', '.join(unknown)}; there are {', '.join(COMMANDS)}")
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    wanted = [] if args.write or args.check else [n for n in only or COMMANDS if n not in skip]
    if args.resume:
        now = commit()
        wanted = [n for n in wanted if results.get(n, {}).get("about", {}).get("commit") != now]
    for name in wanted:
        found = measure(name)
        if found:
            results[name] = found
            # After each, so that what was measured is kept whatever happens next.
            RESULTS.write_text(json.dumps(results, indent=1, sort_keys=True, ensure_ascii=False) + "\n")
    document = Document(results)
    texts = {DOCUMENT: document.text()}
    texts.update((path, document.with_tables(path.read_text())) for path in WITH_TABLES)
    if args.check:
        wrong = [str(path.relative_to(ROOT)) for path, text in texts.items() if path.read_text() != text]
        sys.exit(f"not what the template and the results give: {', '.join(wrong)}" if wrong else 0)
    for path, text in texts.items():
        path.write_text(text)
    if document.missing:
        print(f"{len(document.missing)} numbers are not measured yet: {', '.join(document.missing[:20])}")


if __name__ == "__main__":
    main()
