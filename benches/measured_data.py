"""Where the tables of measured muscles find the program and the data. Standard library only."""

import argparse
import os
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAM = ROOT / "target" / "release" / "pliant"
DATA = pathlib.Path(os.environ.get("PLIANT_DATA", ROOT.parent / "shared" / "data"))


def parser(about):
    """A parser whose `names` choose meshes by parts of their names."""
    made = argparse.ArgumentParser(description=about.split("\n")[0])
    made.add_argument("names", nargs="*")
    return made


def is_named(name, names):
    """Whether a mesh is among those chosen: all of them without names."""
    return not names or any(part.lower() in name.lower() for part in names)


def is_ready():
    """Whether there are data. Ends with a message if the program is not built."""
    if not DATA.is_dir():
        print(f"skipped: no data in {DATA}")
        return False
    if not PROGRAM.is_file():
        sys.exit("build it first: cargo build --release -p pliant-cli")
    return True
