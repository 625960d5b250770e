"""The summary of a map as file and picture."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svbrdfgan.metrics.uv.summary import UVSummary
from svbrdfgan.metrics.uv.visibility import whole_surface
from svbrdfgan.report.uv_summary import atlas_picture, summary_json, write_summary
from svbrdfgan.report.uv_views import PAPER, UNSEEN, checker, look, paint
from svbrdfgan.types import Part, Surface


def rectangles(*uvs: np.ndarray, hidden: tuple[bool, ...] = ()) -> Surface:
    """Upright squares of a metre that face +Z, from the left to the right, each with the UVs of its four corners."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    count = len(uvs)
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(count)])
    return Surface(
        positions=np.concatenate([corners + np.array([1.5 * k, 0, 0]) for k in range(count)]),
        normals=np.tile([0.0, 0.0, 1.0], (4 * count, 1)),
        uv=np.concatenate(uvs),
        faces=faces,
        face_part=np.repeat(np.arange(count), 2),
        parts=tuple(Part(f"part {k}", hidden_half_of="part" if hidden and hidden[k] else None) for k in range(count)),
        elevation=np.zeros(4 * count),
        source_face=np.arange(2 * count),
        source_barycentric=np.tile(np.eye(3), (2 * count, 1, 1)),
    )


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
LEFT, RIGHT = SQUARE * (0.4, 0.8) + 0.05, SQUARE * (0.4, 0.8) + (0.55, 0.05)


def test_a_view_from_the_front_is_upright_and_not_mirrored() -> None:
    seen = look(rectangles(LEFT, RIGHT), 0.0, 0.0, 60, 40)
    height, width = seen.face.shape
    left, right = (seen.face[height // 2, width * k // 4] for k in (1, 3))
    assert (left // 2, right // 2) == (0, 1)
    column = seen.uv[:, width // 4, 1][seen.face[:, width // 4] >= 0]
    assert column[0] > 0.8 > 0.1 > column[-1]  # v is up
    assert look(rectangles(LEFT, RIGHT), math.pi, 0.0, 60, 40).face[height // 2, width // 4] // 2 == 1


def test_hidden_parts_are_grey_and_nothing_is_paper() -> None:
    surface = rectangles(LEFT, RIGHT, hidden=(False, True))
    seen = look(surface, 0.0, 0.0, 60, 40)
    picture = paint(seen, np.array([True, True, False, False]), lambda seen: np.zeros((*seen.face.shape, 3)))
    light = seen.light[40, 90]
    np.testing.assert_allclose(picture[20, 45], UNSEEN * light, atol=1e-9)
    np.testing.assert_allclose(picture[20, 15], 0.0)
    np.testing.assert_allclose(picture[0, 0], PAPER)


def test_the_checkerboard_has_its_squares() -> None:
    middles = (np.stack(np.meshgrid(np.arange(32), np.arange(32)), axis=-1) + 0.5) / 32
    value = checker(middles).max(axis=-1)
    assert np.unique(value.round(6)).tolist() == [0.55, 1.0]
    assert (value[1:] != value[:-1]).all()
    assert (value[:, 1:] != value[:, :-1]).all()


def test_the_atlas_shows_what_is_wrong() -> None:
    mirrored = RIGHT[[1, 0, 3, 2]]
    good, wrong = (
        atlas_picture(whole_surface(rectangles(LEFT, RIGHT)), 64),
        atlas_picture(whole_surface(rectangles(LEFT, mirrored)), 64),
    )
    redder = (wrong - good)[32, 48]
    assert redder[0] > redder[1] + 0.05
    np.testing.assert_array_equal(wrong[32, 16], good[32, 16])
    crowded = atlas_picture(whole_surface(rectangles(LEFT, LEFT)), 64)[32, 16] - good[32, 16]
    assert crowded[2] > crowded[0] + 0.05


@pytest.mark.full
def test_files(tmp_path: Path) -> None:
    summary = write_summary(tmp_path, rectangles(LEFT, RIGHT), "two squares")
    data = json.loads((tmp_path / "card.json").read_text())
    assert data == pytest.approx(summary.flat())
    assert data["stretch_linf"] == pytest.approx(math.sqrt(2), rel=1e-6)
    with Image.open(tmp_path / "card.png") as picture:
        assert picture.width > 1500
        assert np.asarray(picture.convert("RGB")).std() > 20


def test_a_measure_that_is_not_finite_is_null() -> None:
    surface = rectangles(LEFT)
    collapsed = UVSummary.of(whole_surface(replace(surface, uv=np.full_like(surface.uv, 0.5))))
    assert json.loads(summary_json(collapsed))["stretch_l2"] is None


def test_a_surface_of_which_nothing_is_seen_still_has_a_card(tmp_path: Path) -> None:
    summary = write_summary(tmp_path, rectangles(LEFT, hidden=(True,)), "nothing")
    assert summary.kept == 0.0
    assert json.loads((tmp_path / "card.json").read_text())["charts"] == 0
