"""A site is free of the model's scale and place, and finds the wheels by where they touch the ground."""

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
