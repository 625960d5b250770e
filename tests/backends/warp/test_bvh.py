"""The BVH gives what brute force gives, on meshes that are hard for trees."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
import warp as wp
from numpy import ndarray
from svbrdfgan_warp import bvh, bvh_kernels
from svbrdfgan_warp.bvh import build_bvh
from svbrdfgan_warp.device import choose_device, launch

RAYS = 2000


@wp.kernel
def shoot(
    nodes: wp.array(dtype=wp.uint32),
    triangles: wp.array2d(dtype=wp.vec4),
    starts: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    face: wp.array(dtype=wp.int32),
    blocked: wp.array(dtype=wp.int32),
):
    i = wp.tid()
    face[i] = bvh_kernels.nearest(nodes, triangles, starts[i], directions[i])[0]
    blocked[i] = wp.where(bvh_kernels.blocked(nodes, triangles, starts[i], directions[i]), 1, 0)


def soup(rng: np.random.Generator) -> ndarray:
    """Triangles of all sizes, anywhere."""
    return rng.normal(size=(300, 1, 3)) + rng.normal(size=(300, 3, 3)) * rng.uniform(0.1, 1.0, (300, 1, 1)) ** 3


def coincident(rng: np.random.Generator) -> ndarray:
    """Forty triangles, each ten times."""
    return np.repeat(rng.normal(size=(40, 3, 3)), 10, axis=0)


def needles(rng: np.random.Generator) -> ndarray:
    """Long and thin, parallel to the axes, flat in one of them."""
    corners = rng.normal(size=(200, 1, 3)) * 0.5 + rng.normal(size=(200, 3, 3)) * [3.0, 0.01, 0.0]
    return np.ascontiguousarray(corners[:, :, rng.permutation(3)])


def alone(rng: np.random.Generator) -> ndarray:
    return rng.normal(size=(1, 3, 3))


def strung_out(rng: np.random.Generator) -> ndarray:
    """Each half as large and half as far out as the one before, which makes the tree as deep as possible."""
    return rng.normal(size=(16, 3, 3)) * 0.5 ** np.arange(16)[:, None, None]


@pytest.mark.parametrize("mesh", [soup, coincident, needles, alone, strung_out])
def test_rays_meet_what_they_meet_without_a_tree(mesh: Callable[[np.random.Generator], ndarray], device: str) -> None:
    rng = np.random.default_rng(5)
    corners = mesh(rng)
    points = corners.reshape(-1, 3).astype(np.float32)
    points -= (points.min(axis=0) + points.max(axis=0)) / 2
    radius = np.abs(points).max()
    starts = rng.normal(size=(RAYS, 3)) * radius
    targets = points.reshape(-1, 3, 3)[rng.integers(len(corners), size=RAYS)]
    targets = (targets * rng.dirichlet(np.ones(3), size=RAYS)[:, :, None]).sum(axis=1)
    directions = targets - starts
    directions[::7] = np.eye(3)[rng.integers(3, size=len(directions[::7]))] * rng.choice([-1, 1])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    face, blocked = _shoot(points, starts, directions, device)
    t = _distances(points.astype(np.float64).reshape(-1, 3, 3), starts, directions)
    nearest = t.min(axis=1)
    wanted = np.isfinite(nearest)
    clear = t > nearest[:, None] + 1e-4 * radius  # either of two equally near faces is right
    assert (wanted == (face >= 0)).mean() > 0.995  # rays at edges may hit or miss
    assert (blocked == (face >= 0)).all()
    both = wanted & (face >= 0)
    assert not clear[both, face[both]].any()


def test_points_of_no_face_change_nothing(device: str) -> None:
    """Bounds are widened for the rounding at the farthest corner, not at an unused point."""
    where, points = choose_device(device), torch.from_numpy(soup(np.random.default_rng(5)).reshape(-1, 3)).float()
    corners = torch.arange(len(points), dtype=torch.int32, device=where)
    stray = torch.cat([points, torch.full((1, 3), 1e6)])
    # As sets: on CUDA the nodes' numbers depend on the order of the threads.
    trees = [build_bvh(each.to(where), corners) for each in (points, stray)]
    bounds = [sorted(map(tuple, wp.to_torch(nodes).view(-1, 20)[:, :3].tolist())) for nodes, _ in trees]
    assert bounds[0] == bounds[1]


@pytest.mark.parametrize("apart", [0.0, 1.0])
def test_boxes_that_tie_pair_off_at_once(apart: float, device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Coincident or evenly spaced, 1024 of them take about as many rounds as halvings, not one round each."""
    rounds = []
    monkeypatch.setattr(bvh, "launch", lambda kernel, *rest: (rounds.append(kernel), launch(kernel, *rest)))
    triangle = np.random.default_rng(5).uniform(size=(3, 3)).astype(np.float32)
    points = triangle + apart * np.arange(1024, dtype=np.float32)[:, None, None] * np.eye(3, dtype=np.float32)[0]
    where = choose_device(device)
    build_bvh(torch.from_numpy(points.reshape(-1, 3)).to(where), torch.arange(3072, dtype=torch.int32, device=where))
    assert rounds.count(bvh_kernels.find_partners) <= 20


def _shoot(points: ndarray, starts: ndarray, directions: ndarray, device: str) -> tuple[ndarray, ndarray]:
    where = choose_device(device)
    tree = build_bvh(torch.from_numpy(points).to(where), torch.arange(len(points), dtype=torch.int32, device=where))
    rays = [wp.from_torch(torch.tensor(x, dtype=torch.float32, device=where), wp.vec3) for x in (starts, directions)]
    face, blocked = (torch.empty(RAYS, dtype=torch.int32, device=where) for _ in range(2))
    launch(shoot, RAYS, (*tree, *rays, wp.from_torch(face), wp.from_torch(blocked)), where)
    return face.cpu().numpy(), blocked.cpu().numpy() > 0


def _distances(triangles: ndarray, starts: ndarray, directions: ndarray) -> ndarray:
    """The distance of each ray to each triangle, infinite where they do not meet (Möller and Trumbore 1997)."""
    a, b, c = triangles.transpose(1, 0, 2)
    o = starts.astype(np.float32).astype(np.float64)[:, None] - a
    d = np.broadcast_to(directions.astype(np.float32).astype(np.float64)[:, None], o.shape)
    p, q = np.cross(d, c - a), np.cross(o, b - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / ((b - a) * p).sum(axis=-1)
        u, v, t = (o * p).sum(axis=-1) * inverse, (d * q).sum(axis=-1) * inverse, ((c - a) * q).sum(axis=-1) * inverse
        met = (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0)
    return np.where(met, t, np.inf)
