"""Renderers and UV embeddings by entry point: found (`registry`), tried (`probe`) and chosen (`select`)."""

from svbrdfgan.plugins.registry import (
    EMBEDDINGS,
    RENDERERS,
    MissingDependencyError,
    Plugin,
    find_plugin,
    import_factory,
    list_plugins,
    load_embedding,
    load_renderer,
    make,
)

__all__ = [
    "EMBEDDINGS",
    "RENDERERS",
    "MissingDependencyError",
    "Plugin",
    "find_plugin",
    "import_factory",
    "list_plugins",
    "load_embedding",
    "load_renderer",
    "make",
]
