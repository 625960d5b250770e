"""Data sets whose layers a model paints: what it decides, what is refused, and what the folder keeps."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from svbrdfgan.config.distributions import Fixed, UniformInteger
from svbrdfgan.config.models import validate
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.estimate import estimate, preview
from svbrdfgan.data.exemplar_files import exemplar_paths
from svbrdfgan.data.exemplars import load_exemplars
from svbrdfgan.data.generate import generate
from svbrdfgan.data.index import Dataset
from svbrdfgan.data.trained_model import with_model
from svbrdfgan.data.true_draws import Vehicle, paint
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.inference.apply import choose_draw
from svbrdfgan.scene.description import Scene, SceneWeathering
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.training.config import train_config
from svbrdfgan.training.run import load_model
from svbrdfgan.training.trainer import train

Data = Callable[..., dict[str, Any]]
Made = Callable[..., DatasetConfig]


@pytest.fixture(scope="module")
def declared(dataset_data: Data) -> Made:
    """The tiny data set with a model, without what the model decides; with changes laid over it."""

    def made(**changes: Any) -> DatasetConfig:
        data = dataset_data(weathering={"model": "run"})
        del data["embedding"], data["texture"]
        weathering = {**data["weathering"], **changes.pop("weathering", {})}
        return validate(DatasetConfig, {**data, **changes, "weathering": weathering}, "here")

    return made


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory, varied_run: Path, plain_run: Path) -> Path:
    """A folder with a run that has random fields and conditions, and one that has neither."""
    folder = tmp_path_factory.mktemp("runs")
    shutil.copytree(varied_run, folder / "run")
    shutil.copytree(plain_run, folder / "plain")
    return folder


@pytest.fixture(scope="module")
def plain_run(built_once: Any, training_data: Data) -> Path:
    run: Path = built_once("plain_run", lambda f: train(train_config(training_data(), "plain"), f / "run") and None)
    return run / "run"


@pytest.fixture(scope="module")
def folder(built_once: Any, declared: Made, base: Path) -> Path:
    made: Path = built_once("painted", lambda f: generate(declared(), f / "dataset", base=base) and None)
    return made / "dataset"


def pictures(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.glob("*/*.*")) if path.is_file()}


def weathering_of(scene: Scene) -> SceneWeathering:
    assert isinstance(scene.weathering, SceneWeathering)
    return scene.weathering


def test_what_is_left_out_is_that_of_its_training(declared: Made, base: Path, varied_dataset: Path) -> None:
    trained, filled = Dataset.open(varied_dataset).config, with_model(declared(), None, base)
    assert filled.weathering is not None
    assert trained.weathering is not None
    assert (filled.texture, filled.embedding, filled.maps) == (trained.texture, trained.embedding, trained.maps)
    assert filled.weathering.recipe == trained.weathering.recipe
    assert filled.weathering.amount == trained.weathering.amount
    assert filled.weathering.seed == UniformInteger(uniform=(0, 1_000_000))
    assert with_model(filled, None, base) == filled


def test_a_model_without_chance_and_conditions_needs_nothing(declared: Made, base: Path) -> None:
    filled = with_model(declared(weathering={"model": "plain"}), None, base).weathering
    assert filled is not None
    assert filled.recipe == Fixed[str](fixed="road-dirt")
    assert filled.amount == Fixed[float](fixed=1.0)
    assert filled.seed == Fixed[int](fixed=0)


def test_what_is_declared_stays(declared: Made, base: Path) -> None:
    wanted = {"recipe": "dust", "amount": {"uniform": [0.3, 0.4]}, "seed": {"choice": [3, 5]}}
    config = declared(weathering=wanted, learnable={"include": ["body"]}, texture=32)
    filled = with_model(config, None, base)
    assert (filled.weathering, filled.learnable) == (config.weathering, config.learnable)


def test_without_a_model_nothing_changes(dataset_data: Data) -> None:
    config = validate(DatasetConfig, dataset_data(), "here")
    assert with_model(config, None, Path("nowhere")) is config


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"texture": 64}, "texture: the model was trained with 32, not 64: leave the key out"),
        ({"embedding": "hemispherical"}, "embedding: the model was trained with .*'resolution': 32"),
        ({"maps": {"roughness": 0.4}}, r"maps: the model was trained with \[\], not \['roughness'\]"),
        ({"weathering": {"recipe": "snow"}}, r"weathering\.recipe: the model does not know the recipe 'snow'\."),
        ({"weathering": {"recipe": {"choice": ["rust", "dusty"]}}}, "recipe 'dusty'; did you mean 'dust'"),
        ({"weathering": {"seed": -1}}, r"weathering\.seed: -1 is not allowed; wanted whole numbers from 0 to"),
        ({"weathering": {"seed": {"uniform": [0, 2**63]}}}, r"weathering\.seed: 9\d+ is not allowed; wanted"),
        ({"weathering": {"model": "plain", "amount": 0.5}}, r"weathering\.amount: the model does not know amounts"),
        ({"weathering": {"model": "plain", "recipe": "rust"}}, r"weathering\.recipe: the model does not know"),
        (
            {"weathering": {"model": "plain", "seed": {"uniform": [0, 9]}}},
            r"weathering\.seed: the model has no random fields",
        ),
    ],
)
def test_contradictions_are_told_before_anything_is_written(
    changes: dict[str, Any], said: str, declared: Made, base: Path, tmp_path: Path
) -> None:
    for use in (lambda config: generate(config, tmp_path / "out", base=base), lambda c: estimate(c, base)):
        with pytest.raises(ConfigError, match=said) as caught:
            use(declared(**changes))
        assert len(str(caught.value).splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_options_are_refused(declared: Made) -> None:
    with pytest.raises(ConfigError, match=r"weathering.*options are those of recipes.*leave out one of them"):
        declared(weathering={"options": {"scale": 2.0}})


def test_what_is_no_model_is_told(declared: Made, base: Path, tmp_path: Path) -> None:
    def refused(model: str, said: str) -> None:
        with pytest.raises(AssetError, match=said) as caught:
            generate(declared(weathering={"model": model}), tmp_path / "out", base=base)
        assert len(str(caught.value).splitlines()) == 1
        assert not (tmp_path / "out").exists()

    refused("nowhere", r"weathering\.model: .*nowhere is not a run")
    (tmp_path / "config.json").write_text("[]")
    refused(str(tmp_path), "is not the configuration of a run")
    shutil.copy(base / "run" / "config.json", tmp_path)
    refused(str(tmp_path), "train the run until it has saved a model")
    (tmp_path / "model.safetensors").write_bytes(b"x" * 100)
    refused(str(tmp_path), r"model\.safetensors cannot be read")


def test_a_shipped_model_is_named(declared: Made, base: Path, shipped: Path) -> None:
    named, run = (with_model(declared(weathering={"model": model}), None, base) for model in ("corroded", "run"))
    assert named.weathering is not None
    assert named.weathering.model == "corroded"
    assert named.model_copy(update={"weathering": None}) == run.model_copy(update={"weathering": None})
    with pytest.raises(AssetError, match=r"weathering\.model: .*; did you mean 'corroded'\? Shipped are corroded\."):
        with_model(declared(weathering={"model": "corrode"}), None, base)


def test_amounts_beyond_those_of_training_are_told(
    declared: Made, base: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with_model(declared(weathering={"amount": {"uniform": [0, 1]}}), None, base)
    assert "weathering.amount is beyond what the model was trained on: 0.2 to 1" in caplog.text


def test_layers_are_draws_of_the_model(folder: Path, base: Path) -> None:
    exemplars, model = load_exemplars(Dataset.open(folder), "train"), load_model(base / "run")
    assert all(map(exemplars.weathered, range(len(exemplars))))
    for number, scene in enumerate(exemplars.scenes):
        asked = weathering_of(scene)
        draw = choose_draw(model, seed=asked.seed, amount=asked.amount, recipe=asked.recipe)
        layer = exemplars.layers[number]
        assert layer is not None
        painted = draw(exemplars.subject(number).geometry.unsqueeze(0))[0]
        torch.testing.assert_close(layer.values, painted, atol=2 / 255, rtol=0)
    assert len({weathering_of(scene).seed for scene in exemplars.scenes}) == len(exemplars)
    assert {weathering_of(scene).recipe for scene in exemplars.scenes} == {"rust", "dust"}


def test_amount_and_seed_of_a_scene_change_its_layer(folder: Path) -> None:
    one, other = (Scene.load(exemplar_paths(folder, "train", number)[1]) for number in (0, 1))
    loader = SceneLoader(folder, keep=False)
    changed = weathering_of(one).model_copy(update={"amount": 0.2 if weathering_of(one).amount > 0.6 else 1.0})
    layer = loader.paint(one, weathering_of(one)).values
    assert not torch.equal(layer, loader.paint(one, changed).values)
    assert not torch.equal(layer, loader.paint(other, weathering_of(other)).values)


def test_the_folder_goes_on_without_the_run(folder: Path, declared: Made, tmp_path: Path) -> None:
    whole = pictures(folder)
    for path in (folder / "train").glob("000002*"):
        path.unlink()
    shutil.rmtree(folder / "cache" / "layers")
    generate(declared(), folder, base=tmp_path)
    assert pictures(folder) == whole


@pytest.mark.full
def test_baked_ahead_they_are_the_same(folder: Path, declared: Made, base: Path, tmp_path: Path) -> None:
    generate(declared(), tmp_path / "again", base=base, workers=2)
    assert pictures(tmp_path / "again") == pictures(folder)


def test_a_retrained_run_is_told_and_not_used(
    folder: Path, declared: Made, base: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    before = pictures(folder)
    shutil.copytree(base / "plain", tmp_path / "run")
    generate(declared(), folder, base=tmp_path)
    assert "has another model now; the data set goes on with its copy of the earlier one" in caplog.text
    assert pictures(folder) == before


def test_a_changed_copy_is_told(folder: Path, base: Path, tmp_path: Path) -> None:
    copied = shutil.copytree(folder, tmp_path / "copy")
    shutil.copy(base / "plain" / "model.safetensors", copied / "assets" / "model")
    scene = Scene.load(exemplar_paths(copied, "train", 0)[1])
    with pytest.raises(AssetError, match=r"model\.safetensors is not the file that the scene was made with"):
        SceneLoader(copied, keep=False).paint(scene, weathering_of(scene))


def test_a_scene_of_other_maps_is_told(folder: Path) -> None:
    scene = Scene.load(exemplar_paths(folder, "train", 0)[1]).model_copy(update={"maps": {"roughness": 0.5}})
    with pytest.raises(AssetError, match=r"paints base_color and \[\], and the scene declares \['roughness'\]"):
        SceneLoader(folder, keep=False).paint(scene, weathering_of(scene))


def test_it_can_be_previewed_and_estimated(declared: Made, base: Path) -> None:
    shown = preview(declared(), base)
    assert not torch.equal(shown[:, :32], shown[:, 32:])
    needs = estimate(declared(), base)
    assert needs.exemplars == 8


def test_a_run_can_learn_from_it_and_be_scored(folder: Path, training_data: Data, tmp_path: Path) -> None:
    """The truth is then what the model paints."""
    train(train_config(training_data(dataset=str(folder), generator={"random_fields": 2}), "here"), tmp_path / "run")
    trained = json.loads((tmp_path / "run" / "config.json").read_text())
    assert trained["dataset"]["weathering"]["model"] == "run"
    found = evaluate(tmp_path / "run", split="validation", device="cpu", oracle=False).evaluation
    assert found.generated.recovered < 1.0
    assert load_model(tmp_path / "run").config.conditions == load_model_conditions(folder)


def test_true_draws_and_their_amounts_are_the_model_s(folder: Path, base: Path) -> None:
    exemplars = load_exemplars(Dataset.open(folder), "train")
    model, declared = load_model(base / "run"), Dataset.open(folder).config.weathering
    assert declared is not None
    fixed = declared.model_copy(update={"seed": Fixed[int](fixed=7)})
    recipes = model.config.conditions.recipes
    scenes = tuple(exemplars.scenes[view] for view in exemplars.views_of(0))[:1]
    drawn = paint(Vehicle(folder, 0, scenes, fixed, tuple((recipe, (0.2, 1.0)) for recipe in recipes)))

    def painted(amount: float, recipe: str) -> torch.Tensor:
        draw = choose_draw(model, seed=7, amount=amount, recipe=recipe)
        return draw(exemplars.subjects[0].geometry.unsqueeze(0))[0]

    asked = [weathering_of(scene) for scene in scenes * 2]
    wanted = torch.stack([painted(each.amount, each.recipe) for each in asked])
    torch.testing.assert_close(torch.from_numpy(drawn.layers), wanted, atol=2 / 255, rtol=0)
    for row, recipe in zip(drawn.amounts, recipes, strict=True):
        alpha = float((painted(1.0, recipe)[..., 3] * torch.from_numpy(drawn.area)).sum())
        assert abs(row[-1] - alpha) < 2 / 255


def load_model_conditions(folder: Path) -> Any:
    model = Dataset.open(folder).index.model
    assert model is not None
    return model.conditions
