"""The ground station: words, frames, units and time. Read this page before any code.

Time
    ``t_ns``          int64 nanoseconds, UTC, the instant a measurement was *valid*.
    ``arrival_ns``    the instant it reached us, same clock; never used as the time of data.
    The wall clock is never used for data: a flight log replays on the flight's own clock.

Position
    WGS84 ``lat_deg``, ``lon_deg``; ``alt_m`` is height above the *ellipsoid*.
    A height that is not ellipsoidal says so in its name: ``alt_msl_m``.

Frames
    station ENU       local East-North-Up at the station origin; the filter's frame: ``e n u``.
    sensor ENU        local East-North-Up at one instrument. Its range, azimuth and elevation are taken
                      in this frame, so Earth curvature needs no correction term.
    Azimuth is clockwise from true north, elevation is up from the local horizontal plane.

Units
    In the name: ``_m _mps _mps2 _deg _rad _s _ns _hz``. Degrees on the wire and in files, radians
    inside ``filters/``.

Words
    measurement       what one source said at one instant; it has one value per *channel*.
    channel           one number of a measurement: range azimuth elevation range_rate (instruments),
                      e n u ve vn vu ae an au (the INS, in station ENU).
    row               one channel value: time, sensor, channel, value. The filter works on rows.
    epoch             all rows valid at the same instant.
    verdict           what was done with a row: used deweighted isolated patch invalid duplicate late.
    track             the causal state, what the filter knew *then*.
    smoothed          the state after all data, the best estimate of trajectory.
    instrument        a theodolite or a radar; a *sensor* is an instrument or the INS.
"""

__version__ = "0.1.0"
