"""The demo's first picture: a vehicle under several weatherings, each in a cell of its own."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svbrdfgan.experiments.demo import opening
from svbrdfgan.experiments.demo.opening import Cell, demo_rows, write_opening
from svbrdfgan.inference import studio as studio_module
from svbrdfgan.inference.studio import BOUNCES, Studio
from svbrdfgan.inference.weatherings import RecipeWeathering
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.models.shipped import shipped_models
from svbrdfgan.plugins.registry import load_bouncing
from svbrdfgan.procedural.softboxes import build_studio
from svbrdfgan.types import Mesh, Part
from svbrdfgan.weathering.recipes import Dust, RoadDirt


@pytest.fixture
def studio(monkeypatch: pytest.MonkeyPatch, quick_glossy_renderer: str) -> Studio:
    """In which pictures are small and noisy."""
    for module in (opening, studio_module):
        monkeypatch.setattr(module, "can_denoise", lambda: False)
    for name, value in {"WIDTH": 91, "_ASPECT": 1.8, "_PAINTED": 32, "_SPP": (4, 4), "_LABEL": 1}.items():
        monkeypatch.setattr(opening, name, value)
    return Studio(load_bouncing(quick_glossy_renderer, {}, BOUNCES), build_studio())


def test_the_demo_shows_two_recipes_with_two_seeds_and_three_amounts() -> None:
    shown = [cell.weathering.description for row in demo_rows() for cell in row]
    for each, (name, seed) in zip(shown[::3], product(("rust", "road-dirt"), (0, 1)), strict=True):
        assert (each["model" if name in shipped_models() else "recipe"], each["seed"]) == (name, seed)
    for row in range(0, len(shown), 3):
        assert sorted({each["amount"] for each in shown[row : row + 3]}) == [e["amount"] for e in shown[row : row + 3]]


def test_each_weathering_has_its_cell(tmp_path: Path, studio: Studio) -> None:
    vehicle, picture = tmp_path / "box.glb", tmp_path / "opening.png"
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (0.0, 1.0) for z in (-2.0, 2.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))])
    save_mesh_glb(vehicle, Mesh(corners, faces, np.zeros(len(faces), np.int64), (Part("paint", (0.02, 0.1, 0.4)),)))
    clean, dusty, dirty = (RecipeWeathering(r) for r in (RoadDirt(amount=0.0), Dust(amount=1.0), RoadDirt(amount=1.0)))
    rows = [[Cell("clean", clean), Cell("dusty", dusty)], [Cell("dirty", dirty), Cell("clean", clean)]]
    before = vehicle.read_bytes()
    assert len(list(write_opening(picture, vehicle, rows, studio))) == 4
    sheet = np.asarray(Image.open(picture), np.float32)
    assert sheet.shape == (2 * 24 + 5, 91, 3)
    cells = [sheet[top : top + 24, left : left + 43] for top in (0, 29) for left in (0, 48)]
    assert (sheet[24:29] == 255).all()
    clean_again = abs(cells[0][8:] - cells[3][8:]).mean()  # without the label
    assert all(abs(other[8:] - cells[0][8:]).mean() > 4 * clean_again + 1 for other in cells[1:3])
    assert vehicle.read_bytes() == before
