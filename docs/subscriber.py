"""A plain Zenoh subscriber to the cleaned state: needs only ``pip install eclipse-zenoh``."""

import json

import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", '["tcp/127.0.0.1:7447"]')

with zenoh.open(config) as session:
    subscriber = session.declare_subscriber("demo/uav1/state")
    expected = None
    for sample in subscriber:
        state = json.loads(sample.payload.to_bytes())
        if expected not in (None, state["seq"]):
            print(f"gap: state {expected} expected, {state['seq']} came")
        expected = state["seq"] + 1
        east, north, up = (state["covariance"][i] ** 0.5 for i in (0, 2, 5))  # a lower triangle by rows
        print(
            f"{state['t_ns'] / 1e9:.3f} s",
            f"{state['lat_deg']:.7f}° {state['lon_deg']:.7f}° {state['alt_m']:.2f} m",
            f"±{east:.2f} ±{north:.2f} ±{up:.2f} m",
            f"quality {state['quality']}",
            sep="  ",
        )
