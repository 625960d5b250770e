"""The demo: what `dataset`, `train`, `evaluate` and `texture` do, one after the other, on shipped configurations."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from svbrdfgan.config.yaml_files import load_yaml
from svbrdfgan.data.config import dataset_config
from svbrdfgan.data.generate import generate
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.evaluation.oracle import OracleConfig
from svbrdfgan.evaluation.record import Evaluation
from svbrdfgan.inference.apply import paint
from svbrdfgan.inference.export import write_weathered
from svbrdfgan.io import load_mesh
from svbrdfgan.report.hero import write_hero
from svbrdfgan.report.page import write_report
from svbrdfgan.training.config import train_config
from svbrdfgan.training.run import CONFIG, load_model
from svbrdfgan.training.trainer import train
from svbrdfgan.utils.display import Display


@dataclass(frozen=True)
class DemoResult:
    """The evaluation, and the paths of what the demo made.

    Attributes:
        vehicle: GLB of a vehicle of the test split, weathered by the trained generator.
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
    vehicle = out / "weathered_vehicle.glb"
    subject, layer = paint(load_mesh(data / plan.meshes["test"][0].asset.path), load_model(run))
    write_weathered(vehicle, subject, layer)
    picture = out / "overview.png"
    write_hero(run, evaluated, picture)
    return DemoResult(evaluated.evaluation, vehicle, write_report(run, evaluated), picture)
