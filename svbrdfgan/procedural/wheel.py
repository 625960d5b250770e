"""Wheels and door mirrors as closed surfaces of revolution."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

_SEGMENTS = 25
_SPOKES = 5


def wheel(radius: float, width: float) -> tuple[Float[ndarray, "vertices 3"], Int[ndarray, "faces 3"], list[str]]:
    """Vertices, faces and part name of each face, for a wheel around the X axis whose outer side faces +X."""
    outer = 0.5 * width
    profile = np.array(  # (x / half width, r / radius), from the hub over the tread to the centre of the back
        [
            (0.62, 0.0),
            (0.62, 0.16),
            (0.42, 0.30),
            (0.50, 0.60),
            (0.86, 0.66),
            (1.0, 0.80),
            (0.84, 0.97),
            (0.55, 1.0),
            (-0.55, 1.0),
            (-0.9, 0.92),
            (-0.9, 0.0),
        ]
    ) * (outer, radius)
    parts = ["rim", "rim", "spokes", "rim", "tyre", "tyre", "tyre", "tyre", "tyre", "tyre"]
    positions, faces, band, segment = revolve(profile, _SEGMENTS)
    period = _SEGMENTS // _SPOKES
    gap = segment % period > period // 2
    names = [
        ("trim" if hole else "rim") if parts[k] == "spokes" else parts[k] for k, hole in zip(band, gap, strict=True)
    ]
    return positions, faces, names


def mirror(size: float) -> tuple[Float[ndarray, "vertices 3"], Int[ndarray, "faces 3"]]:
    """Vertices and faces of a door mirror: an ellipsoid of half-width `size`, centred at the origin."""
    angle = np.linspace(0.0, np.pi, 6)
    positions, faces, _, _ = revolve(np.stack([np.cos(angle), np.sin(angle)], axis=1), 8)
    return positions * (size, 0.62 * size, 0.5 * size), faces


def revolve(
    profile: Float[ndarray, "points 2"], segments: int
) -> tuple[Float[ndarray, "vertices 3"], Int[ndarray, "faces 3"], Int[ndarray, " faces"], Int[ndarray, " faces"]]:
    """The profile (x, r) rotated around X: vertices, faces, and each face's profile step and segment.

    The profile must run from its greatest x to its least: then faces point outward. Points on the axis are repeated;
    the caller must weld them.
    """
    angle = np.arange(segments) * (2.0 * np.pi / segments)
    x = np.broadcast_to(profile[:, :1], (len(profile), segments))
    y, z = profile[:, 1:] * np.cos(angle), profile[:, 1:] * np.sin(angle)
    positions = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    band, segment = (g.ravel() for g in np.meshgrid(np.arange(len(profile) - 1), np.arange(segments), indexing="ij"))
    a, b = band * segments + segment, band * segments + (segment + 1) % segments
    faces = np.concatenate([np.stack([a, a + segments, b + segments], axis=1), np.stack([a, b + segments, b], axis=1)])
    return positions, faces, np.tile(band, 2), np.tile(segment, 2)
