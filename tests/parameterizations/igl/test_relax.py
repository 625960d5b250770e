"""What is collapsed or wrongly mirrored gets room from its neighbours; what is neither stays."""

import numpy as np
import pytest
from svbrdfgan_igl.relax import Planes, misfits, relaxed

Surface = tuple[np.ndarray, np.ndarray]


@pytest.fixture
def patch(square: Surface) -> Surface:
    """A piece of a mesh of size one, so small that what is wrong in it lies within reach of the springs."""
    return 0.2 * square[0], square[1]


def jacobians(surface: Surface, uv: np.ndarray) -> np.ndarray:
    positions, faces = surface
    return Planes.of(positions[faces]).jacobians(uv[faces])


def moved(surface: Surface, uv: np.ndarray, wrap: np.ndarray, mirrored: bool = False) -> np.ndarray:
    positions, faces = surface
    local = np.broadcast_to(wrap, (len(faces), 2, 2))
    return relaxed(Planes.of(positions[faces]), faces, uv, local, np.full(len(faces), mirrored))


def laid_flat(surface: Surface) -> np.ndarray:
    return surface[0][:, [0, 2]] * (1, -1)


def stepped(surface: Surface) -> Surface:
    """The patch with a step: its middle quarter stands upright, and is a line seen from above."""
    positions, faces = surface
    x = positions[:, 0]
    rise = np.clip(x - 0.075, 0.0, 0.05)
    return np.stack([x - rise, rise, positions[:, 2]], axis=1), faces


def test_jacobians_are_those_of_the_map(square: Surface) -> None:
    """Up to a turn of each plane's axes: singular values and determinant."""
    found = jacobians(square, laid_flat(square) @ np.diag([2.0, 0.5]))
    assert np.linalg.svd(found, compute_uv=False) == pytest.approx(np.tile([2.0, 0.5], (len(found), 1)))
    assert (np.linalg.det(found) > 0.0).all()


@pytest.mark.parametrize("scale", [(1.0, 1.0), (0.1, 0.3)])
def test_what_is_as_large_as_on_the_wrap_stays(square: Surface, scale: tuple[float, float]) -> None:
    """Also where the wrap's own map is small and stretched."""
    uv = laid_flat(square) * scale
    assert moved(square, uv, np.diag(scale)) == pytest.approx(uv, abs=1e-9)


def test_a_wall_gets_room(patch: Surface) -> None:
    surface = stepped(patch)
    start = laid_flat(surface)
    before, after = (np.linalg.det(jacobians(surface, uv)) for uv in (start, moved(surface, start, np.eye(2))))
    assert (np.abs(before) < 1e-12).mean() == pytest.approx(0.25)
    assert after.min() > 0.4


def test_a_fold_is_opened_unless_it_is_right(patch: Surface) -> None:
    uv = laid_flat(patch)
    folded = np.column_stack([np.where(uv[:, 0] > 0.175, 0.35 - uv[:, 0], uv[:, 0]), uv[:, 1]])
    assert (np.linalg.det(jacobians(patch, folded)) < 0.0).mean() == pytest.approx(0.125)
    assert np.linalg.det(jacobians(patch, moved(patch, folded, np.eye(2)))).min() > 0.0
    turned = uv * (-1.0, 1.0)
    assert moved(patch, turned, np.eye(2), mirrored=True) == pytest.approx(turned, abs=1e-9)


def test_triangles_without_an_area_do_no_harm(square: Surface) -> None:
    positions, faces = square
    surface = positions, np.concatenate([faces, [[0, 0, 1], [0, 1, 2]]])
    uv = laid_flat(square)
    assert moved(surface, uv, np.eye(2)) == pytest.approx(uv, abs=1e-9)


@pytest.mark.parametrize("mirrored", [False, True])
def test_what_found_no_room_lies_where_its_middle_is(patch: Surface, mirrored: bool) -> None:
    surface = stepped(patch)
    positions, faces = surface
    planes, wrap = Planes.of(positions[faces]), np.broadcast_to(np.diag([2.0, 0.5]), (len(faces), 2, 2))
    uv = laid_flat(surface)[faces] * ((-1 if mirrored else 1) * 2.0, 0.5)
    middle = uv.mean(axis=1) + 0.01
    some, corners = misfits(planes, uv, middle, wrap, np.full(len(faces), mirrored))
    assert (np.ptp(uv[some, :, 0], axis=1) < 1e-12).all()
    assert len(some) == pytest.approx(len(faces) / 4)
    assert corners.mean(axis=1) == pytest.approx(middle[some])
    uv[some] = corners
    placed = (np.linalg.inv(wrap) @ planes.jacobians(uv))[some]
    assert np.linalg.svd(placed, compute_uv=False).min() > 0.5
    assert (np.sign(np.linalg.det(placed)) == (-1 if mirrored else 1)).all()


def test_what_was_torn_apart_is_no_larger_than_its_surroundings(patch: Surface) -> None:
    positions, faces = patch
    planes, wrap = Planes.of(positions[faces]), np.broadcast_to(np.eye(2), (len(faces), 2, 2))
    uv = laid_flat(patch)[faces]
    torn = uv.copy()
    torn[3] = 10.0 * (torn[3] - torn[3].mean(axis=0)) + torn[3].mean(axis=0)
    some, corners = misfits(planes, torn, uv.mean(axis=1), wrap, np.zeros(len(faces), dtype=bool))
    assert some.tolist() == [3]
    assert corners[0] == pytest.approx(1.5 * (uv[3] - uv[3].mean(axis=0)) + uv[3].mean(axis=0))
