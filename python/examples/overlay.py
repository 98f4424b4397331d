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


def brain() -> Field:
    """Two folded hemispheres, white inside grey, at 1.25 mm."""
    x, y, z = places(136, 1.25)
    size = np.sqrt(((np.abs(x) - 30) / 34) ** 2 + ((y - 2) / 74) ** 2 + ((z - 4) / 52) ** 2)
    # Folds are where a field of waves is 0.
    folds = np.exp(-((waves(x, y, z, 24, 5) / 0.22) ** 2))
    outside = (size - 1) * 40 + 7 * folds
    ventricle = np.sqrt(((np.abs(x) - 12 - 0.15 * y) / 6) ** 2 + ((y - 2) / 26) ** 2 + ((z - 12) / 9) ** 2)
    return (70 * edge(outside) + 30 * edge(outside + 9)) * (1 - 0.75 * edge((ventricle - 1) * 8))


def activation() -> Field:
    """Scores at 3 mm: four places over 0, three under 0, and noise."""
    x, y, z = places(60, 3)
    total = 0.55 * waves(x, y, z, 16, 9)
    for at, width, score in [
        ((-42, 18, 38), 8, 9), ((40, 20, 40), 7, 6), ((-48, -16, 8), 8, 7), ((4, 62, 4), 9, 8),
        ((3, -50, 10), 8, -8), ((2, 46, 34), 8, -7), ((44, 44, 30), 8, -6),
    ]:
        total += score * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2 + (z - at[2]) ** 2) / (2 * width**2))
    return total


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
