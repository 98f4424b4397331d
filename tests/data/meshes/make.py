"""Writes the meshes of this folder by VTK: a square of one polygon, in each format. Needs pyvista."""

from pathlib import Path

import numpy as np
import pyvista
import vtk

HERE = Path(__file__).parent
square = pyvista.PolyData(np.array([[0, 0, 0.5], [1, 0, 0.5], [1, 1, 0.5], [0, 1, 0.5]], np.float32), [4, 0, 1, 2, 3])
square["height"] = np.arange(4.0)
square.save(HERE / "inline.vtp")
square.save(HERE / "text.vtp", binary=False)
triangles = square.triangulate()
triangles.save(HERE / "binary.ply")
triangles.save(HERE / "text.ply", binary=False)
triangles.save(HERE / "binary.stl")
triangles.save(HERE / "text.stl", binary=False)
triangles.save(HERE / "text.obj")
writer = vtk.vtkXMLPolyDataWriter()
writer.SetInputData(square)
writer.SetDataModeToAppended()
writer.EncodeAppendedDataOff()
writer.SetHeaderTypeToUInt64()
writer.SetFileName(str(HERE / "appended.vtp"))
writer.Write()
