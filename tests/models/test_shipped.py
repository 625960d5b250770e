"""Shipped models: found by name or recipe, small, with a card, and without a trace of the machine that made them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from PIL import Image

from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.models.card import ModelCard, Scores
from svbrdfgan.models.shipped import CARD, CONFIG, FOLDER, PICTURE, load_card, model_folder, model_of, shipped_models
from svbrdfgan.training.run import RunConfig, load_model
from svbrdfgan.training.ship import LARGEST, ship
from svbrdfgan.weathering.recipes import RECIPES


def texts(value: object) -> list[str]:
    """All texts in JSON data."""
    if isinstance(value, dict):
        return [text for each in value.values() for text in texts(each)]
    if isinstance(value, list):
        return [text for each in value for text in texts(each)]
    return [value] if isinstance(value, str) else []


def require_good(folder: Path) -> None:
    """Checks what every shipped model must have."""
    card, model = load_card(folder), load_model(folder)
    assert card.name == folder.name
    assert set(card.recipes) == set(model.config.conditions.recipes) <= set(RECIPES)
    assert sum(path.stat().st_size for path in folder.iterdir()) <= LARGEST
    with Image.open(folder / PICTURE) as picture:
        assert picture.format == "JPEG"
    assert model.config.dataset_folder == ""
    stored = texts(json.loads((folder / CONFIG).read_text()))
    assert [text for text in stored if text.startswith(("/", "~", "..")) or ":\\" in text] == []


def test_the_models_of_the_package_are_good() -> None:
    folders = [path for path in FOLDER.iterdir() if path.is_dir() and path.name != "__pycache__"]
    assert {path.name for path in folders} == set(shipped_models())
    for folder in folders:
        require_good(folder)


def test_a_run_becomes_a_model_that_paints_the_same(shipped: Path, varied_run: Path) -> None:
    require_good(shipped)
    made, run = load_model("corroded"), load_model(varied_run)
    assert made.score == run.score
    assert made.config.conditions == run.config.conditions
    for name, weights in run.generator.state_dict().items():
        torch.testing.assert_close(made.generator.state_dict()[name], weights, rtol=2**-11, atol=2**-25)


def test_paths_of_the_machine_are_left_out(varied_run: Path, shipped: Path, tmp_path: Path) -> None:
    config, run = RunConfig.load(varied_run), tmp_path / "run"
    meshes = {"files": ["/home/me/cars/*.glb", "../cars/van.glb", "C:\\cars\\bus.glb", "cars/taxi.glb"]}
    dataset = config.dataset.model_dump(mode="json")
    dataset["splits"]["train"]["meshes"] = {"files": meshes["files"], "procedural": None}
    changed = RunConfig.model_validate_json(json.dumps({**config.model_dump(mode="json"), "dataset": dataset}))
    changed.save(run)
    (run / "model.safetensors").write_bytes((varied_run / "model.safetensors").read_bytes())
    ship(run, tmp_path / "corroded", load_card(shipped), shipped / PICTURE)
    require_good(tmp_path / "corroded")
    left = RunConfig.load(tmp_path / "corroded").dataset.splits["train"].meshes.files
    assert list(left or ()) == ["*.glb", "van.glb", "bus.glb", "cars/taxi.glb"]


def test_what_cannot_be_shipped_is_told(
    varied_run: Path, shipped: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    card, picture = load_card(shipped), shipped / PICTURE
    snow = card.model_copy(update={"recipes": ("rust", "snow")})
    for folder, wrong, shown, said in (
        ("other", card, picture, "another name than the model, corroded"),
        ("corroded", card, tmp_path / "picture.png", r"wanted a \.jpg file"),
        ("corroded", snow, picture, "names the recipes rust, snow; the run learned rust, dust"),
    ):
        with pytest.raises(ConfigError, match=said):
            ship(varied_run, tmp_path / folder, wrong, shown)
    monkeypatch.setattr("svbrdfgan.training.ship.LARGEST", 1000)
    with pytest.raises(ConfigError, match="MB with its picture"):
        ship(varied_run, tmp_path / "corroded", card, picture)
    assert list(tmp_path.iterdir()) == []


def test_a_name_is_that_of_a_model_and_a_path_that_of_a_folder(shipped: Path) -> None:
    assert model_folder("corroded") == shipped
    assert model_folder("corroded", Path("base")) == shipped
    assert model_folder(Path("corroded")) == Path("corroded")
    assert model_folder("./corroded", Path("base")) == Path("base/corroded")
    assert model_folder("runs/cars", Path("base")) == Path("base/runs/cars")


def test_an_unknown_name_is_one_sentence_with_a_guess(shipped: Path) -> None:
    said = (
        r"^corrode is not a run: it has no config\.json; and no .*; did you mean 'corroded'\? Shipped are corroded\.$"
    )
    with pytest.raises(AssetError, match=said):
        load_model("corrode")


def test_a_recipe_leads_to_the_model_that_learned_it(shipped: Path) -> None:
    assert model_of("dust") == "corroded"
    with pytest.raises(ConfigError, match=r"learned the recipe 'rsut'; did you mean 'rust'\? .* know dust, rust;"):
        model_of("rsut")


def test_a_model_of_the_recipe_s_name_comes_first(
    shipped: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    card = json.loads((shipped / CARD).read_text())
    for name in ("all", "rust"):
        (tmp_path / name).mkdir()
        (tmp_path / name / CARD).write_text(json.dumps({**card, "name": name}))
    monkeypatch.setattr("svbrdfgan.models.shipped.FOLDER", tmp_path)
    assert (model_of("rust"), model_of("dust")) == ("rust", "all")


def test_a_card_shows_what_was_measured_and_no_more() -> None:
    scores = Scores(resemblance=0.875, parts={"joint": 0.7}, normals=(0.9, 1.1), further={"seconds": 12.0})
    assert list(scores.rows()) == [
        ("resemblance", "0.875"),
        ("parts", "joint 0.70"),
        ("normals by octave, finest first", "0.90, 1.10"),
        ("seconds", "12"),
    ]


def test_names_are_those_of_folders(shipped: Path) -> None:
    with pytest.raises(ValueError, match="String should match pattern"):
        ModelCard.model_validate({**load_card(shipped).model_dump(), "name": "../rust"})


def test_without_any_model_the_message_says_what_paints(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("svbrdfgan.models.shipped.FOLDER", tmp_path)
    with pytest.raises(ConfigError, match=r"This version ships no model.*`svbrdfgan weather --recipe`"):
        model_of("rust")
