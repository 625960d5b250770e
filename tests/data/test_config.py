"""A data set's configuration: what it takes, what it refuses, and with which words."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from svbrdfgan.config.choices import PartSelection, PluginChoice
from svbrdfgan.config.distributions import Fixed
from svbrdfgan.config.models import validate
from svbrdfgan.config.yaml_files import load_yaml
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.scene.description import OrbitCamera, Scene
from svbrdfgan.types import Part

Data = Callable[..., dict[str, Any]]
MINIMAL = {"splits": {"train": {"meshes": {"files": ["*.obj"]}}}}


def test_defaults_fill_a_minimal_configuration() -> None:
    config = validate(DatasetConfig, MINIMAL, "here")
    assert config.image == (256, 256)
    assert config.renderer == PluginChoice(name="auto")
    assert config.weathering is not None
    assert config.weathering.recipe == Fixed[str](fixed="road-dirt")


def test_json_and_back(dataset_data: Data) -> None:
    for data in (MINIMAL, dataset_data(paint=None, camera={"distance": {"normal": [1, 0.1]}})):
        config = validate(DatasetConfig, data, "here")
        assert DatasetConfig.model_validate_json(config.model_dump_json()) == config
        assert validate(DatasetConfig, config.model_dump(mode="json"), "there") == config


def test_maps_are_ordered_alike_however_written() -> None:
    written = {"normal": 0, "metallic": {"uniform": [0, 1]}, "roughness": 0.5}
    one, other = ({"maps": written}, {"maps": dict(reversed(written.items()))})
    configs = [validate(DatasetConfig, MINIMAL | maps, "here") for maps in (one, other)]
    assert [list(config.maps) for config in configs] == [["roughness", "metallic", "normal"]] * 2


@pytest.mark.parametrize(
    "written", ["warp", {"name": "warp"}, {"name": "warp", "options": {}}, {"name": "warp", "device": "cpu"}]
)
def test_a_plugin_is_a_name_or_a_name_with_options(written: Any, dataset_data: Data) -> None:
    renderer = validate(DatasetConfig, dataset_data() | {"renderer": written}, "here").renderer
    assert renderer.name == "warp"
    assert renderer.options == ({"device": "cpu"} if isinstance(written, dict) and "device" in written else {})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"sed": 1}, r"unknown key 'sed'; did you mean 'seed'\?"),
        ({"seed": "one"}, "seed: 'one' is not allowed"),
        ({"seed": -1}, "seed: -1 is not allowed"),
        ({"splits": {"train": {"meshes": {"procedural": {"count": 1, "seed": -1}}}}}, "seed: -1 is not allowed"),
        ({"splits": {"train": {"meshes": {"procedural": {"count": 1, "kinds": []}}}}}, r"kinds: \[\] is not allowed"),
        ({"image": [64]}, "image"),
        ({"image": [4, 64]}, r"image\[0\].*at least 8"),
        ({"texture": 30}, "texture"),
        ({"texture": 8}, "texture.*at least 16"),
        ({"spp": 0}, "spp.*at least 1"),
        ({"renderer": 3}, "renderer"),
        ({"learnable": {"include": "body"}}, r"learnable\.include"),
        ({"camera": {"azimuth": 3}}, "camera: unknown key 'azimuth'; did you mean 'azimuth_degrees'"),
        ({"camera": {"elevation_degrees": {"uniform": [9, 3]}}}, r"camera\.elevation_degrees.*low <= high"),
        ({"weathering": {"recipe": 3}}, r"weathering\.recipe"),
        ({"weathering": {"amount": "much"}}, r"weathering\.amount"),
        ({"environments": {"procedural": {"count": 0}}}, r"environments\.procedural\.count.*at least 1"),
        ({"splits": {"training": {"meshes": {"files": ["a"]}}}}, "splits"),
        ({"splits": {"train": {"views": 0}}}, r"splits\.train\.views.*at least 1"),
        ({"environment_brightness": float("nan")}, "environment_brightness"),
        ({"maps": {"rough": 0.5}}, r"maps: 'rough' is not a map .* known: roughness, metallic, normal"),
        ({"maps": {"metallic": 0}}, r"maps: metallic needs roughness: declare a value for both"),
        ({"maps": {"normal": 1}}, r"maps: normal is the relief under the layer, .* wanted 0"),
        ({"maps": {"normal": {"uniform": [0, 0.5]}}}, r"maps: normal is the relief under the layer, .* wanted 0"),
        ({"maps": {"base_color": 0.5}}, "maps: 'base_color' is not a map that layers have besides base_color"),
        ({"maps": {"roughness": "high"}}, r"maps\.roughness"),
        ({"maps": ["roughness"]}, "maps"),
    ],
)
def test_a_mistake_is_one_line_with_its_key(changes: dict[str, Any], said: str, dataset_data: Data) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        validate(DatasetConfig, dataset_data(**changes), "here.yaml")
    (line,) = str(caught.value).splitlines()
    assert line.startswith("here.yaml: ")


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({}, "key 'splits' is missing"),
        ({"splits": {"test": {"meshes": {"files": ["*.obj"]}}}}, "needs 'train'"),
        ({"splits": {"train": {"meshes": {}}}}, r"splits\.train: .*'files', 'procedural' or both"),
        (MINIMAL | {"environments": {"procedural": {}}}, r"environments\.procedural: key 'count' is missing"),
        ({"splits": {"train": {}}}, r"splits\.train: key 'meshes' is missing"),
        ({"splits": {"train": {"meshes": {"files": "*.obj"}}}}, r"splits\.train\.meshes\.files"),
    ],
)
def test_what_is_missing_is_one_line(data: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        validate(DatasetConfig, data, "here.yaml")
    assert len(str(caught.value).splitlines()) == 1


def test_three_mistakes_are_three_lines(dataset_data: Data) -> None:
    with pytest.raises(ConfigError) as caught:
        validate(DatasetConfig, dataset_data(spp=0, sed=1, camera={"distance": "far"}), "here.yaml")
    assert len(str(caught.value).splitlines()) == 3


def test_the_shipped_configurations_are_right() -> None:
    from importlib import resources

    with resources.as_file(resources.files("svbrdfgan.experiments.demo") / "dataset.yaml") as path:
        assert "train" in validate(DatasetConfig, load_yaml(path), str(path)).splits


@pytest.mark.parametrize(
    ("name", "learnable"),
    [
        ("body", True),
        ("Paint", True),
        ("Glass_front", False),
        ("WHEEL 1", False),
        ("tyre", False),
        ("headlight", False),
    ],
)
def test_cars_are_learnable_but_for_glass_and_wheels(name: str, learnable: bool) -> None:
    assert PartSelection().selects(Part(name)) is learnable
    assert not PartSelection().selects(Part(name, hidden_half_of="body"))


def test_a_selection_names_patterns() -> None:
    selection = PartSelection(include=("Hood*", "roof"), exclude=("*_inner",))
    chosen = [name for name in ("hood_1", "HOOD_inner", "Roof", "roof_2") if selection.selects(Part(name))]
    assert chosen == ["hood_1", "Roof"]


def test_a_scene_file_returns_what_was_saved(tmp_path: Path, tiny_dataset: Path) -> None:
    scene = Scene.load(tiny_dataset / "train" / "000000.json")
    scene.save(tmp_path / "deep" / "scene.json")
    assert Scene.load(tmp_path / "deep" / "scene.json") == scene


@pytest.mark.parametrize(
    ("text", "error", "said"),
    [
        ("{", AssetError, "not valid JSON"),
        ("[]", ConfigError, "scene.json"),
        ('{"mesh": {"path": "a.glb"}}', ConfigError, "missing"),
    ],
)
def test_a_broken_scene_file_is_told(tmp_path: Path, text: str, error: type[Exception], said: str) -> None:
    (tmp_path / "scene.json").write_text(text)
    with pytest.raises(error, match=said) as caught:
        Scene.load(tmp_path / "scene.json")
    assert all("scene.json" in line for line in str(caught.value).splitlines())


def test_a_missing_scene_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match=r"none\.json cannot be read"):
        Scene.load(tmp_path / "none.json")


@pytest.mark.parametrize(
    ("azimuth", "elevation", "origin"),
    [(0, 0, (0, 1, 2)), (90, 0, (2, 1, 0)), (180, 0, (0, 1, -2)), (0, 30, (0, 2, 3**0.5))],
)
def test_a_camera_speaks_degrees(azimuth: float, elevation: float, origin: tuple[float, ...]) -> None:
    orbit = OrbitCamera(azimuth_degrees=azimuth, elevation_degrees=elevation, distance=2.0, target=(0.0, 1.0, 0.0))
    assert orbit.camera().origin == pytest.approx(origin, abs=1e-12)
    assert orbit.camera().vertical_fov == pytest.approx(0.6108652)
