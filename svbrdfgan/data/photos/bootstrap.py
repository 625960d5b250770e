"""How far off an import is, found by importing simulated pictures whose truth is known: a parametric bootstrap.

A simulated picture is like the imported one: the same mesh from nearly the same camera, with the weathering that was
estimated, but glossy, in a light of the pool. Its light is estimated as that of the picture was. Efron & Tibshirani, An
Introduction to the Bootstrap (1993), chapter 6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.data.photos.calibrated_camera import CalibratedCamera
from svbrdfgan.data.photos.exposure import exposure_factor
from svbrdfgan.data.photos.light import GLOSS, Evidence, white
from svbrdfgan.data.photos.overlay import downsample
from svbrdfgan.data.photos.pairs import USUAL_ROUGHNESS, FlashShading, divided, shading_of_pair
from svbrdfgan.data.reflectance_errors import no_errors
from svbrdfgan.geometry.camera_hits import CameraHits, camera_hits
from svbrdfgan.geometry.texels import nearest_texels
from svbrdfgan.scene.subject import Subject
from svbrdfgan.types import Camera, Environment, Material, Materials, Rendering, View

_ROUGHNESS = (0.1, 0.6)
"""Of simulated paint."""
_STRANGE = 0.3
"""Standard deviation of the logarithm of the simulated weathering's colour, about that which was assumed."""
_DARKEST = 0.02
"""Shading below this share of its mean is not divided by."""
_GAIN = (0.1, 10.0)

Render = Callable[[Materials, View], Float[Tensor, "height width 3"]]
"""Makes pictures of the subject's surface, as noisy as those that the import makes."""
Believe = Callable[[Evidence], Environment]
"""The light that an import takes a picture's to be."""


@dataclass(frozen=True, eq=False)
class Picture:
    """An imported picture.

    Attributes:
        subject, camera, size: of its exemplar's scene; width and height.
        evidence: of its light.
        shares: how much of each pixel of the evidence is weathered.
        dirt: the colour that the import takes weathering to have.
    """

    subject: Subject
    camera: Camera
    size: tuple[int, int]
    evidence: Evidence
    shares: Float[ndarray, "pixels 1"]
    dirt: tuple[float, float, float]


def simulated_errors(
    picture: Picture,
    light: Environment,
    camera: Camera,
    believe: Believe,
    render: Render,
    rng: np.random.Generator,
    clean: Materials | None = None,
) -> Float[Tensor, "height width 8"]:
    """The errors of the import of one simulated picture (`svbrdfgan.data.reflectance_errors`).

    Args:
        light: of the simulated picture.
        camera: that takes it, instead of the one that the import believes in.
        rng: draws the paint's roughness, and a colour of weathering that the import did not expect.
        clean: the unweathered mesh, if a picture of it is simulated, too.
    """
    subject, evidence, size = picture.subject, picture.evidence, picture.size
    count, view = len(subject.surface.parts), View(camera, light, *size)
    matt = white(subject.learnable, count)
    diffuse, gloss = render(matt, view), render(_gloss(subject.learnable, count, rng.uniform(*_ROUGHNESS)), view)
    there = None if clean is None else divided(render(clean, view), diffuse)
    shown = _weathered(picture, rng) if there is None else evidence.base
    radiance = _reduced(diffuse, evidence) * shown + _reduced(gloss, evidence)
    factor = _exposure(radiance, evidence)
    believed = believe(replace(evidence, radiance=radiance * factor))

    own = View(picture.camera, believed, *size)
    shading, hits = render(matt, own), camera_hits(subject.surface, camera, *size)
    clear = (torch.minimum(shading, diffuse) > _DARKEST * shading.mean()).all(dim=-1)
    clear &= torch.from_numpy(np.isin(hits.part, subject.learnable))
    if clean is not None and there is not None:
        base = divided(render(clean, own), shading)
        lit, known = shading_of_pair((diffuse * there + gloss) * factor, base, shading)
        clear &= known
        gain = _gain(diffuse * factor, lit, clear)
        return _placed(gain, base - gain * there, hits, picture, clear, filled=True)
    offset = (gloss * factor / torch.where(clear.unsqueeze(-1), shading, torch.inf)).clamp(max=_GAIN[1]) - GLOSS
    return _placed(_gain(diffuse * factor, shading, clear), offset, hits, picture, clear)


def flash_errors(
    picture: Picture,
    flash: FlashShading,
    hits: CameraHits,
    gain: Callable[[Evidence, np.random.Generator], Float[ndarray, " 3"]],
    rng: np.random.Generator,
) -> Float[Tensor, "height width 8"]:
    """The errors of the import of one simulated picture in the light of a flash.

    Args:
        flash: the shading that the import believes in.
        hits: what the camera that takes the simulated picture sees.
        gain: by how much an import of a picture is too bright, of the evidence of its light.
        rng: draws a colour of weathering that the import did not expect, and is handed to `gain`.
    """
    true, evidence = FlashShading.of(hits), picture.evidence
    clear = flash.clear & true.clear & torch.from_numpy(np.isin(hits.part, picture.subject.learnable))
    seen = replace(evidence, radiance=_weathered(picture, rng) * evidence.white[..., 0])
    scaled = (
        _gain(true.values.unsqueeze(-1), flash.values.unsqueeze(-1), clear) * torch.from_numpy(gain(seen, rng)).float()
    )
    gloss = true.gloss(rng.uniform(*_ROUGHNESS)) * scaled - flash.gloss(USUAL_ROUGHNESS)
    return _placed(scaled, gloss, hits, picture, clear, filled=True)


def _gain(
    true: Float[Tensor, "height width *c"],
    believed: Float[Tensor, "height width *c"],
    clear: Bool[Tensor, "height width"],
) -> Float[Tensor, "height width *c"]:
    """True shading over the believed one, where that is clear."""
    return (true / torch.where(clear.unsqueeze(-1), believed, torch.inf)).clamp(*_GAIN)


def _placed(
    gain: Float[Tensor, "height width 3"],
    offset: Float[Tensor, "height width 3"],
    hits: CameraHits,
    picture: Picture,
    clear: Bool[Tensor, "height width"],
    filled: bool = False,
) -> Float[Tensor, "height width 8"]:
    """The errors, with the shift to where the camera of these hits shows what belongs there.

    Args:
        filled: whether the import shows the nearest clear pixel where one is not clear.
    """
    if not clear.any():
        return no_errors(*clear.shape)
    points = hits.interpolate(picture.subject.surface.positions)
    shift = torch.from_numpy(_shift(points, picture.camera, picture.size)).float()
    row, col = nearest_texels(clear.numpy())
    errors = torch.cat([gain, offset, shift], dim=-1)[row, col]
    if filled:
        errors[..., 6:] += torch.from_numpy(np.stack([col, row], axis=-1) - _places(picture.size))
    return errors


def _weathered(picture: Picture, rng: np.random.Generator) -> Float[ndarray, "pixels 3"]:
    """The reflectance that the simulated picture shows: a draw of the model, or the weathering that was estimated."""
    base, draws = picture.evidence.base, picture.evidence.draws
    if len(draws):
        return draws[rng.integers(len(draws))]
    strange = np.exp(_STRANGE * (rng.normal() + rng.normal(size=3) / 3))
    return base + picture.shares * (np.asarray(picture.dirt) * strange - base)


def _gloss(parts: tuple[int, ...], count: int, roughness: float) -> Materials:
    """Black gloss on these parts, whose pictures are what gloss adds."""
    black = Material.lambertian((0.0, 0.0, 0.0))
    shiny = Material({"base_color": torch.zeros(3), "roughness": torch.tensor([roughness])})
    return Materials(tuple(shiny if part in parts else black for part in range(count)))


def _reduced(picture: Float[Tensor, "height width 3"], evidence: Evidence) -> Float[ndarray, "pixels 3"]:
    rows, cols = evidence.usable.shape
    reduced: Float[ndarray, "rows cols 3"] = downsample(picture.permute(2, 0, 1), (cols, rows)).double().numpy()
    return reduced.transpose(1, 2, 0)[evidence.usable]


def _exposure(radiance: Float[ndarray, "pixels 3"], evidence: Evidence) -> float:
    """The factor by which the picture is exposed like the unweathered mesh."""
    seen = torch.ones(len(radiance))
    clean = evidence.base * evidence.white.sum(axis=-1)
    return exposure_factor(*(Rendering(torch.from_numpy(each), seen) for each in (radiance, clean)))


def _shift(
    points: Float[ndarray, "rows cols 3"], camera: Camera, size: tuple[int, int]
) -> Float[ndarray, "rows cols 2"]:
    """From each pixel to where this camera sees the point that another one sees there, pixels to the right and down."""
    seen = (points - np.asarray(camera.origin)) @ camera.basis().T
    film = CalibratedCamera.of(camera, size).project(seen) * (1, -1)
    return np.nan_to_num((film + 1) / 2 * size - _places(size) - 0.5)


def _places(size: tuple[int, int]) -> Int[ndarray, "rows cols 2"]:
    """Column and row of each pixel."""
    row, col = np.mgrid[: size[1], : size[0]]
    return np.stack([col, row], axis=-1)
