"""The gloss of the demo's pictures: paint's and glass's are the file's, and dirt is rough where there is dirt."""

import pytest
import torch

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.experiments.demo.gloss import GLOSS, matt_dirt
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.subject import Subject, make_subject
from svbrdfgan.types import Layer, Material


@pytest.fixture(scope="module")
def subject() -> Subject:
    mesh = build_vehicle(sample_vehicle("sedan", seed=3))
    return make_subject(mesh, load_embedding("hemispherical"), 32, PartSelection(), file_maps=True)


@pytest.fixture(scope="module")
def layer() -> Layer:
    """Dirty in the upper half of the texture."""
    layer = Layer(torch.zeros(32, 32, 4))
    layer.values[16:] = 1.0
    return layer


@pytest.fixture(scope="module")
def materials(subject: Subject, layer: Layer) -> dict[str, Material]:
    made = subject.materials(matt_dirt(layer), GLOSS)
    return {part.name: material for part, material in zip(subject.surface.parts, made.parts, strict=True)}


def test_paint_is_glossy_and_dirt_is_rough(materials: dict[str, Material]) -> None:
    roughness = materials["body"].maps["roughness"]
    assert (roughness[:16] < 0.2).all()
    assert torch.allclose(roughness[16:], torch.tensor(0.9))
    assert (materials["body"].maps["metallic"] == 0).all()


def test_colours_are_those_that_were_learned(subject: Subject, layer: Layer, materials: dict[str, Material]) -> None:
    body = next(part for part in subject.learnable if subject.surface.parts[part].name == "body")
    assert torch.equal(materials["body"].base_color, subject.materials(layer).parts[body].base_color)
