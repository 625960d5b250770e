"""Applies a trained generator to a new mesh, and exports the weathered mesh."""
