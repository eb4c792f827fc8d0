"""``python -m bench papers`` with small counts: every row, every picture, figures that make sense."""

import json
import re
from importlib.util import find_spec

import numpy as np
import pytest

pytest.importorskip("pywt")
image = pytest.importorskip("matplotlib.image")

from bench.papers import papers  # noqa: E402
from bench.papers.counts import Counts  # noqa: E402
from bench.papers.m1 import convergence, simulations  # noqa: E402
from bench.papers.show import lines_m2  # noqa: E402
from bench.papers.show.report import Drawn, Grid, Line, terminal, write  # noqa: E402
from filters.correction import train  # noqa: E402
from gcs.contract.messages import InputError  # noqa: E402

pytestmark = [
    pytest.mark.torch,
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("torch") is None, reason="needs torch"),
]

FEW = Counts(
    runs=4, lessons=75, tuning=1, trainings=1, theodolites=1, flights=5, unseen=1, winds=4, records=1,
    joined=1, points=1500,
)  # fmt: skip


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    out = tmp_path_factory.mktemp("papers")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulations, "PLAN", train.Plan(population=4, generations=3, epochs=1))
        return out, papers.run(out, out / "nothing recorded here", FEW)


def test_every_row_is_in_the_table_the_page_and_the_file(found):
    out, said = found
    assert {line["row"] for line in said["lines"]} == set(range(1, 11))
    assert json.loads((out / "papers.json").read_text())["lines"] == said["lines"]
    page = (out / "report.html").read_text()
    assert {int(row) for row in re.findall(r"<tr><td>(\d+)</td>", page)} >= set(range(1, 11))
    assert "the recording is not here" in page


def test_every_picture_is_in_the_page_and_shows_something(found):
    out, _ = found
    named = set(re.findall(r'src="([^"]+)"', (out / "report.html").read_text()))
    assert named == {path.name for path in out.glob("*.png")}
    assert len(named) == 9
    for name in named:
        pixels = image.imread(out / name)[:, :, :3]
        coloured = np.ptp(pixels, axis=2) > 0.2
        assert 0.001 < coloured.mean() < 0.3, name


def test_figures_are_in_the_order_the_papers_report(found):
    m1, m2, m3 = (found[1][name] for name in ("m1", "m2", "m3"))
    simulations = m1["simulations"]
    assert simulations["ga-bp-ukf"]["mae_m"] < simulations["bp-ekf"]["mae_m"]
    assert simulations["ga-bp-ukf"]["rise"] < 1.2 < simulations["classic ukf, tuned"]["rise"]
    assert 0.1 < m1["network"]["inference_us"] < 1000.0
    assert m2["navigation"][1] < m2["navigation"][0] / 2
    assert m3["alone"][0]["scores"]["linear-adaptive"]["in_runs"] > 0.856
    assert m3["joined"][0]["either"][2] > 0.99


def test_roulettes_never_lose_their_best_and_the_improved_keeps_diversity():
    rng = np.random.default_rng(0)
    u = rng.normal(size=(400, 9))
    found = convergence.converge(u, 0.5 * u, train.Plan(generations=30), 3)
    for one in found.values():
        assert (np.diff(one.best) <= 0.0).all()
        assert one.best[-1] < one.best[0]
        assert (one.best <= one.mean).all()
        assert one.diversity[0] == 1.0
    assert found["improved"].diversity[-1] > found["classic"].diversity[-1]


def test_a_miss_is_told_as_one():
    steady, lost = [1.0, 1.05], [1.0, 4.0]
    wind = {name: [steady, steady] for name in ("kalman", "sage-husa", "arf")}
    met = {"wind": wind, "navigation": (8.0, 3.0), "recorded": None}
    assert [line.met for line in lines_m2.lines(met)] == [True, True, True, None]
    missed = met | {"wind": wind | {"arf": [steady, lost]}, "navigation": (8.0, 4.1)}
    line, _, navigation, _ = lines_m2.lines(missed)
    assert not line.met
    assert "In 1 of 2 winds" in line.note
    assert not navigation.met


def test_a_folder_that_cannot_be_is_refused_before_anything_is_measured(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="name a folder that can be written"):
        papers.run(tmp_path / "file" / "out")


def test_text_cannot_break_the_page(tmp_path):
    from bench.papers.show.picture import panels

    line = Line(1, "a < b", "", "<i>", "", "", False, "c & d")
    drawn, grid = Drawn("one", panels(1)[0], 'g "h"'), Grid("i", ("j",), [("<k>",)])
    text = write(tmp_path, "e < f", [line], [drawn], [grid]).read_text()
    for shown in ("a &lt; b", "&lt;i&gt;", "c &amp; d", "e &lt; f", "g &quot;h&quot;", "&lt;k&gt;", ">NO<"):
        assert shown in text
    assert terminal([line]).row_count == 1
