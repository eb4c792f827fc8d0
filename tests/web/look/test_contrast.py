"""Every word can be read on the light and on the dark page, by WCAG 2.1 as the browser draws it."""

import pytest

from tests.web import browser
from tests.web.page import tab

pytestmark = browser.NEEDED
TABS = ("Flight", "Sensors", "Events", "Limits", "Show")
SIGNS = ("▬", "✕", "■", "○", "▥", "→", "·")  # of the legend: as they are in the picture, no words
POOR = """() => {
  const context = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
  const rgba = text => {
    context.clearRect(0, 0, 1, 1); context.fillStyle = text; context.fillRect(0, 0, 1, 1);
    const d = context.getImageData(0, 0, 1, 1).data; return [d[0], d[1], d[2], d[3] / 255];
  };
  const share = x => x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4;
  const light = c => [0.2126, 0.7152, 0.0722].reduce((sum, w, i) => sum + w * share(c[i] / 255), 0);
  const over = (top, alpha, below) => below.map((b, i) => alpha * top[i] + (1 - alpha) * b);
  const chain = node => node ? [node, ...chain(node.parentElement)] : [];
  const found = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const text = walk.currentNode.textContent.trim(), own = walk.currentNode.parentElement;
    const box = own.getBoundingClientRect(), style = getComputedStyle(own);
    if (!text || !box.width || !box.height || style.visibility === 'hidden') continue;
    const parents = chain(own).map(one => getComputedStyle(one));
    const ground = parents.map(one => rgba(one.backgroundColor)).reverse()
      .reduce((below, one) => over(one, one[3], below), [255, 255, 255]);
    const ink = rgba(style.color), clear = parents.reduce((all, one) => all * parseFloat(one.opacity), 1);
    const [dark, bright] = [light(over(ink, ink[3] * clear, ground)), light(ground)].sort((a, b) => a - b);
    const contrast = (bright + 0.05) / (dark + 0.05);
    if (contrast < 4.5) found.push([text, contrast.toFixed(2)]);
  }
  return found;
}"""


@pytest.mark.parametrize("dark", [False, True])
def test_words_have_the_contrast_to_be_read_by(page, dark):
    tab(page, "Show")
    page.get_by_role("checkbox", name="dark", exact=True).set_checked(dark, force=True)
    page.locator(f"html[data-mantine-color-scheme={'dark' if dark else 'light'}]").wait_for(state="attached")
    page.wait_for_timeout(1000)  # colours fade over
    poor = {}
    for name in TABS:
        tab(page, name)
        page.wait_for_timeout(500)
        poor[name] = [one for one in page.evaluate(POOR) if one[0] not in SIGNS]
    assert {name: found for name, found in poor.items() if found} == {}
