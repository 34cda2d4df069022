#!/usr/bin/env python3
"""What VTK itself reads from `.vtk` and `.vtp` files: one line of JSON for each file named on the command line.

`points` are doubles, little-endian, in hexadecimal; `single` tells that VTK holds them as singles. `polys`, `strips` and
`lines` are lists of point indices. `triangles` is what vtkTriangleFilter makes of them. `error` stands alone.
"""

import json
import struct
import sys

import vtk

POLYS, STRIPS, LINES = ({5, 7, 8, 9}, {6}, {3, 4})


def read(path):
    reader = vtk.vtkXMLPolyDataReader() if path.endswith(".vtp") else vtk.vtkDataSetReader()
    errors = []
    for what in (reader, vtk.vtkOutputWindow.GetInstance()):
        what.AddObserver("ErrorEvent", lambda *_: errors.append("ErrorEvent"))
    reader.SetFileName(path)
    reader.Update()
    output = reader.GetOutputDataObject(0)
    if output is None or errors:
        return {"error": f"VTK gives an error ({len(errors)})"}
    if not output.IsA("vtkPolyData") and not output.IsA("vtkUnstructuredGrid"):
        return {"error": f"a {output.GetClassName()}"}
    return surface(output)


def corners(cell):
    return [cell.GetPointId(i) for i in range(cell.GetNumberOfPoints())]


def surface(output):
    found = {"polys": [], "strips": [], "lines": [], "volumes": 0}
    for i in range(output.GetNumberOfCells()):
        kind, cell = output.GetCellType(i), corners(output.GetCell(i))
        if kind == 8:
            # The corners of a pixel go by rows.
            cell[2], cell[3] = cell[3], cell[2]
        for name, kinds in (("polys", POLYS), ("strips", STRIPS), ("lines", LINES)):
            if kind in kinds:
                found[name].append(cell)
        if kind > 9:
            found["volumes"] += 1
    points = output.GetPoints()
    count = output.GetNumberOfPoints()
    numbers = [c for i in range(count) for c in points.GetPoint(i)]
    found["points"] = struct.pack(f"<{len(numbers)}d", *numbers).hex()
    found["single"] = count > 0 and points.GetDataType() == vtk.VTK_FLOAT
    if output.IsA("vtkPolyData"):
        split = vtk.vtkTriangleFilter()
        split.SetInputData(output)
        split.PassLinesOff()
        split.PassVertsOff()
        split.Update()
        found["triangles"] = split.GetOutput().GetNumberOfPolys()
    return found


def main():
    vtk.vtkObject.GlobalWarningDisplayOff()
    for path in sys.argv[1:]:
        print(json.dumps(read(path)), flush=True)


if __name__ == "__main__":
    main()
