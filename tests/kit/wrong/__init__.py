"""Renderers, each with one mistake that people make, and the tests of the kit that are to catch it.

Each changes what goes into a right renderer, or what comes out of it, and as a rule in pictures, gradients and
transport alike: whoever holds a texture upside down does so in all three. Importing a module enters its rows.
"""

from wrong import (  # noqa: F401
    alpha,
    contract,
    filtering,
    gradients,
    limits,
    materials,
    normal_maps,
    orientation,
    paths,
    pullbacks,
    radiometry,
    randomness,
    stored_light,
    surfaces,
)
from wrong.base import OnNumpy, Right
from wrong.table import WHOLE, WRONG, Wrong

__all__ = ["WHOLE", "WRONG", "OnNumpy", "Right", "Wrong"]
