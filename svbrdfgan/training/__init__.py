"""Training a generator through the renderer, and its supervised oracle."""
