"""Procedural weathering layers (dirt, dust, rust, chips) from geometry alone: the ground truth that a network learns.

    layer = weather(surface, buffer, recipe_from_options("road-dirt", {"amount": 0.7, "seed": 3}))

A fixed recipe is a function of position, normal, ambient-occlusion visibility and curvature. Lengths are relative to
the model's size.
"""
