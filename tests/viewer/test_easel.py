"""The easel: one canvas that is painted again and again."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svbrdfgan.errors import AssetError
from svbrdfgan.inference.learned import LearnedWeathering
from svbrdfgan.inference.weatherings import RecipeWeathering
from svbrdfgan.inference.workpiece import open_workpiece
from svbrdfgan.io.gltf.document import read_document
from svbrdfgan.training.run import load_model
from svbrdfgan.viewer.documents import COARSE, LAYER, Superseded
from svbrdfgan.viewer.easel import Easel, RememberedSites
from svbrdfgan.weathering.recipes import Dust, Rust


@pytest.fixture(scope="module")
def easel(van: Path) -> Easel:
    return Easel.of(open_workpiece(van))


def test_a_layer_has_all_maps_at_the_size_that_was_asked_for(easel: Easel) -> None:
    maps = easel.paint(RecipeWeathering(Rust(amount=0.8)), COARSE)
    assert {name: values.shape for name, values in maps.items()} == {
        "base_color": (COARSE, COARSE, 4),
        "orm": (COARSE, COARSE, 3),
        "normal": (COARSE, COARSE, 3),
    }
    assert 0.02 < maps["base_color"][..., 3].mean() / 255.0 < 0.9


def test_seeds_and_amounts_change_the_layer(easel: Easel) -> None:
    alphas = [
        easel.paint(RecipeWeathering(Dust(amount=amount, seed=seed)), COARSE)["base_color"][..., 3]
        for amount, seed in ((0.2, 0), (0.9, 0), (0.9, 1))
    ]
    assert alphas[0].mean() < alphas[1].mean()
    assert (alphas[1] != alphas[2]).mean() > 0.05


def test_remembered_sites_change_no_bit(easel: Easel) -> None:
    weathering = RecipeWeathering(Rust(amount=0.7, seed=3))
    first, again = (easel.paint(weathering, COARSE) for _ in range(2))
    fresh = Easel(easel.workpiece, easel.over, RememberedSites(easel.workpiece.surroundings))
    alone = fresh.paint(weathering, COARSE)
    for name, values in first.items():
        assert np.array_equal(values, again[name])
        assert np.array_equal(values, alone[name])


def test_a_stale_painting_stops(easel: Easel) -> None:
    asked = iter([False, True])
    with pytest.raises(Superseded):
        easel.paint(RecipeWeathering(Dust()), 2 * COARSE, lambda: next(asked, True))


def test_a_draft_of_a_model_is_near_the_whole(easel: Easel) -> None:
    """What can be seen from outside is painted by the outermost peel, and so a draft changes little of it."""
    weathering = LearnedWeathering.of(load_model("rust"), seed=1)
    draft, again = (easel.paint(weathering, COARSE, draft=True)["base_color"] for _ in range(2))
    whole = easel.paint(weathering, 2 * COARSE)["base_color"]
    coarse = np.asarray(Image.fromarray(whole[..., 3]).resize((COARSE, COARSE), Image.Resampling.BOX))
    assert np.array_equal(draft, again)
    alpha = [values.astype(float).ravel() for values in (draft[..., 3], coarse)]
    assert np.corrcoef(alpha)[0, 1] > 0.85


def test_the_model_is_marked_where_the_layer_lies(easel: Easel, tmp_path: Path) -> None:
    path = tmp_path / "model.glb"
    path.write_bytes(easel.glb())
    document = read_document(path)
    materials = document.table("materials")
    marks = {
        materials[primitive["material"]]["name"]: primitive.get("extras", {}).get(LAYER)
        for mesh in document.table("meshes")
        for primitive in mesh["primitives"]
    }
    assert set(marks.values()) == {easel.over.number, None}
    for mesh in document.table("meshes"):
        for primitive in mesh["primitives"]:
            if LAYER in primitive.get("extras", {}):
                assert f"TEXCOORD_{easel.over.number}" in primitive["attributes"]
    assert document.path.stat().st_size > 1000
    assert LAYER not in str(easel.over.edited.document.header)


def test_the_floor_is_dark_beneath_and_white_at_the_border(easel: Easel) -> None:
    data, (x, y, z, half) = easel.shadow()
    grey = np.asarray(Image.open(BytesIO(data)).convert("L")).astype(float) / 255.0
    middle = len(grey) // 2
    assert grey[middle - 4 : middle + 4, middle - 4 : middle + 4].mean() < 0.5
    border = np.concatenate([grey[0], grey[-1], grey[:, 0], grey[:, -1]])
    assert border.min() == 1.0
    low = easel.workpiece.mesh.positions.min(axis=0)
    assert y == pytest.approx(low[1])
    assert half > 0.0
    assert abs(x) + abs(z) < half


def test_what_does_not_weather_is_refused(van: Path) -> None:
    with pytest.raises(AssetError, match=r"nothing of .* weathers"):
        Easel.of(open_workpiece(van, keep=["*"]))
