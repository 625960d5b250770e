"""The demo: what `dataset`, `train`, `evaluate` and `texture` do, one after the other, on shipped configurations."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib import resources
from pathlib import Path

import torch

from svbrdfgan.config.choices import PluginChoice
from svbrdfgan.config.yaml_files import load_yaml
from svbrdfgan.data.config import dataset_config
from svbrdfgan.data.generate import generate
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.evaluation.oracle import OracleConfig
from svbrdfgan.evaluation.record import Evaluation
from svbrdfgan.experiments.demo.gloss import GLOSS, glossy, glossy_picture, matt_dirt
from svbrdfgan.experiments.demo.opening import demo_rows, write_opening
from svbrdfgan.inference.apply import paint
from svbrdfgan.inference.studio import BOUNCES, Studio, write_picture
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.softboxes import build_studio
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.rendering.compositing import BARE
from svbrdfgan.report.overview import FurtherColumn, write_overview
from svbrdfgan.report.page import write_report
from svbrdfgan.scene.embedded_files import write_embedded
from svbrdfgan.training.config import train_config
from svbrdfgan.training.run import CONFIG, load_model
from svbrdfgan.training.trainer import train
from svbrdfgan.utils.display import Display

SHOWN = replace(sample_vehicle("van", seed=6), paint=(0.32, 0.52, 0.50))
"""The vehicle that the demo opens with: its sides are large, and its paint is apart from rust and from dirt."""
_ORACLE = OracleConfig(batch=8, rate=3e-3, patience=1, halvings=3)
"""A small network learns faster than those for which the default is made."""
_TEXTURE = 512
"""Texels along a side of the weathered vehicle's textures, a multiple of those trained at."""
_SPP = 12
"""Samples per pixel of the vehicle's picture, which is large."""


@dataclass(frozen=True)
class DemoResult:
    """The evaluation, and the paths of what the demo made.

    Attributes:
        opening: a picture of a vehicle under several weatherings, which was there before all else.
        vehicle: GLB of a vehicle of the test split, weathered by the trained generator, on glossy paint; a PNG of the
            same name shows it.
    """

    evaluation: Evaluation
    opening: Path
    vehicle: Path
    report: Path
    picture: Path


def open_demo(out: Path, display: Display) -> Path:
    """The picture that the demo opens with, before it trains anything; made if it is not there yet."""
    out.mkdir(parents=True, exist_ok=True)
    picture, vehicle, rows = out / "opening.png", out / "clean_vehicle.glb", demo_rows()
    if not picture.is_file():
        display.begin("rust and road dirt on a vehicle", sum(map(len, rows)))
        save_mesh_glb(vehicle, build_vehicle(SHOWN))
        for _ in write_opening(picture, vehicle, rows, _studio()):
            display.advance()
    return picture


def run_demo(out: Path, display: Display) -> DemoResult:
    """The demo's results in `out`; makes what is not there yet."""
    opening = open_demo(out, display)
    for name in ("dataset.yaml", "train.yaml"):
        if not (out / name).is_file():
            with resources.as_file(resources.files("svbrdfgan.experiments.demo") / name) as shipped:
                shutil.copyfile(shipped, out / name)
    data, run = out / "dataset", out / "run"
    declared = dataset_config(load_yaml(out / "dataset.yaml"), str(out / "dataset.yaml"))
    plan = generate(declared, data, base=out, display=display)
    training = train_config(load_yaml(out / "train.yaml"), str(out / "train.yaml"))
    with _one_thread():
        train(training, run, base=out, resume=(run / CONFIG).is_file(), display=display)
        evaluated = evaluate(run, split="test", schedule=_ORACLE, display=display)
    display.begin("writing the vehicle and the report")
    vehicle, mesh = out / "weathered_vehicle.glb", load_mesh(data / plan.meshes["test"][0].asset.path)
    _, learned = paint(mesh, load_model(run), resolution=_TEXTURE)
    subject, layer = glossy(mesh, declared, _TEXTURE), matt_dirt(learned)
    write_embedded(vehicle, subject, layer, GLOSS)
    studio = _studio()
    write_picture(vehicle.with_suffix(".png"), subject, layer, studio.renderer, studio.environment, GLOSS, spp=_SPP)
    picture = out / "overview.png"
    column = FurtherColumn("on glossy paint", partial(glossy_picture, evaluated, studio.renderer))
    write_overview(run, evaluated, picture, further=column)
    return DemoResult(evaluated.evaluation, opening, vehicle, write_report(run, evaluated), picture)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Torch works in one thread: those of so small a network mostly wait for each other, longest on busy cores."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


@cache
def _studio() -> Studio:
    renderer, _ = resolve_renderer(PluginChoice(name="auto"), maps=BARE, bounces=BOUNCES)
    return Studio(renderer, build_studio())
