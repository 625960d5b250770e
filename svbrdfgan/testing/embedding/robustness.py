"""Tests with awkward meshes: each must give a surface, or an error of one sentence with the reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from svbrdfgan.errors import EmbeddingError
from svbrdfgan.testing.embedding.base import EmbeddingKit
from svbrdfgan.testing.embedding.meshes import (
    body,
    box,
    clutter,
    joined,
    mesh_of,
    moved,
    shell,
    sphere,
    with_unused_vertices,
)
from svbrdfgan.testing.kit import check
from svbrdfgan.types import Mesh, Surface

_SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_TWO = np.array([[0, 1, 2], [0, 2, 3]])


class RobustnessTests(EmbeddingKit):
    """An embedding raises nothing but `EmbeddingError`, and returns finite values, for every mesh."""

    def test_a_single_triangle(self) -> None:
        """One triangle, askew in space."""
        self._embeds_or_says_why(mesh_of(np.array([[0, 0, 0], [1, 0.2, 0.1], [0.3, 1, 0.7]]), np.array([[0, 1, 2]])))

    def test_a_single_point(self) -> None:
        """A triangle whose corners coincide."""
        self._embeds_or_says_why(mesh_of(np.ones((3, 3)), np.array([[0, 1, 2]])))

    def test_a_needle(self) -> None:
        """Corners on one line: a mesh without area."""
        self._embeds_or_says_why(mesh_of(np.outer([0, 1, 2], [1, 2, 3]), np.array([[0, 1, 2]])))

    def test_degenerate_faces(self) -> None:
        """Faces that name a vertex twice, and a face whose vertices lie on a line, among good faces."""
        mesh = box()
        middle = len(mesh.positions)
        positions = np.concatenate([mesh.positions, mesh.positions[:2].mean(axis=0, keepdims=True)])
        extra = [[0, 0, 1], [3, 3, 3], [0, middle, 1]]
        part = np.concatenate([mesh.face_part, [0, 1, 2]])
        self._embeds_or_says_why(mesh_of(positions, np.concatenate([mesh.faces, extra]), part))

    def test_duplicate_and_inverted_faces(self) -> None:
        """Every face twice, and once more with the opposite winding."""
        mesh = box()
        faces = np.concatenate([mesh.faces, mesh.faces, mesh.faces[:, ::-1]])
        self._embeds_or_says_why(mesh_of(mesh.positions, faces, np.tile(mesh.face_part, 3)))

    def test_two_components(self) -> None:
        """Two bodies apart from each other."""
        self._embeds_or_says_why(joined(body(), moved(box(), 0.5, (4.0, 0.5, 0.0))))

    def test_an_edge_of_many_faces(self) -> None:
        """Five faces at one edge, and two cones that touch at a vertex."""
        fan = [[0, 1, k] for k in range(2, 7)]
        around = np.linspace(0.0, 5.0, 5)
        fins = np.stack([np.cos(around), np.sin(around), np.full(5, 0.5)], axis=1)
        tips = [[0, 7, 8], [0, 8, 9], [0, 9, 7]]
        cone = [[1, 0, -1], [-1, 1, -1], [-1, -1, -1]]
        positions = np.concatenate([[[0, 0, 0], [0, 0, 1]], fins, cone])
        self._embeds_or_says_why(mesh_of(positions, np.array(fan + tips)))

    def test_unused_vertices(self) -> None:
        """Vertices that no face names, far away."""
        self._embeds_or_says_why(with_unused_vertices(body(), 1e6))

    def test_tiny_and_huge_units(self) -> None:
        """A body of a few micrometres, and one of thousands of kilometres."""
        for scale in (1e-6, 1e6):
            self._embeds_or_says_why(moved(body(), scale))

    def test_far_from_the_origin(self) -> None:
        """A body in the coordinates of a map projection."""
        self._embeds_or_says_why(moved(body(), 1.0, (5e5, 0.0, 5e6)))

    def test_many_parts(self) -> None:
        """Every face a part of its own, and one part that has no face."""
        mesh = box(4)
        parts = np.arange(len(mesh.faces))
        parts[-1] -= 1
        named = mesh_of(mesh.positions, mesh.faces, np.arange(len(mesh.faces))).parts
        self._embeds_or_says_why(replace(mesh, face_part=parts, parts=named))

    def test_an_open_shell(self) -> None:
        """A shell, open below; the same inside out."""
        self._embeds_or_says_why(shell())
        self._embeds_or_says_why(replace(shell(), faces=shell().faces[:, ::-1].copy()))

    def test_a_closed_sphere(self) -> None:
        """A sphere about the origin, without border or seam."""
        self._embeds_or_says_why(sphere())

    def test_planes(self) -> None:
        """A vertical plane along each axis, and a horizontal one."""
        for axis in range(3):
            positions = np.insert(_SQUARE, axis, 0.0, axis=1)
            self._embeds_or_says_why(mesh_of(positions, _TWO))

    def test_a_mesh_without_uv(self) -> None:
        """A mesh that has no texture coordinates of its own."""
        self._embeds_or_says_why(replace(body(), uv=None))

    def test_clutter(self) -> None:
        """Components, open borders, duplicates, degenerate faces and unused vertices at once."""
        self._embeds_or_says_why(clutter())

    def _embeds_or_says_why(self, mesh: Mesh) -> None:
        try:
            surface = self.embedding.embed(mesh)
        except EmbeddingError as error:
            text = str(error)
            check(
                len(text.split()) >= 3 and "\n" not in text,
                f"EmbeddingError says {text!r}; wanted one sentence: what is wrong with the mesh, and what to do.",
            )
        except Exception as error:
            raise AssertionError(
                f"it raised {type(error).__name__}: {error}; wanted a surface, or an EmbeddingError with the reason."
            ) from error
        else:
            check(isinstance(surface, Surface), f"embed gave a {type(surface).__name__}; wanted a Surface.")
