"""Figures of the responses: every curve is the data that was given, in dB or degrees."""

from __future__ import annotations

import numpy as np
from plants.report_values import lines_of, pair

from elastid.report.figures.fit import quality_figure
from elastid.response import Levels, Quality

RESPONSE = pair(2, 4)[0]
N = len(RESPONSE.freq_hz)


def db(values):
    return 20 * np.log10(values)


def made_up():
    """Two inputs, four outputs; two even and three odd detection lines."""
    rng = np.random.default_rng(0)

    def level(n):
        return Levels(np.arange(3.0, 3.0 + n), 2 + rng.random((n, 4)), rng.random((n, 4)))

    return Quality(
        coherence=rng.random((N, 4, 2)),
        multiple_coherence=0.5 + 0.5 * rng.random((N, 4)),
        singular_values=rng.random((N, 2)),
        input_singular_values=np.tile([3.0, 2.0], (N, 1)),
        input_noise=rng.random((N, 2)),
        output_noise=rng.random((N, 4)),
        excited=level(N),
        stochastic=rng.random((N, 4)),
        even=level(2),
        odd=level(3),
    )


def test_the_levels_of_every_output_are_drawn_and_noise_is_taken_off_the_detection_lines():
    """In power, at the detection lines' own frequencies; a spare panel is empty."""
    quality = made_up()
    panels = quality_figure(RESPONSE, quality, "c1").axes
    assert [axes.axison for axes in panels] == [True] * 7 + [False] * 2
    for i, axes in enumerate(panels[:4]):
        drawn = lines_of(axes)
        np.testing.assert_allclose(drawn["excited lines"].get_ydata(), db(quality.excited.amplitude[:, i]))
        np.testing.assert_allclose(drawn["noise"].get_ydata(), db(quality.excited.noise[:, i]))
        np.testing.assert_allclose(drawn["stochastic nonlinear"].get_ydata(), db(quality.stochastic[:, i]))
        for name, found in (("even", quality.even), ("odd", quality.odd)):
            level = np.sqrt(found.amplitude[:, i] ** 2 - found.noise[:, i] ** 2)
            np.testing.assert_allclose(drawn[f"nonlinear, {name}"].get_ydata(), db(level))
            np.testing.assert_allclose(drawn[f"nonlinear, {name}"].get_xdata(), found.freq_hz)


def test_the_last_panels_show_the_unexplained_share_and_singular_values():
    """One curve an output, two singular values of G and of the inputs, their condition in the title."""
    quality = made_up()
    lost, gains, inputs = quality_figure(RESPONSE, quality, "c1").axes[4:7]
    shown = [line.get_ydata() for line in lost.get_lines()]
    np.testing.assert_allclose(shown, 1 - quality.multiple_coherence.T)
    np.testing.assert_allclose([line.get_ydata() for line in gains.get_lines()], db(quality.singular_values.T))
    np.testing.assert_allclose([line.get_ydata() for line in inputs.get_lines()], db(quality.input_singular_values.T))
    assert inputs.get_title().endswith("condition 1.5")
