#!/usr/bin/env python3
"""Writes the bones and muscles of a joint as a segmentation of another subject would have them.

    python3 benches/subject.py knee scans [--raw] [--right] [--spacing 0.9 0.9 1.5]

The measured meshes of PLIANT_DATA are scaled by other factors along each axis, bent by a few millimetres, mirrored to
the left side, turned into the axes of a scanner and shifted far from the origin, in millimetres. Then they are drawn
into voxels and read back as the surfaces of the voxels, smoothed as segmentation programs do (--raw: not smoothed), as
STL. Needs numpy and VTK.
"""

import argparse
import os
import pathlib

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

ROOT = pathlib.Path(__file__).resolve().parent.parent

SETS = {
    "knee": (
        ["Femur.r", "Tibia.r"],
        ["Vastus_lateralis_muscle", "Rectus_femoris", "Gracilis_muscle", "Medial_head_of_gastrocnemius"],
    ),
    "hip": (
        ["Hip_bone.r", "Femur.r"],
        ["Gluteus_maximus_muscle", "Gluteus_medius_muscle", "Iliacus_muscle", "Pectineus_muscle"],
    ),
    "shoulder": (
        ["Scapula.r", "Humerus.r"],
        [
            "Infraspinatus_muscle",
            "Subscapularis_muscle",
            "Long_head_of_biceps_brachii",
            "Short_head_of_biceps_brachii",
        ],
    ),
    "elbow": (
        ["Humerus.r", "Ulna.r", "Radius.r"],
        ["Brachialis_muscle", "Long_head_of_biceps_brachii", "Short_head_of_biceps_brachii"],
    ),
}


def other_subject(x, left):
    """Points [m] of one body in those of another one [mm]."""
    x = x * [0.94, 1.06, 1.03]
    k = 2 * np.pi / 0.35
    bend = [
        np.sin(k * x[:, 1] + 0.3) + 0.5 * np.sin(k * x[:, 2]),
        np.sin(k * x[:, 2] + 1.1),
        np.sin(k * x[:, 0] + 0.5 * k * x[:, 1]),
    ]
    x = x + 0.006 * np.stack(bend, axis=1)
    if left:
        x = x * [-1, 1, 1]
    upright = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    angle = np.radians(7)
    turned = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return 1000 * x @ (turned @ upright).T + [120, -340, -900]


def segmented(surface, spacing, smooth):
    """The surface of the voxels inside a closed surface."""
    low, high = (np.array(surface.GetBounds()).reshape(3, 2)).T
    low = low - 3 * spacing
    image = vtk.vtkImageData()
    image.SetSpacing(spacing)
    image.SetOrigin(low)
    image.SetDimensions(*(int(n) for n in np.ceil((high - low) / spacing) + 4))
    image.AllocateScalars(vtk.VTK_UNSIGNED_CHAR, 1)
    vtk_to_numpy(image.GetPointData().GetScalars())[:] = 1
    stencil = vtk.vtkPolyDataToImageStencil()
    stencil.SetInputData(surface)
    stencil.SetOutputOrigin(low)
    stencil.SetOutputSpacing(spacing)
    stencil.SetOutputWholeExtent(image.GetExtent())
    inside = vtk.vtkImageStencil()
    inside.SetInputData(image)
    inside.SetStencilConnection(stencil.GetOutputPort())
    inside.SetBackgroundValue(0)
    last = vtk.vtkDiscreteFlyingEdges3D()
    last.SetInputConnection(inside.GetOutputPort())
    last.SetValue(0, 1)
    if smooth:
        smoother = vtk.vtkWindowedSincPolyDataFilter()
        smoother.SetInputConnection(last.GetOutputPort())
        smoother.SetNumberOfIterations(20)
        smoother.SetPassBand(0.01)
        smoother.BoundarySmoothingOff()
        smoother.FeatureEdgeSmoothingOff()
        smoother.NonManifoldSmoothingOn()
        smoother.NormalizeCoordinatesOn()
        last = smoother
    last.Update()
    return last.GetOutput()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("joint", choices=SETS)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--raw", action="store_true", help="do not smooth")
    parser.add_argument("--right", action="store_true", help="do not mirror")
    parser.add_argument("--spacing", type=float, nargs=3, default=[0.9, 0.9, 1.5], help="of voxels [mm]")
    given = parser.parse_args()
    data = pathlib.Path(os.environ.get("PLIANT_DATA", ROOT.parent / "shared" / "data")) / "body"
    if not data.is_dir():
        raise SystemExit(f"no measured data in {data}: set PLIANT_DATA")
    given.out.mkdir(parents=True, exist_ok=True)
    bones, muscles = SETS[given.joint]
    side = "right" if given.right else "left"
    files = [("bones", bone) for bone in bones] + [("muscles", f"{muscle}.r") for muscle in muscles]
    for folder, name in files:
        reader = vtk.vtkOBJReader()
        reader.SetFileName(str(data / folder / f"{name}.obj"))
        reader.Update()
        surface = reader.GetOutput()
        points = vtk_to_numpy(surface.GetPoints().GetData()).astype(float)
        moved = np.ascontiguousarray(other_subject(points, not given.right))
        surface.GetPoints().SetData(numpy_to_vtk(moved, deep=True))
        # Mirroring turns the surface inside out.
        outward = vtk.vtkPolyDataNormals()
        outward.SetInputData(surface)
        outward.AutoOrientNormalsOn()
        outward.ConsistencyOn()
        outward.SplittingOff()
        outward.Update()
        result = segmented(outward.GetOutput(), np.array(given.spacing), not given.raw)
        words = name.removesuffix(".r").replace("_muscle", "").replace("_", " ").lower()
        path = given.out / f"Segmentation_{words} {side}.stl"
        writer = vtk.vtkSTLWriter()
        writer.SetFileTypeToBinary()
        writer.SetFileName(str(path))
        writer.SetInputData(result)
        writer.Write()
        print(f"{path}: {result.GetNumberOfPoints()} vertices")


if __name__ == "__main__":
    main()
