"""Figures of bands: everything shown is seen, thin bands close up, and nothing lies over the data."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import pyplot as plt

from workbench.evidence.bands import MOST, Panel, bands, close_up, learning_curve

K = np.linspace(0.0, 1.0, 201)
ONES, BUMP = np.ones_like(K), np.maximum(1 - 10 * K, 0.0)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [
        (0 * K, K, False),  # as wide as the panel
        (0 * K, 0 * K, False),  # no band, and nothing to scale by
        (K, K + 0.01, False),  # thin all along, and never level: close up is the same picture
        (-0.01 * ONES, 0.01 + BUMP, True),  # thin but for its beginning
        (-0.01 * ONES, 0.01 + np.maximum(1 - K, 0.0), False),  # thin at the very end only
        (5 - 0.01 * ONES - 9 * BUMP, 5 + 0.01 * ONES, True),  # off zero
    ],
)
def test_a_panel_close_up_shows_a_thin_band(low, high, shown):
    ends = close_up(low, high)
    assert (ends is not None) is shown
    if ends is not None:
        thin = high - low < 0.05 * (high.max() - low.min())
        assert ends[0] < np.median(low[thin]) and np.median(high[thin]) < ends[1]
        seen = np.median((high - low)[thin]) / (ends[1] - ends[0])
        assert seen > 3 * np.median((high - low)[thin]) / (high.max() - low.min())


def panel(name="x", low=0 * K, high=1 + K, trials=3, unit="m", wanted=None):
    recorded = low + np.linspace(0.2, 0.8, max(trials, 1))[:trials, None] * (high - low)
    return Panel(name, unit, low, high, recorded, wanted)


def test_every_panel_has_its_band_its_trials_and_a_unit():
    thin = panel("force", -0.01 * ONES, 0.01 + BUMP, unit="N")
    figure = bands("law", [panel("speed", unit="km/h", wanted=K), thin, panel("share", unit="1")])
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert labels == ["speed (km/h)", "force (N)", "force (N)", "share"]
    assert [ax.get_title(loc="right") for ax in figure.axes] == ["", "", "close up", ""]
    for ax in figure.axes:
        assert len(ax.collections) == 1 and len(ax.lines) >= 3 + 2
    (legend,) = figure.legends
    assert [one.get_text() for one in legend.get_texts()] == [
        "every trial stays in here",
        "recorded trials",
        "reference",
    ]


def test_the_legend_lies_beside_the_data():
    figure = bands("law", [panel(wanted=K)])
    figure.canvas.draw()
    (box,) = [one.get_window_extent() for one in figure.legends]
    assert not any(box.overlaps(ax.get_window_extent()) for ax in figure.axes)


@pytest.mark.parametrize("trials", [0, 1, 2, MOST, MOST + 1, 500])
def test_as_many_trials_are_drawn_as_can_be_seen(trials):
    (ax,) = bands("law", [panel(trials=trials)]).axes
    assert len(ax.lines) - 2 == min(trials, MOST)


@pytest.mark.parametrize(("final", "shown"), [(None, False), (1e-20, False), (0.5, True)])
def test_what_the_bound_goes_to_is_drawn_where_it_can_be_seen(final, shown):
    bound = np.geomspace(100.0, 1.0, 30)
    (ax,) = learning_curve("law", bound, bound / 10, final=final, unit="(km/h)^2").axes
    labels = [one.get_text() for one in ax.get_legend().get_texts()]
    assert labels[:2] == ["proved bound", "recorded"] and (len(labels) == 3) is shown
    assert ax.get_ylabel() == "MSE ((km/h)²)" and ax.get_yscale() == "log"
