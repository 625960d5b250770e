"""Renderers and UV embeddings as plugins: listed and made (`registry`), tried (`probe`) and selected (`select`)."""
