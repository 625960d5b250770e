"""How long recipes take for a layer: all maps, or base colour alone.

    python benchmarks/paint_recipes.py --texels 256 --texels 1024   # by as many threads as torch has
    python benchmarks/paint_recipes.py --texels 256 --texels 1024 --device cuda

The site is a flank of 4.5 x 4.5 m with edges, as `find_site` would find it once for a mesh. Times are medians of
repeated calls after two that warm up, in milliseconds; on a GPU they end when it has finished. The last column is the
largest difference between the layer and the one that a CPU paints, whose kernels the tests compare with NumPy.
"""

from __future__ import annotations

import statistics
import time

import click
import torch

from svbrdfgan.weathering.layer import painted
from svbrdfgan.weathering.recipes import RECIPES
from svbrdfgan.weathering.recipes.recipe import Recipe
from svbrdfgan.weathering.site import Site

_LENGTH = 4.5
_MAPS = {"base colour": (), "all maps": ("roughness", "metallic", "normal")}


def flank(texels: int) -> Site:
    """A square flank with a door, over all heights."""
    across = torch.linspace(-0.5, 0.5, texels, dtype=torch.float64)
    up, along = (values.ravel() for values in torch.meshgrid(across + 0.5, across, indexing="ij"))
    ones = torch.ones_like(up)
    door = (torch.maximum(along.abs() - 0.12, (up - 0.15).abs() - 0.1)).abs() * _LENGTH
    tangents = torch.zeros(len(up), 2, 3, dtype=torch.float64)
    tangents[:, 0, 2], tangents[:, 1, 1] = -1.0, 1.0
    return Site(
        position=torch.stack([0.2 * ones, up, along], dim=1),
        height=up,
        normal=torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64).expand(len(up), 3).contiguous(),
        visibility=0.9 * ones,
        curvature=0.0 * ones,
        convex=door,
        crease=door + 0.02,
        border=0.135 * ones,
        substance=torch.zeros(len(up), dtype=torch.uint8),
        axles=(-0.3, 0.3),
        texel=1.0 / texels,
        length=_LENGTH,
        tall=_LENGTH,
        tangents=tangents,
    )


def milliseconds(recipe: Recipe, site: Site, maps: tuple[str, ...], repeats: int) -> float:
    def once() -> float:
        start = time.perf_counter()
        painted(recipe, site, maps)
        if site.height.is_cuda:
            torch.cuda.synchronize()
        return 1000.0 * (time.perf_counter() - start)

    return statistics.median([once() for _ in range(repeats + 2)][2:])


@click.command()
@click.option("--texels", multiple=True, default=(256,), help="Texels along a side; repeatable.")
@click.option("--device", default="cpu")
@click.option("--repeats", default=5)
@click.option("--recipe", "names", multiple=True, default=tuple(RECIPES))
def main(texels: tuple[int, ...], device: str, repeats: int, names: tuple[str, ...]) -> None:
    named = torch.cuda.get_device_name() if device == "cuda" else f"{torch.get_num_threads()} threads"
    print(f"{'recipe':16s} {'texels':>6s} {'base colour':>12s} {'all maps':>9s} ms   {named}")
    for count in texels:
        site = flank(count)
        there = site.to(device, torch.float64)
        for name in names:
            recipe = RECIPES[name](seed=1)
            times = [milliseconds(recipe, there, maps, repeats) for maps in _MAPS.values()]
            layers = [painted(recipe, each, _MAPS["all maps"]).cpu() for each in (site, there)]
            apart = float((layers[0] - layers[1]).abs().max())
            print(f"{name:16s} {count:6d} {times[0]:12.1f} {times[1]:9.1f}      {apart:.1e}", flush=True)


if __name__ == "__main__":
    main()
