"""What the bench flies, requirement by requirement. Limits are those of the requirement."""

import numpy as np

from bench.scene import Case, Patch
from filters.simulation.simulate import PATCH_KINDS, InstrumentErrors

WRONG = InstrumentErrors(zero=(5.0, np.radians(0.05), np.radians(0.05), 0.0), clock_offset_s=0.12)
NONE_LOST = {"lost": 0}
LONG = {"during_worst": 3.0, "back_worst_s": 1.0, "lost": 0}
SETS = {
    "passive + ins": ("ins", "passive-a"),
    "theodolite + ins": ("ins", "theo-a"),
    "radar + ins": ("ins", "radar-a"),
    "two passive": ("passive-a", "passive-b"),
    "two theodolites": ("theo-a", "theo-b"),
    "three of each": ("ins", "theo-a", "theo-b", "theo-c", "radar-a", "radar-b", "radar-c"),
}
BOTH = ("bias", "clock")
KNOWN = {"beside_worst": 1.1, "within_3": 0.95}
MANY = {
    "ratio_median": 1.05, "ratio_worst": 1.3, "smoothed_median": 1.03, "lost": 0,
    "found_isolated": 0.995, "found_patch": 0.995,
}  # fmt: skip

CASES = (
    Case("4 %", 1, share=0.041, limits=MANY),
    Case("15 %", 2, share=0.15, limits={"ratio_median": 1.3} | NONE_LOST),
    Case("30 %", 2, share=0.30, limits={"ratio_median": 2.0} | NONE_LOST),
    *(
        Case(f"{kind}, {channels}", 3, patch=Patch(kind, channels), limits=LONG)
        for kind in PATCH_KINDS
        for channels in ("one", "all")
    ),
    Case("offset in a turn", 3, patch=Patch("offset", in_turn=True), limits=LONG),
    Case("ramp in a turn", 3, patch=Patch("ramp", in_turn=True), limits=LONG),
    Case("offset, two at once", 3, patch=Patch("offset", instruments=2), limits=LONG),
    Case("ramp, two at once", 3, patch=Patch("ramp", instruments=2), limits=LONG),
    *(
        Case(level, 4, level=level, limits={"ratio_worst": 1.01, "false_per_10000": 1.0} | NONE_LOST)
        for level in ("hover", "gentle", "normal", "aggressive")
    ),
    *(Case(name, 5, sensors=names, share=0.041, limits=NONE_LOST) for name, names in SETS.items()),
    Case("gaps", 5, share=0.041, gap_share=0.2, limits=NONE_LOST),
    Case("errors", 6, wrong=WRONG, estimate=BOTH, limits=KNOWN),
    Case("errors, 4 %", 6, wrong=WRONG, estimate=BOTH, share=0.041, limits=KNOWN),
    Case("errors, all in doubt", 6, wrong=WRONG, estimate=BOTH, doubt="all", limits=KNOWN),
    Case("late", 7, share=0.041, late_share=0.1, limits={"late_m": 1e-9}),
)  # fmt: skip
