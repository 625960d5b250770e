"""A site is free of the model's scale and place, and finds the wheels by where they touch the ground."""

from dataclasses import replace

import numpy as np
import pytest

from svbrdfgan.weathering.survey import find_axles, survey


def test_height_runs_from_ground_to_roof_and_position_is_in_lengths(shapes):
    surface = shapes.make_vehicle(3.0)
    points = 3.0 * np.array([[0.0, 0.0, 2.0], [0.8, 1.5, -2.0]])
    site = survey(surface, points, np.array([[0.0, 1.0, 0.0]] * 2))
    assert np.allclose(site.height, [0.0, 1.0])
    assert np.allclose(site.position, [[0.0, 0.0, 0.5], [0.2, 0.375, -0.5]])


def test_axles_are_where_the_wheels_stand(vehicle):
    site = survey(vehicle, np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0]]))
    assert np.allclose(sorted(site.axles), [-1.3 / 4.0, 1.2 / 4.0], atol=0.01)


@pytest.mark.parametrize("contact", [np.linspace(-0.5, 0.5, 400), np.linspace(-0.05, 0.05, 50), np.zeros(0)])
def test_what_does_not_stand_on_wheels_gets_the_usual_axles(contact):
    cloud = np.column_stack([np.zeros_like(contact), np.zeros_like(contact), contact])
    assert find_axles(cloud) == (-0.3, 0.3)


def test_a_flat_sheet_has_a_site(shapes):
    site = survey(shapes.flat(shapes.floor()), np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0]]))
    assert all(value.isfinite().all() for value in (site.position, site.height, site.visibility, site.curvature))


@pytest.mark.parametrize(("length", "metres"), [(4.2, 4.2), (12.0, 12.0), (420.0, 4.5), (0.1, 4.5)])
def test_a_model_of_a_vehicle_s_length_is_in_metres_and_any_other_is_a_car(vehicle, length, metres):
    scaled = replace(vehicle, positions=vehicle.positions * (length / 4.0))
    top, normal = np.array([[0.0, 1.5, 0.0]]) * (length / 4.0), np.array([[0.0, 1.0, 0.0]])
    site = survey(scaled, top, normal, texel=0.01 * length / 4.0)
    assert np.isclose(site.length, metres)
    assert np.isclose(site.tall, 1.5 * metres / 4.0)
    assert np.isclose(site.texel * site.length, 0.01 * metres / 4.0)


def test_distances_to_edges_are_in_metres(vehicle):
    """The body's flank at x = 0.8 ends at y = 1; the model is in centimetres, so it is taken for a car of 4.5 m."""
    large = replace(vehicle, positions=vehicle.positions * 100.0)
    site = survey(large, np.array([[80.0, 95.0, 150.0]]), np.array([[1.0, 0.0, 0.0]]))
    assert np.isclose(site.length, 4.5)
    assert np.isclose(float(site.convex[0]), 0.05 * 4.5 / 4.0)
