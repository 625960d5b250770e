"""Opens what a user names, a mesh file or a run, as an exhibit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from svbrdfgan.asset.memory import Plan, require_plan
from svbrdfgan.asset.weather_document import Textures
from svbrdfgan.data.config import DatasetConfig, Split
from svbrdfgan.data.index import Dataset
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.inference.weatherings import Weathering
from svbrdfgan.inference.workpiece import open_workpiece
from svbrdfgan.io.environment import load_environment
from svbrdfgan.io.files import check_file
from svbrdfgan.io.mesh import SUFFIXES
from svbrdfgan.training.run import RunConfig, load_model
from svbrdfgan.viewer.choices import Choice, model_choices, of_run, offered, recipe_choice
from svbrdfgan.viewer.easel import Easel
from svbrdfgan.viewer.exhibit import Exhibit, Piece
from svbrdfgan.viewer.lights import Light, usual_lights
from svbrdfgan.weathering.recipes import RECIPES

_MOST = 12
"""Held-out vehicles of a run that are offered."""


def exhibit_of(
    shown: Path,
    *,
    model: str | None = None,
    recipe: str | None = None,
    environment: Path | None = None,
    dataset: Path | None = None,
    split: Split | None = None,
    fine: int = 1024,
    baked: tuple[Sequence[int], Sequence[float]] | None = None,
    **parts: Any,
) -> Exhibit:
    """The exhibit of a mesh file, or of a run's held-out vehicles.

    Args:
        model, recipe: offer these alone.
        environment: a further light.
        dataset, split: whose vehicles a run is shown on; by default those of its own data set that it never saw.
        fine, baked: as for `Exhibit`. A page without a server offers one model or recipe, and of a run one vehicle.
        parts: as for `open_workpiece`.

    Raises:
        AssetError: a file cannot be read, or the folder is no run.
        ConfigError: the recipe or the model does not exist, or one is named for a run, which has its own.
    """
    if not shown.exists():
        raise AssetError(f"{shown} does not exist; wanted a mesh file ({', '.join(SUFFIXES)}) or the folder of a run.")
    if shown.is_dir():
        if model is not None or recipe is not None:
            raise ConfigError("--model and --recipe are for mesh files: a run shows what it learned, and the truth.")
        pieces = list(_of_run(shown, dataset, split, fine, parts))
    else:
        check_file(shown, SUFFIXES, "mesh")
        choices = _asked(model, recipe, str(shown)) or offered(str(shown))
        pieces = [_piece(shown.name, shown, choices[:1] if baked else choices, fine, parts)]
    lights = usual_lights()
    if environment is not None:
        lights.insert(0, Light.of(environment.stem, load_environment(environment)))
    return Exhibit(shown.name, pieces[:1] if baked else pieces, lights, fine, baked)


def _asked(model: str | None, recipe: str | None, path: str) -> list[Choice]:
    """The choices that a user named; none if that is nothing."""
    if model is not None:
        trained = load_model(model)
        found = list(model_choices(trained, model, Path(model).name, "Learned", path))
        known = trained.config.conditions.recipes
        if recipe is not None and recipe not in known:
            raise ConfigError(f"the model does not know the recipe {recipe!r}; it knows {', '.join(known) or 'none'}.")
        return [found[known.index(recipe)]] if recipe is not None else found
    if recipe is not None and recipe not in RECIPES:
        raise ConfigError(f"recipe {recipe!r} does not exist; there are {', '.join(RECIPES)}.")
    return [] if recipe is None else [recipe_choice(recipe, path)]


def _of_run(run: Path, folder: Path | None, split: Split | None, fine: int, parts: dict[str, Any]) -> Iterator[Piece]:
    config = RunConfig.load(run)
    dataset = Dataset.open(folder or Path(config.dataset_folder))
    splits: tuple[Split, ...] = ("test", "validation", "train") if split is None else (split,)
    meshes = next(filter(None, map(dataset.index.meshes.get, splits)), ())
    for mesh in meshes[:_MOST]:
        path = dataset.folder / mesh.asset.path
        yield _piece(path.stem, path, of_run(run, dataset, str(path)), fine, _selected(config.dataset, parts))


def _selected(config: DatasetConfig, parts: dict[str, Any]) -> dict[str, Any]:
    """The parts that the run's data set weathers, unless others are named."""
    chosen = config.learnable
    named = {"learnable": chosen.include, "keep": chosen.exclude}
    return {**parts, **{key: value for key, value in named.items() if not parts.get(key)}}


def _piece(name: str, path: Path, choices: Sequence[Choice], fine: int, parts: dict[str, Any]) -> Piece:
    return Piece(name, partial(_easel, path, choices[0].make(0, 0.5), fine, parts), choices)


def _easel(path: Path, weathering: Weathering, fine: int, parts: dict[str, Any]) -> Easel:
    workpiece = open_workpiece(path, **parts).settled(weathering.settles_on)
    further = weathering.peak_bytes
    require_plan(Plan.of(workpiece.asset, workpiece.weathered, Textures(fine, fine)).as_overlay(), further, sized=False)
    return Easel.of(workpiece)
