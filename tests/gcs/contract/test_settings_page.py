"""docs/settings.md says what the schema says."""

from pathlib import Path

import msgspec

from gcs.contract import config
from gcs.contract.settings_page import page

DOCS = Path(__file__).resolve().parents[3] / "docs"


def test_the_page_is_that_of_the_schema():
    written = (DOCS / "settings.md").read_text(encoding="utf-8")
    assert written == page(), "run: python -m gcs.contract.settings_page > docs/settings.md"


def test_every_setting_has_a_row_and_every_row_a_reason():
    rows = [line.strip("|").split("|") for line in page().splitlines() if line.startswith("| `")]
    names = {cells[0].strip(" `") for cells in rows}
    for section in msgspec.inspect.type_info(config.FilterSection).fields:
        assert section.name in names
    assert {"latency_s.range_m", "tilt_deg.east", "orientation_deg", "prior.slow", "height_m.mean"} <= names
    assert [cells[0] for cells in rows if not cells[-1].strip()] == []
