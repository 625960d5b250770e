"""A run's configuration: recipes, what contradicts itself, and the words for it."""

from __future__ import annotations

from typing import Any

import pytest

from svbrdfgan.errors import ConfigError
from svbrdfgan.training.config import DiscriminatorConfig, LossConfig, TrainConfig, resolved, train_config


def config(**data: Any) -> TrainConfig:
    return train_config({"dataset": "somewhere", **data}, "train.yaml")


def test_the_thesis_recipe_is_wgan_gp_of_batch_one() -> None:
    thesis = config(recipe="thesis")
    assert thesis.batch_size == 1
    assert (thesis.loss.name, thesis.loss.gradient_penalty, thesis.loss.critic_steps) == ("wgan", 10.0, 5)
    assert (thesis.loss.r1, thesis.loss.r2) == (0.0, 0.0)
    assert (thesis.generator.width, thesis.generator.blocks, thesis.generator.norm) == (64, 6, "instance")
    assert (thesis.discriminator.gbuffer, thesis.discriminator.norm) == (False, "none")
    assert (thesis.discriminator.compares, thesis.loss.penalty_every) == ("radiance", 1)
    assert (thesis.optimizer.beta1, thesis.optimizer.beta2, thesis.optimizer.ema_images) == (0.5, 0.999, 0.0)


def test_what_is_said_goes_before_what_a_recipe_says() -> None:
    mine = config(recipe="thesis", batch_size=3, loss={"gradient_penalty": 1.0})
    assert mine.batch_size == 3
    assert (mine.loss.name, mine.loss.gradient_penalty, mine.loss.critic_steps) == ("wgan", 1.0, 5)


@pytest.mark.parametrize("recipe", ["default", "thesis"])
def test_online_rendering_shows_no_gbuffer_unless_told(recipe: str) -> None:
    online = config(recipe=recipe, rendering="online", discriminator={"width": 32}).discriminator
    assert (online.width, online.gbuffer) == (32, False)


def test_python_fills_in_what_a_file_does() -> None:
    assert TrainConfig(dataset="somewhere", recipe="thesis") == config(recipe="thesis")
    assert TrainConfig(dataset="somewhere", rendering="online") == config(rendering="online")
    said = {"loss": LossConfig(gradient_penalty=1.0), "discriminator": DiscriminatorConfig(width=8)}
    mine = TrainConfig(dataset="somewhere", recipe="thesis", **said)  # type: ignore[arg-type]
    assert mine == config(recipe="thesis", loss={"gradient_penalty": 1.0}, discriminator={"width": 8})


def test_a_step_shows_a_batch_to_each_update_of_the_discriminator() -> None:
    assert config(batch_size=3).images_per_step == 3
    assert config(recipe="thesis", batch_size=2).images_per_step == 10


@pytest.mark.parametrize(
    ("data", "compares"),
    [
        ({}, "radiance"),
        ({"scenes": {"pool": 3}}, "radiance"),
        ({"spp": 16}, "reflectance"),
        ({"scenes": {"environment": "redrawn"}}, "reflectance"),
        ({"scenes": {"camera_noise_degrees": 1}}, "reflectance"),
        ({"scenes": {"camera": {}}}, "reflectance"),
        ({"scenes": {"environment": "redrawn"}, "rendering": "online"}, "radiance"),
        ({"scenes": {"environment": "redrawn"}, "recipe": "thesis"}, "radiance"),
        ({"discriminator": {"compares": "reflectance"}}, "reflectance"),
        ({"scenes": {"environment": "redrawn"}, "discriminator": {"compares": "radiance"}}, "radiance"),
    ],
)
def test_plain_pictures_are_seen_where_only_texture_differs(data: dict[str, Any], compares: str) -> None:
    assert resolved(config(**data), spp=64).discriminator.compares == compares


def test_pictures_of_further_maps_are_never_divided_by_their_light() -> None:
    unmatched = config(spp=16, scenes={"environment": "redrawn"})
    assert resolved(unmatched, 64, ("roughness",)).discriminator.compares == "radiance"


def test_a_recipe_stays_as_it_is() -> None:
    config(recipe="thesis", loss={"gradient_penalty": 1.0})
    assert config(recipe="thesis").loss.gradient_penalty == 10.0


def test_json_and_back() -> None:
    for one in (config(), config(recipe="thesis"), config(scenes={"camera": {"distance": {"normal": [1, 0.1]}}})):
        assert TrainConfig.model_validate_json(one.model_dump_json()) == one
        assert train_config(one.model_dump(mode="json"), "there") == one


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"step": 3}, r"unknown key 'step'; did you mean 'steps'\?"),
        ({"steps": 0}, "steps: 0 is not allowed; wanted a number of at least 1"),
        ({"recipe": "thesis2"}, "recipe"),
        ({"recipe": ["thesis"]}, "recipe"),
        ({"loss": "wgan"}, "loss: 'wgan' is not allowed"),
        ({"recipe": "thesis", "loss": "wgan"}, "loss: 'wgan' is not allowed"),
        ({"loss": {"name": "wgann"}}, r"loss\.name.*did you mean 'wgan'"),
        ({"loss": {"r1": -1}}, r"loss\.r1"),
        ({"loss": {"R1": 1}}, "loss: unknown key 'R1'"),
        ({"generator": {"norm": "batch"}}, r"generator\.norm"),
        ({"discriminator": {"layers": 9}}, r"discriminator\.layers"),
        ({"optimizer": {"generator_rate": 0}}, r"optimizer\.generator_rate"),
        ({"scenes": {"environment": "other"}}, r"scenes\.environment"),
        ({"scenes": {"pool": -1}}, r"scenes\.pool"),
        ({"scenes": {"camera": {"distance": {"uniform": [2, 1]}}}}, r"scenes\.camera\.distance"),
        ({"rendering": "fast"}, "rendering"),
        ({"discriminator": {"light_buffer": "maybe"}}, r"discriminator\.light_buffer"),
        (
            {"rendering": "online", "discriminator": {"compares": "reflectance"}},
            "discriminator.compares: reflectance needs rendering: stored",
        ),
        ({"spp_grad": 4}, "spp_grad needs rendering: online"),
        (
            {"loss": {"gradient_penalty": 10.0}, "discriminator": {"norm": "instance"}},
            "gradient_penalty needs discriminator.norm none or group",
        ),
        ({"batch_size": 3, "devices": 2}, "batch_size 3 cannot be shared out among 2 devices"),
        ({"minutes": 0}, "minutes"),
        ({"discriminator": {"guide": True}}, r"^train.yaml: discriminator\.guide is now discriminator\.gbuffer\.$"),
        ({"discriminator": {"light": True}}, r"discriminator\.light is now discriminator\.light_buffer\.$"),
        ({"discriminator": {"sees": "auto"}}, r"discriminator\.sees is now discriminator\.compares\.$"),
        ({"generator": {"chance": 2}}, r"generator\.chance is now generator\.random_fields\.$"),
        ({"rendering": "fresh"}, r"rendering: 'fresh' is not allowed; .*; 'fresh' is now 'online'\.$"),
        ({"rendering": "transport"}, r"rendering: 'transport' is not allowed; .*; 'transport' is now 'stored'\.$"),
        ({"sees": "radiance"}, "unknown key 'sees'"),  # an earlier name elsewhere
    ],
)
def test_a_mistake_is_one_line_with_its_key(data: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        config(**data)
    (line,) = str(caught.value).splitlines()
    assert line.startswith("train.yaml: ")


def test_a_dataset_is_needed() -> None:
    with pytest.raises(ConfigError, match="key 'dataset' is missing"):
        train_config({}, "train.yaml")
