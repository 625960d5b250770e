"""A folder of the user's that keeps what was baked of meshes, so that no further data set bakes them again."""

from __future__ import annotations

import os
from pathlib import Path

from svbrdfgan import __version__
from svbrdfgan.plugins.registry import EMBEDDINGS, find_plugin
from svbrdfgan.scene.description import Scene

VARIABLE = "SVBRDFGAN_CACHE"
"""The environment variable that names the folder; unset, there is none."""


def kept_for_user(path: Path, scene: Scene) -> Path | None:
    """Where the folder keeps a file of a data set's cache, whose name goes by the contents of the scene's mesh.

    Each version of the project and of the embedding's distribution has files of its own, so whoever changes either's
    code leaves the variable unset. Windows are not kept, since
    each close-up has another; nor meshes whose contents nobody hashed.
    """
    folder = os.environ.get(VARIABLE)
    if not folder or scene.window is not None or scene.mesh.sha256 is None:
        return None
    versions = f"svbrdfgan {__version__}, {find_plugin(EMBEDDINGS, scene.embedding.name).origin}"
    return Path(folder) / versions / path.parent.name / path.name
