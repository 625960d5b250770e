"""What a data set will hold: its configuration and its assets, gathered into its folder before a picture is made."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.config.models import StrictModel, differences, validate
from svbrdfgan.data.config import DatasetConfig, EnvironmentSource, MeshSource, Split
from svbrdfgan.data.sampler import ConfigSampler, EnvironmentAsset, MeshAsset
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io import load_environment, load_mesh, luminance, save_environment, save_mesh_glb
from svbrdfgan.io.records import load_json, save_record
from svbrdfgan.procedural import build_room, build_sky, build_vehicle, sample_sky, sample_vehicle
from svbrdfgan.scene.description import AssetRef
from svbrdfgan.types import Mesh

PLAN = "dataset.json"
FORMAT = "svbrdfgan data set 1"
_RUN = "config.json"
"""What a run's folder has, as `svbrdfgan.training.run` names it."""

log = logging.getLogger(__name__)


class DatasetPlan(StrictModel):
    """The contents of `dataset.json`."""

    format: str = FORMAT
    config: DatasetConfig
    meshes: dict[Split, tuple[MeshAsset, ...]]
    environments: dict[Split, tuple[EnvironmentAsset, ...]]

    def sampler(self, split: Split) -> ConfigSampler:
        return ConfigSampler(self.config, split, self.meshes[split], self.environments[split])

    def save(self, folder: Path) -> None:
        save_record(folder / PLAN, self)

    @classmethod
    def load(cls, folder: Path) -> DatasetPlan:
        """Reads a data set's plan.

        Raises:
            AssetError: the folder is no data set, or one of another version.
        """
        path = folder / PLAN
        if not path.is_file():
            raise AssetError(f"{folder} is not a data set: it has no {PLAN}; make one with `svbrdfgan dataset`.")
        data = load_json(path)
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            raise AssetError(f"{path} is not of this version ({FORMAT!r}); make the data set anew.")
        return validate(cls, data, str(path))


def make_plan(config: DatasetConfig, folder: Path, base: Path) -> DatasetPlan:
    """Gathers the assets of all splits into the folder and writes its plan; or finds the plan of an earlier run.

    Args:
        base: the folder that file patterns are relative to.

    Raises:
        ConfigError: the folder holds a data set of another configuration, or a pattern matches nothing.
        AssetError: an asset cannot be read.
    """
    if (folder / _RUN).is_file():
        raise ConfigError(f"{folder} holds a run; choose another folder for the data set.")
    if (folder / PLAN).is_file():
        plan = DatasetPlan.load(folder)
        if plan.config == config:
            _tell_of_new_files(plan, folder, base)
            return plan
        if any(next((folder / split).glob("*.json"), None) for split in plan.config.splits):
            changed = "; ".join(differences(plan.config.model_dump(), config.model_dump()))
            raise ConfigError(
                f"{folder} holds a data set of another configuration ({changed}); choose another folder or delete it."
            )
        (folder / PLAN).unlink()  # of which nothing was made
    _require_files(config, base)
    meshes = {split: _meshes(source.meshes, config, folder, base) for split, source in config.splits.items()}
    lights = {
        split: gather_environments(source.environments or config.environments, config.environment_rows, folder, base)
        for split, source in config.splits.items()
    }
    _require_distinct(mesh.asset for pool in meshes.values() for mesh in pool)
    _require_distinct(light.asset for pool in lights.values() for light in pool)
    _require_held_out(meshes)
    plan = DatasetPlan(config=config, meshes=meshes, environments=lights)
    plan.save(folder)
    return plan


def _require_files(config: DatasetConfig, base: Path) -> None:
    """Refuses patterns that match nothing, by their keys, before anything is stored."""
    named: dict[str, MeshSource | EnvironmentSource] = {}
    for split, source in config.splits.items():
        named[f"splits.{split}.meshes"] = source.meshes
        if source.environments is None:
            named["environments"] = config.environments
        else:
            named[f"splits.{split}.environments"] = source.environments
    for key, files in named.items():
        try:
            _matches(files.files, base)
        except ConfigError as error:
            raise ConfigError(f"{key}.files: {error}") from error


def _meshes(source: MeshSource, config: DatasetConfig, folder: Path, base: Path) -> tuple[MeshAsset, ...]:
    made: dict[str, Callable[[], Mesh]] = {}
    for path in _matches(source.files, base):
        made[path.stem] = lambda path=path: load_mesh(path)  # type: ignore[misc]
    if source.procedural is not None:
        kinds, first = source.procedural.kinds, source.procedural.seed * 100_003
        for number in range(source.procedural.count):
            kind, seed = kinds[number % len(kinds)], first + number
            made[f"{kind}_{seed}"] = lambda kind=kind, seed=seed: build_vehicle(sample_vehicle(kind, seed))  # type: ignore[misc]
    return tuple(mesh_asset(name, make(), config, folder) for name, make in made.items())


def mesh_asset(name: str, mesh: Mesh, config: DatasetConfig, folder: Path) -> MeshAsset:
    """A mesh, stored among the folder's assets."""
    path = folder / "assets" / "meshes" / f"{name}.glb"
    save_mesh_glb(path, mesh)
    (x0, y0, z0), (x1, y1, z1) = mesh.bounds.tolist()
    painted = tuple(part.name for part in mesh.parts if config.learnable.selects(part))
    return MeshAsset(name=name, asset=_reference(path, folder), bounds=((x0, y0, z0), (x1, y1, z1)), painted=painted)


def gather_environments(source: EnvironmentSource, rows: int, folder: Path, base: Path) -> tuple[EnvironmentAsset, ...]:
    """The environment maps of a source, shrunk to so many rows and stored among the folder's assets."""
    made: dict[str, Callable[[], Tensor]] = {}
    for path in _matches(source.files, base):
        made[path.stem] = lambda path=path: load_environment(path)  # type: ignore[misc]
    if source.procedural is not None:
        for number in range(source.procedural.count):
            seed = source.procedural.seed * 100_003 + number
            if source.procedural.kind == "indoor":
                made[f"room_{seed}"] = partial(build_room, seed)
            else:
                made[f"sky_{seed}"] = lambda seed=seed: build_sky(sample_sky(seed))  # type: ignore[misc]
    if not made:
        raise ConfigError("environments needs 'files', 'procedural' or both.")
    return tuple(environment_asset(name, make(), rows, folder) for name, make in made.items())


def environment_asset(name: str, radiance: Float[Tensor, "rows cols 3"], rows: int, folder: Path) -> EnvironmentAsset:
    """An environment map, shrunk to so many rows and stored among the folder's assets."""
    radiance = _shrink(radiance, rows)
    path = folder / "assets" / "environments" / f"{name}.exr"
    if not path.is_file() or not torch.equal(load_environment(path), radiance):
        if path.is_file() and (folder / PLAN).is_file():
            raise ConfigError(f"{folder} holds another environment of the name {name!r} already; rename yours.")
        save_environment(path, radiance)
    mean = _mean_luminance(radiance)
    if not mean > 0:
        raise AssetError(f"environment {name} is black; choose another.")
    return EnvironmentAsset(name=name, asset=_reference(path, folder), normalisation=1.0 / mean)


def _mean_luminance(radiance: Float[Tensor, "rows cols 3"]) -> float:
    """Over the sphere."""
    rows = radiance.shape[0]
    solid_angle = torch.sin((torch.arange(rows) + 0.5) * torch.pi / rows)
    by_row = luminance(radiance).mean(dim=1)
    return float((by_row * solid_angle).sum() / solid_angle.sum())


def _shrink(radiance: Float[Tensor, "rows cols 3"], rows: int) -> Float[Tensor, "rows cols 3"]:
    """At most so many rows, by averaging whole blocks of pixels."""
    factor = -(-radiance.shape[0] // rows)
    if factor == 1:
        return radiance
    size = (radiance.shape[0] // factor, radiance.shape[1] // factor)
    return F.adaptive_avg_pool2d(radiance.permute(2, 0, 1), size).permute(1, 2, 0).contiguous()


def _matches(patterns: tuple[str, ...], base: Path) -> list[Path]:
    found: list[Path] = []
    for pattern in patterns:
        absolute = Path(pattern).expanduser()
        root = Path(absolute.anchor) if absolute.is_absolute() else base
        try:
            matches = sorted(root.glob(str(absolute.relative_to(root) if absolute.is_absolute() else absolute)))
        except (ValueError, IndexError) as error:
            raise ConfigError(f"{pattern!r} is not a shell pattern of files ({error}); correct it.") from error
        if not matches:
            raise ConfigError(f"no file matches {pattern!r} in {base}; correct the pattern or the folder.")
        found += [match for match in matches if match not in found]
    stems = [path.stem for path in found]
    doubled = sorted({stem for stem in stems if stems.count(stem) > 1})
    if doubled:
        raise ConfigError(f"files share the names {doubled}; rename them, since a data set keeps assets by name.")
    return found


def _require_distinct(assets: Iterable[AssetRef]) -> None:
    """Splits may share an asset, but not a name for different ones: the last would replace the first."""
    first: dict[str, AssetRef] = {}
    for asset in assets:
        if first.setdefault(asset.path, asset) != asset:
            raise ConfigError(
                f"different files of two splits share the name {Path(asset.path).stem!r}; rename one, "
                "since a data set keeps assets by name."
            )


def _require_held_out(meshes: Mapping[Split, tuple[MeshAsset, ...]]) -> None:
    """Scores are of meshes that were never trained on."""
    trained = {mesh.asset.sha256 for mesh in meshes.get("train", ())}
    for split, pool in meshes.items():
        for mesh in pool if split != "train" else ():
            if mesh.asset.sha256 in trained:
                raise ConfigError(
                    f"the mesh {mesh.name!r} is in the splits train and {split}, which would be scored on what it was "
                    "trained on: name other files, or give 'procedural' another seed."
                )


def _tell_of_new_files(plan: DatasetPlan, folder: Path, base: Path) -> None:
    """Assets were gathered when the data set was begun: what patterns match only now is not among them."""
    config = plan.config
    for split, source in config.splits.items():
        kept = {mesh.name for mesh in plan.meshes[split]} | {light.name for light in plan.environments[split]}
        for files in (source.meshes.files, (source.environments or config.environments).files):
            with suppress(ConfigError):  # the files may have gone, since the folder has copies
                new = sorted({path.stem for path in _matches(files, base)} - kept)
                if new:
                    log.warning(
                        "%s was begun without %s, which %s files match now: choose another folder to have them in.",
                        *(folder, ", ".join(new), split),
                    )


def _reference(path: Path, folder: Path) -> AssetRef:
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return AssetRef(path=path.relative_to(folder).as_posix(), sha256=digest)
