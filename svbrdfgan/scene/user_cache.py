"""The user's cache: what was baked of meshes for one data set, so that no other bakes them again."""

from __future__ import annotations

import os
from pathlib import Path

from svbrdfgan import __version__
from svbrdfgan.plugins.registry import EMBEDDINGS, find_plugin
from svbrdfgan.scene.description import Scene

VARIABLE = "SVBRDFGAN_CACHE"
"""The environment variable that names the folder of the user's cache. Without it there is none."""


def in_user_cache(path: Path, scene: Scene) -> Path | None:
    """The counterpart of a file that a data set's cache keeps of the scene's mesh; None if it has none.

    Windows have none, since each close-up has another, nor have meshes whose contents nobody hashed. Files of other
    versions of the project or of the embedding's distribution are told apart; changes of code within a version are
    not.

    Args:
        path: with the folder and the name that it has in every data set, which go by the mesh's contents.
    """
    folder = os.environ.get(VARIABLE)
    if not folder or scene.window is not None or scene.mesh.sha256 is None:
        return None
    versions = f"svbrdfgan {__version__}, {find_plugin(EMBEDDINGS, scene.embedding.name).origin}"
    return Path(folder) / versions / path.parent.name / path.name
