"""Events: what happened when, at which level."""

from html import escape

from gcs.contract.messages import Event
from web.look import colours
from web.look.html import block, clock, inked

LEVELS = {"all": 0, "warnings": 1, "errors": 2}  # by what may be chosen: the least that is shown
RANK = {"info": 0, "patch": 1, "warning": 1, "error": 2}
SIGN = {"info": "ℹ", "patch": "■", "warning": "⚠", "error": "✖"}
TINT = {"patch": colours.KIND["patch"], "warning": colours.WARNING, "error": colours.BAD}
SHOWN = 12
MARK = {"patch": "■", "gap": "∅", "reset": "↺"}
MOST_MARKS = 40  # on a slider of two hundred pixels


def chosen(moments: dict[tuple[int, str], str], level: str, upto_ns: int) -> list[Event]:
    """The moments up to a time, of that level and above, in order."""
    least = LEVELS[level]
    return [
        Event(t_ns=t_ns, level=rank, text=text)
        for (t_ns, text), rank in sorted(moments.items())
        if t_ns <= upto_ns and RANK.get(rank, 1) >= least
    ]


def neighbour(
    moments: dict[tuple[int, str], str], marks: dict[int, str], level: str, now_ns: int, step: int
) -> int | None:
    """Time of the next (+1) or the previous (−1) mark, or moment of that level; None: there is none."""
    times = [*marks, *(event.t_ns for event in chosen(moments, level, 2**63 - 1))]
    ahead = [t for t in times if (t - now_ns) * step > 0]
    return (min(ahead) if step > 0 else max(ahead)) if ahead else None


def listed(latest: list[Event], notes: list[str]) -> str:
    """The newest first; ``notes`` of the page itself before them."""
    lines = [inked(escape(note), colours.WARNING) for note in notes]
    lines += [
        f'<span class="quiet">{clock(event.t_ns)}</span> '
        + inked(f"{SIGN.get(event.level, '⚠')} {escape(event.text)}", TINT.get(event.level))
        for event in latest[: -SHOWN - 1 : -1]
    ]
    return block("".join(f"<div>{line}</div>" for line in lines) or "none yet")


def on_slider(marks: dict[int, str], start_ns: int, end_ns: int) -> tuple[tuple[float, str], ...]:
    """Seconds from the start and sign of each mark of that time, the newest ``MOST_MARKS``, in order."""
    there = sorted((t_ns, what) for t_ns, what in marks.items() if start_ns <= t_ns <= end_ns)
    return tuple((round((t_ns - start_ns) / 1e9, 1), MARK[what]) for t_ns, what in there[-MOST_MARKS:])


def strip(moments: dict[tuple[int, str], str], start_ns: int, end_ns: int, now_ns: int) -> str:
    """A line under the slider with a mark for every moment, as far along as its time."""

    def at(t_ns: int) -> float:
        return 100.0 * (t_ns - start_ns) / max(end_ns - start_ns, 1)

    marks = "".join(
        f'<span title="{clock(t_ns)} {escape(text)}" style="position:absolute;left:{at(t_ns):.2f}%;'
        f'top:0;width:3px;height:100%;background:{colours.css(TINT.get(level, colours.INS))}"></span>'
        for (t_ns, text), level in moments.items()
        if start_ns <= t_ns <= end_ns
    )
    gone = f"position:absolute;left:0;width:{at(now_ns):.2f}%;height:100%;opacity:0.25;background:gray"
    here = f'<span style="{gone}"></span>'
    return block(
        '<div style="position:relative;height:0.7em;border-radius:3px;overflow:hidden;'
        f'border:1px solid rgba(128,128,128,0.6)">{here}{marks}</div>'
    )
