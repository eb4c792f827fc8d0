"""Writes docs/messages.md from gcs/contract/messages.py: ``python docs/messages.py``."""

import inspect
import re
from pathlib import Path
from typing import Any

import msgspec

from gcs.contract import messages as contract

PAGE = Path(__file__).with_suffix(".md")
HEAD = """# Messages

Written by `python docs/messages.py` from [gcs/contract/messages.py](../gcs/contract/messages.py); a test
holds the two together. Frames, units and time: [gcs/\\_\\_init\\_\\_.py](../gcs/__init__.py).

A key is `{range}/{vehicle}/` and the subject below. The payload is JSON (or MessagePack, `[bus] media`), the
encoding says which: `application/json;gcs.State`. `type` is always there. A field with a default may be left
out. New fields come with a default, so a reader ignores what it does not know. The JSON schema of all:
query `{range}/{vehicle}/schema`.
"""
KEYS = {
    "InsMeasurement": "`raw/ins`",
    "PolarMeasurement": "`raw/NAME` of the instrument",
    "AirData": "`raw/air`",
    "Bad": "`raw/NAME`, among the measurements",
    "State": "`state`, `smoothed`",
    "Verdict": "`verdict/NAME`",
    "Wind": "`wind`",
    "Health": "`health`",
    "Event": "`event`",
    "Scene": "`scene` (also answers a query)",
}
EXAMPLES: dict[str, Any] = {  # by field, by Type.field where that is not enough; the rest by type
    "t_ns": 1795320744992292642,
    "arrival_ns": 1795320745012292642,
    "lat_deg": -35.3612,
    "lon_deg": 149.1651,
    "alt_m": 734.2,
    "alt_msl_m": 712.9,
    "ve_mps": -10.1,
    "vn_mps": -18.9,
    "vu_mps": 0.2,
    "origin_lat_deg": -35.363261,
    "origin_lon_deg": 149.16523,
    "origin_alt_m": 584.0,
    "range_m": 812.4,
    "azimuth_deg": 12.25,
    "elevation_deg": 3.5,
    "airspeed_mps": 22.4,
    "roll_deg": 51.0,
    "yaw_deg": 208.0,
    "source": "theo-north",
    "where": "theo-north.csv:17",
    "raw": "1795320744.99,812.4,twelve,3.5",
    "Bad.reason": "azimuth_deg: 'twelve' is no number from -360 to 720",
    "position_enu_m": (-12.0, 231.0, 150.2),
    "velocity_enu_mps": (-10.1, -18.9, 0.2),
    "acceleration_enu_mps2": (9.1, -4.9, 0.1),
    "covariance": [0.04] + [0.0] * 44,
    "quality": 96,
    "State.age_s": {"theo-north": 0.04, "ins": 0.02},
    "SensorHealth.age_s": 0.04,
    "protection_h_m": 1.9,
    "protection_v_m": 2.6,
    "sensor": "theo-north",
    "channel": "azimuth",
    "value": 12.31,
    "predicted": 12.25,
    "sigma": 0.004,
    "verdict": "isolated",
    "Verdict.reason": "innovation",
    "speed_mps": 8.1,
    "from_deg": 262.0,
    "Wind.covariance": (0.09, 0.01, 0.12),
    "known": True,
    "rate_hz": 20.0,
    "outlier_share": 0.021,
    "latency_s": 0.03,
    "alive": True,
    "level": "warning",
    "text": "theo-north is silent",
    "range": "demo",
    "vehicle": "uav1",
    "name": "theo-north",
    "kind": "theodolite",
    "errors": {"azimuth": {"value": -0.0081, "sigma": 0.0012, "unit": "deg", "known": True}},
}
PARTS = (  # held by messages
    contract.SensorHealth,
    contract.SystematicError,
    contract.PartHealth,
    contract.Instrument,
)


def page() -> str:
    """The whole page."""
    return HEAD + "".join(section(kind) for kind in contract.TYPES.values())


def section(kind: type) -> str:
    """One message: what it is, where it travels, its fields, an example."""
    text = msgspec.json.format(contract.encode(example(kind))[0], indent=2).decode()
    text = re.sub(r"\[[^][{}]*\]", lambda found: re.sub(r"\s+", " ", found[0]), text)  # numbers on one line
    text = re.sub(r"(0\.0, ){9,}0\.0", "…", text)
    doc = " ".join((inspect.getdoc(kind) or "").split())
    deeper = [inner for part in parts(kind) for inner in parts(part)]
    fields = "".join(table(part) for part in (kind, *parts(kind), *deeper))
    return f"\n## {kind.__name__}\n\n{doc}\n\nKey: {KEYS[kind.__name__]}\n\n{fields}```json\n{text}\n```\n"


def table(kind: type) -> str:
    """The fields of one type, with the comments that stand beside them in the code."""
    code = inspect.getsource(kind)
    title = "field" if kind.__name__ in contract.TYPES else f"field of {kind.__name__}"
    lines = [f"| {title} | type | default | meaning |", "|---|---|---|---|"]
    for field in msgspec.structs.fields(kind):
        said = re.search(rf"^    {field.name}: ([^=#\n]+?)\s*(?:= ([^#\n]+?))?\s*(?:# (.*))?$", code, re.M)
        assert said, f"{kind.__name__}.{field.name}: write it in one line"
        shape, default, meaning = (re.sub(r"\|", r"\\|", part or "") for part in said.groups())
        lines.append(f"| `{field.name}` | {shape} | {default} | {meaning} |")
    return "\n".join(lines) + "\n\n"


def parts(kind: type) -> list[type]:
    """The types of ours that its fields hold."""
    shown = " ".join(str(field.type) for field in msgspec.structs.fields(kind))
    return [part for part in PARTS if f".{part.__name__}" in shown]


def example(kind: type) -> Any:
    """A value of ``kind`` with every field that has an example; others have their default, or zero."""
    values = {}
    for field in msgspec.structs.fields(kind):
        named = EXAMPLES.get(f"{kind.__name__}.{field.name}", EXAMPLES.get(field.name))
        inner = next((part for part in parts(kind) if f".{part.__name__}" in str(field.type)), None)
        if inner and named is None:
            name = {"sensors": "theo-north", "parts": "mavlink"}.get(field.name)
            values[field.name] = {name: example(inner)} if name else [example(inner)]
        elif named is not None:
            values[field.name] = named
        elif field.required:
            values[field.name] = field.type(0)
    return msgspec.convert(values, kind)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
