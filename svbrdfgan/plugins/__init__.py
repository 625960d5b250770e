"""Renderers and UV embeddings as plugins: listed and made (`registry`), tried (`probe`) and selected (`select`)."""

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
