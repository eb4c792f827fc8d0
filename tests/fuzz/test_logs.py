"""Damaged logs, short: `make fuzz` hunts longer. The damage is checked first, since it is the oracle."""

import random

import numpy as np
import pytest

from bridges.tlog import scan
from tests.fuzz import logs, mutate

BEGINS, LENGTHS = np.arange(8, 1000, 40), np.full(25, 24)
FEEDS = {name: logs.SAMPLE / f"{name}.csv" for name in ("theo-north", "theo-east", "radar-1")}
LONG, SHORT = 60_000, 20_000  # bytes
KINDS = [
    mutate.flip,
    mutate.cut,
    mutate.insert,
    mutate.zero,
    mutate.repeat,
    mutate.swap,
    mutate.stamp,
    mutate.shift,
    mutate.forge,
]


def log_of(name: str) -> logs.FuzzedLog:
    if not logs.path_of(name).is_file():
        pytest.skip(f"{name}: no flights in shared/data")
    return logs.opened(name)


def test_undamaged_bytes_are_all_there():
    there = mutate.untouched(mutate.whole(np.zeros(1000, np.uint8)), BEGINS, LENGTHS)
    assert there == {begin: [begin] for begin in BEGINS.tolist()}


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_a_surviving_byte_is_where_its_origin_says(kind):
    original = np.frombuffer(random.Random(1).randbytes(1000), np.uint8)
    for seed in range(50):
        got = kind(mutate.whole(original), BEGINS, random.Random(seed))
        own = got.origin != mutate.FOREIGN
        assert np.array_equal(got.data[own], original[got.origin[own]])
        for begin, places in mutate.untouched(got, BEGINS, LENGTHS).items():
            for at in places:
                assert np.array_equal(got.data[at : at + 24], original[begin : begin + 24])


def test_a_flipped_byte_costs_the_frame_it_is_in():
    of = mutate.whole(np.zeros(1000, np.uint8))
    there = mutate.untouched(mutate.replaced(50, b"\1", of), BEGINS, LENGTHS)
    assert sorted(set(BEGINS.tolist()) - set(there)) == [48]


def test_a_forged_frame_has_the_right_checksum():
    data = np.fromfile(logs.path_of("sample"), np.uint8)[:20_000]
    frames = scan.scan(data)
    rng, changed = random.Random(0), 0
    for _ in range(100):
        forged = mutate.forge(mutate.whole(data), frames["offset"], rng)
        changed += not np.array_equal(forged.data, data)
        assert np.array_equal(scan.scan(forged.data)["kind"], frames["kind"])
    assert changed > 50


@pytest.mark.parametrize("name", [*logs.REAL, "sample"])
def test_no_untouched_frame_is_lost(name):
    log = log_of(name)
    for seed in range(20):
        assert logs.lost_frames(logs.case(log, seed, LONG)) == [], f"seed {seed}"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("name", [*logs.REAL, "sample"])
def test_damaged_logs_are_replayed_to_the_end(name, seed, tmp_path):
    log = log_of(name)
    longest = SHORT if name.startswith("codelever") else LONG  # a tenth of the messages a second
    feeds = FEEDS if name == "sample" and seed == 1 else None
    assert logs.problems(logs.case(log, seed, longest), tmp_path, feeds) == []


def test_what_is_found_would_be_said(tmp_path):
    """The checks themselves: a frame the reader does not have, a number that is none, a verdict too few."""
    of = logs.case(logs.opened("sample"), 0, SHORT)
    begin, at = next(iter(mutate.untouched(of.damaged, of.log.begins, of.log.lengths).items()))
    data = of.damaged.data.copy()
    data[at[0] + 3] ^= 1  # behind the back of its origin
    assert (
        f"frame {begin} at {at[0]}"
        in logs.lost_frames(of._replace(damaged=of.damaged._replace(data=data)))[0]
    )
    table = tmp_path / "track.csv"
    table.write_text("t_ns,e_m,reason\n1,2.0,nan\n2,nan,\n")
    assert list(logs.table(table)) == ["track.csv:3: e_m is 'nan'"]
