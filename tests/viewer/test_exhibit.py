"""The documents of an exhibit."""

from __future__ import annotations

import json
from base64 import b64decode
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from svbrdfgan.errors import ConfigError
from svbrdfgan.inference.ground import Cove
from svbrdfgan.models.shipped import shipped_models
from svbrdfgan.viewer.choices import OFFERED
from svbrdfgan.viewer.documents import GLB, Unknown
from svbrdfgan.viewer.exhibit import Exhibit
from svbrdfgan.viewer.lights import COLS, ROWS, Light
from svbrdfgan.viewer.open import exhibit_of


def test_the_state_lists_what_can_be_chosen(exhibit: Exhibit) -> None:
    state = json.loads(exhibit.document("/state").data)
    (piece,) = state["pieces"]
    groups = [choice["group"] for choice in piece["choices"]]
    assert groups.count("Recipes") == len(OFFERED)
    assert len(groups) - len(OFFERED) >= len(shipped_models())
    assert state["baked"] is None
    assert state["lights"][0]["name"] == "Studio"
    assert all(choice["command"].startswith("svbrdfgan ") for choice in piece["choices"])


def test_a_command_names_the_file_as_a_shell_wants_it(exhibit: Exhibit, van: Path) -> None:
    command = exhibit.pieces[0].choices[-1].command
    assert f"'{van}'" in command


def test_a_layer_is_pictures(exhibit: Exhibit) -> None:
    dust = next(k for k, choice in enumerate(exhibit.pieces[0].choices) if choice.label == "Dust")
    found = json.loads(exhibit.document(f"/layer/0/{dust}/0/80/512").data)
    assert found["texels"] == 512
    pictures = {name: Image.open(BytesIO(b64decode(uri.partition(",")[2]))) for name, uri in found["maps"].items()}
    assert {name: picture.mode for name, picture in pictures.items()} == {
        "base_color": "RGBA",
        "orm": "RGB",
        "normal": "RGB",
    }
    assert np.asarray(pictures["base_color"])[..., 3].std() > 5.0


@pytest.mark.parametrize(
    "path",
    [
        "",
        "/",
        "/state/1",
        "/model/1",
        "/model/-1",
        "/model/x",
        "/light/99",
        "/layer/0/0/0/50/4096",
        "/layer/0/99/0/50/512",
        "/layer/0/0/-1/50/512",
        "/layer/0/0/0/101/512",
        "/../../etc/passwd",
        "/model/../../etc/passwd",
    ],
)
def test_nothing_else_is_known(exhibit: Exhibit, path: str) -> None:
    with pytest.raises(Unknown):
        exhibit.document(path)


def test_a_page_without_a_server_has_every_layer_of_its_sliders(dusty: Exhibit) -> None:
    paths = list(dusty.paths())
    assert len([path for path in paths if path.startswith("/layer/")]) == 4
    assert {"/state", "/light/0", "/model/0", "/stand/0"} < set(paths)
    assert dusty.document("/model/0").kind == GLB
    assert dusty.document("/model/0").data[:4] == b"glTF"
    state = json.loads(dusty.document("/state").data)
    assert state["baked"] == {"seeds": [0, 1], "amounts": [50, 100]}


def test_lights_lie_as_the_page_looks_them_up() -> None:
    """Three.js looks up direction d at u = atan2(z, x) / 2 pi + 1/2 and v = asin(y) / pi + 1/2, row 0 at v = 0."""
    radiance = torch.full((ROWS, COLS, 3), 0.1)
    radiance[ROWS // 4, COLS * 3 // 4] = 900.0  # towards +X, 45 degrees up
    light = Light.of("lamp", radiance)
    values = np.frombuffer(light.half_floats(), "<f2").reshape(ROWS, COLS, 4)
    row, col = np.unravel_index(values[..., 0].argmax(), (ROWS, COLS))
    assert (col + 0.5) / COLS == pytest.approx(0.5, abs=0.01)
    assert ((row + 0.5) / ROWS - 0.5) * 180.0 == pytest.approx(45.0, abs=2.0)
    assert light.floor == pytest.approx(tuple(Cove.of(radiance, (0.0, 0.0, 1.0)).floor.tolist()))


def test_an_unknown_recipe_is_refused(van: Path) -> None:
    with pytest.raises(ConfigError, match="recipe 'rusty' does not exist"):
        exhibit_of(van, recipe="rusty")
    with pytest.raises(ConfigError, match="does not know the recipe 'dust'"):
        exhibit_of(van, model="rust", recipe="dust")
