"""Plain surfaces whose visibility and curvature are known, and a boxy vehicle to weather."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from svbrdfgan.types import Part, Surface


@dataclass(frozen=True)
class Texels:
    """As much of a geometry buffer as weathering needs."""

    position: np.ndarray
    normal: np.ndarray


def make_surface(positions, normals, faces) -> Surface:
    count = len(faces)
    return Surface(
        positions=np.asarray(positions, float),
        normals=np.asarray(normals, float),
        uv=np.zeros((len(positions), 2)),
        faces=np.asarray(faces),
        face_part=np.zeros(count, int),
        parts=(Part("body"),),
        elevation=np.zeros(len(positions)),
        source_face=np.arange(count),
        source_barycentric=np.tile(np.eye(3), (count, 1, 1)),
    )


def quads(corners, normals) -> Surface:
    """A surface of separate quads (quads, 4, 3), each with its own normal."""
    corners, normals = np.asarray(corners, float), np.asarray(normals, float)
    first = 4 * np.arange(len(corners))[:, None]
    faces = np.concatenate([first + np.array(three) for three in ([0, 1, 2], [0, 2, 3])])
    return make_surface(corners.reshape(-1, 3), np.repeat(normals, 4, axis=0), faces)


def box_sides(low, high, inward=False):
    """The six quads of a box, in the order -x +x -y +y -z +z, and their normals."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    corners, normals = [], []
    for axis in range(3):
        for side in (0, 1):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            quad = np.tile(np.where(np.arange(3) == axis, (low, high)[side], low), (4, 1))
            quad[[1, 2], u] = high[u]
            quad[[2, 3], v] = high[v]
            corners.append(quad)
            normals.append(np.eye(3)[axis] * (2 * side - 1) * (-1 if inward else 1))
    return np.array(corners), np.array(normals)


def texels_of(surface: Surface, size: int) -> Texels:
    """A grid of size x size texels over each quad of a surface, one quad above the other."""
    steps = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(steps, steps)
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=-1)
    corners = surface.positions.reshape(-1, 4, 3)
    position = np.einsum("ijk,qkc->qijc", weights, corners).reshape(-1, size, 3)
    normal = np.repeat(surface.normals.reshape(-1, 4, 3)[:, 0], size * size, axis=0).reshape(-1, size, 3)
    return Texels(position, normal)


def make_vehicle(scale: float = 1.0) -> Surface:
    """A body, a cabin and four box wheels, nose at +z."""
    boxes = [((-0.8, 0.3, -2.0), (0.8, 1.0, 2.0)), ((-0.7, 1.0, -1.2), (0.7, 1.5, 0.7))]
    boxes += [((x - 0.1, 0.0, z - 0.3), (x + 0.1, 0.6, z + 0.3)) for x in (-0.75, 0.75) for z in (-1.3, 1.2)]
    sides = [box_sides(*box) for box in boxes]
    return quads(scale * np.concatenate([c for c, _ in sides]), np.concatenate([n for _, n in sides]))


def floor(y=0.0, normal=(0.0, 1.0, 0.0)):
    """A square quad of side 2 at height y, and its normal."""
    return np.array([[-1.0, y, -1.0], [-1.0, y, 1.0], [1.0, y, 1.0], [1.0, y, -1.0]]), np.array(normal)


def flat(*pairs) -> Surface:
    """A surface of such pairs of quad and normal."""
    return quads(*map(np.array, zip(*pairs, strict=True)))


def sphere(radius: float) -> Surface:
    ball = trimesh.creation.icosphere(4, radius)
    return make_surface(ball.vertices, ball.vertices / radius, ball.faces)


@pytest.fixture(scope="session")
def shapes() -> SimpleNamespace:
    """The makers of surfaces, for tests that need their own."""
    makers = (make_surface, quads, box_sides, texels_of, make_vehicle, floor, flat, sphere)
    return SimpleNamespace(Texels=Texels, **{maker.__name__: maker for maker in makers})


@pytest.fixture(scope="session")
def arrays():
    """A record of tensors as a namespace of arrays."""

    def converted(record) -> SimpleNamespace:
        fields = {name: np.asarray(value) if hasattr(value, "numpy") else value for name, value in vars(record).items()}
        return SimpleNamespace(**fields)

    return converted


@pytest.fixture(scope="session")
def vehicle() -> Surface:
    return make_vehicle()


@pytest.fixture(scope="session")
def texels(vehicle: Surface) -> Texels:
    return texels_of(vehicle, 16)
