"""Measures of how much of G0 was recovered: errors on textures where the truth is known, and on pictures."""
