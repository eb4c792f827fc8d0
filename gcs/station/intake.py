"""Intake: measurements in input units become numbered rows in filter units, the impossible is judged."""

from typing import NamedTuple

import numpy as np

from filters.models.rows import ROW, Sensor
from filters.models.settings import Settings
from gcs.contract import limits
from gcs.contract.config import InsSection, Station
from gcs.contract.frames import Frame, polar_to_enu
from gcs.contract.messages import CHANNELS, Bad
from gcs.station.ledger import ANGLES, ENTRY, NO_TIME, PENDING, Ledger

POLAR_FIELDS = ("range_m", "azimuth_deg", "elevation_deg", "range_rate_mps")
TURNED = ("ve_mps", "vn_mps", "vu_mps", "ae_mps2", "an_mps2", "au_mps2")  # two vectors at the aircraft
LOW, HIGH = np.array([limits.CHANNEL[name] for name in CHANNELS]).T
FINEST, COARSEST = np.array([limits.SIGMA[name] for name in POLAR_FIELDS]).T


class Batch(NamedTuple):
    """One source's values in one array: (n,) ENTRY, and the valid time of each, (n,) int64 ns."""

    entries: np.ndarray
    valid_ns: np.ndarray
    complaints: np.ndarray  # (n,) int, index into Ledger.reasons; 0 where there is nothing wrong
    sigma: np.ndarray  # (n,) its own 1-sigma noise, units of the input; 0: the sensor's


def merge(batches: list[Batch]) -> Batch:
    """One batch in the order of valid time; values of one measurement stay together."""
    first = np.cumsum([0] + [int(b.entries["measurement"].max(initial=-1)) + 1 for b in batches])
    for batch, offset in zip(batches, first, strict=False):
        batch.entries["measurement"] += offset
    whole = Batch(*(np.concatenate(column) for column in zip(*batches, strict=True)))
    order = np.argsort(whole.valid_ns, kind="stable")
    return Batch(*(column[order] for column in whole))


def sensors_of(station: Station, frame: Frame) -> list[Sensor]:
    """The estimator's sensors: the INS first, then the instruments in the order of the station file."""
    sensors = [Sensor("ins", "ins", np.r_[np.full(len(POLAR_FIELDS), np.nan), ins_sigma(station.ins)])]
    for sensor in station.sensor:
        sigma = np.full(len(CHANNELS), np.nan)
        for channel, value in sensor.sigma_by_channel.items():
            index = CHANNELS.index(channel)
            sigma[index] = np.radians(value) if ANGLES[index] else value
        offset, rotation = frame.place_sensor(sensor)
        prior = sensor.prior
        zero_sigma = prior.range_m, np.radians(prior.azimuth_deg), np.radians(prior.elevation_deg)
        about = sensor.refraction, tuple(sensor.estimate), zero_sigma, prior.clock_s, prior.slow
        sensors.append(Sensor(sensor.name, sensor.kind, sigma, offset, rotation, *about))
    return sensors


def ins_sigma(noise: InsSection) -> np.ndarray:
    """(9,) 1-sigma noise of the INS channels: m, m/s, m/s²."""
    sigma = np.repeat([noise.position_m, noise.velocity_mps, noise.acceleration_mps2], 3)
    sigma[2] = noise.height_m
    return sigma


def settings_of(station: Station, frame: Frame | None = None) -> Settings:
    """The estimator's settings as the station file has them; without ``frame`` no height is known before."""
    named = {name: getattr(station.filter, name) for name in station.filter.__struct_fields__}
    height = station.vehicle.height_m
    if height and frame:
        named |= {"height_m": height.mean - frame.alt_m, "height_sigma_m": height.sigma}
    return Settings(**named)


class Intake:
    """Turns columns of measurements into ledger entries and filter rows."""

    def __init__(self, station: Station, frame: Frame, ledger: Ledger):
        self.station = station
        self.frame = frame
        self.ledger = ledger
        self.names = ledger.sensors
        self.places = {s.name: frame.place_sensor(s) for s in station.sensor}  # offset, rotation
        known = {"ins": dict.fromkeys(CHANNELS, station.ins.latency_s)}
        known |= {s.name: s.latency_by_channel for s in station.sensor}
        self._latency_ns = {  # by channel
            name: np.array([round(1e9 * late.get(channel, 0.0)) for channel in CHANNELS])
            for name, late in known.items()
        }
        self.separation_source = "unknown" if station.ins.geoid_separation_m is None else "station file"

    def polar(self, name: str, measured: np.ndarray) -> Batch:
        """(n,) POLAR of one instrument; a value whose own noise cannot be is complained of."""
        values = np.stack([measured[field] for field in POLAR_FIELDS], axis=1)
        sigmas = np.nan_to_num(np.stack([measured[f"sigma_{field}"] for field in POLAR_FIELDS], axis=1))
        offset, rotation = self.places[name]
        position = polar_to_enu(
            values[:, 0], np.radians(values[:, 1]), np.radians(values[:, 2]), offset, rotation
        )
        batch = self._batch(name, measured["t_ns"], values, CHANNELS.index("range"), position)
        channel = batch.entries["channel"]
        own = sigmas[batch.entries["measurement"], channel]
        wrong = (own != 0.0) & ~((FINEST[channel] <= own) & (own <= COARSEST[channel]))
        batch.complaints[wrong] = self.ledger.reason("its own sigma cannot be")
        return batch._replace(sigma=np.where(wrong, 0.0, own))

    def ins(self, measured: np.ndarray) -> Batch:
        """(n,) INS: heights become ellipsoidal, everything station ENU. What was guessed is complained of."""
        lat, lon = measured["lat_deg"], measured["lon_deg"]
        position = self.frame.to_enu(lat, lon, measured["alt_msl_m"] + self._separation(measured))
        where = np.isfinite(lat) & np.isfinite(lon)
        here = np.where(where, lat, self.frame.lat_deg), np.where(where, lon, self.frame.lon_deg)
        local = np.stack([measured[field] for field in TURNED], axis=1).reshape(-1, 2, 3)
        turned = self.frame.turn(local, *(angle[:, np.newaxis] for angle in here))
        values = np.concatenate([position, turned.reshape(-1, 6)], axis=1)
        batch = self._batch("ins", measured["t_ns"], values, CHANNELS.index("e"), position)
        guessed = (measured["dead_reckoned"] > 0)[batch.entries["measurement"]]
        guessed &= batch.entries["channel"] < CHANNELS.index("ae")
        batch.complaints[guessed] = self.ledger.reason("no GPS fix, the autopilot's own dead reckoning")
        return batch

    def bad(self, name: str, bads: list[Bad]) -> Batch:
        """Input that was no measurement at all: one entry for each."""
        entries = np.zeros(len(bads), dtype=ENTRY)
        entries["sensor"] = self.names.index(name)
        entries["channel"] = -1
        entries["measurement"] = np.arange(len(bads))
        entries["t_ns"] = [
            NO_TIME if bad.t_ns is None or abs(bad.t_ns) > limits.WIRE_NS else bad.t_ns for bad in bads
        ]
        for field in ("value", "position_m", "predicted", "sigma"):
            entries[field] = np.nan
        entries["count"] = [bad.count for bad in bads]
        complaints = np.array([self.ledger.remark(_remark(bad)) for bad in bads], dtype=np.int32)
        return Batch(entries, entries["t_ns"].copy(), complaints, np.zeros(len(bads)))

    def enter(self, batch: Batch) -> tuple[np.ndarray, np.ndarray]:
        """Number the values and judge the impossible. Returns the good (g,) ROW and the ids (b,) judged."""
        ids = self.ledger.add(batch.entries)
        good = batch.complaints == 0
        entries = batch.entries[good]
        rows = np.zeros(len(entries), dtype=ROW)
        rows["id"], rows["t_ns"] = ids[good], batch.valid_ns[good]
        rows["sensor"], rows["channel"] = entries["sensor"], entries["channel"]
        for field, given in (("value", entries["value"]), ("sigma", batch.sigma[good])):
            rows[field] = np.where(ANGLES[entries["channel"]], np.radians(given), given)
        return rows, self.ledger.dismiss(ids[~good], "invalid", batch.complaints[~good])

    def _batch(
        self, name: str, t_ns: np.ndarray, values: np.ndarray, first_channel: int, position_m: np.ndarray
    ) -> Batch:
        """Spread (n, k) values of one source over entries; NaN is no value and leaves none."""
        measurement, column = np.nonzero(~np.isnan(values))
        entries = np.empty(len(measurement), dtype=ENTRY)
        entries["t_ns"], entries["sensor"] = t_ns[measurement], self.names.index(name)
        entries["channel"], entries["measurement"] = first_channel + column, measurement
        entries["value"] = values[measurement, column]
        entries["position_m"] = position_m[measurement]
        entries["predicted"] = entries["sigma"] = np.nan
        entries["weight"], entries["verdict"], entries["reason"], entries["final"] = 0.0, PENDING, 0, False
        entries["screened"], entries["count"] = False, 1
        low, high = LOW[entries["channel"]], HIGH[entries["channel"]]
        impossible = ~((low <= entries["value"]) & (entries["value"] <= high))
        complaints = np.where(impossible, self.ledger.reason("no target can be there"), 0)
        valid_ns = entries["t_ns"] - self._latency_ns[name][entries["channel"]]
        return Batch(entries, valid_ns, complaints, np.zeros(len(entries)))

    def _separation(self, measured: np.ndarray) -> np.ndarray:
        """Ellipsoidal minus mean-sea-level height in m, (n,): the station's, the receiver's own, else 0."""
        if self.station.ins.geoid_separation_m is not None:
            return np.full(len(measured), self.station.ins.geoid_separation_m)
        own = measured["geoid_separation_m"]
        if np.isfinite(own).any():
            self.separation_source = "receiver"
        return np.nan_to_num(own)


def _remark(bad: Bad) -> str:
    """Why it is no measurement, in one line."""
    many = f"{bad.count} like this: " if bad.count > 1 else ""
    return " ".join(f"{bad.where[: limits.TEXT]}: {many}{bad.reason[: limits.TEXT]}"[: limits.TEXT].split())
