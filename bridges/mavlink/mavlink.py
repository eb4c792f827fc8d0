"""The live MAVLink link of a vehicle: listens, never speaks.

A heartbeat from a ground station arms an autopilot's failsafe, so nothing is ever sent: no heartbeat, no
request. The autopilot or its router must stream by itself. The one exception is ``udpout:``, where the other
end only learns who listens from a datagram of ours: an empty one, once a second until the vehicle is heard.

The same formulas and the same rules as for a log (``bridges/mavlink/autopilot.py``), one message at a time.
"""

import socket
import time
from contextlib import closing
from threading import Event as Flag
from typing import TYPE_CHECKING, Any

import numpy as np

from bridges.mavlink import autopilot
from bridges.mavlink.flightclock import LAST_UNIX_US, US, LiveClock
from gcs.contract.limits import TEXT
from gcs.contract.messages import AirData, Bad, Event, InputError, InsMeasurement

if TYPE_CHECKING:  # a bridge is given its bus; zenoh is loaded by whoever opens it
    from gcs.contract.bus import Bus

RETRY_S = 1.0  # between two attempts to open a link that was there
SILENT_S = 5.0  # a link without the vehicle for so long is reported
POLL_S = 0.1
KNOCK_S = 1.0
CLIP = 32  # bytes of a damaged frame shown
CLIMBS = 100  # positions after which the sign of the climb rate is looked at again
AUTOPILOT = 1  # MAV_COMP_ID_AUTOPILOT1, the component listened to until a HEARTBEAT came


class LinkError(InputError):
    """A link that cannot be used. The message names it and what to do."""


class Decoder:
    """Messages of one vehicle in, measurements out. Keeps its clock, attitude, fix and geoid separation."""

    def __init__(self, system_id: int | None, link: str = "mavlink") -> None:
        self.system_id, self.link = system_id, link
        self.clock = LiveClock()
        self.bad = 0  # damaged frames so far
        self._component: int | None = None  # of the autopilot, known from its HEARTBEAT
        self._forces: dict[str, list[np.ndarray]] = {}  # first samples of each IMU message
        self._pitot = self._fixed_wing = False
        self._own_wind = np.nan, np.nan  # east, north m/s
        self._climbs: list[tuple[int, float, float]] = []  # t ns, height m, climb rate m/s
        self._turned = False  # is the climb rate sent with the wrong sign?
        self._restart()

    def _restart(self) -> None:
        self._attitude: tuple[int, np.ndarray, np.ndarray] | None = None  # UTC ns, angles, rates
        # of each receiver that has spoken: its fix, and boot time of the first position since then
        self._receivers: dict[str, tuple[int, int | None]] = {}
        self._had_fix = False
        self._position_ms = 0  # boot time of the newest position
        self._gps_alt = self._separation = np.nan

    def decode(self, message: Any, arrival_ns: int) -> InsMeasurement | AirData | Bad | None:
        """What one pymavlink message says: a measurement, a reason why not, or nothing of interest.

        ``arrival_ns`` UTC ns is the instant of reception.
        """
        name = message.get_type()
        if name == "BAD_DATA":
            return self._refused(message.reason, bytes(message.data[:CLIP]).hex(" "))
        beats = name == "HEARTBEAT" and message.autopilot != autopilot.NO_AUTOPILOT
        if self.system_id is None and beats:
            self.system_id = message.get_srcSystem()  # the first autopilot heard
        if message.get_srcSystem() != self.system_id:
            return None
        if beats:
            self._component = min(message.get_srcComponent(), self._component or 255)
            self._fixed_wing = message.type == autopilot.FIXED_WING
        if message.get_srcComponent() != (self._component or AUTOPILOT):
            return None
        boot_ns = self._boot_ns(message, arrival_ns)
        if name == "SYSTEM_TIME":
            if message.time_unix_usec >= LAST_UNIX_US:
                return self._refused(f"SYSTEM_TIME says {message.time_unix_usec} µs, after the year 2099")
            self.clock.system_time(message.time_unix_usec, boot_ns)
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
        else:
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

    def _boot_ns(self, message, arrival_ns: int) -> int:
        """Boot time of the message in ns; of IMU messages the time they carry, 0 where they carry none."""
        if not hasattr(message, "time_boot_ms"):
            return getattr(message, "time_usec", 0) * US
        boot_ns, restarted = self.clock.boot_ns(message.time_boot_ms, arrival_ns)
        if restarted:
            self._restart()
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
        if not self._turned and len(self._climbs) == CLIMBS:
            self._turned = autopilot.vz_is_upward(*map(np.array, zip(*self._climbs, strict=True)))
            self._climbs.clear()
        vu_mps = -vu_mps if self._turned else vu_mps
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


def run(link: str, system_id: int | None, bus: "Bus", stop: Flag) -> None:
    """Publish ``raw/ins`` and ``raw/air`` from ``link`` (any pymavlink address) until ``stop`` is set.

    Without a ``system_id`` it is the first autopilot heard.

    A link that is lost is opened again and again; losing and finding it are published as events.
    Raises LinkError where the address cannot be used at all.
    """
    _check(link)
    bus.declare_alive("ins")
    decoder, lost = Decoder(system_id, link), False
    while not stop.is_set():
        try:
            with closing(_open(link)) as port:
                _tell(bus, "info", f"{link}: listening for vehicle {system_id or '(any)'}")
                lost = False
                _listen(port, decoder, bus, stop)
        except OSError as error:
            if not lost:
                _tell(bus, "warning", f"{link}: {error.strerror or error}; trying again every {RETRY_S:g} s")
            lost = True
            stop.wait(RETRY_S)


def _listen(port, decoder: Decoder, bus, stop: Flag) -> None:
    heard, silent, knocked, readable = time.monotonic(), False, -KNOCK_S, False
    knock, stream = decoder.link.startswith("udpout:"), decoder.link.startswith("tcp:")
    while not stop.is_set():
        now = time.monotonic()
        if knock and now - knocked >= KNOCK_S:
            port.write(b"")
            knocked = now
        before = port.mav.total_bytes_received
        message = port.recv_msg()
        if message is None:
            if stream and readable and port.mav.total_bytes_received == before:
                raise ConnectionResetError(0, "closed by the other end")
            if now - heard > SILENT_S and not silent:
                silent = True
                _tell(bus, "warning", f"{decoder.link}: nothing from vehicle {decoder.system_id}")
            readable = port.select(POLL_S)
            continue
        readable = False
        measurement = decoder.decode(message, time.time_ns())
        if measurement is not None:
            bus.publish("raw", measurement, "air" if isinstance(measurement, AirData) else "ins")
        if message.get_srcSystem() == decoder.system_id:
            heard, knock = now, False
            if silent:
                silent = False
                _tell(bus, "info", f"{decoder.link}: vehicle {decoder.system_id} is back")


def _tell(bus, level: str, text: str) -> None:
    bus.publish("event", Event(t_ns=time.time_ns(), level=level, text=text))


def _check(link: str) -> None:
    """Raise LinkError for an address pymavlink would not refuse clearly."""
    kind, _, rest = link.partition(":")
    if kind not in ("udpin", "udpout", "tcp", "tcpin"):
        return  # a serial port, whose own error says enough
    host, _, port = rest.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise LinkError(f"{link}: give {kind}:HOST:PORT, as in {kind}:127.0.0.1:14550")
    if kind == "udpin":
        # pymavlink binds with SO_REUSEADDR, which would quietly share the port with another listener
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
            try:
                probe.bind((host, int(port)))
            except (OSError, TypeError, ValueError) as error:  # a name that cannot be resolved too
                why = getattr(error, "strerror", None) or error
                raise LinkError(
                    f"{link}: {why}; another ground station may be listening: choose another port"
                ) from None


def _open(link: str):
    """A pymavlink connection that parses MAVLink 1 and 2 and never answers."""
    from pymavlink import mavutil  # sets os.environ when imported

    return mavutil.mavlink_connection(link, retries=1)
