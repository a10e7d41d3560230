"""Curves and tunnels of a line against plain loops, and what a line refuses."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from models.line import Line, pieces
from models.metro_line import PATENT_LINE, MetroLine
from models.quantity import InvalidValue
from models.station_runs import Shuttle, StationRun, Trapezoid


def overlap(a, b, c, d):
    return max(0.0, min(b, d) - max(a, c))


@pytest.mark.parametrize("front", [0.0, 299.0, 300.0, 350.0, 420.0, 610.0, 640.0, 800.0, 1000.0, 1200.0, 1260.0])
@pytest.mark.parametrize("length", [1.0, 100.0, 300.0])
def test_mean_curvature_adds_up_the_curves_under_the_train(front, length):
    expected = sum(
        overlap(front - length, front, a, b) / length / r
        for a, b, r in zip(PATENT_LINE.curve_starts_m, PATENT_LINE.curve_ends_m, PATENT_LINE.curve_radii_m, strict=True)
    )
    assert float(ca.DM(PATENT_LINE.mean_curvature(ca.DM(front), length))) == pytest.approx(expected, abs=1e-15)


def test_points_on_curves_and_in_tunnels():
    line = Line(
        curve_starts_m=(10, 20), curve_ends_m=(20, 30), curve_radii_m=(2, 4), tunnel_starts_m=(5,), tunnel_ends_m=(7,)
    )
    assert [float(ca.DM(line.curvature(ca.DM(s)))) for s in (9, 10, 19, 20, 29, 30)] == [0, 0.5, 0.5, 0.25, 0.25, 0]
    assert [float(ca.DM(line.tunnel(ca.DM(s)))) for s in (4.9, 5, 6.9, 7)] == [0, 1, 1, 0]
    assert pieces((), (), ()) == ((), (0.0,))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"curve_starts_m": (0, 50), "curve_ends_m": (60, 90), "curve_radii_m": (9, 9)}, "curves must follow one ano"),
        ({"curve_starts_m": (0,), "curve_ends_m": (60,), "curve_radii_m": (0,)}, "curve_radii_m must be above 0 m"),
        ({"curve_starts_m": (0,), "curve_ends_m": (60,), "curve_radii_m": (-5,)}, "curve_radii_m must be above 0 m"),
        ({"curve_starts_m": (0,), "curve_ends_m": (60,)}, "curve_radii_m must have one entry a curve"),
        ({"curve_starts_m": (0,)}, "curve_ends_m must have one entry"),
        ({"tunnel_starts_m": (9,), "tunnel_ends_m": (9,)}, "tunnel_ends_m must lie beyond"),
        ({"length": 0}, "length must lie in"),
    ],
)
def test_lines_that_cannot_be_are_refused(fields, message):
    with pytest.raises(InvalidValue, match=message):
        Line(**fields)


def test_a_train_longer_than_its_line_is_refused():
    with pytest.raises(InvalidValue, match="length must be at most that of the line, 1500 m, got 1600"):
        MetroLine(length=1600.0)


def test_derivatives_of_the_metro_line_are_finite_at_rest():
    plant = MetroLine()
    for by in ("x", "u"):
        for s in (0.0, 600.0, 1000.0):
            assert np.isfinite(plant.derivative(by)([s, 0.0], 0.0, [], 0).full()).all()


def test_the_shuttle_has_the_published_period_and_distance():
    from models.point_mass import PointMass

    plant = PointMass(sampling_time=0.01)
    x, v = Shuttle().samples(plant)
    assert Shuttle().period == pytest.approx(178.0, abs=1e-12)
    assert x.size == 17801 and x.max() == pytest.approx(1580.0, abs=1e-9) and v.max() == pytest.approx(30.0)
    np.testing.assert_allclose(x[1:], np.cumsum((v[1:] + v[:-1]) / 2 * 0.01), atol=1e-4)
    np.testing.assert_allclose(x[8600:8900], 1580.0, atol=1e-9)
    np.testing.assert_allclose(x[17500:], 0.0, atol=1e-8)
    np.testing.assert_allclose(v[:8901] + v[8900:], 0.0, atol=1e-9)


def test_the_station_run_is_the_moving_average_of_a_trapezoid():
    s, v = StationRun().samples(MetroLine())
    assert s.size == 1041 and s[-1] == pytest.approx(1500.0, abs=1e-9)
    fine = np.arange(0, 104, 0.001)
    a = np.where(fine < 25, 0.8, 0) - np.where((fine >= 75) & (fine < 100), 0.8, 0)
    smooth = np.convolve(a, np.full(2000, 1 / 2000))[: fine.size]
    np.testing.assert_allclose(v[:-1], np.cumsum(np.append(0, smooth[:-1]))[::100] * 0.001, atol=2e-3)
    np.testing.assert_allclose(s[1:], np.cumsum((v[1:] + v[:-1]) / 2) * 0.1, atol=2e-3)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Shuttle().samples(MetroLine(sampling_time=0.03)), "the period must be a multiple of the sampling"),
        (lambda: StationRun().samples(MetroLine(sampling_time=0.3)), "the running time must be a multiple of the samp"),
        (lambda: Shuttle(speed=60.0), "speed must be reached within the distance of 1580 m"),
        (lambda: StationRun(distance=100.0), "speed must be reached within the distance"),
        (lambda: Trapezoid(distance=10, speed=1, acceleration=0), "acceleration must lie in"),
    ],
)
def test_references_that_cannot_be_are_refused(make, message):
    with pytest.raises(InvalidValue, match=message):
        make()
