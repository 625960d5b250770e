"""Procedural weathering layers (dirt, dust, rust, chips, grime) from geometry: the ground truth that a network learns.

    layer = weather(surface, buffer, recipe_from_options("road-dirt", {"amount": 0.7, "seed": 3}))

A fixed recipe is a function of position, normal, ambient-occlusion visibility, curvature, distance to sharp edges and
substance, in metres.
"""
