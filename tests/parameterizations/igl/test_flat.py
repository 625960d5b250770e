"""Maps of surfaces whose best map is known; derivatives against finite differences; no flips, no crossings."""

import numpy as np
import pytest
from svbrdfgan_igl.boundary_barrier import BoundaryBarrier
from svbrdfgan_igl.collision_barrier import SelfCollisionBarrier
from svbrdfgan_igl.crossing import loop_crosses_itself
from svbrdfgan_igl.energy import DistortionEnergy, RestTriangles, stretch
from svbrdfgan_igl.flatten import Boundary, conformal, least_stretch, one_to_one, packed
from svbrdfgan_igl.topology import Disk
from svbrdfgan_igl.tutte import tutte

Surface = tuple[np.ndarray, np.ndarray]


def test_stretch_has_known_values(square: Surface) -> None:
    """An isometry has 1, whatever its size; a square drawn out to 1 : a has sqrt((a + 1 / a) / 2)."""
    positions, faces = square
    uv = positions[:, [0, 2]] * (1, -1)
    assert stretch(positions, faces, 7.0 * uv) == pytest.approx(1.0)
    assert stretch(positions, faces, uv * (1.0, 1.6)) == pytest.approx(np.sqrt((1.6 + 1 / 1.6) / 2))
    assert stretch(positions, faces, uv * (1, -1)) == np.inf


@pytest.mark.parametrize("distortion", [DistortionEnergy(2, 0.5), DistortionEnergy(1, -1.0)])
def test_gradients_are_those_of_finite_differences(hemisphere: Surface, distortion: DistortionEnergy) -> None:
    disk = Disk(*hemisphere)
    triangles, uv = RestTriangles.of(*hemisphere), tutte(disk)
    blocks, hessian = distortion.derivatives(triangles, uv)
    gradient = np.zeros_like(uv)
    np.add.at(gradient, triangles.faces, blocks.reshape(-1, 3, 2))
    step = np.random.default_rng(0).normal(size=uv.shape)
    ahead, behind = (distortion.value(triangles, uv + s * 1e-6 * step) for s in (1, -1))
    assert (ahead - behind) / 2e-6 == pytest.approx((gradient * step).sum(), rel=1e-5)
    assert np.linalg.eigvalsh(hessian).min() > -1e-9 * np.abs(hessian).max()


@pytest.mark.parametrize("shape", ["square", "disk"])
def test_walls_push_inward_as_their_value_says(shape: str) -> None:
    rng = np.random.default_rng(1)
    uv, step = rng.uniform(-0.3, 0.3, (6, 2)), rng.normal(size=(6, 2))
    walls = BoundaryBarrier(shape, np.arange(6), np.full(6, 1 / 6), 0.02)  # type: ignore[arg-type]
    ahead, behind = (walls.value(uv + s * 1e-6 * step) for s in (1, -1))
    assert (ahead - behind) / 2e-6 == pytest.approx((walls.derivatives(uv)[0] * step).sum(), rel=1e-6)
    assert walls.value(uv + np.array([0.9, 0.0])) == np.inf


def test_contact_pushes_apart_as_its_value_says() -> None:
    """A horseshoe whose ends nearly meet."""
    turn = np.linspace(0.1, 2 * np.pi - 0.1, 20)
    arc = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = np.concatenate([arc, 0.8 * arc[::-1]])
    start = points * 1.0
    contact = SelfCollisionBarrier(np.arange(40), np.full(40, 1 / 40), 4 * start, 0.3, 0.02)
    vertices, blocks, _ = contact.derivatives(points)
    gradient = np.zeros_like(points)
    np.add.at(gradient, vertices, blocks.reshape(-1, 3, 2))
    step = np.random.default_rng(2).normal(size=points.shape)
    ahead, behind = (contact.value(points + s * 1e-7 * step) for s in (1, -1))
    assert len(vertices) > 10
    assert (ahead - behind) / 2e-7 == pytest.approx((gradient * step).sum(), rel=1e-5)


def test_crossings_are_found() -> None:
    turn = 2 * np.pi * np.arange(7) / 7
    assert not loop_crosses_itself(np.stack([np.cos(turn), np.sin(turn)], axis=1))
    assert loop_crosses_itself(np.stack([np.cos(2 * turn), np.sin(2 * turn)], axis=1))  # a star


def test_a_flat_square_fills_the_square_without_stretch(square: Surface) -> None:
    disk = Disk(*square)
    uv = packed(least_stretch(disk, "square", 0.004), 0.0)
    assert stretch(*square, uv) < 1.003
    assert np.abs(uv - disk.positions[:, [0, 2]] * (1, -1)).max() < 0.02


def test_a_conformal_map_of_a_flat_surface_is_the_surface(oblong: Surface) -> None:
    uv = conformal(Disk(*oblong), "free", 0.004)
    assert stretch(*oblong, uv) == pytest.approx(1.0, abs=1e-6)
    width, height = np.ptp(uv, axis=0)
    assert width / height == pytest.approx(0.5)
    assert np.ptp(packed(uv, 0.1), axis=0) == pytest.approx([0.8, 0.8])


@pytest.mark.parametrize("boundary", ["free", "square", "disk"])
@pytest.mark.parametrize("flatten", [least_stretch, conformal])
def test_every_boundary_gives_a_one_to_one_map(hemisphere: Surface, flatten, boundary: Boundary) -> None:  # type: ignore[no-untyped-def]
    disk = Disk(*hemisphere)
    uv = flatten(disk, boundary, 0.004)
    assert one_to_one(disk, uv)
    triangles = RestTriangles.of(*hemisphere)
    filled = float((triangles.area * triangles.determinants(packed(uv, 0.0))).sum())
    if boundary == "square":
        assert filled > 0.9
    if boundary == "disk":
        assert filled == pytest.approx(np.pi / 4, abs=0.02)


def test_least_stretch_has_less_than_the_conformal_map(hemisphere: Surface) -> None:
    """Half a sphere: the conformal map is stereographic, of stretch sqrt(7 / 6) (its scale runs from 1 to 2)."""
    disk = Disk(*hemisphere)
    least, angle = (stretch(*hemisphere, f(disk, "free", 0.004)) for f in (least_stretch, conformal))
    assert least < angle
    assert angle == pytest.approx(np.sqrt(7 / 6), abs=0.02)
    assert least < 1.06


def test_nose_roof_and_sides_lie_where_the_docstring_says(hemisphere: Surface) -> None:
    positions, _ = hemisphere
    uv = packed(least_stretch(Disk(*hemisphere), "free", 0.004), 0.0)
    nose, tail = uv[np.argmax(positions[:, 2])], uv[np.argmin(positions[:, 2])]
    right, left = uv[np.argmin(positions[:, 0])], uv[np.argmax(positions[:, 0])]
    assert np.allclose(uv[0], 0.5, atol=0.02)
    assert np.allclose([*nose, *tail], [0.5, 0.0, 0.5, 1.0], atol=0.03)
    assert np.allclose([*right, *left], [0.0, 0.5, 1.0, 0.5], atol=0.03)
