"""A run without its cost: real records of flat vehicles, and a stage that shows layers as they are."""

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import torch.nn.functional as F

from svbrdfgan.data.config import DatasetConfig, MeshSource, SplitConfig
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.evaluation.evaluated import Evaluated, by_subject
from svbrdfgan.evaluation.record import ConstantScores, Evaluation, LearnedScores, OracleScores, PainterScores
from svbrdfgan.geometry.bake import bake
from svbrdfgan.geometry.rasterize import Fragments
from svbrdfgan.networks.saved import GeneratorConfig
from svbrdfgan.scene.description import AssetRef, OrbitCamera, Scene, SceneEnvironment, SceneWeathering
from svbrdfgan.scene.subject import Subject
from svbrdfgan.training.batches import BatchSource
from svbrdfgan.training.config import DiscriminatorConfig, TrainConfig
from svbrdfgan.training.discriminator_batch import ImageBatch
from svbrdfgan.training.run import RunConfig
from svbrdfgan.types import Layer, Part, Surface

TEXELS, HEIGHT, WIDTH = 32, 32, 40


@dataclass(frozen=True)
class PlainStage:
    """Shows each layer's colour, premultiplied, in the middle of the picture."""

    coverage: torch.Tensor
    gbuffer: torch.Tensor | None

    def render(self, layers: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        shown = F.interpolate((layers[..., :3] * layers[..., 3:]).permute(0, 3, 1, 2), size=(HEIGHT, WIDTH))
        return shown.permute(0, 2, 3, 1) * self.coverage.unsqueeze(-1), self.coverage


@dataclass(frozen=True)
class PlainScenes:
    """The same stage for every exemplar; pictures show the left half of the texture."""

    coverage: torch.Tensor

    def scenes(self, indices: list[int], rng: np.random.Generator, visit: int = 0) -> PlainStage:
        count = len(indices)
        return PlainStage(self.coverage.expand(count, -1, -1), torch.zeros(count, HEIGHT, WIDTH, 6))

    def seen(self, index: int) -> torch.Tensor:
        return (torch.arange(TEXELS) < TEXELS // 2).float().expand(TEXELS, TEXELS)


def make_subject() -> Subject:
    """A square of 2 m, its lower half learnable paint, its upper half glass."""
    corners = np.array([[0, 0], [1, 0], [1, 0.5], [0, 0.5], [0, 0.5], [1, 0.5], [1, 1], [0, 1]], float)
    surface = Surface(
        positions=np.column_stack([2 * corners, np.zeros(8)]),
        normals=np.tile([0.0, 0.0, 1.0], (8, 1)),
        uv=corners,
        faces=np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]),
        face_part=np.array([0, 0, 1, 1]),
        parts=(Part("paint"), Part("glass")),
        elevation=np.zeros(8),
        source_face=np.arange(4),
        source_barycentric=np.tile(np.eye(3), (4, 1, 1)),
    )
    buffer = bake(Fragments.of(surface, TEXELS, TEXELS))
    return Subject(surface, buffer, (0,), (torch.full((3,), 0.5), torch.full((3,), 0.1)))


def make_scene(name: str) -> Scene:
    return Scene(
        mesh=AssetRef(path=f"assets/meshes/{name}.glb"),
        environment=SceneEnvironment(asset=AssetRef(path="assets/environments/noon.exr")),
        camera=OrbitCamera(azimuth_degrees=45.0, elevation_degrees=20.0, distance=5.0),
        width=WIDTH,
        height=HEIGHT,
        texture=TEXELS,
        weathering=SceneWeathering(recipe="dust"),
    )


def make_evaluated(names: tuple[str, ...] = ("sedan_1", "van_2"), views: int = 2) -> Evaluated:
    """Vehicles of these names, each in so many pictures; the oracle paints exactly what G0 did."""
    torch.manual_seed(0)
    count, subject = len(names), make_subject()
    truth = torch.rand(count, TEXELS, TEXELS, 4)
    coverage = torch.zeros(HEIGHT, WIDTH)
    coverage[10:22, 8:32] = 1.0
    stages = PlainScenes(coverage)
    owner = torch.arange(count).repeat_interleave(views)
    images, _ = stages.scenes([0] * (count * views), np.random.default_rng(0)).render(truth[owner])
    exemplars = Exemplars(
        images=images.half(),
        coverage=coverage.expand(count * views, -1, -1).half(),
        scenes=tuple(make_scene(names[n]) for n in owner.tolist()),
        subjects=(subject,) * count,
        subject_of=owner,
        layers=tuple(Layer(truth[n]) for n in owner.tolist()),
        loader=SimpleNamespace(),
    )
    gbuffers = torch.zeros(count * views, HEIGHT, WIDTH, 6)
    buffers = torch.stack([subject.geometry] * count)
    source = BatchSource(exemplars, stages, stages, buffers, ImageBatch(exemplars.images, exemplars.coverage, gbuffers))
    constant = (0.4, 0.3, 0.2, 0.5)
    layers = {
        "generated": (truth + 0.1).clamp(0, 1),
        "oracle": truth,
        "constant": torch.tensor(constant).expand_as(truth),
    }
    evaluation = Evaluation(
        split="test",
        subjects=count,
        exemplars=count * views,
        areas={"base_color": 0.83},
        generated=LearnedScores(recovered=0.6123, flip=0.0432),
        oracle=OracleScores(recovered=0.8741, flip=0.0311, steps=2300, plateau=True, validation=0.8),
        constant=ConstantScores(flip=0.0811, layer=constant),
        truth=PainterScores(flip=0.0205),
    )
    train = TrainConfig(
        dataset="dirty-cars",
        batch_size=4,
        generator=GeneratorConfig(width=4, blocks=1),
        discriminator=DiscriminatorConfig(width=4, layers=1),
    )
    dataset = DatasetConfig(splits={"train": SplitConfig(meshes=MeshSource(files=("cars/*.glb",)))})
    config = RunConfig(train=train, dataset=dataset, dataset_folder="nowhere", versions={"svbrdfgan": "1.2.3"})
    return Evaluated(evaluation, config, source, layers, by_subject(source.exemplars, layers))


def without_oracle(evaluated: Evaluated) -> Evaluated:
    layers = {name: layer for name, layer in evaluated.layers.items() if name != "oracle"}
    return replace(
        evaluated,
        evaluation=evaluated.evaluation.model_copy(update={"oracle": None}),
        layers=layers,
        layers_of=by_subject(evaluated.source.exemplars, layers),
    )


def without_weathering(evaluated: Evaluated) -> Evaluated:
    before = evaluated.source.exemplars
    scenes = tuple(scene.model_copy(update={"weathering": None}) for scene in before.scenes)
    exemplars = replace(before, scenes=scenes, layers=(None,) * len(before))
    return replace(evaluated, source=replace(evaluated.source, exemplars=exemplars))


@pytest.fixture(scope="session")
def evaluated() -> Evaluated:
    return make_evaluated()


@pytest.fixture(scope="session")
def makers() -> SimpleNamespace:
    """For tests that need other runs."""
    return SimpleNamespace(
        make_evaluated=make_evaluated, without_oracle=without_oracle, without_weathering=without_weathering
    )


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run's folder with nothing in it."""
    folder = tmp_path / "run-7"
    folder.mkdir()
    return folder
