"""What the colours and shapes of the picture mean."""

from html import escape

from gcs.contract.messages import Scene
from web.look import colours
from web.look.colours import RAMP, css
from web.look.html import block, swatch
from web.memory.other import OtherTrack
from web.scene.paint import PLAIN, UNITS, Scale

SHAPE = {"isolated": "✕", "patch": "■", "invalid": "○"}  # as the solids of the picture look


def shown(
    scene: Scene, factor: int, choice: str, scale: Scale | None, other: OtherTrack | None = None
) -> str:
    """Lines, shapes, sensors, the painted track's scale, and how much larger than life trust is drawn."""
    newest = "" if choice != PLAIN else f' style="color:{css(colours.FILTERED)}"'
    words = [
        f"<span{newest}>▬</span> newest",
        f'<span style="color:{css(colours.SMOOTHED)}">▬</span> smoothed',
        *([f"▬ {escape(other.name)}"] if other else []),  # in the colour of text, as it is drawn
        *(f'<b style="color:{css(colours.KIND[kind])}">{sign}</b> {kind}' for kind, sign in SHAPE.items()),
        *(f"{swatch(colour)}{escape(name)}" for name, colour in colours.of_sensors(scene).items()),
        f'<span style="color:{css(colours.PROTECTION)}">▥</span> protection, 3σ inside: ×{factor}',
    ]
    body = " &nbsp; ".join(f'<span class="word">{word}</span>' for word in words)
    return block(body + _bar(choice, scale))


def _bar(choice: str, scale: Scale | None) -> str:
    if scale is None:
        return ""
    steps = ",".join(css((int(r), int(g), int(b))) for r, g, b in RAMP)
    return (
        f'<div style="display:flex;gap:0.5em;align-items:center">{choice} {scale.low:.1f}'
        f'<span style="flex:1;height:0.8em;background:linear-gradient(to right,{steps})"></span>'
        f"{scale.high:.1f} {UNITS[choice]}</div>"
    )
