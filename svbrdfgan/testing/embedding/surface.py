"""Tests of the surface: it keeps the mesh's shape, parts and shading, and is cut only if declared."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from svbrdfgan.geometry.normals import corner_normals, face_areas
from svbrdfgan.testing.embedding.base import EmbeddingKit
from svbrdfgan.testing.embedding.points import Points, find
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.types import Mesh, Surface

_ROUNDING = 1e-6  # of barycentric coordinates and directions, since vertices may be merged if they agree to 2^-24
_OF_DIAGONAL = 1e-9


class SurfaceTests(EmbeddingKit):
    """The promises of `svbrdfgan.types.Surface` that its constructor cannot check."""

    def test_uv_lies_in_the_unit_square(self) -> None:
        """No coordinate is below 0 or above 1."""
        for name, _, surface in self.surfaces():
            low, high = surface.uv.min(), surface.uv.max()
            check(low >= 0.0 and high <= 1.0, f"{name}: uv runs from {low:.6g} to {high:.6g}; wanted 0 to 1.")

    def test_pieces_lie_in_their_source_faces(self) -> None:
        """`source_face` names a face of the mesh; `source_barycentric` is not negative and adds up to one."""
        for name, mesh, surface in self.surfaces():
            low, high = surface.source_face.min(), surface.source_face.max()
            check(low >= 0 and high < len(mesh.faces), f"{name}: source_face runs from {low} to {high}.")
            weights = surface.source_barycentric
            error = max(-weights.min(), np.abs(weights.sum(axis=2) - 1.0).max())
            check(error <= _ROUNDING, f"{name}: source_barycentric lies outside its face by {error:.3g}.")

    def test_positions_are_the_meshs(self) -> None:
        """Each corner lies where its barycentric coordinates put it on the mesh, in the mesh's own metres."""
        for name, mesh, surface in self.surfaces():
            wanted = _from_source(mesh.positions[mesh.faces], surface)
            error = np.linalg.norm(surface.positions[surface.faces] - wanted, axis=2).max()
            diagonal = np.linalg.norm(mesh.bounds[1] - mesh.bounds[0])
            check(
                error <= _OF_DIAGONAL * diagonal,
                f"{name}: corners lie up to {error:.3g} m away from where source_face and source_barycentric say, "
                f"on a mesh of {diagonal:.3g} m; move, scale and smooth nothing.",
            )

    def test_pieces_keep_the_winding(self) -> None:
        """Each piece has the winding of the face that it lies in."""
        for name, mesh, surface in self.surfaces():
            turned = (turns(surface) <= 0.0) & _has_area(mesh)[surface.source_face]
            check(not turned.any(), f"{name}: {turned.sum()} of {len(turned)} pieces are wound backwards, or a line.")

    def test_pieces_cover_every_face_once(self) -> None:
        """The pieces of a face leave no gap and do not overlap: areas add up, and each point lies in one piece."""
        for name, mesh, surface in self.surfaces():
            covered = np.bincount(surface.source_face, np.abs(turns(surface)), len(mesh.faces))[_has_area(mesh)]
            wrong = covered[np.abs(covered - 1.0) > _ROUNDING]
            check(not len(wrong), f"{name}: pieces cover {wrong[:3]} of {len(wrong)} faces of the mesh; wanted 1.")
            pieces = find(surface, Points.on_every_face(mesh, 8)).pieces
            check(
                bool((pieces == 1).all()),
                f"{name}: of {len(pieces)} points, {(pieces == 0).sum()} lie in no piece, {(pieces > 1).sum()} in two.",
            )

    def test_faces_are_cut_only_if_declared(self) -> None:
        """A surface without `subdivides` has one face for each face of the mesh, with the same corners."""
        declared(not self.capabilities.subdivides, "keeping faces whole")
        for name, mesh, surface in self.surfaces():
            good = _has_area(mesh)[surface.source_face]
            whole = np.abs(surface.source_barycentric[good].max(axis=2) - 1.0).max() <= _ROUNDING
            once = np.unique(surface.source_face[good], return_counts=True)[1].max() == 1
            check(whole and once, f"{name}: faces are cut; declare subdivides=True.")

    def test_parts_are_the_meshs(self) -> None:
        """The mesh's parts come first and unchanged; all parts after them are hidden."""
        for name, mesh, surface in self.surfaces():
            own, further = surface.parts[: len(mesh.parts)], surface.parts[len(mesh.parts) :]
            names = [part.name for part in surface.parts]
            check(own == mesh.parts, f"{name}: parts are {names}, of the mesh {[part.name for part in mesh.parts]}.")
            check(all(part.hidden for part in further), f"{name}: of the parts {names}, added ones are not hidden.")

    def test_each_piece_has_its_faces_part(self) -> None:
        """A piece is in the part of the face that it lies in, or in its hidden half."""
        for name, mesh, surface in self.surfaces():
            wanted = [mesh.parts[part].name for part in mesh.face_part[surface.source_face]]
            found = [surface.parts[part].mesh_part for part in surface.face_part]
            wrong = sum(a != b for a, b in zip(wanted, found, strict=True))
            check(not wrong, f"{name}: {wrong} of {len(found)} pieces are in another part than their faces.")

    def test_no_vertex_serves_two_parts(self) -> None:
        """Vertices are split where parts meet."""
        for name, _, surface in self.surfaces():
            pairs = np.unique(np.stack([surface.faces.ravel(), np.repeat(surface.face_part, 3)], axis=1), axis=0)
            shared = len(pairs) - len(np.unique(pairs[:, 0]))
            check(not shared, f"{name}: {shared} vertices belong to faces of two parts; split them.")

    def test_normals_have_length_one(self) -> None:
        """Shading normals are unit vectors."""
        for name, _, surface in self.surfaces():
            length = np.linalg.norm(surface.normals, axis=1)
            low, high = length.min(), length.max()
            check(
                low > 1 - _ROUNDING and high < 1 + _ROUNDING, f"{name}: normals have lengths {low:.6g} to {high:.6g}."
            )

    def test_normals_are_those_of_the_core(self) -> None:
        """Normals are `corner_normals` of the whole mesh, interpolated within each face."""
        for name, mesh, surface in self.surfaces():
            wanted = _unit(_from_source(corner_normals(mesh.positions, mesh.faces), surface))
            angle = np.linalg.norm(_unit(surface.normals[surface.faces]) - wanted, axis=2)
            angle = angle[_has_area(mesh)[surface.source_face]].max()
            check(
                angle <= 10 * _ROUNDING,
                f"{name}: normals are up to {angle:.3g} rad off; take svbrdfgan.geometry.normals.corner_normals of the "
                "mesh before it is cut, and interpolate.",
            )

    def test_elevation_is_zero_where_one_to_one(self) -> None:
        """The elevation of an injective embedding is zero, since it has no layers to order."""
        declared(self.capabilities.injective, "injective")
        for name, _, surface in self.surfaces():
            high = np.abs(surface.elevation).max()
            check(not high, f"{name}: elevation reaches {high:.3g}, though the embedding is declared injective.")


def turns(surface: Surface) -> Float[ndarray, " faces"]:
    """Each piece's share of its source face's area; negative if its winding is reversed."""
    # corners in barycentric coordinates: their determinant is the ratio of signed areas
    return np.asarray(np.linalg.det(surface.source_barycentric))


def _from_source(attribute: Float[ndarray, "source_faces 3 3"], surface: Surface) -> Float[ndarray, "faces 3 3"]:
    """An attribute of the mesh's face corners, interpolated at the pieces' corners."""
    return np.einsum("fij,fjx->fix", surface.source_barycentric, attribute[surface.source_face])


def _has_area(mesh: Mesh) -> Bool[ndarray, " faces"]:
    return face_areas(mesh.positions, mesh.faces) > 0.0


def _unit(vectors: Float[ndarray, "*n 3"]) -> Float[ndarray, "*n 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)
