"""What steers an estimator."""

from typing import NamedTuple

import numpy as np

from filters.models import ins


class Settings(NamedTuple):
    """The motion to expect, the INS, a height known beforehand, and how long later rows count."""

    jerk_psd: float = 10.0  # m²/s⁵, middle of the prior of the density of the white jerk
    gust_psd: float = 0.3  # m²/s³, the same of the white acceleration
    ins_bias_sigma_m: float = ins.BIAS_SIGMA_M
    ins_bias_tau_s: float = ins.BIAS_TAU_S
    height_m: float = np.nan  # of the target, where no sensor sees it; NaN: not known
    height_sigma_m: float = np.nan
    lag_scans: float = 5.0  # of the slowest sensor, that later rows may still change a decision
    shortest_lag_s: float = 1.0
    longest_lag_s: float = 30.0
    lateness_s: float = 1.0  # a row may come so much later than the newest one
