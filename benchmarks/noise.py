"""Noise of the renderers at equal samples: the deviation of pixels over seeds, relative to their mean.

    python benchmarks/noise.py [SPP] [RENDERER ...]

A procedural vehicle in 64x64 pixels, without those at edges, Lambertian and glossy, under procedural skies
with a sun, in a room, and in the light of each file that NOISE_MAPS names (separated by colons). Renderers that do not
work here are left out.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from svbrdfgan import load_renderer
from svbrdfgan.config.choices import PartSelection
from svbrdfgan.errors import PluginError
from svbrdfgan.io.environment import load_environment
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.room import build_room
from svbrdfgan.procedural.sky import build_sky, sample_sky
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.subject import make_subject
from svbrdfgan.types import Camera, Environment, Material, Materials, View

_SEEDS = 16
_SIZE = 64
_GLOSS = {"roughness": torch.tensor([0.35]), "metallic": torch.tensor([0.0])}


def main(spp: int = 32, names: Sequence[str] = ("warp", "mitsuba", "numpy")) -> None:
    mesh = build_vehicle(sample_vehicle("sedan", 0))
    subject = make_subject(mesh, load_embedding("hemispherical"), 64, PartSelection())
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    middle, length = tuple(((low + high) / 2).tolist()), float((high - low).max())
    camera = Camera.orbit(math.radians(35.0), math.radians(20.0), 1.3 * length, middle, math.radians(40.0))
    lights = {f"sky {seed}": build_sky(sample_sky(seed), 256, 512) for seed in range(3)}
    lights["room"] = build_room(0, 256, 512)
    files = [Path(name) for name in os.environ.get("NOISE_MAPS", "").split(":") if name]
    lights |= {path.stem: load_environment(path) for path in files}
    print(f"{spp} samples, {_SEEDS} seeds: " + ", ".join(lights))
    for name in names:
        try:
            renderer = load_renderer(name)
        except PluginError as error:
            print(f"{name}: {error}")
            continue
        prepared = renderer.prepare(subject.surface)
        for finish, maps in (("Lambertian", {}), ("glossy", _GLOSS)):
            parts = tuple(
                Material({"base_color": torch.tensor([0.5, 0.4, 0.3]), **maps}) for _ in subject.surface.parts
            )
            found = []
            for light in lights.values():
                view = View(camera, Environment(light / light.mean()), _SIZE, _SIZE)
                rendered = [renderer.render(prepared, Materials(parts), view, spp=spp, seed=n) for n in range(_SEEDS)]
                inside = torch.stack([each.coverage for each in rendered]).min(dim=0).values > 0.999
                shown = torch.stack([each.image for each in rendered]).double()[:, inside]
                found.append(float(shown.var(dim=0).mean().sqrt() / shown.mean()))
            print(f"{name:8} {finish:10} " + " ".join(f"{noise:.4f}" for noise in found), flush=True)


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:2]), *([sys.argv[2:]] if sys.argv[2:] else []))
