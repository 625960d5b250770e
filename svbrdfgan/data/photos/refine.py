"""Refines a camera until the mesh's outline lies on that of the picture's mask.

Points of each outline are matched with the nearest of the other, as in the iterative closest point method (Besl and
McKay 1992); distances count along the normals of the outlines, and little if they are much longer than most. Each round
solves for a turn about the mesh's middle, a move and a focal length by least squares. An outline leaves some of them
open, such as distance against focal length: all are held near the camera that was given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.ndimage import binary_erosion, distance_transform_edt, gaussian_filter
from scipy.spatial.transform import Rotation
from torch import Tensor

from svbrdfgan.data.photos.overlay import downsample, intersection_over_union, visible_depth
from svbrdfgan.errors import ConfigError
from svbrdfgan.types import Camera, Mesh

_SIDE = 320
"""Pixels, at most, along the longer side of the outlines' pictures."""
_ROUNDS = 30
_SMALL = 1e-4
"""A step, in the units of `_HELD`, below which rounds end."""
_HELD = 0.05
"""How far cameras are off, by standard deviation: turns in radians, moves in depths of the middle, log focal length."""
_MATCHES = 60.0
"""Independent distances that outlines are worth, each as sure as most are long; neighbours are off alike."""
_SMOOTH = 1.0
"""Pixels over which an outline's normals are smoothed."""
_LEAST = 20
"""Points of an outline that are needed."""


@dataclass(frozen=True)
class Refinement:
    """How a camera was changed.

    Attributes:
        degrees: how far it has turned about the mesh's middle, or about itself: the greater of both.
        percent: how much its distance from the middle has changed, or its focal length: the greater of both.
        before, after: intersection over union of mask and silhouette.
    """

    degrees: float
    percent: float
    before: float
    after: float


def refine_camera(camera: Camera, mesh: Mesh, mask: Float[Tensor, "height width"]) -> tuple[Camera, Refinement]:
    """The camera that fits the mask best: the given one where no other fits better.

    Args:
        mask: share of each pixel that shows the object.

    Raises:
        ConfigError: the given camera does not have all of the mesh in front of it.
    """
    height, width = mask.shape
    shrink = min(1.0, _SIDE / max(width, height))
    size = max(1, round(width * shrink)), max(1, round(height * shrink))
    wanted = downsample(mask[None], size)[0].numpy() > 0.5
    depth = visible_depth(mesh, camera, *size)
    before = best = intersection_over_union(wanted, np.isfinite(depth))
    found, tried, total = camera, camera, np.zeros(7)
    for _ in range(_ROUNDS):
        step = _step(tried, mesh, depth, wanted, total)
        if step is None or np.abs(step).max() < _SMALL:
            break
        tried, total = _moved(tried, mesh, step), total + step
        try:
            depth = visible_depth(mesh, tried, *size)
        except ConfigError:  # it moved into the mesh
            break
        fits = intersection_over_union(wanted, np.isfinite(depth))
        if fits > best:
            found, best = tried, fits
    return found, _refinement(camera, found, mesh, before, best)


def _step(
    camera: Camera,
    mesh: Mesh,
    depth: Float[ndarray, "rows cols"],
    wanted: Bool[ndarray, "rows cols"],
    total: Float[ndarray, " 7"],
) -> Float[ndarray, " 7"] | None:
    """The change of the camera that moves the mesh's outline to the mask's; None if an outline is too short."""
    silhouette = np.isfinite(depth)
    mine, theirs = _outline(silhouette), _outline(wanted)
    if min(len(mine), len(theirs)) < _LEAST:
        return None
    focal = len(depth) / 2 / math.tan(camera.vertical_fov / 2)
    jacobian = _jacobian(mine, depth, focal, _middle(camera, mesh))
    nearest = _nearest(mine, theirs, silhouette.shape)
    outward, normal = _distances(wanted, mine)
    inward, other_normal = _distances(silhouette, theirs)
    moves = jacobian[np.concatenate([np.arange(len(mine)), nearest])]
    matrix = np.einsum("pk,pkj->pj", np.concatenate([normal, other_normal]), moves)
    error = np.concatenate([-outward, inward])
    usual = max(1.0, float(np.median(np.abs(error))))
    trust = 1 / (1 + (error / (2 * usual)) ** 2)
    trust *= _MATCHES / (trust.sum() * usual**2)
    held = np.eye(7) / _HELD**2
    return np.linalg.solve((matrix * trust[:, None]).T @ matrix + held, matrix.T @ (trust * error) - held @ total)


def _outline(inside: Bool[ndarray, "rows cols"]) -> Int[ndarray, "points 2"]:
    """Rows and columns of pixels inside that touch the outside; the picture's border is no outline."""
    edge = inside & ~binary_erosion(inside, border_value=1)
    return np.argwhere(edge)


def _nearest(
    mine: Int[ndarray, "points 2"], theirs: Int[ndarray, "others 2"], shape: tuple[int, ...]
) -> Int[ndarray, " others"]:
    """The number of the point of `mine` that is nearest to each of `theirs`."""
    number = np.zeros(shape, dtype=np.int64)
    number[mine[:, 0], mine[:, 1]] = np.arange(len(mine))
    free = np.ones(shape, dtype=bool)
    free[mine[:, 0], mine[:, 1]] = False
    _, (row, col) = distance_transform_edt(free, return_indices=True)
    at = row[theirs[:, 0], theirs[:, 1]], col[theirs[:, 0], theirs[:, 1]]
    return number[at]


def _distances(
    inside: Bool[ndarray, "rows cols"], at: Int[ndarray, "points 2"]
) -> tuple[Float[ndarray, " points"], Float[ndarray, "points 2"]]:
    """The distance of points to the outline in pixels, negative inside of it, and its normal: right and downwards."""
    signed = distance_transform_edt(~inside) - distance_transform_edt(inside) + np.where(inside, 0.5, -0.5)
    down, right = np.gradient(gaussian_filter(signed, _SMOOTH))
    normal = np.stack([right, down], axis=-1)[at[:, 0], at[:, 1]]
    # pixels of an outline are half a pixel inside
    return signed[at[:, 0], at[:, 1]] + 0.5, normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-6)


def _jacobian(
    at: Int[ndarray, "points 2"], depth: Float[ndarray, "rows cols"], focal: float, middle: Float[ndarray, " 3"]
) -> Float[ndarray, "points 2 7"]:
    """How points move over the picture, to the right and downwards, by turns, moves and the log focal length."""
    rows, cols = depth.shape
    z = -depth[at[:, 0], at[:, 1]]
    right, down = at[:, 1] + 0.5 - cols / 2, at[:, 0] + 0.5 - rows / 2
    point = np.stack([-right * z / focal, down * z / focal, z], axis=-1)
    # of (right, down) by the point in the camera's axes
    by_point = np.zeros((len(at), 2, 3))
    by_point[:, 0, 0], by_point[:, 1, 1] = -focal / z, focal / z
    by_point[:, 0, 2], by_point[:, 1, 2] = -right / z, -down / z
    lever = point - middle
    turns = np.stack([np.cross(axis, lever) for axis in np.eye(3)], axis=-1)
    moves = np.broadcast_to(np.eye(3) * -middle[2], (len(at), 3, 3))
    by_camera = by_point @ np.concatenate([turns, moves], axis=-1)
    return np.concatenate([by_camera, np.stack([right, down], axis=-1)[..., None]], axis=-1)


def _middle(camera: Camera, mesh: Mesh) -> Float[ndarray, " 3"]:
    """The middle of the mesh in the camera's axes."""
    return camera.basis() @ (mesh.bounds.mean(axis=0) - np.asarray(camera.origin))


def _moved(camera: Camera, mesh: Mesh, step: Float[ndarray, " 7"]) -> Camera:
    """The camera that sees the mesh turned about its middle and moved by a step."""
    basis, middle = camera.basis(), _middle(camera, mesh)
    turn = Rotation.from_rotvec(step[:3]).as_matrix()
    origin = np.asarray(camera.origin) + basis.T @ (middle - turn.T @ (middle - middle[2] * step[3:6]))
    _, top, backward = turn @ basis
    tangent = math.tan(camera.vertical_fov / 2) * math.exp(-step[6])
    x, y, z = origin.tolist()
    a, b, c = (origin - backward).tolist()
    up_x, up_y, up_z = top.tolist()
    return replace(
        camera, origin=(x, y, z), target=(a, b, c), up=(up_x, up_y, up_z), vertical_fov=2 * math.atan(tangent)
    )


def _refinement(old: Camera, new: Camera, mesh: Mesh, before: float, after: float) -> Refinement:
    """How the new camera differs from the old one."""
    sights = [mesh.bounds.mean(axis=0) - np.asarray(one.origin) for one in (old, new)]
    lengths = [float(np.linalg.norm(sight)) for sight in sights]
    about = math.acos(float(np.clip(sights[0] @ sights[1] / lengths[0] / lengths[1], -1, 1)))
    itself = float(Rotation.from_matrix(new.basis() @ old.basis().T).magnitude())
    zoom = math.tan(old.vertical_fov / 2) / math.tan(new.vertical_fov / 2)
    return Refinement(
        degrees=math.degrees(max(about, itself)),
        percent=100 * max(abs(lengths[1] / lengths[0] - 1), abs(zoom - 1)),
        before=before,
        after=after,
    )
