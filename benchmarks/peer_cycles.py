"""Our renderers and Blender's Cycles, which nobody here wrote: same meshes, light, textures and model.

    python benchmarks/peer_cycles.py --mesh car.glb --environment sky.hdr --blender python3.11
    python benchmarks/peer_cycles.py --export weathered.glb --environment sky.hdr --blender python3.11 --keep pictures

`--blender` is a Python that has `bpy` (pip install bpy, CPython 3.11). For each case the table shows the mean
difference of the pictures, relative to the mean of ours, that of blocks of 16 x 16 pixels (root mean square, relative
to the mean), and the noise of the latter between two seeds of ours. `--keep DIR` keeps the pictures.

Cases: a Lambertian texture, glTF's metal, each with and without a normal map; and the whole material against Blender's
Principled BSDF, which is another model. Where the node graph is that of our model, Cycles still differs in this: it
darkens the diffuse reflection of tilted normals (Conty Estevez et al., "A Microfacet-Based Shadowing Function to Solve
the Bump Terminator Problem", Ray Tracing Gems, 2019), its Smith term is height-correlated, and it bends normals by
another rule. The case "shadowed" is ours with that darkening, by the `numpy` renderer and with fewer samples.

`--export` compares a file instead, such as `svbrdfgan weather` writes: with its own maps, in Cycles by Blender's glTF
importer, which makes Principled BSDFs of them. Two further cases leave of these only what both models share: the
diffuse lobe, and a metal whose facets scatter once. These cases show whether the maps arrive; what is left of the
difference in the first case is Principled's other mixture of the two.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest import mock

import click
import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from rich.console import Console
from rich.table import Table
from torch import Tensor

from svbrdfgan import load_embedding, load_environment, load_mesh, load_renderer
from svbrdfgan.geometry.split import surface_over
from svbrdfgan.io.image import save_image
from svbrdfgan.types import Camera, Environment, FileMap, Material, Materials, Surface, View

Look = dict[str, Float[Tensor, "*shape"]]
"""The maps of a material, by name."""

HERE = Path(__file__).parent
BLOCK = 16


@dataclass(frozen=True)
class Case:
    """One row of the table: which maps the material has, and which model of Blender's it is compared with.

    `shadowed` darkens ours as Cycles does.
    """

    name: str
    maps: tuple[str, ...]
    model: str = "same"
    shadowed: bool = False


CASES = (
    Case("diffuse", ("base_color",)),
    Case("diffuse, normal map", ("base_color", "normal")),
    Case("diffuse, normal map, shadowed", ("base_color", "normal"), shadowed=True),
    Case("metal", ("base_color", "roughness", "metallic")),
    Case("metal, normal map", ("base_color", "roughness", "metallic", "normal")),
    Case("whole material, Principled", ("base_color", "roughness", "metallic", "normal"), "principled"),
)
EXPORTED = (
    Case("exported", ("base_color", "roughness", "metallic", "normal"), "imported"),
    Case("exported, diffuse", ("base_color", "normal"), "imported diffuse"),
    Case("exported, all metal", ("base_color", "roughness", "metallic", "normal"), "imported metal"),
)


@click.command()
@click.option("--mesh", type=click.Path(exists=True, path_type=Path), help="Its shape, under maps of this script.")
@click.option("--export", type=click.Path(exists=True, path_type=Path), help="A GLB to compare with its own maps.")
@click.option("--environment", type=click.Path(exists=True, path_type=Path), required=True)
@click.option("--embedding", default="hemispherical", show_default=True)
@click.option("--renderer", default="mitsuba", show_default=True)
@click.option("--blender", default=sys.executable, help="A Python that has bpy; by default this one.")
@click.option("--spp", default=256, show_default=True)
@click.option("--width", default=320, show_default=True)
@click.option("--only", default="", help="Run only the cases whose name contains this.")
@click.option("--keep", type=click.Path(path_type=Path), help="Keep the pictures in this folder.")
def main(
    mesh: Path | None,
    export: Path | None,
    environment: Path,
    embedding: str,
    renderer: str,
    blender: str,
    spp: int,
    width: int,
    only: str,
    keep: Path | None,
) -> None:
    """Prints the table."""
    if export is not None:
        surface, looks = _exported(export)
    elif mesh is not None:
        surface = load_embedding(embedding).embed(load_mesh(mesh))
        looks = [_waves()] * len(surface.parts)
    else:
        raise click.UsageError("Name a file by --mesh or by --export.")
    radiance = load_environment(environment)
    view = View(_camera(surface), Environment(radiance / float(radiance.mean())), width, width * 5 // 8)
    ours = load_renderer(renderer)
    prepared = ours.prepare(surface)
    table = Table("case", "mean difference", "blocks", "noise of blocks")
    with tempfile.TemporaryDirectory() as folder:
        for case in (each for each in (CASES if export is None else EXPORTED) if only in each.name):
            materials = Materials(tuple(_material(case, look) for look in looks))
            if case.shadowed:
                pictures = _shadowed(surface, materials, view, max(1, spp // 4))
            else:
                pictures = [
                    ours.render(prepared, materials, view, spp=spp, seed=seed).image.double().cpu().numpy()
                    for seed in (1, 2)
                ]
            given = _arrays(surface, materials) if export is None else {"glb": str(export.resolve())}
            theirs = _cycles(Path(folder), blender, case, given, view, spp)
            table.add_row(case.name, *_compare(pictures, theirs))
            if keep:
                keep.mkdir(parents=True, exist_ok=True)
                both = torch.from_numpy(np.concatenate([pictures[0], theirs], axis=1)).float()
                save_image(keep / f"{case.name.replace(', ', '-').replace(' ', '-')}.png", both.clamp(0.0, 1.0))
    Console(width=None if sys.stdout.isatty() else 120).print(table)


def _camera(surface: Surface) -> Camera:
    low, high = surface.positions.min(axis=0), surface.positions.max(axis=0)
    x, y, z = ((low + high) / 2).tolist()
    distance = float(np.linalg.norm(high - low))
    return Camera.orbit(math.radians(50.0), math.radians(20.0), distance, (x, y, z), math.radians(35.0))


def _material(case: Case, look: Look) -> Material:
    """The material of the maps that the case has."""
    maps = {name: value for name, value in look.items() if name in case.maps}
    if "metallic" in maps and case.model in ("same", "imported metal"):
        maps["metallic"] = torch.ones(1)
    return Material(maps)


def _waves() -> Look:
    """Smooth textures, so that the renderers' texture filters do not matter."""
    v, u = (
        torch.stack(torch.meshgrid(*(torch.arange(n) / n for n in (256, 256)), indexing="ij")) + 0.5 / 256
    ) * math.tau
    wave = torch.stack([0.5 + 0.3 * torch.sin(3.0 * u + k) * torch.cos(2.0 * v - k) for k in range(3)], dim=-1)
    tilt = torch.stack([0.35 * torch.sin(9.0 * u), 0.35 * torch.sin(7.0 * v), torch.ones_like(u)], dim=-1)
    return {
        "base_color": wave,
        "roughness": (0.45 + 0.25 * torch.sin(2.0 * v + u))[..., None],
        "metallic": (0.5 + 0.5 * torch.sin(2.0 * u + v))[..., None],
        "normal": tilt / tilt.norm(dim=-1, keepdim=True),
    }


def _exported(path: Path) -> tuple[Surface, list[Look]]:
    """The surface of a file over its own UVs, and what the file says of each part."""
    mesh = load_mesh(path)
    if mesh.uv is None or mesh.further_uv:
        raise click.UsageError(f"{path} has no UVs, or several sets; wanted a file as this package writes it.")
    looks = [{name: _value(given) for name, given in part.all_maps.items()} for part in mesh.parts]
    alphas = [look.pop("alpha", torch.ones(1)).numpy()[..., 0] for look in looks]
    parts = tuple(
        replace(part, alpha=alpha if alpha.ndim else float(alpha))
        for part, alpha in zip(mesh.parts, alphas, strict=True)
    )
    return replace(surface_over(mesh, mesh.uv), parts=parts), looks


def _value(given: FileMap) -> Float[Tensor, ...]:
    """The map as renderers take it."""
    factor = torch.tensor(given.factor, dtype=torch.float32)
    value = factor if given.texture is None else factor * torch.from_numpy(given.texture.copy()).float()
    return value if given.cutoff is None else (value >= given.cutoff).float()


def _arrays(surface: Surface, materials: Materials) -> dict[str, Any]:
    """The scene as `peer_cycles_render.py` builds it."""
    arrays: dict[str, Any] = {
        "positions": surface.positions,
        "normals": surface.normals,
        "uv": surface.uv,
        "faces": surface.faces,
        "face_part": surface.face_part,
        "parts": len(surface.parts),
    }
    for part, material in enumerate(materials.parts):
        arrays |= {f"{part}.{name}": value.numpy() for name, value in material.maps.items()}
    return arrays


def _cycles(
    folder: Path, blender: str, case: Case, given: Mapping[str, Any], view: View, spp: int
) -> Float[ndarray, "height width 3"]:
    """The picture by Cycles, premultiplied.

    Args:
        given: `_arrays`, or the file to import.
    """
    arrays = {
        **given,
        "radiance": view.environment.radiance.numpy(),
        "film": (view.width, view.height),
        "fov": view.camera.vertical_fov,
        "axes": view.camera.basis(),
        "origin": np.asarray(view.camera.origin),
        "model": case.model,
        "bounces": 1,
        "filepath": str(folder / "picture.exr"),
    }
    np.savez(folder / "case.npz", **arrays)
    command = [
        blender,
        str(HERE / "peer_cycles_render.py"),
        str(folder / "case.npz"),
        str(folder / "out.npy"),
        str(spp),
    ]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return np.load(folder / "out.npy")[..., :3].astype(np.float64)


def _shadowed(surface: Surface, materials: Materials, view: View, spp: int) -> list[Float[ndarray, "height width 3"]]:
    """Two pictures by the numpy renderer, with Cycles' darkening of tilted normals."""
    from svbrdfgan_numpy import renderer, shading

    def shade(bounce: Any, maps: Any, environment: Any) -> Any:
        shaded = shading.shade(bounce, maps, environment)
        terms = [_shadow(shaded.bsdf.normal, bounce.vertices.points.normal, a.direction) for a in bounce.arrivals]
        reflected = [value * term[:, None] for value, term in zip(shaded.reflected, terms, strict=True)]
        return replace(shaded, reflected=reflected)

    numpy = load_renderer("numpy")
    prepared = numpy.prepare(surface)
    with mock.patch.object(renderer, "shade", shade):
        return [numpy.render(prepared, materials, view, spp=spp, seed=s).image.double().numpy() for s in (1, 2)]


def _shadow(tilted: ndarray, smooth: ndarray, incoming: ndarray) -> Float[ndarray, " points"]:
    """The term of Conty Estevez et al. for light from `incoming`."""

    def squared_tangent(cosine: ndarray) -> ndarray:
        return 1.0 / np.clip(cosine, 1e-6, 1.0) ** 2 - 1.0

    alpha2 = np.clip(0.125 * squared_tangent((tilted * smooth).sum(axis=1)), 0.0, 1.0)
    return 2.0 / (1.0 + np.sqrt(1.0 + alpha2 * squared_tangent((smooth * incoming).sum(axis=1))))


def _compare(ours: list[ndarray], theirs: ndarray) -> tuple[str, ...]:
    mean = ours[0].mean()
    apart = (theirs.mean() - np.mean([each.mean() for each in ours])) / mean
    blocks = [_blocks(each) for each in (*ours, theirs)]
    noise = np.sqrt(np.square(blocks[0] - blocks[1]).mean()) / mean
    difference = np.sqrt(np.square(blocks[2] - (blocks[0] + blocks[1]) / 2).mean()) / mean
    return f"{apart:+.2%}", f"{difference:.2%}", f"{noise:.2%}"


def _blocks(picture: ndarray) -> ndarray:
    rows, cols = (n // BLOCK for n in picture.shape[:2])
    return picture[: rows * BLOCK, : cols * BLOCK].reshape(rows, BLOCK, cols, BLOCK, 3).mean(axis=(1, 3))


if __name__ == "__main__":
    main()
