"""Mitsuba 3 without us in between, as a peer of `svbrdfgan bench`: its own `prb`, `envmap` and bitmap textures.

Scenes with all maps (`--material whole`) get Mitsuba's `principled` under its `normalmap`.

    svbrdfgan bench --peer "python benchmarks/peer_mitsuba.py {scene} --spp {spp} --repeats {repeats}"

Prints one JSON line with median seconds of a picture, and of a picture and its gradient. Needs NumPy and Mitsuba, and
on a CPU an LLVM: `pip install mitsuba karellen-llvm-core` brings both, and the LLVM is found by itself.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

Arrays = Mapping[str, np.ndarray]
"""The scene's file: `svbrdfgan.bench.bench_scene` says what is in it."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--variant", help="else cuda_ad_rgb where there is a GPU, and llvm_ad_rgb where there is none")
    given = parser.parse_args()
    if library := next(Path(sys.prefix, "lib").glob("libLLVM.so*"), None):
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(library))  # read when drjit is first imported
    import drjit as dr
    import mitsuba as mi

    variant = given.variant or ("cuda_ad_rgb" if dr.has_backend(dr.JitBackend.CUDA) else "llvm_ad_rgb")
    mi.set_variant(variant)
    start = time.perf_counter()
    with np.load(given.scene) as arrays:
        scene = _scene(mi, arrays)
    prepare = time.perf_counter() - start
    forward, both = _timed(dr, mi, scene, given.spp, given.repeats)
    line = {"peer": f"mitsuba {mi.__version__} {variant}", "spp": given.spp, "prepare_s": prepare}
    print(json.dumps({**line, "forward_s": forward, "forward_backward_s": both}))


def _timed(dr: Any, mi: Any, scene: Any, spp: int, repeats: int) -> tuple[float, float]:
    params = mi.traverse(scene)
    keys = [name for name in params.keys() if name.startswith("part0.") and name.endswith(".data")]  # noqa: SIM118

    def forward(seed: int) -> None:
        dr.eval(mi.render(scene, params, spp=spp, seed=seed))

    def forward_backward(seed: int) -> None:
        image = mi.render(scene, params, spp=spp, seed=seed)
        dr.backward(dr.mean(dr.square(image), axis=None))
        dr.eval([dr.grad(params[key]) for key in keys])

    first = _median(dr, forward, repeats)
    for key in keys:
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


def _scene(mi: Any, arrays: Arrays) -> Any:
    origin, target, up = arrays["camera"].tolist()
    film = {"width": int(arrays["width"]), "height": int(arrays["height"]), "rfilter": {"type": "box"}}
    pose = mi.ScalarTransform4f().look_at(origin, target, up)
    sensor = {"type": "perspective", "fov": math.degrees(arrays["vertical_fov"]), "fov_axis": "y", "to_world": pose}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "prb", "max_depth": 2, "hide_emitters": True},
            "sensor": {**sensor, "film": {"type": "hdrfilm", **film}, "sampler": {"type": "independent"}},
            "light": _light(mi, arrays),
            **{f"part{part}": _mesh(mi, arrays, part) for part in np.unique(arrays["face_part"])},
        }
    )


def _light(mi: Any, arrays: Arrays) -> dict[str, Any]:
    """Mitsuba's first column lies where our middle one does, half a turn away."""
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], math.degrees(arrays["rotation"]) + 180)
    return {"type": "envmap", "bitmap": mi.Bitmap(arrays["radiance"]), "to_world": turn}


def _mesh(mi: Any, arrays: Arrays, part: int) -> Any:
    """A part's faces, with the vertices that they use; part 0 has the texture."""
    used, faces = np.unique(arrays["faces"][arrays["face_part"] == part], return_inverse=True)
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": _bsdf(mi, arrays, part)})
    sizes = {"vertex_count": len(used), "face_count": faces.size // 3}
    mesh = mi.Mesh(f"part{part}", **sizes, has_vertex_normals=True, has_vertex_texcoords=True, props=properties)
    params = mi.traverse(mesh)
    params["vertex_positions"] = mi.Float(arrays["positions"][used].ravel())
    params["vertex_normals"] = mi.Float(arrays["normals"][used].ravel())
    params["vertex_texcoords"] = mi.Float(arrays["uv"][used].ravel())
    params["faces"] = mi.UInt32(faces.ravel().astype(np.uint32))
    params.update()
    return mesh


def _bsdf(mi: Any, arrays: Arrays, part: int) -> dict[str, Any]:
    if part:
        return {"type": "diffuse", "reflectance": {"type": "rgb", "value": arrays["base_color"][part].tolist()}}
    if not arrays["gloss"].size:
        return {"type": "diffuse", "reflectance": _texture(mi, arrays, arrays["texture"])}
    rough, metallic, normal = (_texture(mi, arrays, v) for v in np.split(_encoded(arrays["gloss"]), (1, 2), axis=2))
    principled = {"base_color": _texture(mi, arrays, arrays["texture"]), "roughness": rough, "metallic": metallic}
    return {"type": "normalmap", "normalmap": normal, "bsdf": {"type": "principled", **principled}}


def _encoded(gloss: np.ndarray) -> np.ndarray:
    """The maps with normals as files store them."""
    return np.concatenate([gloss[..., :2], 0.5 + 0.5 * gloss[..., 2:]], axis=2)


def _texture(mi: Any, arrays: Arrays, values: np.ndarray) -> dict[str, Any]:
    wrap = "repeat" if arrays["repeat"].any() else "clamp"
    bitmap = mi.Bitmap(np.ascontiguousarray(values, dtype=np.float32))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "wrap_mode": wrap}


if __name__ == "__main__":
    main()
