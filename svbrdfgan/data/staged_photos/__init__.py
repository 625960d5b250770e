"""Photographs of weathered vehicles by Blender's Cycles: a camera that we did not write, and a truth that we know."""
