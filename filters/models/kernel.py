"""How the inner loops are compiled.

They allocate nothing, so that numba need not count references to arrays there: that took half of their time.
Numbers divided by zero give inf, as in numpy.
"""

from numba import njit

# Sums may be reordered, but NaN and inf keep their meaning: "not known" is NaN.
REORDER = {"reassoc", "contract", "arcp", "nsz", "afn"}
kernel = njit(cache=True, fastmath=REORDER, error_model="numpy", _nrt=False)
# Where reordering would cost P its exact symmetry. Said explicitly: else a caller's fastmath is inherited.
exact = njit(cache=True, fastmath=False, error_model="numpy", _nrt=False)
