"""What files of cameras say of one picture, before it is checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Frame:
    """A picture and its camera, as a file of cameras has them.

    Attributes:
        name: of the picture, relative to the folder of pictures; it may lack the suffix.
        camera: makes the keys of `CalibratedCamera`; takes the picture's file, of which some formats need the size. It
            raises ConfigError if the camera cannot be used.
        mask: name of the mask, relative to the same folder; None if there is none.
    """

    name: str
    camera: Callable[[Path], dict[str, Any]]
    mask: str | None = None
