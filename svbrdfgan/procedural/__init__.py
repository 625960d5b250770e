"""Procedural vehicles, skies and rooms: each is generated from a seed, so no download is needed."""
