"""A workpiece on whose one canvas layers are painted again and again, as fast as sliders move."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.ndimage import gaussian_filter

from svbrdfgan.asset.masks import MaskedPainter
from svbrdfgan.asset.overlay import Maps, OverlayCanvas, layer_maps
from svbrdfgan.asset.painted_texture import Model, paint_texture
from svbrdfgan.asset.painters import Paint, Painter, RecipePainter
from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.asset.surroundings import Surroundings
from svbrdfgan.errors import AssetError
from svbrdfgan.geometry.split import surface_over
from svbrdfgan.inference.learned import LearnedWeathering
from svbrdfgan.inference.weatherings import Weathering
from svbrdfgan.inference.workpiece import Workpiece
from svbrdfgan.io.eight_bit import png_bytes
from svbrdfgan.io.gltf.document import write_document
from svbrdfgan.utils.leftovers import scratch_folder
from svbrdfgan.viewer.documents import COARSE, LAYER, Superseded
from svbrdfgan.viewer.plain_document import make_plain
from svbrdfgan.weathering.edges import SharpEdges
from svbrdfgan.weathering.occlusion import ambient_visibility
from svbrdfgan.weathering.site import Site
from svbrdfgan.weathering.survey import Grounds

_FLOOR = 128  # texels along a side of the floor's shadow
_BLUR = 1.2  # of them
_WHOLE = 0.35  # of the shadow's half side: where it begins to fade
_REACH = 1.9  # half the side of the square with the shadow, in half diagonals of the model's footprint


@dataclass(frozen=True, eq=False)
class Easel:
    """A workpiece that waits to be painted.

    Attributes:
        over: the canvas, over a further UV set of the document.
    """

    workpiece: Workpiece
    over: OverlayCanvas
    _sites: RememberedSites = field(repr=False)

    @classmethod
    def of(cls, workpiece: Workpiece) -> Easel:
        """Unwraps all that weathers.

        Raises:
            AssetError: nothing weathers, or what weathers has too many charts for any texture, or xatlas is missing.
        """
        if not workpiece.weathered:
            raise AssetError(f"nothing of {workpiece.asset.path} weathers; name parts by --learnable.")
        model = Model(workpiece.mesh, workpiece.surroundings.reversed)
        over = OverlayCanvas.of(workpiece.asset, model, workpiece.weathered, COARSE)
        return cls(workpiece, over, RememberedSites(workpiece.surroundings))

    def paint(
        self, weathering: Weathering, texels: int, stale: Callable[[], bool] = lambda: False, *, draft: bool = False
    ) -> Maps:
        """The textures of a layer.

        Args:
            texels: along a side; the canvas's size is taken if that is more.
            stale: asked from time to time whether something newer is to be painted.
            draft: whether models paint the outermost surface alone.

        Raises:
            Superseded: something newer is.
            EmbeddingError: a model cannot embed the mesh.
            ConfigError: there is not enough memory for a model.
        """
        if stale():
            raise Superseded
        size = max(texels, self.over.size)
        if isinstance(weathering, LearnedWeathering):
            weathering = replace(weathering, draft=draft)
        painter = weathering.painter(self.workpiece)
        if isinstance(painter, RecipePainter) and size == self.over.size:
            painter = replace(painter, surroundings=self._sites)
        masked = MaskedPainter(_Patient(painter, stale), self.workpiece.masks)
        return layer_maps(paint_texture(self.over.canvas, masked, size, size), size, painter.maps)

    def glb(self) -> bytes:
        """The clean model as a GLB file whose primitives that weather are marked by `LAYER`."""
        document = self.over.edited.document.copy()
        for piece, verdict in enumerate(self.workpiece.verdicts):
            source = self.workpiece.asset.source(piece)
            node = document.table("nodes")[source.node]
            if piece in self.workpiece.weathered:
                primitive = document.table("meshes")[node["mesh"]]["primitives"][source.primitive]
                primitive["extras"] = {LAYER: self.over.number}
            elif verdict.kind == "ground" and not verdict.weathers and self._alone(piece):
                node.pop("mesh", None)
        make_plain(document)
        with scratch_folder() as folder:
            path = folder / "model.glb"
            write_document(path, document)
            return path.read_bytes()

    def shadow(self) -> tuple[bytes, list[float]]:
        """How open the sky is above the floor around the model: a grey PNG, and its middle and half side, metres.

        Row 0 of the picture is the floor's edge at -Z, column 0 that at -X, in the workpiece's axes.
        """
        mesh = self.workpiece.mesh
        low, high = mesh.positions[mesh.faces].min(axis=(0, 1)), mesh.positions[mesh.faces].max(axis=(0, 1))
        middle, half = (low + high) / 2.0, _REACH * float(np.linalg.norm((high - low)[[0, 2]])) / 2.0
        offset = ((np.arange(_FLOOR) + 0.5) / _FLOOR * 2.0 - 1.0) * half
        z, x = np.meshgrid(middle[2] + offset, middle[0] + offset, indexing="ij")
        points = np.stack([x.ravel(), np.full(x.size, low[1]), z.ravel()], axis=1)
        surface = surface_over(mesh, np.zeros((len(mesh.faces), 3, 2)))
        open_ = ambient_visibility(surface, points, np.tile([0.0, 1.0, 0.0], (len(points), 1)))
        grey = np.round(255.0 * _faded(open_.reshape(_FLOOR, _FLOOR))).astype(np.uint8)
        return png_bytes(np.repeat(grey[::-1, :, None], 3, axis=2)), [middle[0], low[1], middle[2], half]

    def _alone(self, piece: int) -> bool:
        """Whether a piece is all that its node shows."""
        node = self.workpiece.asset.source(piece).node
        return sum(self.workpiece.asset.source(k).node == node for k in range(len(self.workpiece.verdicts))) == 1


def _faded(open_: Float[ndarray, "rows cols"]) -> Float[ndarray, "rows cols"]:
    """The floor's openness without the grain of its few directions, and 1 at the border."""
    smooth = gaussian_filter(open_, _BLUR, mode="nearest")
    line = np.linspace(-1.0, 1.0, len(open_))
    distance = np.hypot(line[:, None], line)
    inside = np.clip((1.0 - distance) / (1.0 - _WHOLE), 0.0, 1.0)
    inside = inside * inside * (3.0 - 2.0 * inside)
    return 1.0 - inside * (1.0 - np.clip(smooth, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class RememberedSites:
    """The sites of a workpiece, kept for points that were asked for before: finding them is most of a recipe's work."""

    surroundings: Surroundings
    known: dict[object, Site] = field(default_factory=dict)

    @property
    def grounds(self) -> Grounds:
        return self.surroundings.grounds

    @property
    def edges(self) -> SharpEdges:
        return self.surroundings.edges

    def site(self, points: SurfacePoints, texel: float, *, edges: bool = True) -> Site:
        """As of `Surroundings`."""
        key = (texel, edges, len(points), hash(points.face.tobytes()), hash(points.barycentric.tobytes()))
        if key not in self.known:
            self.known[key] = self.surroundings.site(points, texel, edges=edges)
        return self.known[key]


@dataclass(frozen=True, eq=False)
class _Patient:
    """Paints as another painter does, until that is out of date."""

    painter: Painter
    stale: Callable[[], bool]

    @property
    def maps(self) -> Collection[str]:
        return self.painter.maps

    def __call__(self, points: SurfacePoints, texel: float) -> Paint:
        if self.stale():
            raise Superseded
        return self.painter(points, texel)
