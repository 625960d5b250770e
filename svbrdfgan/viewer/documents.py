"""What a viewer's page asks for by path, and what all modules of the viewer agree on."""

from __future__ import annotations

import json
from dataclasses import dataclass

JSON, GLB, PNG, BYTES = "application/json", "model/gltf-binary", "image/png", "application/octet-stream"

COARSE = 512
"""Texels along a side at which a layer is repainted while a slider moves."""
MOST_SEEDS = 100
"""Patterns that can be chosen of each way to weather."""
LAYER = "svbrdfgan_layer"
"""The key in a primitive's `extras` that marks it as one that carries the layer, with the number of its UV set."""


@dataclass(frozen=True)
class Document:
    """One answer: a MIME type and the bytes."""

    kind: str
    data: bytes

    @classmethod
    def of(cls, content: object) -> Document:
        """The content as JSON."""
        return cls(JSON, json.dumps(content).encode())


class Unknown(Exception):  # noqa: N818
    """There is no document of that path."""


class Superseded(Exception):  # noqa: N818
    """Something newer is to be painted."""
