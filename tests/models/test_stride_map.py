"""Modes of maps that are known: linear ones, one that jumps, and one that is chaotic."""

import numpy as np
import pytest

from glassgait.models.stride_map import (
    averaged_jacobians,
    growth,
    jackknife_error,
    jacobians,
    modes_of,
    newton,
)

# A slow oscillation, two real modes, and a shear that makes left and right vectors differ.
CORE = np.array([[0.3, -0.6, 0, 0], [0.6, 0.3, 0, 0], [0, 0, 0.5, 0], [0, 0, 0, -0.1]])
SHEAR = np.eye(4) + np.triu(np.full((4, 4), 0.7), 1)
LINEAR = SHEAR @ CORE @ np.linalg.inv(SHEAR)
EIGENVALUES = {0.3 + 0.6j, 0.3 - 0.6j, 0.5, -0.1}


def linear(points, problems):
    """Maps points linearly; that of the second problem is half as long."""
    return (points @ LINEAR.T) * np.where(problems == 1, 0.5, 1.0)[:, None]


def test_eigenvalues_of_a_linear_map_come_out_for_every_problem():
    first, second = jacobians(linear, np.array([[1.0, 2, 3, 4], [0, 0, 0, 0]]), 1e-2)
    assert first == pytest.approx(LINEAR, abs=1e-12)
    assert second == pytest.approx(0.5 * LINEAR, abs=1e-12)
    modes = modes_of(first)
    assert modes.radius == pytest.approx(np.hypot(0.3, 0.6))
    assert all(min(abs(modes.eigenvalues - value)) < 1e-9 for value in EIGENVALUES)
    assert (np.diff(np.abs(modes.eigenvalues)) <= 1e-12).all()


def test_a_stride_multiplies_the_slowest_modes_amplitude_by_its_eigenvalue(generator):
    modes = modes_of(LINEAR)
    point = generator.normal(size=4)
    before, after = modes.left @ point, modes.left @ (LINEAR @ point)
    assert after == pytest.approx(modes.eigenvalues[0] * before)
    assert modes.eigenvalues[0] * modes.right == pytest.approx(LINEAR @ modes.right)


def test_participation_is_of_shares_that_no_change_of_units_changes():
    units = np.diag([1.0, 100.0, 0.01, 7.0])
    plain, scaled = modes_of(LINEAR), modes_of(np.linalg.inv(units) @ LINEAR @ units)
    assert plain.participation.sum() == pytest.approx(1.0)
    assert scaled.participation == pytest.approx(plain.participation)
    (alone,) = [modes_of(np.diag([0.1, 0.9, 0.2])).participation]
    assert alone == pytest.approx([0, 1, 0])


def test_where_a_row_has_no_image_the_column_is_unknown():
    def ends(points, problems):
        return np.where(points[:, :1] > 0.5, np.nan, points)

    (own,) = jacobians(ends, np.zeros((1, 2)), 1.0)
    assert np.isnan(own[:, 0]).all() and own[:, 1] == pytest.approx([0, 1])
    with pytest.raises(ValueError, match="infs or NaNs"):
        modes_of(own)


def test_newton_finds_fixed_points_that_repel():
    def repels(points, problems):
        return points + 0.8 * np.sin(points) + problems[:, None]

    start = np.array([[0.3, -0.2], [4.0, 4.0]])
    found, residuals = newton(repels, start, size=1e-4, tolerance=1e-10, n_iterations=12, reach=0.5)
    assert found[0] == pytest.approx([0, 0], abs=1e-9) and residuals[0] < 1e-10
    # 0.8 sin x = -1 has no solution: the best that was met comes back, as what it is.
    assert residuals[1] > 0.1


def test_newton_leaves_a_point_without_an_image_as_it_is():
    found, residuals = newton(
        lambda x, i: np.full_like(x, np.nan),
        np.ones((1, 3)),
        size=1e-3,
        tolerance=1e-9,
        n_iterations=3,
        reach=1.0,
    )
    assert found.tolist() == [[1, 1, 1]] and residuals.tolist() == [np.inf]


def test_growth_about_a_fixed_point_is_the_spectral_radius():
    options = {"size": 1e-6, "n_strides": 400, "n_left_out": 40}
    rates = growth(linear, np.zeros((2, 4)), **options)
    assert rates == pytest.approx([np.hypot(0.3, 0.6), 0.5 * np.hypot(0.3, 0.6)], rel=0.01)


def test_growth_along_a_chaotic_orbit_is_that_of_its_lyapunov_exponent():
    def logistic(points, problems):
        return 4.0 * points * (1.0 - points)

    # The exponent of the logistic map at 4 is the logarithm of 2.
    (rate,) = growth(logistic, np.array([[0.3123]]), size=1e-9, n_strides=4000, n_left_out=10)
    assert rate == pytest.approx(2.0, rel=0.03)


def test_growth_of_an_orbit_that_ends_is_not_known():
    rates = growth(
        lambda x, i: np.full_like(x, np.nan), np.ones((1, 2)), size=1e-3, n_strides=3, n_left_out=1
    )
    assert np.isnan(rates).all()


def test_the_averaged_jacobian_of_a_linear_map_is_exact(generator):
    points = np.ones((2, 4))
    whole, parts = averaged_jacobians(linear, points, size=0.3, n_pairs=40, generator=generator)
    assert whole == pytest.approx(np.array([LINEAR, 0.5 * LINEAR]), abs=1e-10)
    radii = np.abs(np.linalg.eigvals(parts)).max(axis=-1)
    assert jackknife_error(radii) == pytest.approx([0, 0], abs=1e-9)


def test_the_averaged_jacobian_sees_through_steps_that_derivatives_do_not(generator):
    def stairs(points, problems):
        return 0.6 * np.round(points, 1)

    points = np.full((1, 2), 0.02)
    assert (jacobians(stairs, points, 1e-4) == 0.0).all()
    (whole,), parts = averaged_jacobians(stairs, points, size=0.5, n_pairs=400, generator=generator)
    error = jackknife_error(parts.reshape(1, len(parts[0]), -1)[..., 0])
    assert abs(whole[0, 0] - 0.6) < 4 * error < 0.1
