"""Tests of the map: conditions on the UVs of every embedding, and the promises of its capabilities."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from svbrdfgan.geometry.bake import bake
from svbrdfgan.geometry.layers import hide_inner_layers
from svbrdfgan.geometry.normals import face_areas
from svbrdfgan.geometry.rasterize import Fragments, rasterize
from svbrdfgan.testing.embedding.base import EmbeddingKit
from svbrdfgan.testing.embedding.meshes import body, inset, moved, nested, shell, sphere, with_unused_vertices
from svbrdfgan.testing.embedding.points import Points, find
from svbrdfgan.testing.embedding.surface import turns
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.types import Mesh, Surface

_TEXELS = 64  # along a side
_LEAST_FILLED = 0.1  # of the texels
_MOST_OVERLAPPING = 0.005  # of the texels in use
_MOST_COLLAPSED = 0.01  # of the area
_MOST_MIRRORED = 0.6  # a projection of both sides of a body from one side mirrors half of them
_SAME_UV = 1e-3  # a quarter of a texel at 256
_FEW = 0.01  # of points, texels or area: for rounding at borders


class MappingTests(EmbeddingKit):
    """Conditions on any embedding; the author of one tests whether it follows its own formula."""

    def test_the_square_is_used(self) -> None:
        """A closed body covers at least a tenth of the texels."""
        filled = float(bake(Fragments.of(self.embedding.embed(body()), _TEXELS, _TEXELS)).mask.double().mean())
        check(filled >= _LEAST_FILLED, f"{filled:.1%} of the texels show the body; wanted {_LEAST_FILLED:.0%}.")

    def test_one_to_one_means_no_overlap(self) -> None:
        """An injective embedding puts at most one texel centre in 200 into two faces, by rounding at borders."""
        declared(self.capabilities.injective, "injective")
        for name, _, surface in self.surfaces():
            layers = Fragments.of(surface, 4 * _TEXELS, 4 * _TEXELS).layers
            share = (layers > 1).sum() / max((layers > 0).sum(), 1)
            check(share <= _MOST_OVERLAPPING, f"{name}: {share:.1%} of the texels in use lie in two faces or more.")

    def test_one_to_one_means_no_face_collapses(self) -> None:
        """Faces that make up 99 % of the area keep an area in UV under an injective embedding."""
        declared(self.capabilities.injective, "injective")
        for name, _, surface in self.surfaces():
            area = face_areas(surface.positions, surface.faces)
            share = area[np.abs(uv_areas(surface)) < 1e-12].sum() / area.sum()
            check(share <= _MOST_COLLAPSED, f"{name}: faces of {share:.1%} of the area are a line or a point in UV.")

    def test_small_faces_keep_an_area(self) -> None:
        """A face a 100,000th as wide as others, on top of a body, is in its surface and has an area in UV."""
        whole = body()
        top = int(np.argmax(whole.positions[whole.faces, 1].sum(axis=1)))
        mesh = inset(whole, top, 1e-5)
        surface = self.embedding.embed(mesh)
        pieces = surface.source_face == len(mesh.faces) - 1
        covered = float(np.abs(turns(surface))[pieces].sum())
        check(abs(covered - 1.0) < 1e-6, f"pieces cover {covered:.6g} of a small face; wanted 1.")
        area = float(np.abs(uv_areas(surface))[pieces].sum())
        check(area > 0.0, "a small face on top of a body is a line or a point in UV; are UVs rounded?")

    def test_outer_faces_are_not_mirrored(self) -> None:
        """Faces that are wound counter-clockwise seen from outside are so in UV."""
        mirrored = self._share_mirrored()
        check(
            mirrored <= _MOST_MIRRORED,
            f"{mirrored:.0%} of the map of a shell are mirrored: seen from outside, u runs to the right and v up.",
        )

    def test_no_face_is_smeared_across_the_square(self) -> None:
        """No piece of a face of a sphere (a 432nd of it) is more than half the square wide: seams are cut."""
        surface = self.embedding.embed(sphere(6))
        extent = np.ptp(surface.uv[surface.faces], axis=1).max(axis=1)
        check(
            extent.max() <= 0.5,
            f"{(extent > 0.5).sum()} of {len(extent)} faces are up to {extent.max():.2f} wide in UV: they join points "
            "on the two sides of a seam.",
        )

    def test_outer_sides_lie_on_top(self) -> None:
        """The side of a closed body that is seen from outside has the greater elevation where both share texels."""
        declared(not self.capabilities.injective, "sharing of texels")
        mirrored = self._share_mirrored()
        # if the shell is partly mirrored, winding does not tell the inside from the outside
        declared(not _FEW < mirrored < 1 - _FEW, "seeing a shell from one side")
        surface = self.embedding.embed(body())
        top = rasterize(surface, _TEXELS, _TEXELS)
        inward = (_unmirrored(surface) > 0)[top.face[top.mask]] == (mirrored > 0.5)
        check(
            inward.mean() <= 5 * _FEW,
            f"at {inward.mean():.0%} of the texels the inside of a closed body lies on top; is elevation upside down?",
        )

    def test_what_encloses_lies_on_top(self) -> None:
        """The outer one of nested bodies has the greater elevation where both share texels; the inner one is hidden."""
        declared(not self.capabilities.injective, "sharing of texels")
        mesh = nested()
        surface = self.embedding.embed(mesh)
        wrong, both = _hidden_by(surface, mesh, rasterize(surface, _TEXELS, _TEXELS).face)
        check(
            wrong <= _FEW * both, f"the inner body is on top at {wrong} of {both} texels; does elevation grow outward?"
        )
        surface = hide_inner_layers(surface, _TEXELS)
        exposed = ~np.array([part.hidden for part in surface.parts])[surface.face_part]
        inner = _mask(surface, exposed & _inner(surface, mesh)) & _mask(surface, ~_inner(surface, mesh))
        check(inner.sum() <= 5 * _FEW * both, f"the inner body is still exposed at {inner.sum()} of {both} texels.")

    def test_place_and_size_do_not_matter(self) -> None:
        """A vehicle has the same map in another place or unit, since weathering depends on shape (thesis 4.1)."""
        for what, mesh in (
            ("four times as large", moved(body(), 4.0)),
            ("a thousandth as large", moved(body(), 2.0**-10)),
            ("8 m to the left", moved(body(), 1.0, (8.0, 0.0, 0.0))),
            ("16 m up and 32 m back", moved(body(), 1.0, (0.0, 16.0, -32.0))),
        ):
            self._check_same_map(mesh, f"a body {what}")

    def test_unused_vertices_do_not_count(self) -> None:
        """Vertices that no face names do not change the map."""
        self._check_same_map(with_unused_vertices(body(), 50.0), "a body with unused vertices 50 m away")

    def test_textures_repeat_only_where_the_map_does(self) -> None:
        """The map reaches both borders of the square, which meet there, along an axis declared to repeat."""
        declared(self._repeats(body), "repeating")
        surface = self.embedding.embed(body())
        for axis, repeats in zip("uv", surface.repeat, strict=True):
            low, high = (f(surface.uv[:, "uv".index(axis)]) for f in (np.min, np.max))
            check(
                not repeats or (low < 1 / _TEXELS and high > 1 - 1 / _TEXELS),
                f"textures repeat along {axis}, but the map runs from {low:.3f} to {high:.3f}: nothing meets there.",
            )

    def _repeats(self, make: Callable[[], Mesh]) -> bool:
        return any(self.embedding.embed(make()).repeat)

    def _share_mirrored(self) -> float:
        """The share of an open shell's map that is mirrored; all of the shell faces outwards."""
        area = _unmirrored(self.embedding.embed(shell()))
        return float(-area[area < 0].sum() / np.abs(area).sum())

    def _check_same_map(self, mesh: Mesh, what: str) -> None:
        """Fails unless the mesh has the UVs of `body` at all but a hundredth of its points."""
        points = Points.on_every_face(body(), 8)
        one, other = (find(self.embedding.embed(each), points).uv for each in (body(), mesh))
        apart = np.linalg.norm(one - other, axis=1)
        share = float((apart > _SAME_UV).mean())
        check(share <= _FEW, f"{what} has another map: {share:.0%} of its points moved, by up to {apart.max():.3f}.")


def uv_areas(surface: Surface) -> Float[ndarray, " faces"]:
    """Areas in the unit square; negative for faces that are wound clockwise there."""
    a, b, c = (surface.uv[surface.faces[:, k]] for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def _unmirrored(surface: Surface) -> Float[ndarray, " faces"]:
    """Areas in the unit square; negative for faces whose winding differs from that on the mesh."""
    return uv_areas(surface) * np.sign(turns(surface))


def _inner(surface: Surface, mesh: Mesh) -> Bool[ndarray, " faces"]:
    """The mask of those faces of a surface of `nested` that belong to the inner body."""
    return mesh.face_part[surface.source_face] == 0


def _mask(surface: Surface, only: Bool[ndarray, " faces"]) -> Bool[ndarray, "rows cols"]:
    return rasterize(surface, _TEXELS, _TEXELS, only).mask


def _hidden_by(surface: Surface, mesh: Mesh, top: ndarray) -> tuple[int, int]:
    """The number of texels at which the inner body is on top, and of texels that both bodies share."""
    inner = _inner(surface, mesh)
    both = _mask(surface, inner) & _mask(surface, ~inner)
    return int((both & inner[top]).sum()), int(both.sum())
