"""Every kind of file that the program reads: seeds, made by the program itself, and what reads them."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

import svbrdfgan
from svbrdfgan.asset.asset import load_asset
from svbrdfgan.asset.masks import Mask
from svbrdfgan.asset.orientation import find_orientation
from svbrdfgan.asset.verdicts import judge, warnings
from svbrdfgan.asset.weather_document import Textures
from svbrdfgan.bench.bench_scene import BenchScene
from svbrdfgan.bench.cases import Case
from svbrdfgan.bench.history import entries_of, read_history, write_history
from svbrdfgan.bench.programs import Figures
from svbrdfgan.bench.run import Result
from svbrdfgan.bench.standard_scenes import standard_scene
from svbrdfgan.cli.options import read_config
from svbrdfgan.config.models import validate
from svbrdfgan.data.config import dataset_config
from svbrdfgan.data.exemplar_files import SplitFiles, load_picture, packing
from svbrdfgan.data.index import INDEX, DatasetIndex
from svbrdfgan.data.photos.manifest import read_manifest
from svbrdfgan.data.photos.photo import load_photo
from svbrdfgan.data.photos.transforms import read_transforms
from svbrdfgan.evaluation.oracle import _Notes
from svbrdfgan.experiments.definition import load_experiment
from svbrdfgan.inference.weathered_file import write_weathered
from svbrdfgan.io.environment import load_environment
from svbrdfgan.io.exr import load_exr, save_exr
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.io.image import load_grey, load_image, save_image
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.io.records import load_record
from svbrdfgan.models.shipped import CARD, load_card
from svbrdfgan.networks.saved import GeneratorConfig, load_generator, make_generator, save_generator
from svbrdfgan.scene.cache import load_layer, load_mesh_maps, load_subject, save_layer, save_mesh_maps, save_subject
from svbrdfgan.scene.description import Scene
from svbrdfgan.training.config import train_config
from svbrdfgan.training.metrics_log import read_metrics
from svbrdfgan.training.run import CONFIG, LOG, RunConfig
from svbrdfgan.training.state import _Counters
from svbrdfgan.types import Layer, Surface
from svbrdfgan.weathering.recipes import RECIPES
from tests.fuzz.judge import SECONDS

SIDE = 16
"""Texels along a side of what is cached."""


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        name: the file's, of which readers may look for one alone; its suffix says how it is damaged.
        seeds: whole files.
        read: reads a damaged one, in a folder of its own.
        beside: files that lie in that folder, too.
        seconds: what reading may take.
        share: inputs in a round of all kinds.
    """

    name: str
    seeds: tuple[bytes, ...]
    read: Callable[[Path], Any]
    beside: tuple[Path, ...] = ()
    seconds: float = SECONDS
    share: int = 20

    @property
    def suffix(self) -> str:
        return Path(self.name).suffix

    def place(self, folder: Path, data: bytes) -> Path:
        """Writes a file of this kind, and what lies beside it."""
        folder.mkdir(parents=True, exist_ok=True)
        for path in self.beside:
            if not (folder / path.name).exists():
                shutil.copy(path, folder)
        path = folder / self.name
        path.write_bytes(data)
        return path


def _gathered(path: Path) -> None:
    """What `svbrdfgan dataset` does with a mesh."""
    save_mesh_glb(path.with_name("stored.glb"), load_mesh(path))


def _judged(path: Path) -> None:
    """What `svbrdfgan parts` does with a mesh."""
    asset = load_asset(path)
    found = find_orientation(asset.mesh, front=None, up=None)
    warnings(judge(asset, orientation=found.matrix(), learnable=(), keep=(), masked={}), asset)


def _weathered(path: Path) -> None:
    """What `svbrdfgan weather` does with a mesh."""
    write_weathered(path.with_name("out.glb"), path, RECIPES["dust"](), Textures(16, 16), learnable=("*",))


def kinds(folder: Path, dataset: Path, samples: dict[str, bytes]) -> dict[str, Kind]:
    """All kinds, by name.

    Args:
        folder: an empty one, for seeds.
        dataset: a data set of the program.
        samples: glTF files with something of everything, by suffix.
    """
    files = _files(folder, dataset)
    meshes = {suffix: (files[f"mesh{suffix}"],) for suffix in (".obj", ".ply", ".stl")}
    meshes |= {suffix: (data,) for suffix, data in samples.items()}
    meshes[".glb"] += (files["mesh.glb"],)
    found = {}
    for suffix, seeds in meshes.items():
        beside = (folder / "paint.mtl", folder / "paint.png") if suffix == ".obj" else ()
        found[suffix[1:]] = Kind(f"mesh{suffix}", seeds, _gathered, beside)
        found[f"parts-{suffix[1:]}"] = Kind(f"mesh{suffix}", seeds, _judged, beside, 6 * SECONDS, 5)
        found[f"weather-{suffix[1:]}"] = Kind(f"mesh{suffix}", seeds, _weathered, beside, 12 * SECONDS, 1)
    for suffix in (".png", ".jpg", ".exr", ".hdr"):
        found[f"picture-{suffix[1:]}"] = Kind(f"picture{suffix}", (files[f"picture{suffix}"],), load_image)
    for suffix in (".exr", ".hdr"):
        found[f"environment-{suffix[1:]}"] = Kind(f"a{suffix}", (files[f"picture{suffix}"],), load_environment)
    photos = {s: Kind(f"photo{s}", (files[f"picture{s}"],), lambda p: load_photo(p, None)) for s in (".png", ".jpg")}
    grey = {f"grey-{s[1:]}": Kind(f"grey{s}", (files[f"picture{s}"],), load_grey) for s in (".png", ".exr")}
    found |= {f"photo-{suffix[1:]}": kind for suffix, kind in photos.items()} | grey
    found["channels-exr"] = Kind("a.labels.exr", (files["labels.exr"],), load_exr)
    found["mask-png"] = Kind("mask.png", (files["picture.png"],), lambda p: Mask.read(str(p)))
    found["mtl"] = Kind(
        "paint.mtl",
        ((folder / "paint.mtl").read_bytes(),),
        lambda p: _gathered(p.with_name("mesh.obj")),
        (folder / "mesh.obj", folder / "paint.png"),
    )
    return found | _configurations(dataset) | _records(dataset, files, _subject(folder).surface)


def _configurations(dataset: Path) -> dict[str, Kind]:
    shipped = Path(svbrdfgan.__file__).parent / "experiments"

    def declared(read: Callable[[dict[str, Any], str], Any]) -> Callable[[Path], Any]:
        return lambda path: read(read_config(path, ()), str(path))

    manifest = {
        "pictures": [
            {
                "file": "a.jpg",
                "mesh": "a.glb",
                "camera": {"azimuth_degrees": 35, "elevation_degrees": 9, "distance": 6.5},
            }
        ],
        "paint": {"a.glb": [0.4, 0.1, 0.1]},
    }
    definitions = sorted((shipped / "definitions").glob("*.yaml"))
    return {
        "dataset": Kind("dataset.yaml", ((shipped / "demo/dataset.yaml").read_bytes(),), declared(dataset_config)),
        "train": Kind("train.yaml", ((shipped / "demo/train.yaml").read_bytes(),), declared(train_config)),
        "manifest": Kind("manifest.yaml", (json.dumps(manifest).encode(),), declared(read_manifest)),
        "experiment": Kind(
            "experiment.yaml", tuple(path.read_bytes() for path in definitions), lambda p: load_experiment(str(p))
        ),
    }


def _records(dataset: Path, files: dict[str, bytes], surface: Surface) -> dict[str, Kind]:
    counters = {"step": 4, "seconds": 2.5, "best": [1.5, 2], "history": [{"step": 2, "seconds": 1.0, "score": 0.5}]}
    lines = "\n".join(json.dumps({"step": step, "loss": 0.5 / step}) for step in range(1, 9))
    model = Path(svbrdfgan.__file__).parent / "models" / "rust"
    frames = {"camera_angle_x": 0.7, "frames": [{"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}]}
    scene = next(dataset.rglob("000000.json"))
    return {
        "index": Kind(INDEX, ((dataset / INDEX).read_bytes(),), lambda p: DatasetIndex.load(p.parent)),
        "scene": Kind("scene.json", (scene.read_bytes(),), Scene.load),
        "pack": Kind("train-0000.tar", (_packed(scene),), _read_pack),
        "counters": Kind("state.json", (json.dumps(counters).encode(),), lambda p: load_record(_Counters, p)),
        "notes": Kind(
            "oracle.json", (b'{"steps": 3, "run_steps": 4, "plateau": true}',), lambda p: load_record(_Notes, p)
        ),
        "log": Kind(LOG, (lines.encode(),), lambda p: read_metrics(p.parent)),
        "run": Kind(CONFIG, ((model / CONFIG).read_bytes(),), lambda p: load_record(RunConfig, p)),
        "card": Kind(CARD, ((model / CARD).read_bytes(),), lambda p: load_card(p.parent)),
        "transforms": Kind("transforms.json", (json.dumps(frames).encode(),), read_transforms),
        "generator": Kind("model.safetensors", (files["generator"],), load_generator),
        "subject": Kind("subject.safetensors", (files["subject"],), lambda p: load_subject(p, SIDE)),
        "window": Kind("window.safetensors", (files["window"],), lambda p: load_subject(p, SIDE, surface)),
        "history": Kind("bench.jsonl", (files["history"],), read_history),
        "maps": Kind("maps.safetensors", (files["maps"],), lambda p: load_mesh_maps(p, SIDE)),
        "layer": Kind("layer.safetensors", (files["layer"],), lambda p: load_layer(p, SIDE)),
        "bench": Kind("scene.npz", (files["bench"],), BenchScene.load),
    }


def _packed(record: Path) -> bytes:
    """A tar file of one exemplar."""
    path = record.with_name("packed.tar")
    with packing(path) as add:
        for file in (record.with_suffix(".exr"), record):
            add(file)
    content = path.read_bytes()
    path.unlink()
    return content


def _read_pack(path: Path) -> None:
    with SplitFiles(path.parent, "train") as files:
        for number in files.numbers:
            with files.exemplar(number) as (picture, record):
                Scene.load(record)
                load_picture(picture)


def _files(folder: Path, dataset: Path) -> dict[str, bytes]:
    """Files that are made here, by name."""
    import trimesh

    random = torch.Generator().manual_seed(5)
    picture = torch.rand(16, 24, 3, generator=random)
    for suffix in (".png", ".jpg", ".exr", ".hdr"):
        save_image(folder / f"picture{suffix}", picture)
    save_exr(folder / "labels.exr", {"part.id": picture[..., 0], "depth.Z": picture[..., 1]})
    Image.new("RGB", (4, 4), "red").save(folder / "paint.png")
    (folder / "paint.mtl").write_text("newmtl paint\nKd 0.5 0.2 0.1\nd 0.9\nPr 0.4\nPm 0.1\nmap_Kd paint.png\n")
    ball = trimesh.creation.icosphere(subdivisions=1)
    corners = "\n".join(f"v {x} {y} {z}\nvt {x} {y}" for x, y, z in ball.vertices)
    faces = "\n".join("f " + " ".join(f"{k + 1}/{k + 1}" for k in face) for face in ball.faces)
    (folder / "mesh.obj").write_text(f"mtllib paint.mtl\n{corners}\nusemtl paint\n{faces}\n")
    for suffix in (".ply", ".stl"):
        (folder / f"mesh{suffix}").write_bytes(ball.export(file_type=suffix[1:]))
    save_mesh_glb(folder / "mesh.glb", load_mesh(folder / "mesh.obj"))
    subject = _subject(folder)
    save_subject(folder / "subject", subject)
    window = replace(subject, surface=replace(subject.surface, uv=2.0 * subject.surface.uv))
    save_subject(folder / "window", window, subject.surface)
    made = Figures("warp", "cpu", {"forward": 0.5}, {}, {})
    result = Result(Case("standard", 2000, 16, 2), 2025, 3872, 0.0, (made, made), ())
    write_history(folder / "history", entries_of([result], {"processor": "Abacus", "cores": 2}, 16))
    save_mesh_maps(folder / "maps", subject.with_mesh_maps().mesh_maps)
    save_layer(folder / "layer", Layer(torch.rand(SIDE, SIDE, 4, generator=random)))
    generator = make_generator(validate(GeneratorConfig, {"width": 4, "blocks": 1}, "seed"))
    save_generator(folder / "generator", generator, validate(GeneratorConfig, {"width": 4, "blocks": 1}, "seed"), 0.5)
    stream = BytesIO()
    scene = standard_scene(25, 16, 8)
    np.savez(stream, **{field.name: getattr(scene, field.name) for field in fields(scene)})
    return {path.name: path.read_bytes() for path in folder.iterdir()} | {"bench": stream.getvalue()}


def _subject(folder: Path) -> Any:
    from svbrdfgan.config.choices import PartSelection
    from svbrdfgan.plugins.registry import load_embedding
    from svbrdfgan.scene.subject import make_subject

    return make_subject(
        load_mesh(folder / "mesh.glb"), load_embedding("hemispherical", {"resolution": 16}), SIDE, PartSelection()
    )
