"""docs/messages.md says what the messages are."""

import re
from pathlib import Path

import pytest

from docs import messages as written
from gcs.contract import messages

TEXT = (Path(__file__).parents[2] / "docs" / "messages.md").read_text(encoding="utf-8")


def test_the_page_is_up_to_date():
    assert written.page() == TEXT, "run python docs/messages.py"


@pytest.mark.parametrize("name", messages.TYPES)
def test_every_example_is_a_message(name):
    message = written.example(messages.TYPES[name])
    assert messages.decode(*messages.encode(message)) == message
    assert re.search(rf'^  "type": "{name}"', TEXT, re.MULTILINE)
