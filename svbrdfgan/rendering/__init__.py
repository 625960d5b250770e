"""Layers to pictures and back: compositing, checked renderers, the render layer, stored light transport."""
