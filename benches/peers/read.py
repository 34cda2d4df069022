#!/usr/bin/env python3
"""Times PyPI's vtk and trimesh, where they are installed, on the files that `read FOLDER` wrote there.

    cargo run --release --manifest-path benches/peers/Cargo.toml --bin read -- FOLDER
    python3 benches/peers/read.py FOLDER

Each prints the best of seven readings; both must find the triangles that we find.
"""

import csv
import pathlib
import sys
import time

TRIANGLES = 199_712
VTK_READERS = {
    "obj": "vtkOBJReader", "ply": "vtkPLYReader", "stl": "vtkSTLReader", "vtk": "vtkPolyDataReader",
    "vtp": "vtkXMLPolyDataReader",
}


def by_vtk(path):
    import vtk

    if path.suffix[1:] not in VTK_READERS:
        return None
    reader = getattr(vtk, VTK_READERS[path.suffix[1:]])()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput().GetNumberOfPolys()


def by_trimesh(path):
    import trimesh

    if path.suffix in (".vtk", ".vtp"):
        return None
    return len(trimesh.load(path, process=False).faces)


def best(read, path):
    times = []
    for _ in range(7):
        begin = time.perf_counter()
        count = read(path)
        times.append(time.perf_counter() - begin)
        if count is None:
            return None
        assert count == TRIANGLES, f"{path}: {count} triangles"
    return min(times)


def main():
    folder = pathlib.Path(sys.argv[1])
    readers = {}
    for name, read in [("vtk", by_vtk), ("trimesh", by_trimesh)]:
        try:
            __import__(name)
            readers[name] = read
        except ImportError:
            print(f"skipped: {name} is not installed")
    if not readers:
        return
    with (folder / "pliant.csv").open() as file:
        for row in csv.DictReader(file):
            ours = float(row["seconds"])
            cells = []
            for name in ("vtk", "trimesh"):
                theirs = best(readers[name], folder / row["file"]) if name in readers else None
                cells.append(f"{theirs / ours:.1f}" if theirs else "–")
            print(f"ROW peers.python | {row['file']} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
