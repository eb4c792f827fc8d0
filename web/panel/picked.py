"""What is told of a clicked outlier."""

from html import escape

from gcs.contract.messages import Verdict
from web.look import colours
from web.look.html import block, clock, inked, table
from web.memory.claims import ACCEPTED, Claim
from web.memory.lies import UNITS
from web.memory.residuals import Statement, sigmas_off

WORDS = {  # the estimator's reasons in plain words
    "innovation": "too far from what everything else says",
    "run": "one of a run of outliers of this channel",
    "ambiguous": "no third sensor tells which side is right",
}


def story(claim: Claim, others: list[Statement]) -> str:
    """Time, sensor, every channel with its verdict and why, and what the others said then."""
    tint = colours.KIND.get(claim.kind)
    head = f"<div>{inked(claim.kind, tint)} · <b>{escape(claim.sensor)}</b> · {clock(claim.t_ns)} UTC</div>"
    body = [
        [
            inked(verdict.channel.replace("_", " "), colours.KIND.get(verdict.verdict)),
            number(verdict.value, verdict.channel),
            number(verdict.predicted, verdict.channel),
            f"{sigmas_off(verdict):+.1f} σ",
            verdict.verdict,
        ]
        for verdict in claim.verdicts.values()
    ]
    why = {f"<div>{escape(v.channel.replace('_', ' '))}: {escape(in_words(v))}</div>" for v in claim.refused}
    said = [
        [
            escape(other.sensor),
            f"{other.apart_s:.2f} s apart",
            f"{other.channel.replace('_', ' ')} {other.sigmas:+.1f} σ",
            other.kind if other.kind != ACCEPTED else "believed",
        ]
        for other in others
    ]
    rest = f"<div><b>the others then</b>, each one's worst channel</div>{table(said)}" if said else ""
    return block(
        head + table(body, ("", "value", "predicted", "off", "verdict")) + "".join(sorted(why)) + rest
    )


def number(value: float | None, channel: str) -> str:
    digits = 4 if channel in ("azimuth", "elevation") else 2
    return "–" if value is None else f"{value:.{digits}f} {UNITS[channel]}"


def in_words(verdict: Verdict) -> str:
    """The reason as a sentence; what is one already stays."""
    word, *rest = verdict.reason.split(" ", 1)
    return " ".join([WORDS.get(word, word), *rest]) or "no reason is given"
