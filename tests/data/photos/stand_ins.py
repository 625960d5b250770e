"""Stand-ins for users' photographs, unlike images in training: several bounces, gloss, a tone curve, a sky behind.

python tests/data/photos/stand_ins.py OUT --vehicles 15 --views 4 --skies some/*.hdr
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
import yaml
from torch import Tensor

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.data.config import PAINTS
from svbrdfgan.io.environment import load_environment
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.io.image import save_image
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.plugins.registry import load_embedding, load_renderer
from svbrdfgan.procedural.kinds import KINDS, sample_vehicle
from svbrdfgan.procedural.sky import build_sky, sample_sky
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.protocols import Renderer
from svbrdfgan.rendering.compositing import over
from svbrdfgan.scene.description import OrbitCamera
from svbrdfgan.scene.subject import Subject, make_subject
from svbrdfgan.types import Camera, Environment, Materials, Rendering, View
from svbrdfgan.weathering.layer import recipe_from_options, weather

GLOSS = {"roughness": 0.35}
SMALL: dict[str, Any] = {
    "image": [48, 48],
    "texture": 32,
    "renderer": {"name": "mitsuba", "device": "cpu"},
    "embedding": {"name": "hemispherical", "resolution": 32},
    "environments": {"procedural": {"count": 3, "seed": 1}},
    "environment_rows": 16,
    "bootstrap": 0,
}
"""Keys of manifests of stand-ins that are imported fast."""
SHOULDER = 0.7
"""Where the tone curve leaves the straight line."""


@dataclass(frozen=True, eq=False)
class StandIn:
    """A picture and the truth about it.

    Attributes:
        render: the linear picture from any camera, of any size and samples per pixel.
        gain: the camera's factor on radiance.
        camera: the true camera.
        claimed: the camera in the manifest, with errors.
        sky, turn: the light, by its index among the photographer's skies, and its rotation in radians.
        amount: of the recipe.
        turntable: whether the vehicle turned before one camera, in one light.
    """

    file: str
    mesh: str
    render: Callable[[Camera, tuple[int, int], int], Rendering]
    gain: float
    camera: OrbitCamera
    claimed: OrbitCamera
    paint: tuple[float, float, float]
    sky: int
    turn: float
    amount: float
    turntable: bool


@dataclass(frozen=True)
class Photographer:
    """Makes stand-ins."""

    renderer: Renderer[Any]
    skies: tuple[Tensor, ...]
    size: tuple[int, int] = (96, 64)
    spp: int = 32
    camera_error: float = 1.0
    recipe: str = "road-dirt"
    turntable: bool = False

    def photograph(
        self, folder: Path, subject: Subject, mesh: str, views: int, rng: np.random.Generator
    ) -> list[StandIn]:
        """Photographs of a vehicle, weathered once, with masks beside them.

        On a turntable, camera and light stay where they are relative to each other.
        """
        amount = float(rng.uniform(0.8, 1.0))
        recipe = recipe_from_options(self.recipe, {"amount": amount})
        layer = weather(subject.surface, subject.buffer, recipe, GLOSS)
        prepared, paint = self.renderer.prepare(subject.surface), PAINTS[rng.integers(len(PAINTS))]
        painted = dict.fromkeys((subject.surface.parts[part].name for part in subject.learnable), paint)
        materials = subject.materials(layer, GLOSS, base_colors=painted)
        taken: list[StandIn] = []
        for number in range(views):
            camera, sky, turn = _camera(rng), int(rng.integers(len(self.skies))), rng.uniform(0, 2 * math.pi)
            if self.turntable and taken:
                first = taken[0]
                camera = first.camera.model_copy(update={"azimuth_degrees": camera.azimuth_degrees})
                turned = math.radians(camera.azimuth_degrees - first.camera.azimuth_degrees)
                sky, turn = first.sky, first.turn + turned
            light = Environment(self.skies[sky] / self.skies[sky].mean(), turn)
            seed = int(rng.integers(2**31))
            render = partial(self._picture, prepared, materials, light, seed)
            made = render(camera.camera(), self.size, self.spp)
            image, coverage = made.image.cpu(), made.coverage.cpu()
            gain = 0.6 / float(torch.quantile(image[coverage > 0.5], 0.9)) * math.exp(rng.normal(0, 0.3))
            file = f"photos/{Path(mesh).stem}_{number}.jpg"
            save_image(
                folder / file, _toned(over(image, coverage, _behind(View(camera.camera(), light, *self.size))) * gain)
            )
            save_image((folder / file).with_suffix(".mask.png"), (coverage > 0.5).float().unsqueeze(-1))
            claimed = _mistaken(camera, self.camera_error, rng)
            truth = (gain, camera, claimed, paint, sky, turn, amount, self.turntable)
            taken.append(StandIn(file, mesh, render, *truth))
        return taken

    def _picture(
        self,
        prepared: Any,
        materials: Materials,
        light: Environment,
        seed: int,
        camera: Camera,
        size: tuple[int, int],
        spp: int,
    ) -> Rendering:
        return self.renderer.render(prepared, materials, View(camera, light, *size), spp=spp, seed=seed)


def make_stand_ins(
    folder: Path, photographer: Photographer, vehicles: int, views: int, seed: int = 0, meshes: Sequence[Path] = ()
) -> list[StandIn]:
    """Photographs, masks and meshes in a folder, and a `manifest.yaml` of them: half with masks, half by look-at.

    Args:
        vehicles: the number of procedural vehicles.
        meshes: files to take instead, of length 1, on the ground, with the nose at +Z.
    """
    rng = np.random.default_rng(seed)
    embedding = load_embedding("hemispherical", {"resolution": 64})
    made: list[StandIn] = []
    for number in range(len(meshes) or vehicles):
        if meshes:
            mesh, file = load_mesh(meshes[number]), f"meshes/{meshes[number].name}"
        else:
            mesh = build_vehicle(sample_vehicle(list(KINDS)[number % len(KINDS)], seed=9000 + 100 * seed + number))
            file = f"meshes/car_{number}.glb"
        save_mesh_glb(folder / file, mesh)
        subject = make_subject(mesh, embedding, 128, PartSelection())
        made += photographer.photograph(folder, subject, file, views, rng)
    manifest = {"pictures": [_entry(one, number) for number, one in enumerate(made)]}
    manifest["paint"] = {one.mesh: list(one.paint) for one in made}
    (folder / "manifest.yaml").write_text(yaml.safe_dump(manifest), encoding="utf-8")
    known = ("file", "mesh", "gain", "sky", "turn", "amount")
    truth = [{name: getattr(one, name) for name in known} | {"camera": one.camera.model_dump()} for one in made]
    (folder / "truth.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")
    return made


def _entry(one: StandIn, number: int) -> dict[str, Any]:
    camera: dict[str, Any] = json.loads(one.claimed.model_dump_json())
    if number % 4 > 1:
        seen = one.claimed.camera()
        camera = {"position": list(seen.origin), "look_at": list(seen.target)}
        camera["vertical_fov_degrees"] = one.claimed.vertical_fov_degrees
    mask = {"mask": str(Path(one.file).with_suffix(".mask.png"))} if number % 2 == 0 else {}
    group = {"light_group": one.mesh, "turntable": True} if one.turntable else {}
    return {"file": one.file, "mesh": one.mesh, "camera": camera, **mask, **group}


def _camera(rng: np.random.Generator) -> OrbitCamera:
    """From all round, the vehicle (of length 1) whole in the picture but not in its middle."""
    return OrbitCamera(
        azimuth_degrees=rng.uniform(0, 360),
        elevation_degrees=rng.uniform(5, 35),
        distance=rng.uniform(1.7, 2.3),
        target=(rng.uniform(-0.05, 0.05), rng.uniform(0.1, 0.25), rng.uniform(-0.05, 0.05)),
        vertical_fov_degrees=rng.uniform(30, 38),
    )


def _mistaken(camera: OrbitCamera, error: float, rng: np.random.Generator) -> OrbitCamera:
    """The camera as a person might have measured it: off by `error` degrees, hundredths of a metre and percent."""
    off = rng.normal(size=7) * error
    x, y, z = (value + 0.01 * step for value, step in zip(camera.target, off[:3], strict=True))
    return OrbitCamera(
        azimuth_degrees=(camera.azimuth_degrees + off[3]) % 360,
        elevation_degrees=camera.elevation_degrees + off[4],
        distance=camera.distance * (1 + 0.01 * off[5]),
        target=(x, y, z),
        vertical_fov_degrees=camera.vertical_fov_degrees * (1 + 0.01 * off[6]),
    )


def _toned(image: Tensor) -> Tensor:
    """Straight below the shoulder, never quite 1 above it."""
    room = 1 - SHOULDER
    return torch.where(image < SHOULDER, image, SHOULDER + room * torch.tanh((image - SHOULDER) / room))


def _behind(view: View) -> Tensor:
    """The sky, and what lies below it, as the camera sees it."""
    up = math.tan(view.camera.vertical_fov / 2)
    y, x = torch.meshgrid(
        torch.linspace(up, -up, view.height),
        torch.linspace(-up, up, view.width) * view.width / view.height,
        indexing="ij",
    )
    sight = F.normalize(torch.stack([x, y, -torch.ones_like(x)], -1), dim=-1) @ _basis(view.camera)
    u = torch.atan2(sight[..., 0], -sight[..., 2]) / math.pi + view.environment.rotation / math.pi
    v = torch.arccos(sight[..., 1].clamp(-1, 1)) / math.pi * 2 - 1
    place = torch.stack([(u + 1) % 2 - 1, v], dim=-1)[None]
    radiance = view.environment.radiance.permute(2, 0, 1)[None]
    return F.grid_sample(radiance, place, align_corners=False)[0].permute(1, 2, 0)


def _basis(camera: Camera) -> Tensor:
    return torch.from_numpy(camera.basis()).float()


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--vehicles", type=int, default=15)
    parser.add_argument("--views", type=int, default=4)
    parser.add_argument("--size", type=int, nargs=2, default=(480, 320))
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--bounces", type=int, default=4)
    parser.add_argument("--error", type=float, default=1.0, help="of cameras, in degrees")
    parser.add_argument("--renderer", default="mitsuba")
    parser.add_argument("--turntable", action="store_true", help="one light for each vehicle, which turns before it")
    parser.add_argument("--meshes", type=Path, nargs="*", default=(), help="instead of procedural vehicles")
    parser.add_argument("--skies", type=Path, nargs="*", default=())
    given = parser.parse_args(arguments)
    skies = [load_environment(path) for path in given.skies] or [build_sky(sample_sky(seed)) for seed in range(50, 56)]
    renderer = load_renderer(given.renderer, {"max_bounces": given.bounces})
    photographer = Photographer(
        renderer, tuple(skies), tuple(given.size), given.spp, given.error, turntable=given.turntable
    )
    make_stand_ins(given.out, photographer, given.vehicles, given.views, meshes=given.meshes)


if __name__ == "__main__":
    main()
