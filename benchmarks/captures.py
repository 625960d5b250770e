"""What was learned from photographs of one object, beside the photographs that were kept from training.

    python benchmarks/captures.py split CAPTURE/cameras.json -o head      # head/train.json and head/kept.json
    svbrdfgan learn head.yaml train.yaml -o learned
    python benchmarks/captures.py score head.yaml learned/turn-3/exemplars learned/turn-3/run \
        --kept head/kept.json -o scores

`head.yaml` and `tankard.yaml` are beside this file, `train.yaml` is that of docs/own-pictures.md, and `head` holds the
capture's images, masks and mesh.

`split` keeps every sixth picture. `score` renders the kept pictures' views under the light of their group, as the
import of the others estimated it, with

- `constant`: the one colour that fits the training pictures best,
- `learned`: a layer that the run paints, the mean of several draws,
- `projected`: a texture that the training pictures show, which no generator had to learn: the ceiling,

and writes FLIP against the photographs, and `kept.png`: photograph, constant, learned, projected. FLIP is the mean over
the object's pixels, at an exposure that makes the brightest twentieth of the photograph white.
"""

from __future__ import annotations

import json
from pathlib import Path

import click
import numpy as np
import torch
from torch import Tensor

from svbrdfgan.config.yaml_files import load_yaml
from svbrdfgan.data.index import Dataset
from svbrdfgan.data.photos.captures import expand_captures
from svbrdfgan.data.photos.check import ErrorCollector, ImportJob, RectifiedPhoto, check_meshes, check_pictures
from svbrdfgan.data.photos.manifest import Manifest, read_manifest
from svbrdfgan.data.photos.picture_renderer import PictureRenderer
from svbrdfgan.data.trained_model import TrainedModel
from svbrdfgan.geometry.camera_hits import camera_hits
from svbrdfgan.geometry.texels import nearest_texels
from svbrdfgan.io.image import load_image, save_image
from svbrdfgan.metrics.flip import flip
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.types import RGBA, Layer
from svbrdfgan.utils.display import SilentDisplay

EVERY, FIRST = 6, 3
DRAWS = 4
SPP = 64
TEXTURE = 512


@click.group()
def main() -> None:
    pass


@main.command()
@click.argument("cameras", type=click.Path(path_type=Path, exists=True))
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True)
def split(cameras: Path, out: Path) -> None:
    """Writes train.json and kept.json of a NeRF's or this project's file of cameras."""
    given = json.loads(cameras.read_text(encoding="utf-8"))
    out.mkdir(parents=True, exist_ok=True)
    kept = given["frames"][FIRST::EVERY]
    for name, frames in (("kept", kept), ("train", [frame for frame in given["frames"] if frame not in kept])):
        (out / f"{name}.json").write_text(json.dumps({**given, "frames": frames}, indent=1), encoding="utf-8")
        click.echo(f"{out / name}.json: {len(frames)} pictures")


@main.command()
@click.argument("manifest", type=click.Path(path_type=Path, exists=True))
@click.argument("exemplars", type=click.Path(path_type=Path, exists=True))
@click.argument("run", type=click.Path(path_type=Path, exists=True))
@click.option("--kept", type=click.Path(path_type=Path, exists=True), required=True)
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True)
def score(manifest: Path, exemplars: Path, run: Path, kept: Path, out: Path) -> None:
    """Scores RUN, which learned from EXEMPLARS, the import of MANIFEST's one capture."""
    scenes = Scenes(exemplars)
    declared = read_manifest(load_yaml(manifest), str(manifest)).model_copy(update={"image": scenes.image})
    photos = rectified(declared, manifest.parent, kept)
    projected, constant = scenes.shown()
    size = projected.shape[:2]
    layers = {
        "constant": [opaque(constant.expand(*size, 3))],
        "learned": scenes.painted(run),
        "projected": [opaque(projected)],
    }
    found: dict[str, list[float]] = {name: [] for name in layers}
    rows = []
    for photo in photos:
        scene = scenes.of(photo)
        coverage = scenes.renders.render(scene, scenes.renders.clean(scene)).coverage
        inside = (torch.minimum(coverage, photo.film[3]) > 0.99).unsqueeze(-1)
        picture = photo.film[:3].permute(1, 2, 0) * scenes.exposure * inside
        white = 0.9 / float(picture[inside.squeeze(-1)].mean(dim=-1).quantile(0.95))
        shown = [picture * white]
        for name, drawn in layers.items():
            made = [
                scenes.renders.render(scene, each, SPP).image * white * inside
                for each in scenes.renders.weathered(scene, drawn)
            ]
            errors = [flip(shown[0].clamp(0, 1), each.clamp(0, 1)) / float(inside.float().mean()) for each in made]
            found[name].append(float(np.mean(errors)))
            shown.append(made[0])
        rows.append(torch.cat(shown, dim=1).clamp(0, 1))
    out.mkdir(parents=True, exist_ok=True)
    save_image(out / "kept.png", torch.cat(rows[:: max(1, len(rows) // 4)], dim=0))
    mean = {name: float(np.mean(values)) for name, values in found.items()}
    way = (mean["constant"] - mean["learned"]) / (mean["constant"] - mean["projected"])
    (out / "scores.json").write_text(json.dumps({"flip": found, "mean": mean, "way": way}, indent=1), encoding="utf-8")
    click.echo(f"FLIP of {len(photos)} views: {mean}; learned is {way:.0%} of the way from constant to projected")


class Scenes:
    """The imported pictures of one object on a turntable."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.loader = folder, SceneLoader(folder)
        config = Dataset.open(folder).config
        self.image = config.image
        self.renders = PictureRenderer(self.loader, resolve_renderer(config.renderer)[0])
        records = json.loads((folder / "imported.json").read_text(encoding="utf-8"))
        self.exposure = float(np.median([record["exposure"] for record in records]))
        self.scenes = [Scene.load(folder / f"{record['exemplar']}.json") for record in records]
        self.pictures = [load_image(folder / f"{record['exemplar']}.exr")[..., :3] for record in records]

    def of(self, photo: RectifiedPhoto) -> Scene:
        """The scene of another picture of the turntable."""
        turn = {"rotation_degrees": float(np.degrees(photo.entry.heading))}
        first = self.scenes[0]
        light = first.environment.model_copy(update=turn)
        return first.model_copy(update={"camera": photo.camera, "environment": light})

    def painted(self, run: Path) -> list[Layer]:
        model = TrainedModel.open(run, "run")
        there = self.scenes[0].model_copy(update={"texture": model.trained_on.texture, "maps": {}})
        weatherings = model.weatherings(model.store(self.folder), DRAWS)
        return [Layer(self.loader.paint(there, one).values[..., :RGBA]) for one in weatherings]

    def shown(self) -> tuple[Tensor, Tensor]:
        """The texture that all pictures show, the nearest shown texel where there is none; and its median colour."""
        total, weight = torch.zeros(TEXTURE * TEXTURE, 3), torch.zeros(TEXTURE * TEXTURE, 1)
        samples = []
        for scene, picture in zip(self.scenes, self.pictures, strict=True):
            subject, made = self.loader.subject(scene), self.renders.shaded(scene, SPP)
            hits = camera_hits(subject.surface, scene.camera.camera(), scene.width, scene.height)
            clear = torch.from_numpy(hits.hit) & (made.shading > 0.1 * made.shading.mean()).all(dim=-1)
            color = (picture - made.others.image)[clear] / made.shading[clear]
            uv = torch.from_numpy(hits.interpolate(subject.surface.uv))[clear]
            col, row = ((uv[:, 0] % 1) * TEXTURE).long(), ((uv[:, 1] % 1) * TEXTURE).long()
            place = row.clamp(0, TEXTURE - 1) * TEXTURE + col.clamp(0, TEXTURE - 1)
            trust = made.shading[clear].mean(dim=-1, keepdim=True)
            total.index_add_(0, place, color * trust)
            weight.index_add_(0, place, trust)
            samples.append(color)
        seen = (weight > 0).reshape(TEXTURE, TEXTURE).numpy()
        texture = (total / weight.clamp(min=1e-6)).reshape(TEXTURE, TEXTURE, 3)[nearest_texels(seen)].clamp(0, 1)
        return texture, torch.cat(samples).median(dim=0).values.clamp(0, 1)


def opaque(color: Tensor) -> Layer:
    return Layer(torch.cat([color, torch.ones_like(color[..., :1])], dim=-1))


def rectified(manifest: Manifest, base: Path, cameras: Path) -> list[RectifiedPhoto]:
    """The pictures of the manifest's one capture by another file of its cameras, warped to the data set's."""
    (capture,) = manifest.captures
    moved = capture.model_copy(update={"cameras": str(cameras.resolve())})
    errors = ErrorCollector("kept")
    expanded, labels = expand_captures(manifest.model_copy(update={"captures": (moved,)}), base, errors)
    job = ImportJob(expanded, base, errors, SilentDisplay(), labels)
    photos = check_pictures(job, check_meshes(job))
    errors.raise_if_any()
    if job.unusable:
        raise click.ClickException("\n".join(line for lines in job.unusable.values() for line in lines))
    return list(photos.values())


if __name__ == "__main__":
    main()
