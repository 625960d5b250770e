"""The scene that programs are timed on: plain arrays, in a file that any program can read."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.errors import AssetError
from svbrdfgan.types import Camera, Environment, Material, Materials, Part, Surface, View

_AXES: Mapping[str, tuple[int, ...]] = MappingProxyType(
    {
        **dict.fromkeys(("positions", "normals", "faces", "base_color"), (-1, 3)),
        **dict.fromkeys(("rotation", "vertical_fov", "width", "height", "embedding_s"), ()),
        **dict.fromkeys(("texture", "radiance"), (-1, -1, 3)),
        "uv": (-1, 2),
        "face_part": (-1,),
        "repeat": (2,),
        "camera": (3, 3),
        "gloss": (-1, -1, 5),
    }
)
"""The shape of each array, where -1 is any number."""


@dataclass(frozen=True, eq=False)
class BenchScene:
    """A scene to render. `save` writes a NumPy .npz file with an array for each attribute; numbers have no axes.

    Conventions are those of `docs/conventions.md`.

    Attributes:
        positions, normals, uv, faces, face_part: as in `Surface`, as float32 and int32.
        repeat: as in `Surface`.
        base_color: linear reflectance of each part; that of part 0 is replaced by the texture.
        texture: linear reflectance, row 0 at v = 0. Gradients are taken with respect to it.
        radiance, rotation: as in `Environment`, the rotation in radians.
        camera: rows are its origin, its target and its up direction.
        vertical_fov: full angle over the picture's height, radians.
        width, height: of the picture, in pixels.
        embedding_s: seconds that embedding and baking took; 0 for a scene that was made with UVs.
        gloss: roughness, metallic and unit normal of part 0, over the same UVs; without texels if it is Lambertian.
            Gradients are taken with respect to it, too.
    """

    positions: Float[ndarray, "vertices 3"]
    normals: Float[ndarray, "vertices 3"]
    uv: Float[ndarray, "vertices 2"]
    faces: Int[ndarray, "faces 3"]
    face_part: Int[ndarray, " faces"]
    repeat: Bool[ndarray, " axes"]
    base_color: Float[ndarray, "parts 3"]
    texture: Float[ndarray, "rows cols 3"]
    radiance: Float[ndarray, "height width 3"]
    rotation: float
    camera: Float[ndarray, "3 3"]
    vertical_fov: float
    width: int
    height: int
    embedding_s: float = 0.0
    gloss: Float[ndarray, "rows cols 5"] = field(default_factory=lambda: np.zeros((0, 0, 5), np.float32))

    @classmethod
    def of(
        cls,
        surface: Surface,
        view: View,
        texture: Float[ndarray, "rows cols 3"],
        base_color: Float[ndarray, "parts 3"],
        embedding_s: float = 0.0,
    ) -> BenchScene:
        """The view of a surface whose part 0 has the texture."""
        camera = view.camera
        return cls(
            positions=surface.positions.astype(np.float32),
            normals=surface.normals.astype(np.float32),
            uv=surface.uv.astype(np.float32),
            faces=surface.faces.astype(np.int32),
            face_part=surface.face_part.astype(np.int32),
            repeat=np.array(surface.repeat),
            base_color=base_color.astype(np.float32),
            texture=texture,
            radiance=view.environment.radiance.numpy(),
            rotation=view.environment.rotation,
            camera=np.array([camera.origin, camera.target, camera.up]),
            vertical_fov=camera.vertical_fov,
            width=view.width,
            height=view.height,
            embedding_s=embedding_s,
        )

    def with_film(self, pixels: int) -> BenchScene:
        """The same scene in a picture of `pixels` x `pixels`."""
        return replace(self, width=pixels, height=pixels)

    def surface(self) -> Surface:
        vertices, faces = len(self.positions), len(self.faces)
        return Surface(
            positions=self.positions.astype(np.float64),
            normals=self.normals.astype(np.float64),
            uv=self.uv.astype(np.float64),
            faces=self.faces.astype(np.int64),
            face_part=self.face_part.astype(np.int64),
            parts=tuple(Part(f"part {part}") for part in range(len(self.base_color))),
            elevation=np.zeros(vertices),
            source_face=np.arange(faces),
            source_barycentric=np.broadcast_to(np.eye(3), (faces, 3, 3)),
            repeat=(bool(self.repeat[0]), bool(self.repeat[1])),
        )

    def view(self) -> View:
        origin, target, up = (tuple(row) for row in self.camera.tolist())
        camera = Camera(origin, target, up, float(self.vertical_fov))
        environment = Environment(torch.from_numpy(self.radiance), float(self.rotation))
        return View(camera, environment, int(self.width), int(self.height))

    def textures(self, device: torch.device) -> dict[str, Float[torch.Tensor, "rows cols channels"]]:
        """The maps of part 0, by name."""
        maps = {"base_color": self.texture}
        if self.gloss.size:
            maps |= dict(zip(("roughness", "metallic", "normal"), np.split(self.gloss, (1, 2), axis=2), strict=True))
        return {name: torch.tensor(values, device=device) for name, values in maps.items()}

    def materials(self, textures: Mapping[str, Float[torch.Tensor, "rows cols channels"]]) -> Materials:
        """The materials of all parts, with these maps on part 0."""
        plain = [Material.lambertian(torch.from_numpy(color)) for color in self.base_color[1:]]
        return Materials((Material(dict(textures)), *plain))

    def save(self, path: str | os.PathLike[str]) -> None:
        np.savez(path, **{field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> BenchScene:
        """Reads what `save` wrote.

        Raises:
            AssetError: the file is missing, damaged or something else.
        """
        try:
            size = os.stat(path).st_size
            with np.load(path) as file:
                scene = cls(**{field.name: _array(file, field.name, size) for field in fields(cls)})
            scene.require_whole()
        except Exception as error:  # NumPy and zipfile raise many types
            reason = " ".join(str(error).split())[:200]
            raise AssetError(f"{path} cannot be read as a scene of `svbrdfgan bench` ({reason}).") from error
        return scene

    def require_whole(self) -> None:
        """Checks the arrays' axes, which a file may have otherwise.

        Raises:
            AssetError, ValueError, TypeError: one has other axes, is not of numbers, or does not fit the others.
        """
        for name, axes in _AXES.items():
            values = np.asarray(getattr(self, name))
            fits = len(values.shape) == len(axes) and all(a in (-1, b) for a, b in zip(axes, values.shape, strict=True))
            if not fits or values.dtype.kind not in "biuf" or not np.isfinite(values).all():
                raise ValueError(f"{name} has shape {values.shape} of {values.dtype}, or numbers that are not finite")
        self.surface()
        self.view()


def _array(file: Any, name: str, most: int) -> Any:
    """An array of a .npz file that `save` wrote, which compresses nothing.

    Raises:
        ValueError: its header claims more than `most` bytes.
    """
    with file.zip.open(f"{name}.npy") as member:
        version = np.lib.format.read_magic(member)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(member)
    if math.prod(shape) * dtype.itemsize > most:
        raise ValueError(f"{name} claims the shape {shape}, which the file's bytes cannot hold")
    return file[name]
