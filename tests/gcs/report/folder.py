"""A run folder written by hand: 10 s straight north at 20 m/s, one theodolite, numbers one can check."""

import json
from pathlib import Path

import numpy as np

from gcs.contract.config import Station, dump
from gcs.contract.config import load as load_station
from gcs.contract.frames import Frame

T0_NS = 1_767_225_600_000_000_000
STEP_NS = 100_000_000
STATES, SPEED_MPS = 101, 20.0
SIGMA_M = (0.3, 0.4, 0.5)  # of the best estimate, E N U; live twice as much
APART_M = 1.5  # live is so far east of the best estimate
BARE = 20  # states at the beginning without a protection level, half of them ambiguous
FRAME = Frame(-35.0, 149.0, 600.0)
STATION = """
[range]
name = "here"
origin = { lat_deg = -35.0, lon_deg = 149.0, alt_m = 600.0 }
[[sensor]]
name = "theo-a"
kind = "theodolite"
position = { lat_deg = -35.0, lon_deg = 149.0, alt_m = 600.0 }
estimate = ["bias", "clock"]
"""
TRACK = (
    "t_ns,lat_deg,lon_deg,alt_m,e_m,n_m,u_m,ve_mps,vn_mps,vu_mps,ae_mps2,an_mps2,au_mps2,"
    "sigma_e_m,sigma_n_m,sigma_u_m,sigma_ve_mps,sigma_vn_mps,sigma_vu_mps,quality,reset_counter,"
    "protection_h_m,protection_v_m,ambiguous"
)
ERROR = {"observable": True, "prior_sigma": 5.0, "sigma": 0.1, "unit": "m", "value": 0.5}
CLOCK = {"observable": False, "prior_sigma": 0.1, "sigma": 0.05, "unit": "s", "value": 0.02}
SUMMARY = {
    "complete": True,
    "software": {"name": "gcs", "version": "0.1.0"},
    "settings": {"method": "default", "learned_correction": False},
    "inputs": {"theo-a": {"file": "<b>theo</b>.csv", "bytes": 1234, "sha256": "ab" * 32}},
    "verdicts": {
        "theo-a": {"range": {"used": 94, "deweighted": 2, "isolated": 1, "patch": 3}, "line": {"invalid": 1}}
    },
    "pace": {"theo-a": {"rate_hz": 10.0, "gaps": 0, "longest_gap_s": 0.1}},
    "height": {"geoid_separation_from": "unknown"},
    "estimator": {
        "resets": [],
        "sensors": {
            "theo-a": {
                "channels": {
                    "range": {"used": 96, "refused": 4, "nis_mean": 2.25, "nis_band_95": [0.72, 1.28]}
                },
                "errors": {"range": ERROR, "clock": CLOCK},
            }
        },
    },
    "wind": None,
    "log": None,
}


def station(path: Path) -> Station:
    file = path / "written.toml"
    file.write_text(STATION, encoding="utf-8")
    return load_station(file)


def track(east_m: float, factor: float, *, live: bool) -> str:
    lines = [TRACK]
    for k in range(STATES):
        north = SPEED_MPS * k * STEP_NS * 1e-9
        lat, lon, alt = (float(x[0]) for x in FRAME.to_geodetic(np.array([[east_m, north, 100.0]])))
        sigma = ",".join(f"{factor * s:.4f}" for s in SIGMA_M)
        level = "5.000,6.000,0" if live and k >= BARE else f",,{int(live and k < BARE // 2)}"
        lines.append(
            f"{T0_NS + k * STEP_NS},{lat:.9f},{lon:.9f},{alt:.4f},{east_m},{north},100.0,"
            f"0,{SPEED_MPS},0,0,0,0,{sigma},0.1,0.1,0.1,90,0,{level}"
        )
    return "\n".join(lines) + "\n"


def verdicts() -> str:
    """100 ranges: residuals ±1 sigma in turns, two deweighted, one isolated outlier, one patch of three."""
    lines = ["t_ns,sensor,channel,value,predicted,sigma,weight,verdict,reason"]
    for k in range(100):
        verdict, off, reason = "used", (-1.0) ** k, ""
        if k in (10, 11):
            verdict, reason = "deweighted", "innovation (3.0 sigma)"
        elif k == 20:
            verdict, off, reason = "isolated", 9.0, "innovation (9.0 sigma)"
        elif 40 <= k < 43:
            verdict, off, reason = "patch", 20.0, "run (20.0 sigma)"
        value = 1000.0 + 0.5 * off
        lines.append(f"{T0_NS + k * STEP_NS},theo-a,range,{value},1000.0,0.5,1,{verdict},{reason}")
    lines.append(',theo-a,,,,,0,invalid,"theo-a.csv:7: torn, no time"')
    return "\n".join(lines) + "\n"


def separation() -> str:
    """Without the theodolite the state moves by 2 m and 1 m, without the INS by nothing; a pause of 3 s."""
    lines = ["t_ns,sensor,horizontal_m,vertical_m,sigma_h_m,sigma_v_m"]
    for k in (*range(0, 40, 2), *range(70, STATES, 2)):
        lines.append(f"{T0_NS + k * STEP_NS},ins,0.0000,0.0000,0.5000,0.6000")
        lines.append(f"{T0_NS + k * STEP_NS},theo-a,2.0000,1.0000,3.0000,4.0000")
    return "\n".join(lines) + "\n"


def write(path: Path, east_m: float = 0.0) -> Path:
    """The folder ``path``/run, ``east_m`` beside the usual place."""
    folder = path / "run"
    folder.mkdir()
    (folder / "station.toml").write_text(dump(station(path)), encoding="utf-8")
    (folder / "track.csv").write_text(track(east_m + APART_M, 2.0, live=True), encoding="utf-8")
    (folder / "smoothed.csv").write_text(track(east_m, 1.0, live=False), encoding="utf-8")
    (folder / "verdicts.csv").write_text(verdicts(), encoding="utf-8")
    (folder / "separation.csv").write_text(separation(), encoding="utf-8")
    (folder / "summary.json").write_text(json.dumps(SUMMARY), encoding="utf-8")
    (folder / "events.csv").write_text(
        f't_ns,level,text\n{T0_NS},warning,"theo-a, <i>silent</i>"\n', encoding="utf-8"
    )
    (folder / "errors.csv").write_text(
        "t_ns,sensor,error,value,sigma,prior_sigma\n"
        + "".join(f"{T0_NS + k * 10 * STEP_NS},theo-a,range,0.5,{5 / (k + 1)},5\n" for k in range(10)),
        encoding="utf-8",
    )
    return folder
