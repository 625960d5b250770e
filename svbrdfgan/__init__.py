"""svbrdfgan learns how surfaces weather, from pictures, through a differentiable renderer.

Its public names are listed in `docs/api.md`. Each is imported when first used, so importing the package is free.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from svbrdfgan.config.choices import PartSelection
    from svbrdfgan.config.yaml_files import load_yaml
    from svbrdfgan.data.config import DatasetConfig, dataset_config
    from svbrdfgan.data.generate import generate
    from svbrdfgan.errors import ConfigError, SvbrdfganError
    from svbrdfgan.evaluation.evaluate import evaluate
    from svbrdfgan.evaluation.leakage.probe import probe_shortcuts
    from svbrdfgan.inference.apply import paint
    from svbrdfgan.inference.export import write_picture, write_weathered
    from svbrdfgan.io.environment import load_environment
    from svbrdfgan.io.image import save_image
    from svbrdfgan.io.mesh import load_mesh
    from svbrdfgan.plugins.registry import load_embedding, load_renderer
    from svbrdfgan.procedural.kinds import sample_vehicle
    from svbrdfgan.procedural.sky import build_sky, sample_sky
    from svbrdfgan.procedural.vehicle import build_vehicle
    from svbrdfgan.protocols import Renderer, RendererCapabilities, UVEmbedding
    from svbrdfgan.rendering.checked_renderer import CheckedRenderer
    from svbrdfgan.rendering.compositing import composite, over
    from svbrdfgan.rendering.render_layer import RenderLayer
    from svbrdfgan.rendering.transport.build import build_transport
    from svbrdfgan.rendering.transport.light_transport import LightTransport
    from svbrdfgan.rendering.transport.product import TransportBatch
    from svbrdfgan.report.page import write_report
    from svbrdfgan.scene.description import Scene
    from svbrdfgan.scene.subject import Subject, make_subject
    from svbrdfgan.training.config import TrainConfig, train_config
    from svbrdfgan.training.run import load_model
    from svbrdfgan.training.trainer import train
    from svbrdfgan.types import (
        Camera,
        Environment,
        Gradients,
        Layer,
        Material,
        Materials,
        Mesh,
        Part,
        Rendering,
        Surface,
        View,
    )
    from svbrdfgan.weathering.layer import weather
    from svbrdfgan.weathering.recipes import ChippedPaint, Dust, RoadDirt, Rust

__all__ = [
    "Camera",
    "CheckedRenderer",
    "ChippedPaint",
    "ConfigError",
    "DatasetConfig",
    "Dust",
    "Environment",
    "Gradients",
    "Layer",
    "LightTransport",
    "Material",
    "Materials",
    "Mesh",
    "Part",
    "PartSelection",
    "RenderLayer",
    "Renderer",
    "RendererCapabilities",
    "Rendering",
    "RoadDirt",
    "Rust",
    "Scene",
    "Subject",
    "Surface",
    "SvbrdfganError",
    "TrainConfig",
    "TransportBatch",
    "UVEmbedding",
    "View",
    "__version__",
    "build_sky",
    "build_transport",
    "build_vehicle",
    "composite",
    "dataset_config",
    "evaluate",
    "generate",
    "load_embedding",
    "load_environment",
    "load_mesh",
    "load_model",
    "load_renderer",
    "load_yaml",
    "make_subject",
    "over",
    "paint",
    "probe_shortcuts",
    "sample_sky",
    "sample_vehicle",
    "save_image",
    "train",
    "train_config",
    "weather",
    "write_picture",
    "write_report",
    "write_weathered",
]

_MODULES = {
    "types": (
        *(
            "Camera",
            "Environment",
            "Gradients",
            "Layer",
            "Material",
            "Materials",
            "Mesh",
            "Part",
            "Rendering",
            "Surface",
            "View",
        ),
    ),
    "protocols": ("Renderer", "RendererCapabilities", "UVEmbedding"),
    "io.environment": ("load_environment",),
    "io.image": ("save_image",),
    "io.mesh": ("load_mesh",),
    "procedural.kinds": ("sample_vehicle",),
    "procedural.sky": ("build_sky", "sample_sky"),
    "procedural.vehicle": ("build_vehicle",),
    "plugins.registry": ("load_embedding", "load_renderer"),
    "scene.subject": ("Subject", "make_subject"),
    "weathering.layer": ("weather",),
    "weathering.recipes": ("ChippedPaint", "Dust", "RoadDirt", "Rust"),
    "rendering.compositing": ("composite", "over"),
    "rendering.checked_renderer": ("CheckedRenderer",),
    "rendering.render_layer": ("RenderLayer",),
    "rendering.transport.build": ("build_transport",),
    "rendering.transport.light_transport": ("LightTransport",),
    "rendering.transport.product": ("TransportBatch",),
    "config.choices": ("PartSelection",),
    "data.config": ("DatasetConfig", "dataset_config"),
    "scene.description": ("Scene",),
    "data.generate": ("generate",),
    "evaluation.leakage.probe": ("probe_shortcuts",),
    "training.config": ("TrainConfig", "train_config"),
    "training.trainer": ("train",),
    "training.run": ("load_model",),
    "evaluation.evaluate": ("evaluate",),
    "report.page": ("write_report",),
    "inference.apply": ("paint",),
    "inference.export": ("write_picture", "write_weathered"),
    "config.yaml_files": ("load_yaml",),
    "errors": ("ConfigError", "SvbrdfganError"),
}
_MODULE_OF = {name: f"svbrdfgan.{module}" for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'svbrdfgan' has no attribute {name!r}")
    value: object = getattr(importlib.import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF})
