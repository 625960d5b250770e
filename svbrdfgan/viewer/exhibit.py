"""What a page shows, as documents that it asks for by path: live from a server, or stored in the page itself."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from svbrdfgan.viewer.documents import BYTES, COARSE, GLB, LAYER, MOST_SEEDS, PNG, Document, Unknown

if TYPE_CHECKING:
    from svbrdfgan.asset.overlay import Maps
    from svbrdfgan.viewer.choices import Choice
    from svbrdfgan.viewer.easel import Easel
    from svbrdfgan.viewer.lights import Light

_QUALITY = 88


@dataclass(frozen=True, eq=False)
class Piece:
    """One model that is shown: what it is called, where it stands, and with what it can be painted."""

    name: str
    open: Callable[[], Easel]
    choices: Sequence[Choice]

    @cached_property
    def easel(self) -> Easel:
        return self.open()


@dataclass(frozen=True, eq=False)
class Exhibit:
    """Models, lights, and the layers that are painted on demand.

    Attributes:
        fine: texels along a side of layers that are not repainted while a slider moves.
        baked: seeds and amounts of a page without a server; None if there is one.
    """

    title: str
    pieces: Sequence[Piece]
    lights: Sequence[Light]
    fine: int
    baked: tuple[Sequence[int], Sequence[float]] | None = None
    _painting: Lock = field(default_factory=Lock, repr=False)

    def document(self, path: str, stale: Callable[[], bool] = lambda: False) -> Document:
        """The document of a path.

        Args:
            stale: as for `Easel.paint`.

        Raises:
            Unknown: there is none.
            Superseded: something newer is to be painted.
            SvbrdfganError: what is asked for cannot be painted.
        """
        kind, *words = path.strip("/").split("/")
        try:
            numbers = [int(word) for word in words]
            match kind, numbers:
                case "state", []:
                    return Document.of(self._state())
                case "model", [number]:
                    return Document(GLB, self._piece(number).easel.glb())
                case "stand", [number]:
                    return Document.of(_stand(self._piece(number).easel))
                case "light", [number] if 0 <= number < len(self.lights):
                    return Document(BYTES, self.lights[number].half_floats())
                case "layer", [number, choice, seed, percent, texels]:
                    return self._layer(self._piece(number), choice, seed, percent, texels, stale)
        except ValueError:
            pass
        raise Unknown(path)

    def paths(self) -> Iterator[str]:
        """The paths of all documents of a page without a server."""
        assert self.baked is not None
        yield "/state"
        yield from (f"/light/{number}" for number in range(len(self.lights)))
        for number, piece in enumerate(self.pieces):
            yield from (f"/model/{number}", f"/stand/{number}")
            for index, choice in enumerate(piece.choices):
                seeds, amounts = self.baked if choice.seeds else ((0,), self.baked[1])
                for seed in seeds:
                    for amount in amounts if choice.amounts else (1.0,):
                        yield f"/layer/{number}/{index}/{seed}/{round(100 * amount)}/{self.fine}"

    def _piece(self, number: int) -> Piece:
        if not 0 <= number < len(self.pieces):
            raise Unknown(f"model {number}")
        return self.pieces[number]

    def _state(self) -> object:
        pieces = [
            {"name": piece.name, "choices": [choice.description() for choice in piece.choices]} for piece in self.pieces
        ]
        lights = [{"name": light.name, "floor": light.floor} for light in self.lights]
        size = {"rows": len(self.lights[0].values), "cols": self.lights[0].values.shape[1]}
        baked = None
        if self.baked is not None:
            baked = {"seeds": list(self.baked[0]), "amounts": [round(100 * amount) for amount in self.baked[1]]}
        texels = {"coarse": COARSE, "fine": self.fine}
        return {
            "title": self.title,
            "pieces": pieces,
            "lights": lights,
            "light_size": size,
            "baked": baked,
            "texels": texels,
            "most_seeds": MOST_SEEDS,
            "mark": LAYER,
        }

    def _layer(
        self, piece: Piece, choice: int, seed: int, percent: int, texels: int, stale: Callable[[], bool]
    ) -> Document:
        known = 0 <= choice < len(piece.choices) and 0 <= seed < MOST_SEEDS and 0 <= percent <= 100
        if not known or texels not in (COARSE, self.fine):
            raise Unknown("layer")
        with self._painting:
            weathering = piece.choices[choice].make(seed, percent / 100.0)
            maps = piece.easel.paint(weathering, texels, stale, draft=texels < self.fine)
        return Document.of(_pictures(maps))


def _stand(easel: Easel) -> object:
    picture, place = easel.shadow()
    mesh = easel.workpiece.mesh
    corners = mesh.positions[mesh.faces]
    return {
        "turn": easel.workpiece.orientation.matrix().tolist(),
        "low": corners.min(axis=(0, 1)).tolist(),
        "high": corners.max(axis=(0, 1)).tolist(),
        "shadow": f"data:{PNG};base64,{b64encode(picture).decode()}",
        "place": place,
    }


def _pictures(maps: Maps) -> object:
    """The maps as WebP, and the texels along a side. Relief is stored without loss: its errors would glitter."""
    found: dict[str, object] = {}
    for name, values in maps.items():
        stream = BytesIO()
        options = {"lossless": True, "quality": 0} if name == "normal" else {"quality": _QUALITY}
        Image.fromarray(np.ascontiguousarray(values[::-1])).save(stream, "WEBP", method=0, **options)
        found[name] = f"data:image/webp;base64,{b64encode(stream.getvalue()).decode()}"
    return {"maps": found, "texels": len(maps["base_color"])}
