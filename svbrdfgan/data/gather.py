"""Gathers a data set's meshes and environment maps: finds or makes them, and stores copies in its folder."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.config import DatasetConfig, EnvironmentSource, MeshSource
from svbrdfgan.data.index import INDEX
from svbrdfgan.data.sampler import EnvironmentAsset, MeshAsset
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.geometry.viewpoints import find_viewpoints
from svbrdfgan.io.environment import load_environment, save_environment
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.io.image import luminance
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.room import build_room
from svbrdfgan.procedural.sky import build_sky, sample_sky
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.description import AssetRef
from svbrdfgan.types import Mesh
from svbrdfgan.utils.named_files import expanded
from svbrdfgan.utils.processes import worker_pool

_SEED_STRIDE = 100_003
"""Distance between the first seeds of two sources: a prime above any count, so that sources share no asset."""
_VIEWPOINTS = 64
"""Of each mesh, for close-ups."""
_WORTH_A_PROCESS = 4
"""Meshes. To start a process takes about as long as to gather that many, with viewpoints one."""
_DECIMALS = 5
"""Of a viewpoint's metres and degrees."""


def match_files(patterns: Sequence[str], base: Path) -> list[Path]:
    """The files that shell patterns match, each once. Relative patterns start at `base`.

    Raises:
        ConfigError: a pattern is malformed or matches nothing, or two files share a name.
    """
    found: list[Path] = []
    for pattern in patterns:
        absolute = expanded(pattern)
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
        raise ConfigError(f"files share the names {doubled}; rename them, since a data set stores assets by name.")
    return found


def gather_meshes(
    source: MeshSource,
    files: Iterable[Path],
    config: DatasetConfig,
    folder: Path,
    *,
    close_ups: bool = False,
    workers: int = 1,
) -> tuple[MeshAsset, ...]:
    """Stores the meshes of a source among the folder's assets: those of the files, and the procedural ones.

    Args:
        close_ups: whether some of their pictures are.
        workers: processes, at most; they are spawned where there are enough meshes.

    Raises:
        AssetError: a file cannot be read, or nothing of a mesh can be seen in close-ups; or a process was killed.
    """
    makers: dict[str, Callable[[], Mesh]] = {path.stem: partial(load_mesh, path) for path in files}
    if source.procedural is not None:
        kinds, first = source.procedural.kinds, source.procedural.seed * _SEED_STRIDE
        for number in range(source.procedural.count):
            kind, seed = kinds[number % len(kinds)], first + number
            makers[f"{kind}_{seed}"] = partial(_procedural_vehicle, kind, seed)
    store = partial(_gather, config=config, folder=folder, close_ups=close_ups)
    processes = min(workers, len(makers) // _WORTH_A_PROCESS)
    if processes < 2:
        return tuple(map(store, makers, makers.values()))
    with worker_pool(processes, "gathers meshes", "--workers") as pool:
        return tuple(pool.map(store, makers, makers.values()))


def _gather(name: str, make: Callable[[], Mesh], config: DatasetConfig, folder: Path, close_ups: bool) -> MeshAsset:
    return mesh_asset(name, make(), config, folder, close_ups=close_ups)


def mesh_asset(name: str, mesh: Mesh, config: DatasetConfig, folder: Path, *, close_ups: bool = False) -> MeshAsset:
    """Stores a mesh among the folder's assets.

    Raises:
        AssetError: nothing of it can be seen in close-ups, which are wanted.
    """
    path = folder / "assets" / "meshes" / f"{name}.glb"
    save_mesh_glb(path, mesh)
    (x0, y0, z0), (x1, y1, z1) = mesh.bounds.tolist()
    painted = tuple(part.name for part in mesh.parts if config.learnable.selects(part))
    return MeshAsset(
        name=name,
        asset=reference(path, folder),
        bounds=((x0, y0, z0), (x1, y1, z1)),
        painted=painted,
        parts=tuple(part.name for part in mesh.parts),
        viewpoints=_viewpoints(name, mesh, config) if close_ups else (),
    )


def _viewpoints(name: str, mesh: Mesh, config: DatasetConfig) -> tuple[tuple[float, float, float, float, float], ...]:
    learnable = np.array([config.learnable.selects(part) for part in mesh.parts])
    found = find_viewpoints(mesh, learnable[mesh.face_part], _VIEWPOINTS)
    if not len(found.points):
        raise AssetError(f"no camera sees a learnable part of the mesh {name!r} from near; leave out camera.close_ups.")
    x, y, z = found.directions.T
    degrees = np.rad2deg([np.arctan2(x, z) % (2.0 * np.pi), np.arcsin(y.clip(-1.0, 1.0))]).T
    rows = np.column_stack([found.points, degrees]).round(_DECIMALS).tolist()
    return tuple((px, py, pz, azimuth, elevation) for px, py, pz, azimuth, elevation in rows)


def gather_environments(
    source: EnvironmentSource, files: Iterable[Path], rows: int, folder: Path
) -> tuple[EnvironmentAsset, ...]:
    """Stores the environment maps of a source among the folder's assets, each shrunk to at most `rows` rows.

    Raises:
        AssetError: a file cannot be read, or a map is black.
        ConfigError: the source names none, or the folder holds another map of the same name.
    """
    makers: dict[str, Callable[[], Tensor]] = {path.stem: partial(load_environment, path) for path in files}
    if source.procedural is not None:
        indoor, first = source.procedural.kind == "indoor", source.procedural.seed * _SEED_STRIDE
        for seed in range(first, first + source.procedural.count):
            makers[f"{'room' if indoor else 'sky'}_{seed}"] = partial(build_room if indoor else _procedural_sky, seed)
    if not makers:
        raise ConfigError("environments needs 'files', 'procedural' or both.")
    return tuple(environment_asset(name, make(), rows, folder) for name, make in makers.items())


def environment_asset(name: str, radiance: Float[Tensor, "rows cols 3"], rows: int, folder: Path) -> EnvironmentAsset:
    """Stores an environment map among the folder's assets, shrunk to at most `rows` rows."""
    radiance = _shrink(radiance, rows)
    path = folder / "assets" / "environments" / f"{name}.exr"
    if not path.is_file() or not torch.equal(load_environment(path), radiance):
        if path.is_file() and (folder / INDEX).is_file():
            raise ConfigError(f"{folder} holds another environment of the name {name!r} already; rename yours.")
        save_environment(path, radiance)
    mean = _mean_luminance(radiance)
    if not mean > 0:
        raise AssetError(f"environment {name} is black; choose another.")
    return EnvironmentAsset(name=name, asset=reference(path, folder), normalisation=1.0 / mean)


def _mean_luminance(radiance: Float[Tensor, "rows cols 3"]) -> float:
    """The mean over the sphere."""
    rows = radiance.shape[0]
    solid_angle = torch.sin((torch.arange(rows) + 0.5) * torch.pi / rows)
    by_row = luminance(radiance).mean(dim=1)
    return float((by_row * solid_angle).sum() / solid_angle.sum())


def _shrink(radiance: Float[Tensor, "rows cols 3"], rows: int) -> Float[Tensor, "rows cols 3"]:
    """The map with at most `rows` rows, by averaging whole blocks of pixels, which keeps its energy."""
    factor = -(-radiance.shape[0] // rows)
    if factor == 1:
        return radiance
    size = (radiance.shape[0] // factor, radiance.shape[1] // factor)
    return F.adaptive_avg_pool2d(radiance.permute(2, 0, 1), size).permute(1, 2, 0).contiguous()


def _procedural_vehicle(kind: str, seed: int) -> Mesh:
    return build_vehicle(sample_vehicle(kind, seed))


def _procedural_sky(seed: int) -> Tensor:
    return build_sky(sample_sky(seed))


def reference(path: Path, folder: Path) -> AssetRef:
    """The reference to a file below the folder."""
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return AssetRef(path=path.relative_to(folder).as_posix(), sha256=digest)
