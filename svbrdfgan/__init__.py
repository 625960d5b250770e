"""svbrdfgan learns how surfaces weather, from pictures, through a differentiable renderer."""

__version__ = "0.1.0"
