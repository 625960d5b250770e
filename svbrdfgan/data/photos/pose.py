"""Finds the cameras of users' pictures by COLMAP's structure from motion (Schönberger and Frahm 2016)."""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.data.photos.check import ErrorCollector
from svbrdfgan.data.photos.photo import ORIENTATION, find_mask, load_photo, opened, reduced
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io.atomic import folder_beside
from svbrdfgan.io.image import EIGHT_BIT, save_codes
from svbrdfgan.utils.display import Display, SilentDisplay
from svbrdfgan.utils.processes import cores

LENS_MODEL = "SIMPLE_RADIAL"

_SEED = 0
_FEWEST = 3
_MOST_EXHAUSTIVE = 200
"""Pictures above which each is matched with those near it in the order of names, instead of with all."""
_LONGEST_SIDE = 1600
"""Pixels of a picture's longer side; features are found in a smaller copy of larger pictures."""
_MOST_FEATURES = 4096
"""Of each picture, the largest; the time of matching grows with their square."""
_NEAR = math.cos(math.radians(20))


@dataclass(frozen=True)
class PosedPictures:
    """Which pictures COLMAP has placed.

    Attributes:
        placed: the names of those that have a camera, relative to the folder of pictures, in order.
        others: the names of those that have none.
        error: the mean reprojection error in pixels.
    """

    placed: tuple[str, ...]
    others: tuple[str, ...]
    error: float


def pose_pictures(images: Path, out: Path, masks: Path | None = None, display: Display | None = None) -> PosedPictures:
    """Writes the COLMAP model of a folder of pictures, which `read_colmap` reads: of several, the largest.

    Pictures are PNG and JPEG files, also in subfolders. Those of one size share a camera, which has the lens model
    SIMPLE_RADIAL. The model's Y is about up if the camera was held upright; its unit and turn about Y are arbitrary.

    Args:
        out: a folder that is new or empty.
        masks: a folder with a mask of each picture, white where the object is; features lie there alone. Without
            it, they lie where the pictures are opaque.

    Raises:
        AssetError: no picture could be placed, or `out` cannot be written.
        ConfigError: pycolmap is not installed, there are fewer than three pictures, a picture or mask is missing or
            broken, or `out` is not empty.
    """
    names = _picture_names(images, masks)
    if out.is_file() or (out.is_dir() and any(out.iterdir())):
        raise ConfigError(f"{out} already exists and is not empty; choose another folder or delete it.")
    pycolmap, display = _library(), display or SilentDisplay()
    with folder_beside(out) as stage:
        sizes = _prepare(images, masks, names, stage, display)
        model = _largest(_models(pycolmap, stage, sizes, display), images)
        placed = tuple(sorted(model.image(number).name for number in model.reg_image_ids()))
        model.transform(pycolmap.Sim3d(1.0, pycolmap.Rotation3d(_upright(model)), np.zeros(3)))
        written = stage / "model"
        written.mkdir()
        model.write(written)
        out.mkdir(exist_ok=True)
        for file in sorted(written.iterdir()):
            shutil.move(file, out / file.name)
    return PosedPictures(placed, tuple(sorted({*names} - {*placed})), model.compute_mean_reprojection_error())


def _picture_names(images: Path, masks: Path | None) -> list[str]:
    found = (path for path in images.rglob("*") if path.suffix.lower() in EIGHT_BIT and path.is_file())
    names = sorted(path.relative_to(images).as_posix() for path in found if masks not in path.parents)
    if len(names) < _FEWEST:
        raise ConfigError(
            f"{images} holds too few pictures: {len(names)} PNG or JPEG files; wanted at least {_FEWEST} of one object."
        )
    return names


def _library() -> ModuleType:
    try:
        import pycolmap
    except ImportError as error:
        raise ConfigError(
            "cameras are found by COLMAP, whose package is not installed; pip install 'svbrdfgan[colmap]'."
        ) from error
    return pycolmap


def _prepare(
    images: Path, masks: Path | None, names: Sequence[str], stage: Path, display: Display
) -> Mapping[tuple[int, int], list[str]]:
    """Copies the pictures, upright, to `images` of the stage, and COLMAP's masks to `masks`: names by width and height.

    Raises:
        ConfigError: one line for each picture or mask that cannot be used.
    """
    sizes: dict[tuple[int, int], list[str]] = {}
    errors = ErrorCollector(str(images))
    display.begin("reading pictures", len(names))
    for name in names:
        with errors.context(name):
            photo = load_photo(images / name, None if masks is None else find_mask(masks, name))
            sizes.setdefault(photo.size, []).append(name)
            mask = photo.image.new_ones(photo.image.shape[:2]) if photo.mask is None else photo.mask
            save_codes(stage / "masks" / f"{name}.png", 255 * (mask > 0.5), 8)
            _copy_upright(images / name, stage / "images" / name)
        display.advance()
    errors.raise_if_any()
    return sizes


def _copy_upright(picture: Path, copy: Path) -> None:
    """A copy of at most as many pixels as `load_photo` keeps, and without EXIF orientation, which COLMAP ignores.

    Other tags stay, since they give the focal length.
    """
    from PIL import ImageOps

    copy.parent.mkdir(parents=True, exist_ok=True)
    with opened(picture) as image:
        smaller = reduced(image)
        if smaller is image and image.getexif().get(ORIENTATION, 1) == 1:
            shutil.copyfile(picture, copy)
        else:
            upright = ImageOps.exif_transpose(smaller)
            upright.save(copy, quality=95, exif=upright.getexif())


def _models(
    pycolmap: ModuleType, stage: Path, sizes: Mapping[tuple[int, int], Sequence[str]], display: Display
) -> list[Any]:
    """The models that COLMAP makes of the pictures and masks in the stage, each of other pictures."""
    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.FATAL)
    pycolmap.set_random_seed(_SEED)
    database, count = stage / "database.db", sum(map(len, sizes.values()))
    display.begin(f"finding features in {count} pictures")
    _extract(pycolmap, stage, database, sizes)
    display.begin(f"matching {count} pictures")
    _match(pycolmap, database, exhaustive=count <= _MOST_EXHAUSTIVE)
    display.begin("placing pictures", count)
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = options.mapper.random_seed = options.triangulation.random_seed = _SEED
    options.num_threads = cores()
    folder = stage / "models"
    folder.mkdir()
    models = pycolmap.incremental_mapping(
        database, stage / "images", folder, options, next_image_callback=display.advance
    )
    return list(models.values())


def _extract(pycolmap: ModuleType, stage: Path, database: Path, sizes: Mapping[tuple[int, int], Sequence[str]]) -> None:
    reader, options = pycolmap.ImageReaderOptions(), pycolmap.FeatureExtractionOptions()
    reader.camera_model, reader.mask_path = LENS_MODEL, stage / "masks"
    options.max_image_size, options.num_threads = _LONGEST_SIDE, cores()
    options.sift.max_num_features = _MOST_FEATURES
    pycolmap.Database.open(database).close()
    for names in sizes.values():  # numbers them in this order; the threads below would in that in which they finish
        pycolmap.import_images(database, stage / "images", pycolmap.CameraMode.SINGLE, names, reader)
    every = [name for names in sizes.values() for name in names]
    pycolmap.extract_features(
        database, stage / "images", every, reader_options=reader, extraction_options=options, device=pycolmap.Device.cpu
    )


def _match(pycolmap: ModuleType, database: Path, *, exhaustive: bool) -> None:
    options, verification = pycolmap.FeatureMatchingOptions(), pycolmap.TwoViewGeometryOptions()
    options.num_threads, verification.ransac.random_seed = cores(), _SEED
    match = pycolmap.match_exhaustive if exhaustive else pycolmap.match_sequential
    match(database, options, verification_options=verification, device=pycolmap.Device.cpu)


def _largest(models: Sequence[Any], images: Path) -> Any:
    if not models:
        raise AssetError(
            f"COLMAP could place no picture of {images}: take sharp ones of a textured object, some ten degrees apart, "
            "and give --masks if the background stands still while the object turns."
        )
    return max(models, key=lambda model: model.num_reg_images())


def _upright(model: Any) -> Float[ndarray, "3 3"]:
    """The rotation that takes up to +Y.

    Up is perpendicular to the rows of all pictures, if that is near the mean of their columns: it is of a camera that
    was never rolled, also where it looked down from one side alone. Else up is that mean.
    """
    turns = np.stack([model.image(number).cam_from_world().rotation.matrix() for number in model.reg_image_ids()])
    rows, mean = turns[:, 0], -turns[:, 1].sum(axis=0)
    mean /= np.linalg.norm(mean)
    axis = np.linalg.eigh(rows.T @ rows).eigenvectors[:, 0]
    axis *= np.sign(axis @ mean)
    up = axis if axis @ mean > _NEAR else mean
    side = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    side /= np.linalg.norm(side)
    return np.stack([side, up, np.cross(side, up)])
