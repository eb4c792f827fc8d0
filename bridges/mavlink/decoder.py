"""What a vehicle's MAVLink messages say, one at a time.

The same formulas and the same rules as for a log (``bridges/mavlink/autopilot.py``).
"""

from collections import Counter, deque
from typing import Any

import numpy as np

from bridges.mavlink import autopilot
from bridges.mavlink.flightclock import LAST_UNIX_US, MS, US, S
from bridges.mavlink.liveclock import LiveClock
from gcs.contract.limits import TEXT
from gcs.contract.messages import AirData, Bad, InsMeasurement

CLIP = 32  # bytes of a damaged frame shown
CLIMBS = 100  # positions, the newest, from which the sign of the climb rate is told
PATIENCE_NS = 10 * S  # from the first position on, so long it waits for a SYSTEM_TIME: some send one in 5 s
WAITING = 5_000  # messages that wait at most, the newest: 10 s of a fast link
AUTOPILOT = 1  # MAV_COMP_ID_AUTOPILOT1, the component listened to until a HEARTBEAT came


class Decoder:
    """Messages of one vehicle in, measurements out. Keeps its clock, attitude, fix and geoid separation.

    Nothing comes out until the vehicle's clock is known: what came before a SYSTEM_TIME, at most
    ``PATIENCE_NS`` from the first position on, waits for it. ``told``: (level, text) for the operator.
    """

    def __init__(self, system_id: int | None, link: str = "mavlink") -> None:
        self.system_id, self.link = system_id, link
        self.clock = LiveClock()
        self.told: list[tuple[str, str]] = self.clock.told
        self.bad = 0  # damaged frames so far
        self._others: set[int] | None = set() if system_id is None else None  # autopilots beside it
        self._beats: Counter[int] = Counter()  # HEARTBEATs by component
        self._component = AUTOPILOT  # the one with the most of them
        self._waiting: deque[tuple[Any, int]] | None = deque(maxlen=WAITING)  # None: the clock is known
        self._patience_ns: int | None = None  # when it ends
        self._forces: dict[str, list[np.ndarray]] = {}  # first samples of each IMU message
        self._pitot = self._fixed_wing = False
        self._own_wind = np.nan, np.nan  # east, north m/s
        self._climbs: deque[tuple[int, float, float]] = deque(maxlen=CLIMBS)  # t ns, height m, climb m/s
        self._turned = False  # is the climb rate sent with the wrong sign?
        self._restart()

    def _restart(self) -> None:
        self._attitude: tuple[int, np.ndarray, np.ndarray] | None = None  # UTC ns, angles, rates
        # of each receiver that has spoken: its fix, and boot time of the first position since then
        self._receivers: dict[str, tuple[int, int | None]] = {}
        self._had_fix = False
        self._placed = False  # has a position come out in this boot?
        self._position_ms = 0  # boot time of the newest position
        self._gps_alt = self._separation = np.nan

    def decode(self, message: Any, arrival_ns: int) -> list[InsMeasurement | AirData | Bad]:
        """What one pymavlink message says: measurements, or reasons why not; of those that waited, too.

        ``arrival_ns`` UTC ns is the instant of reception.
        """
        name = message.get_type()
        if name == "BAD_DATA":
            return [self._refused(message.reason, bytes(message.data[:CLIP]).hex(" "))]
        if not self._is_ours(message):
            return []
        return self._take(message, arrival_ns)

    def flush(self) -> list[InsMeasurement | AirData | Bad]:
        """What still waits, when nothing more will come."""
        waited, self._waiting = self._waiting or (), None
        return [one for item in waited for one in self._take(*item)]

    def _take(self, message: Any, arrival_ns: int) -> list[InsMeasurement | AirData | Bad]:
        """Measurements of a message, or of all that waited; none while the clock is not known."""
        if self._waiting is not None:
            self._waiting.append((message, arrival_ns))
            return self.flush() if self._may_begin(message, arrival_ns) else []
        boot_ns = self._boot_ns(message, arrival_ns)
        if self._waiting is not None:  # it has restarted just now
            return self._take(message, arrival_ns)
        one = None if boot_ns is None else self._measured(message, boot_ns, arrival_ns)
        return [] if one is None else [one]

    def _is_ours(self, message: Any) -> bool:
        """Is it from the vehicle's autopilot? HEARTBEATs say who that is."""
        system = message.get_srcSystem()
        beats = message.get_type() == "HEARTBEAT" and message.autopilot != autopilot.NO_AUTOPILOT
        if self.system_id is None and beats:
            self.system_id = system  # the first autopilot heard
        if system != self.system_id:
            if beats and self._others is not None and system not in self._others:
                self._others.add(system)
                text = f"{self.link}: vehicles {self.system_id} and {system} are on this link; "
                text += f"{self.system_id} is taken, heard first: set [vehicle] system_id"
                self.told.append(("error", text))
            return False
        if beats:
            self._beats[message.get_srcComponent()] += 1
            self._component = min(self._beats, key=lambda component: (-self._beats[component], component))
            self._fixed_wing = message.type == autopilot.FIXED_WING
        return message.get_srcComponent() == self._component

    def _may_begin(self, message: Any, arrival_ns: int) -> bool:
        """Is the clock known, or has it been waited for long enough?"""
        name = message.get_type()
        if name == "SYSTEM_TIME":
            self.clock.system_time(
                message.time_unix_usec, message.time_boot_ms * MS, arrival_ns, in_use=False
            )
        elif name == "GLOBAL_POSITION_INT" and self._patience_ns is None:
            place = message.lat, message.lon, message.alt
            if autopilot.has_position(*place, message.relative_alt, np.nan):
                self._patience_ns = arrival_ns + PATIENCE_NS
        over = self._patience_ns is not None and arrival_ns >= self._patience_ns
        if over and not self.clock.known:
            text = f"{self.link}: no SYSTEM_TIME in {PATIENCE_NS / S:g} s; stamped by the station's own clock"
            self.told.append(("warning", text))
        return self.clock.known or over

    def _measured(self, message: Any, boot_ns: int, arrival_ns: int) -> InsMeasurement | AirData | Bad | None:
        """What one message of the autopilot says: a measurement, a reason why not, or nothing of interest."""
        name = message.get_type()
        if name == "SYSTEM_TIME":
            if message.time_unix_usec >= LAST_UNIX_US:
                return self._refused(f"SYSTEM_TIME says {message.time_unix_usec} µs, after the year 2099")
            self.clock.system_time(message.time_unix_usec, boot_ns, arrival_ns, in_use=self._placed)
        elif name == "ATTITUDE":
            angles = np.array([message.roll, message.pitch, message.yaw])
            rates = np.array([message.rollspeed, message.pitchspeed, message.yawspeed])
            self._attitude = self.clock.utc_ns(boot_ns), angles, rates
        elif name in autopilot.RECEIVERS:
            self._gps(name, message)
        elif name == "GLOBAL_POSITION_INT":
            return self._position(message, self.clock.utc_ns(boot_ns), arrival_ns)
        elif name in autopilot.IMUS:
            t_ns = self.clock.utc_ns(boot_ns) if boot_ns < autopilot.UNIX_US * US else boot_ns
            return self._acceleration(name, message, t_ns, arrival_ns)
        elif not self.clock.shared(arrival_ns):
            return self._air(name, message, arrival_ns)
        return None

    def _refused(self, reason: str, raw: str = "") -> Bad:
        self.bad += 1
        return Bad(source="ins", where=f"{self.link} #{self.bad}", reason=reason[:TEXT], raw=raw)

    def _air(self, name: str, message, arrival_ns: int) -> AirData | Bad | None:
        """What concerns the air; a VFR_HUD becomes a measurement once a pitot tube is known of."""
        if name == "AIRSPEED":
            self._pitot = True
        elif name == "SYS_STATUS":
            self._pitot |= bool(message.onboard_control_sensors_present & autopilot.DIFFERENTIAL_PRESSURE)
        elif name == "WIND":
            self._own_wind = autopilot.wind_en(message.direction, message.speed)
        elif name == "WIND_COV":
            self._own_wind = autopilot.wind_cov_en(message.wind_x, message.wind_y)
        elif name == "VFR_HUD" and self._pitot and self._attitude is not None:
            t_ns, angles, _ = self._attitude
            if not np.isfinite([message.airspeed, message.alt, *angles]).all():
                return self._refused("VFR_HUD, or the ATTITUDE before it, holds what is no number")
            roll_deg, pitch_deg, yaw_deg = np.degrees(angles).tolist()
            return AirData(
                t_ns=t_ns,
                arrival_ns=arrival_ns,
                airspeed_mps=message.airspeed,
                alt_msl_m=message.alt,
                roll_deg=roll_deg,
                pitch_deg=pitch_deg,
                yaw_deg=yaw_deg,
                coordinated=self._fixed_wing,
                own_wind_e_mps=_known(self._own_wind[0]),
                own_wind_n_mps=_known(self._own_wind[1]),
            )
        return None

    def _boot_ns(self, message: Any, arrival_ns: int) -> int | None:
        """Boot time of the message in ns; of IMU messages the time they carry, 0 where they carry none.

        None: from another vehicle with the same system id.
        """
        if not hasattr(message, "time_boot_ms"):
            return getattr(message, "time_usec", 0) * US
        boot_ns, restarted = self.clock.boot_ns(message.time_boot_ms, arrival_ns)
        if restarted:
            self._restart()
            self._waiting, self._patience_ns = deque(maxlen=WAITING), None
        return boot_ns

    def _gps(self, name: str, message) -> None:
        self._receivers[name] = message.fix_type, None
        if name != "GPS_RAW_INT":
            return
        if message.fix_type >= autopilot.FIX_3D:
            self._had_fix, self._gps_alt = True, message.alt
        ellipsoidal = getattr(message, "alt_ellipsoid", 0)  # an extension: a MAVLink 1 frame has none
        separation = autopilot.geoid_separation_m(message.fix_type, message.alt, ellipsoidal)
        self._separation = separation if np.isfinite(separation) else self._separation

    def _position(self, message, t_ns: int, arrival_ns: int) -> InsMeasurement | None:
        place = message.lat, message.lon, message.alt
        dead_reckoned = self._dead_reckoned(message.time_boot_ms)
        if "GPS_RAW_INT" in self._receivers and not self._had_fix:
            return None
        if not autopilot.has_position(*place, message.relative_alt, self._gps_alt):
            return None
        values = autopilot.position_velocity(*place, message.vx, message.vy, message.vz)
        lat_deg, lon_deg, alt_msl_m, ve_mps, vn_mps, vu_mps = values
        self._climbs.append((t_ns, alt_msl_m, vu_mps))
        if abs(vu_mps) > autopilot.CLIMB_MPS:
            shown = autopilot.vz_is_upward(*map(np.array, zip(*self._climbs, strict=True)))
            self._turned = self._turned if shown is None else shown
        vu_mps = -vu_mps if self._turned else vu_mps
        self._placed = True
        return InsMeasurement(
            t_ns=t_ns,
            arrival_ns=arrival_ns,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_msl_m=alt_msl_m,
            geoid_separation_m=_known(self._separation),
            ve_mps=ve_mps,
            vn_mps=vn_mps,
            vu_mps=vu_mps,
            dead_reckoned=dead_reckoned,
        )

    def _dead_reckoned(self, boot_ms: int) -> bool:
        """Is this position one without a receiver? To be asked of every position once."""
        lost = []
        for name, (fix_type, first_ms) in self._receivers.items():
            first_ms = boot_ms if first_ms is None else first_ms
            self._receivers[name] = fix_type, first_ms
            lost.append(autopilot.is_lost(fix_type, self._position_ms - first_ms))
        self._position_ms = boot_ms
        return bool(lost) and all(lost)

    def _acceleration(self, name: str, message, t_ns: int, arrival_ns: int) -> InsMeasurement | None:
        force = np.array([message.xacc, message.yacc, message.zacc]) * autopilot.IMUS[name]
        first = self._forces.setdefault(name, [])
        if len(first) < autopilot.IMU_SAMPLES:
            first.append(force)
        best = next((i for i in autopilot.IMUS if autopilot.is_accelerometer(self._forces.get(i, []))), None)
        if name != best or self._attitude is None:
            return None
        attitude_ns, angles, rates = self._attitude
        if abs(t_ns - attitude_ns) > autopilot.ATTITUDE_AGE_NS:
            return None
        ae, an, au = autopilot.acceleration_enu(force, angles, rates, (t_ns - attitude_ns) * 1e-9).tolist()
        return InsMeasurement(t_ns=t_ns, arrival_ns=arrival_ns, ae_mps2=ae, an_mps2=an, au_mps2=au)


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
