"""The demo: what `dataset`, `train`, `evaluate` and `texture` do, one after the other, on shipped configurations."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from functools import partial
from importlib import resources
from pathlib import Path

from svbrdfgan.config.yaml_files import load_yaml
from svbrdfgan.data.config import dataset_config
from svbrdfgan.data.generate import generate
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.evaluation.oracle import OracleConfig
from svbrdfgan.evaluation.record import Evaluation
from svbrdfgan.experiments.demo.gloss import GLOSS, glossy, glossy_picture, matt_dirt
from svbrdfgan.inference.apply import paint
from svbrdfgan.inference.embedded import write_embedded
from svbrdfgan.inference.studio import BOUNCES, write_picture
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.procedural.softboxes import build_studio
from svbrdfgan.report.overview import FurtherColumn, write_overview
from svbrdfgan.report.page import write_report
from svbrdfgan.training.config import train_config
from svbrdfgan.training.run import CONFIG, load_model
from svbrdfgan.training.trainer import train
from svbrdfgan.utils.display import Display

_TEXTURE = 512
"""Texels along a side of the weathered vehicle's textures."""


@dataclass(frozen=True)
class DemoResult:
    """The evaluation, and the paths of what the demo made.

    Attributes:
        vehicle: GLB of a vehicle of the test split, weathered by the trained generator, on glossy paint; a PNG of the
            same name shows it.
    """

    evaluation: Evaluation
    vehicle: Path
    report: Path
    picture: Path


def run_demo(out: Path, display: Display) -> DemoResult:
    """The demo's results in `out`; makes what is not there yet."""
    out.mkdir(parents=True, exist_ok=True)
    for name in ("dataset.yaml", "train.yaml"):
        if not (out / name).is_file():
            with resources.as_file(resources.files("svbrdfgan.experiments.demo") / name) as shipped:
                shutil.copyfile(shipped, out / name)
    data, run = out / "dataset", out / "run"
    declared = dataset_config(load_yaml(out / "dataset.yaml"), str(out / "dataset.yaml"))
    plan = generate(declared, data, base=out, display=display)
    training = train_config(load_yaml(out / "train.yaml"), str(out / "train.yaml"))
    train(training, run, base=out, resume=(run / CONFIG).is_file(), display=display)
    evaluated = evaluate(run, split="test", schedule=OracleConfig(batch=training.batch_size), display=display)
    display.begin("writing the vehicle and the report")
    renderer, _ = resolve_renderer(training.renderer, maps=GLOSS, bounces=BOUNCES)
    vehicle, mesh = out / "weathered_vehicle.glb", load_mesh(data / plan.meshes["test"][0].asset.path)
    _, learned = paint(mesh, load_model(run), resolution=_TEXTURE)
    subject, layer = glossy(mesh, declared, _TEXTURE), matt_dirt(learned)
    write_embedded(vehicle, subject, layer, GLOSS)
    write_picture(vehicle.with_suffix(".png"), subject, layer, renderer, build_studio(), GLOSS)
    picture = out / "overview.png"
    column = FurtherColumn("on glossy paint", partial(glossy_picture, evaluated, renderer))
    write_overview(run, evaluated, picture, further=column)
    return DemoResult(evaluated.evaluation, vehicle, write_report(run, evaluated), picture)
