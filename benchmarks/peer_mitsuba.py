"""Mitsuba 3 without us in between: the standard scene, rendered and differentiated by its own `prb` integrator.

    python peer_mitsuba.py [--spp 16] [--repeats 5] [--variant llvm_ad_rgb]

Prints one JSON line with median seconds of a picture, and of a picture and its gradient. Needs `pip install mitsuba`,
and for llvm_ad_rgb an LLVM: `pip install karellen-llvm-core` brings one, which is found by itself.
"""

from __future__ import annotations

import json
import math
import os
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from standard_scene import standard_scene

from svbrdfgan.types import Environment, Material, Surface, View


@click.command()
@click.option("--spp", default=16, show_default=True)
@click.option("--repeats", default=5, show_default=True)
@click.option("--variant", default="llvm_ad_rgb", show_default=True)
def main(spp: int, repeats: int, variant: str) -> None:
    """Times Mitsuba on the standard scene."""
    if library := next(Path(sys.prefix, "lib").glob("libLLVM.so*"), None):
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(library))  # read when drjit is first imported
    import mitsuba as mi

    mi.set_variant(variant)
    scene = _scene(mi, *standard_scene())
    forward, both = _timed(mi, scene, spp, repeats)
    line = {"peer": f"mitsuba {mi.__version__} {variant}", "spp": spp, "forward_s": forward}
    click.echo(json.dumps({**line, "forward_backward_s": both}))


def _timed(mi: Any, scene: Any, spp: int, repeats: int) -> tuple[float, float]:
    import drjit as dr

    params = mi.traverse(scene)
    key = next(name for name in params.keys() if name.endswith("reflectance.data"))  # noqa: SIM118

    def forward(seed: int) -> None:
        dr.eval(mi.render(scene, params, spp=spp, seed=seed))

    def forward_backward(seed: int) -> None:
        image = mi.render(scene, params, spp=spp, seed=seed)
        dr.backward(dr.mean(dr.square(image), axis=None))
        dr.eval(dr.grad(params[key]))

    first = _median(dr, forward, repeats)
    dr.enable_grad(params[key])
    params.update()
    return first, _median(dr, forward_backward, repeats)


def _median(dr: Any, action: Callable[[int], None], repeats: int) -> float:
    """Median seconds, after one run that compiles."""
    seconds = []
    for seed in range(repeats + 1):
        dr.sync_thread()
        start = time.perf_counter()
        action(seed)
        dr.sync_thread()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds[1:])


def _scene(mi: Any, surface: Surface, material: Material, view: View) -> Any:
    camera = view.camera
    film = {"type": "hdrfilm", "width": view.width, "height": view.height, "rfilter": {"type": "box"}}
    pose = mi.ScalarTransform4f().look_at(list(camera.origin), list(camera.target), list(camera.up))
    sensor = {"type": "perspective", "fov": math.degrees(camera.vertical_fov), "fov_axis": "y", "to_world": pose}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "prb", "max_depth": 2, "hide_emitters": True},
            "sensor": {**sensor, "film": film, "sampler": {"type": "independent"}},
            "light": _light(mi, view.environment),
            "body": _mesh(mi, surface, material),
        }
    )


def _light(mi: Any, environment: Environment) -> dict[str, Any]:
    """Mitsuba's first column lies where our middle one does, half a turn away."""
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], math.degrees(environment.rotation) + 180)
    return {"type": "envmap", "bitmap": mi.Bitmap(environment.radiance.numpy()), "to_world": turn}


def _mesh(mi: Any, surface: Surface, material: Material) -> Any:
    texture = {"type": "bitmap", "bitmap": mi.Bitmap(material.base_color.numpy()), "raw": True, "wrap_mode": "clamp"}
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture}})
    sizes = {"vertex_count": len(surface.positions), "face_count": len(surface.faces)}
    mesh = mi.Mesh("body", **sizes, has_vertex_normals=True, has_vertex_texcoords=True, props=properties)
    params = mi.traverse(mesh)
    params["vertex_positions"] = mi.Float(surface.positions.ravel())
    params["vertex_normals"] = mi.Float(surface.normals.ravel())
    params["vertex_texcoords"] = mi.Float(surface.uv.ravel())
    params["faces"] = mi.UInt32(surface.faces.ravel())
    params.update()
    return mesh


if __name__ == "__main__":
    main()
