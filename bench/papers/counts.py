"""How many flights, trainings and records the papers' bench takes."""

from typing import NamedTuple

from bench.papers.m3.screening import POINTS


class Counts(NamedTuple):
    """How much is measured."""

    runs: int = 200  # flights of simulations 1 and 2
    lessons: int = 300  # flights their networks learn from
    tuning: int = 20  # flights that the tuned filters are tuned on
    trainings: int = 20  # of each start
    theodolites: int = 20  # flights of each level
    flights: int = 100  # that the default network is trained on
    unseen: int = 20  # that it is tried on
    winds: int = 1000  # of which the first `lines_m2.FEW` make row 8, all its second line
    records: int = 20  # screened
    joined: int = 5  # of them, with the trajectory filter
    points: int = POINTS  # of each of those
