"""What stands on a figure stands where it belongs."""

import numpy as np
import pytest

from gcs.report.basis.drawing import LIVE, limit, line, sheet


def test_the_name_of_a_limit_is_at_its_line_on_a_logarithmic_axis():
    figure = sheet(2, ["horizontal, m", "height, m"])
    for row in (1, 2):
        line(figure, np.arange(3.0), np.ones(3), "sigma", LIVE, row)
    limit(figure, 5.0, 2)
    limit(figure, None, 1)
    figure.update_yaxes(type="log")
    (name,), (level,) = figure.layout.annotations, figure.layout.shapes
    assert (name.yref, name.xref) == (level.yref, level.xref) == ("y2", "x2 domain")
    assert 10.0**name.y == pytest.approx(level.y0) == 5.0
