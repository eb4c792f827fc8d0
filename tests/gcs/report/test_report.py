"""The page of a run: complete, well-formed, safe, and quiet."""

import importlib.util
import json
import re
from collections import Counter
from html.parser import HTMLParser

import numpy as np
import pytest

from gcs.report import certainty, flight, report
from gcs.report.basis import page
from gcs.report.basis import run as runs
from gcs.report.trust import Tolerance
from tests.web import browser

VOID = ("meta", "link", "br")
PAPER_PX = 680.4, 1009.1  # A4 less 15 mm on each side, at 96 px an inch
MISSING = [
    name
    for name, found in (
        ("chromium", browser.Path(browser.CHROMIUM).exists()),
        ("playwright", importlib.util.find_spec("playwright")),
    )
    if not found
]


class PageReader(HTMLParser):
    """Every element opened and closed in order; collects ids, links, addresses and figures."""

    def __init__(self, html: str):
        super().__init__()
        self.open: list[str] = []
        self.ids, self.links, self.addresses, self.figures = [], [], [], []
        self._json = False
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attributes):
        told = dict(attributes)
        self.ids += [told["id"]] if "id" in told else []
        self.links += [told["href"]] if tag == "a" else []
        self.addresses += [told[name] for name in ("src", "href") if name in told and tag != "a"]
        self._json = told.get("type") == "application/json"
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self._json and data.strip():
            self.figures.append(json.loads(data))


@pytest.fixture
def html(run):
    return page.render(report.document(run, Tolerance(3.0, 2.0)))


def test_the_page_is_well_formed_and_every_link_leads_somewhere(html):
    read = PageReader(html)
    assert read.open == []
    assert {name: n for name, n in Counter(read.ids).items() if n > 1} == {}
    assert {link for link in read.links if link.removeprefix("#") not in read.ids} == set()
    assert read.addresses == ["data:,"]
    assert len(read.figures) == html.count("data-figure=")
    assert len(html) < 15e6


def test_texts_of_files_cannot_become_part_of_the_page(html):
    assert "<i>silent</i>" not in html
    assert "&lt;i&gt;silent" in html
    assert "<b>theo</b>" not in html


def test_a_figure_holds_the_extremes(run):
    """The isolated outlier of 9 sigma and the patch of 20 stand at the edge."""
    figures = [
        p.figure
        for c in report.document(run, Tolerance()).chapters
        for p in c.parts
        if isinstance(p, page.Diagram)
    ]
    names = {trace.name for figure in figures for trace in figure.data}
    assert {"isolated", "patch", "best estimate", "live", "protection level, live"} <= names
    isolated = next(trace for figure in figures for trace in figure.data if trace.name == "isolated")
    assert isolated.y.tolist() == [8.0]
    assert "+9.0 sigma" in isolated.text[0]


def test_every_figure_over_time_has_the_flight_s_time(run):
    for part in (p for c in report.document(run, Tolerance()).chapters for p in c.parts):
        if isinstance(part, page.Diagram) and part.figure.layout.meta.get("time"):
            assert part.figure.layout.xaxis.range == (0.0, 10.0), part.title


def test_a_killed_run_gives_a_page_that_says_so(written):
    for name in ("summary.json", "events.csv", "errors.csv"):
        (written / name).unlink()
    html = page.render(report.document(runs.load(written), Tolerance(3.0)))
    assert "the run did not end" in html
    assert "Open: the run did not end" in html
    assert PageReader(html).open == []


def test_what_each_sensor_carries_is_drawn_beside_the_protection_level(run):
    figure = certainty.without_each(run).figure
    lines = {(trace.name, trace.yaxis): np.unique(trace.y[np.isfinite(trace.y)]) for trace in figure.data}
    expected = {
        ("protection level, live", "y"): 5.0,
        ("protection level, live", "y2"): 6.0,
        ("without theo-a", "y"): 2.0,
        ("without theo-a", "y2"): 1.0,
        ("without ins", "y"): certainty.LEAST_M,  # nothing, on a logarithmic axis
        ("without ins", "y2"): certainty.LEAST_M,
    }
    assert {at: y.tolist() for at, y in lines.items()} == {
        at: pytest.approx([metres]) for at, metres in expected.items()
    }
    for trace in figure.data[1:3]:
        assert np.isnan(trace.y).sum() == 1  # at the pause
    assert "Leave-one-sensor-out separation" in page.render(report.document(run, Tolerance()))


def test_a_run_of_before_or_of_another_method_has_no_such_figure(written):
    header, *_ = (written / "separation.csv").read_text().splitlines()
    (written / "separation.csv").write_text(header + "\n")
    assert certainty.without_each(runs.load(written)) is None
    (written / "separation.csv").unlink()
    run = runs.load(written)
    assert not any("separation" in line for line in run.remarks)
    assert "Leave-one-sensor-out" not in page.render(report.document(run, Tolerance()))


@pytest.mark.slow
def test_a_long_flight_makes_no_large_page(run):
    """1,000 times the flight, one after the other: 100,000 values and as many states."""
    by_sensor = {name: repeated(values) for name, values in run.by_sensor.items()}
    long = run._replace(track=repeated(run.track), smoothed=repeated(run.smoothed), by_sensor=by_sensor)
    short, html = (len(page.render(report.document(one, Tolerance()))) for one in (run, long))
    assert html - short < 1e6


def repeated(rows: np.ndarray) -> np.ndarray:
    """A thousand times, each 10.1 s after the one before."""
    many = np.tile(rows, 1_000)
    many["t_ns"] += np.repeat(np.arange(1_000), len(rows)) * 10_100_000_000
    return many


def test_lines_of_a_slow_log_break_at_its_pauses_only(run):
    steps = np.where(np.arange(len(run.smoothed)) % 4 == 3, 1_400_000_000, 360_000_000)
    run.smoothed["t_ns"] = run.start_ns + np.cumsum(steps)
    run.smoothed["t_ns"][50:] += 10_000_000_000
    told = next(trace for trace in flight.motion(run).figure.data if trace.name == "best estimate")
    assert np.isnan(told.y).sum() == 1


def test_a_logarithmic_axis_has_marks_inside_a_decade_too(run):
    for column in ("sigma_e_m", "sigma_n_m", "sigma_u_m"):
        run.track[column] = run.smoothed[column] = 3.0
    for end in ("h", "v"):
        run.track[f"protection_{end}_m"] = 6.0
    assert certainty.sigma(run, Tolerance()).figure.layout.yaxis.dtick == "D2"
    run.track["sigma_u_m"][3] = 300.0
    assert certainty.sigma(run, Tolerance()).figure.layout.yaxis2.dtick == 1


def test_numbers_are_short_and_never_in_powers():
    said = [page.number(x) for x in (None, float("nan"), 0, 0.012345, 12.345, 123456.0, float("inf"))]
    assert said == ["–", "–", "0", "0.0123", "12.3", "123456", "∞"]


def test_zeros_that_were_measured_stay():
    said = [page.number(x) for x in (1.5, 20.0, 300.0, -0.68, 1e-5, 999.7)]
    assert said == ["1.50", "20.0", "300", "-0.680", "1.00e-05", "1000"]
    assert page.number(1.0, 2) == "1.0"


@pytest.mark.browser
@pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}")
def test_it_opens_without_any_network_and_plays(html, tmp_path):
    """In Chromium without network: all drawn, nothing asked for, both themes, paper, the flight played."""
    from playwright.sync_api import sync_playwright

    file = tmp_path / "report.html"
    file.write_text(html, encoding="utf-8")
    asked, wrong = [], []
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser.CHROMIUM, args=browser.ARGS)
        tab = chromium.new_context(offline=True, viewport=browser.SMALL, color_scheme="light").new_page()
        tab.set_default_timeout(120_000)
        tab.on("request", lambda request: asked.append(request.url))
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        tab.goto(file.as_uri())
        tab.locator("body[data-drawn=all]").wait_for()
        assert tab.locator(".plot .main-svg").count() >= tab.locator(".plot").count()
        assert tab.evaluate("document.documentElement.scrollWidth") <= browser.SMALL["width"]
        ink = "getComputedStyle(document.querySelector('.xtick text')).fill"
        light = tab.evaluate(ink)
        tab.emulate_media(color_scheme="dark")
        tab.wait_for_function(f"{ink} !== '{light}'")
        sizes = "[...document.querySelectorAll('.plot')].map(({ _fullLayout: f }) => [f.width, f.height])"
        on_screen = tab.evaluate(sizes)
        tab.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        assert tab.evaluate(ink) == light
        assert min(width for width, _ in on_screen) > PAPER_PX[0]
        assert (np.array(tab.evaluate(sizes)) <= PAPER_PX).all()
        tab.evaluate("window.dispatchEvent(new Event('afterprint'))")
        tab.wait_for_function(f"JSON.stringify({sizes}) === '{json.dumps(on_screen, separators=(',', ':'))}'")
        slider = tab.get_by_label("time", exact=True)
        slider.fill("0")
        assert tab.locator(".replay output").inner_text() == "0.0 s"
        tab.get_by_label("speed").select_option("60×")
        tab.get_by_role("button", name="Play").click()
        tab.wait_for_function("document.querySelector('.replay output').textContent === '10.0 s'")
        assert tab.get_by_role("button", name="Play").is_visible()
        chromium.close()
    assert wrong == []
    assert [url for url in asked if not re.match("file:|data:|blob:", url)] == []
