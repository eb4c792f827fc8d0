"""Claims out of a few numbers."""

from gcs.contract.messages import Verdict
from web.memory.claims import Claim

PLACE = (1.0, 2.0, 3.0)


def verdict(t_ns=0, sensor="radar", channel="range", word="used", position=PLACE, **more) -> Verdict:
    told = {"value": 1.0, "predicted": 1.0, "sigma": 1.0, "reason": ""} | more
    return Verdict(
        t_ns=t_ns,
        sensor=sensor,
        channel=channel,
        weight=1.0,
        verdict=word,
        position_enu_m=position,
        **told,
    )


def claim(t_ns: int, sensor: str, channels: dict[str, tuple], position=PLACE) -> Claim:
    """By channel: value, predicted, sigma, then verdict and reason where it is not simply used."""
    made = Claim(t_ns, sensor)
    made.position = position
    for channel, (value, predicted, sigma, *rest) in channels.items():
        word, reason = (*rest, "used", "")[:2] if len(rest) != 1 else (rest[0], "")
        made.verdicts[channel] = verdict(
            t_ns,
            sensor,
            channel,
            word,
            position,
            value=value,
            predicted=predicted,
            sigma=sigma,
            reason=reason,
        )
    return made
