"""How exact and how fast the estimator is, measured so that anyone can repeat it.

``cases`` says what is flown, ``scene`` flies it, ``score`` compares with the truth and with the oracle,
``accuracy`` does that for many seeds; ``speed`` times the filter beside its peers, the log reader, a replay
and the live station; ``papers`` are the methods of the three papers. ``python -m bench`` runs them.
"""
