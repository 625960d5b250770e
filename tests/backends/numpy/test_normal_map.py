"""Tilted normals: their frame, the bend towards the viewer, and derivatives of both."""

import numpy as np
import pytest
from numpy import ndarray
from svbrdfgan_numpy import NumpyRenderer
from svbrdfgan_numpy.bvh import search
from svbrdfgan_numpy.normal_map import Frame
from svbrdfgan_numpy.surface import Points, frames_at, points_at

from svbrdfgan.testing import scenes
from svbrdfgan.types import Surface

FLAT = np.array([0.0, 0.0, 1.0])


def _unit(vectors: ndarray) -> ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _frames(count: int, seed: int = 0) -> Frame:
    """Random axes, left-handed ones too, seen from random directions in front."""
    random = np.random.default_rng(seed)
    axes = np.linalg.qr(random.normal(size=(count, 3, 3)))[0]
    outgoing = _unit(random.normal(size=(count, 3)))
    outgoing *= np.where((outgoing * axes[:, 2]).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    return Frame(axes, outgoing)


def _texels(count: int, seed: int = 1) -> ndarray:
    """Random numbers of a normal map, with z > 0 and of any length."""
    texels = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3))
    texels[:, 2] = np.abs(texels[:, 2])
    return texels


def _cosines(frame: Frame, normal: ndarray) -> tuple[ndarray, ndarray, ndarray]:
    """n . N, w_o . N and n . w_o."""
    surface = frame.axes[:, 2]
    pairs = ((normal, surface), (frame.outgoing, surface), (normal, frame.outgoing))
    return tuple((first * second).sum(axis=1) for first, second in pairs)


def test_a_flat_map_changes_nothing() -> None:
    frame = _frames(500)
    assert np.allclose(frame.tilted(np.broadcast_to(0.7 * FLAT, (500, 3))), frame.axes[:, 2], atol=1e-15)


def test_it_is_the_sum_along_the_axes_bent_as_the_conventions_say() -> None:
    frame, texels = _frames(5000), _texels(5000)
    unbent = np.einsum("pa,pac->pc", _unit(texels), frame.axes)
    a, b, c = _cosines(frame, unbent)
    below = b - 2.0 * a * c > 0.0
    k = np.where(below, (b - 2.0 * a * c) / (a + np.sqrt(np.abs(a**2 + b * (b - 2.0 * a * c)))), 0.0)
    truth = _unit(unbent + k[:, None] * frame.outgoing)
    assert 0.1 < below.mean() < 0.9
    assert np.allclose(frame.tilted(texels), truth, atol=1e-12)
    a, b, c = _cosines(frame, frame.tilted(texels))
    assert np.allclose(2.0 * (a * c)[below], b[below], atol=1e-12)
    assert (c > 0.0).all()


def test_whatever_the_map_holds_normals_have_unit_length() -> None:
    """Seen at the horizon a normal that points below the surface is bent until it is the viewer's direction."""
    axes = np.broadcast_to(np.eye(3), (4, 3, 3))
    grazing = Frame(axes, np.repeat([[1.0, 0.0, 0.0]], 4, axis=0))
    texels = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, -0.5], [0.0, 1.0, 0.0], [-1.0, 0.0, 1e-9]])
    normals = grazing.tilted(texels)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert np.allclose(normals[0], FLAT)
    assert np.allclose(normals[1], [1.0, 0.0, 0.0])
    gradient = grazing.tilted_vjp(texels, np.ones((4, 3)))
    assert np.isfinite(gradient).all()
    assert not gradient[0].any()


@pytest.mark.parametrize("bent", [False, True])
def test_the_gradient_is_the_derivative(bent: bool) -> None:
    """At each point, along a random direction, by central differences of fourth order."""
    frame, texels, random = _frames(4000), _texels(4000), np.random.default_rng(2)
    texels = texels * 0.9 + [0.0, 0.0, 0.1]  # the shorter, the more curved
    a, b, c = _cosines(frame, np.einsum("pa,pac->pc", _unit(texels), frame.axes))
    some = (b - 2.0 * a * c > 0.01) if bent else (b - 2.0 * a * c < -0.01)
    frame, texels = Frame(frame.axes[some], frame.outgoing[some]), texels[some]
    grad, along = random.normal(size=texels.shape), random.normal(size=texels.shape)

    def change(step: float) -> ndarray:
        there, back = (frame.tilted(texels + s * along) for s in (step, -step))
        return ((there - back) * grad).sum(axis=1) / (2.0 * step)

    slope = (4.0 * change(1e-4) - change(2e-4)) / 3.0
    found = (frame.tilted_vjp(texels, grad) * along).sum(axis=1)
    assert len(found) > 500
    assert np.allclose(found, slope, rtol=1e-6, atol=1e-6)


def _seen(surface: Surface, origin: tuple[float, float, float], target: tuple[float, float, float]) -> Points:
    """Where a ray from one point to another meets the surface."""
    direction = _unit(np.subtract(target, origin))[None]
    prepared = NumpyRenderer().prepare(surface)
    return points_at(prepared, search(prepared.bvh, np.array([origin]), direction), direction)


def _axes(surface: Surface, origin: tuple[float, float, float], target: tuple[float, float, float]) -> ndarray:
    prepared = NumpyRenderer().prepare(surface)
    return frames_at(prepared, _seen(surface, origin, target), np.arange(1)).axes[0]


def test_the_frame_follows_the_uvs_and_turns_to_the_viewer() -> None:
    """On a plane in z = 0 with u to the right and v up. From behind relief pushes through: every axis turns."""
    assert np.allclose(_axes(scenes.plane(), (0.2, 0.1, 2.0), (0.1, 0.3, 0.0)), np.eye(3))
    assert np.allclose(_axes(scenes.plane(), (0.2, 0.1, -2.0), (0.1, 0.3, 0.0)), -np.eye(3))


def test_the_frame_of_mirrored_uvs_is_left_handed() -> None:
    plain = scenes.plane()
    mirrored = Surface(**{**vars(plain), "uv": plain.uv * [-1.0, 1.0] + [1.0, 0.0]})
    for height, turned in ((2.0, 1.0), (-2.0, -1.0)):
        axes = _axes(mirrored, (0.2, 0.1, height), (0.1, 0.3, 0.0))
        assert np.allclose(axes, turned * np.diag([-1.0, 1.0, 1.0]))


def test_the_frame_between_corners_is_orthonormal() -> None:
    axes = _axes(scenes.sphere(), (0.3, 0.2, 3.0), (0.3, 0.2, 0.0))
    assert np.allclose(axes @ axes.T, np.eye(3))
    assert axes[0, 0] > 0.9
    assert np.linalg.det(axes) == pytest.approx(1.0)
