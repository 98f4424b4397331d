"""Meshes and depth buffers of the objects that Python programs hold."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _native

__all__ = ["depth_of", "meshes_of"]


def meshes_of(meshes: Any) -> list[_native.Mesh]:
    """Return native meshes of one mesh or of several, each maybe with a colour: ``mesh`` or ``(mesh, "gold")``.

    A mesh is a path, an object with points and faces (pyvista) or vertices and faces (trimesh), or two arrays (vertices,
    triangles).
    """
    if meshes is None:
        return []
    several = isinstance(meshes, list) or (isinstance(meshes, Iterable) and not _is_mesh(meshes))
    return [_mesh_of(one) for one in (meshes if several else [meshes])]


def _is_mesh(data: Any) -> bool:
    return isinstance(data, (str, os.PathLike, tuple)) or hasattr(data, "faces")


def _mesh_of(data: Any) -> _native.Mesh:
    color = None
    if isinstance(data, tuple) and len(data) == 2 and isinstance(data[1], str):
        data, color = data
    if isinstance(data, (str, os.PathLike)):
        return _native.Mesh.of_file(data, color)
    if isinstance(data, tuple) and len(data) == 2:
        vertices, triangles = data
    elif hasattr(data, "n_faces_strict"):
        surface = data.triangulate()
        vertices, triangles = surface.points, np.asarray(surface.faces).reshape(-1, 4)[:, 1:]
    elif hasattr(data, "vertices") and hasattr(data, "faces"):
        vertices, triangles = data.vertices, data.faces
    else:
        raise ValueError(f"meshes: a {type(data).__name__}, expected a path, a mesh of pyvista or trimesh, or two arrays")
    return _native.Mesh.of_arrays(_rows("vertices", vertices, np.float32), _indices(triangles), None, color)


def _indices(triangles: Any) -> NDArray[np.uint32]:
    array = np.asarray(triangles)
    if array.size and (not np.issubdtype(array.dtype, np.integer) or array.min() < 0):
        raise ValueError("meshes: triangles must be numbers of vertices, from 0")
    return _rows("triangles", array, np.uint32)


def _rows(name: str, values: Any, dtype: Any) -> NDArray[Any]:
    array = np.ascontiguousarray(values, dtype=dtype)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"meshes: {name} of shape {array.shape}, expected (n, 3)")
    return array


def depth_of(depth: Any) -> NDArray[np.float32] | None:
    """Return a depth buffer as f32."""
    if depth is None:
        return None
    array = np.ascontiguousarray(depth, dtype=np.float32)
    if array.ndim != 2:
        raise ValueError(f"depth: an array of shape {array.shape}, expected (height, width)")
    return array
