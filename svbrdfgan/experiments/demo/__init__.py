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
from svbrdfgan.experiments.demo.gloss import PAINT, glossy_picture, matt_dirt, polished
from svbrdfgan.inference.apply import paint
from svbrdfgan.inference.embedded import write_embedded
from svbrdfgan.inference.studio import write_picture
from svbrdfgan.io.environment import load_environment
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.report.overview import FurtherColumn, write_overview
from svbrdfgan.report.page import write_report
from svbrdfgan.training.config import train_config
from svbrdfgan.training.run import CONFIG, load_model
from svbrdfgan.training.trainer import train
from svbrdfgan.utils.display import Display

_SPP = 16
"""Samples per pixel of the vehicle's picture, which is large."""


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
    renderer, _ = resolve_renderer(training.renderer, maps=PAINT)
    vehicle = out / "weathered_vehicle.glb"
    subject, learned = paint(load_mesh(data / plan.meshes["test"][0].asset.path), load_model(run))
    subject, layer = polished(subject), matt_dirt(learned)
    write_embedded(vehicle, subject, layer, PAINT)
    sky = load_environment(data / plan.environments["test"][0].asset.path)
    write_picture(vehicle.with_suffix(".png"), subject, layer, renderer, sky, PAINT, spp=_SPP)
    picture = out / "overview.png"
    column = FurtherColumn("on glossy paint", partial(glossy_picture, evaluated, renderer))
    write_overview(run, evaluated, picture, further=column)
    return DemoResult(evaluated.evaluation, vehicle, write_report(run, evaluated), picture)
