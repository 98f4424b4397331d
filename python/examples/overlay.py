"""A statistical map over a brain, both made here: docs/overlay.png."""

from __future__ import annotations

import sys

import numpy as np
import voxsplat
from numpy.typing import NDArray

Field = NDArray[np.float64]


def places(count: int, spacing: float) -> tuple[Field, Field, Field]:
    """World coordinates x, y, z of a cube of samples around the origin, in axes (z, y, x)."""
    line = (np.arange(count) - (count - 1) / 2) * spacing
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    return x, y, z


def waves(x: Field, y: Field, z: Field, length: float, seed: int) -> Field:
    """A smooth field of about -1 to 1 whose waves have a length and all directions."""
    numbers = np.random.default_rng(seed)
    total = np.zeros_like(x)
    for _ in range(24):
        direction = numbers.normal(size=3)
        direction *= 2 * np.pi / length / np.linalg.norm(direction)
        total += np.cos(direction[0] * x + direction[1] * y + direction[2] * z + numbers.uniform(0, 2 * np.pi))
    return total / np.sqrt(24)


def edge(distance: Field) -> Field:
    return 1 / (1 + np.exp(distance / 0.8))


def depth(x: Field, y: Field, z: Field) -> Field:
    """The distance from the surface of two folded hemispheres, about, mm; negative inside."""
    size = np.sqrt(((np.abs(x) - 31) / 35) ** 2 + ((y - 2) / 74) ** 2 + ((z - 4) / 52) ** 2)
    # Folds are where a field of waves is 0.
    folds = np.exp(-((waves(x, y, z, 26, 5) / 0.16) ** 2))
    return np.maximum((size - 1) * 42, 2.5 - np.abs(x)) + 13 * folds * np.exp(-(((size - 1) * 42 / 12) ** 2))


def brain() -> Field:
    """White inside grey, at 1.25 mm; 0 outside, as behind a mask."""
    x, y, z = places(136, 1.25)
    outside = depth(x, y, z)
    ventricle = np.sqrt(((np.abs(x) - 11) / 6) ** 2 + ((y - 2) / 26) ** 2 + ((z - 12) / 9) ** 2)
    tissue = (70 * edge(outside) + 25 * edge(outside + 6)) * (1 - 0.8 * edge((ventricle - 1) * 8))
    return np.where(tissue < 3, 0, tissue)


def activation() -> Field:
    """Scores at 3 mm in the brain: five places over 0, three under 0, and noise."""
    x, y, z = places(60, 3)
    total = 0.55 * waves(x, y, z, 16, 9)
    for at, width, score in [
        ((-40, 10, 34), 8, 9), ((38, 14, 36), 7, 6), ((-46, -16, 4), 8, 7), ((8, 58, 4), 9, 8), ((42, -8, -18), 7, 6),
        ((5, -48, 14), 8, -8), ((6, 40, 32), 8, -7), ((44, 40, 24), 8, -6),
    ]:
        total += score * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2 + (z - at[2]) ** 2) / (2 * width**2))
    return np.where(depth(x, y, z) < 1, total, 0)


def volume(field: Field, spacing: float, unit: str | None = None) -> voxsplat.Volume:
    """A volume in the space of a patient, around its origin."""
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = -(len(field) - 1) / 2 * spacing
    units = {"length": "mm"} | ({"value": unit} if unit else {})
    return voxsplat.Volume(field.astype(np.float32), affine=affine, space="LPS", units=units)


if __name__ == "__main__":
    head, scores = volume(brain(), 1.25), volume(activation(), 3, "z")
    image = voxsplat.render(head, overlays=scores, azimuth=50, elevation=20, size=(560, 480))
    print(*image.choices, sep="\n")
    image.save(sys.argv[1] if len(sys.argv) > 1 else "overlay.png")
