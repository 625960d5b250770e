"""A generator's configuration, and the file that holds its weights."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import torch
from pydantic import Field, field_validator

from svbrdfgan.config.models import StrictModel, validate
from svbrdfgan.io.tensors import save_tensors, stored_tensors
from svbrdfgan.networks.generator import Generator, Upsampling
from svbrdfgan.networks.layers import Norm
from svbrdfgan.networks.random_fields import MOST_FIELDS

_FORMAT = "svbrdfgan generator 5"


class GeneratorConfig(StrictModel):
    """The ResNet of thesis 4.3.1, which paints layers (`svbrdfgan.networks.generator.Generator`)."""

    width: int = Field(
        default=64, ge=4, le=1024, description="channels after its first convolution; cost grows with the square"
    )
    blocks: int = Field(default=6, ge=0, le=64, description="residual blocks")
    downsamplings: int = Field(
        default=2,
        ge=1,
        le=6,
        description="how often it halves the resolution before its blocks; for twice the texels, one more with half "
        "the `width` keeps most of the cost and what a block sees",
    )
    norm: Norm = Field(default="instance", description="norm before each activation; windows need `pixel` or `none`")
    upsampling: Upsampling = Field(
        default="nearest", description="`strided`, as in the thesis, leaves a pattern of four texels"
    )
    kernel: Literal[3, 5, 7] = Field(
        default=7, description="side of its first and last convolution; with `skips` 3 is enough, and cheaper"
    )
    skips: bool = Field(
        default=False,
        description="whether features skip the blocks at each resolution, as in a U-Net; for detail as fine as a texel",
    )
    mesh_maps: bool = Field(
        default=False,
        description="whether it also reads ambient visibility, curvature, and how near sharp edges and borders are, "
        "since rust starts in recesses and on edges; baked once, a second for each mesh",
    )
    random_fields: int = Field(
        default=0,
        ge=0,
        le=MOST_FIELDS,
        description="the number of random fields of object space that it reads next to the geometry, one an octave: 2, "
        "4, 8, ... waves a vehicle length; 0: the layer is a function of the geometry alone",
    )
    conditions: bool | None = Field(
        default=None,
        description="whether generator and discriminator are told each exemplar's amount and recipe, where they vary "
        "in the data set, so that they can be chosen later; `null`: if it reads random fields",
    )
    refined: GeneratorConfig | None = Field(
        default=None,
        description="the network whose layers it refines, if `refines` names one, which fills this in",
    )

    @field_validator("refined")
    @classmethod
    def _not_refined_twice(cls, refined: GeneratorConfig | None) -> GeneratorConfig | None:
        if refined is not None and refined.refined is not None:
            raise ValueError("a generator that refines layers cannot be refined again")
        return refined

    @property
    def conditional(self) -> bool:
        """Whether it is told amount and recipe."""
        return self.random_fields > 0 if self.conditions is None else self.conditions

    @property
    def without_random_fields(self) -> GeneratorConfig:
        """The network that paints one layer for each geometry."""
        return self.model_copy(update={"random_fields": 0, "conditions": False, "refined": None})


class _About(StrictModel):
    """What a generator's file says besides its weights.

    Attributes:
        maps: that it paints besides base_color.
        labels: how many numbers it is told of a layer.
        score: on the validation split.
    """

    generator: GeneratorConfig
    maps: tuple[str, ...]
    labels: int = Field(ge=0, le=1000)
    score: float | None


def make_generator(config: GeneratorConfig, maps: tuple[str, ...] = (), labels: int = 0) -> Generator:
    """The network that paints layers with these further maps, and is told labels of each."""
    refined = None if config.refined is None else make_generator(config.refined, maps, labels)
    return Generator(**config.model_dump(exclude={"conditions", "refined"}), maps=maps, labels=labels, refined=refined)


def save_generator(
    path: Path, generator: Generator, config: GeneratorConfig, score: float | None, *, half: bool = False
) -> None:
    """Writes a generator's weights, its configuration, and the maps that it paints.

    Args:
        half: whether weights are rounded to float16; they are read as float32 again.
    """
    about = {"maps": generator.maps, "labels": generator.labels, "score": score}
    words = {"generator": config.model_dump_json()} | {name: json.dumps(value) for name, value in about.items()}
    weights = generator.state_dict()
    if half:
        weights = {name: value.half() if value.is_floating_point() else value for name, value in weights.items()}
    save_tensors(path, _FORMAT, weights, words)


def load_generator(path: Path) -> tuple[Generator, float | None]:
    """Reads what `save_generator` wrote, and its validation score.

    Raises:
        AssetError: missing, damaged, or of another kind.
    """
    with stored_tensors(path, _FORMAT, "train the run until it has saved a model") as (weights, words):
        about = validate(_About, {name: json.loads(words[name]) for name in _About.model_fields}, str(path))
        if not all(value.isfinite().all() for value in weights.values()):
            raise ValueError("it has weights that are not finite")
        with torch.device("meta"):  # what the file says takes no memory before its weights are known to fit
            generator = make_generator(about.generator, about.maps, about.labels)
        generator.load_state_dict({name: value.float() for name, value in weights.items()}, assign=True)
    # convolutions of such weights take channels last, in two thirds of the time on a CPU
    generator.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack it
    return generator.eval().requires_grad_(False), about.score
