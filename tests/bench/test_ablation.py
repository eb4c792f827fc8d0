"""The trial that switches parts of the estimator off."""

from argparse import Namespace

import pytest

from bench.trials import ablation

ASKED = Namespace(method="default", setting=[], share=0.05, data=None)


@pytest.mark.parametrize("part", ablation.PARTS)
def test_a_part_is_off_while_open_and_back_afterwards(part):
    instead = ablation.PARTS[part].instead
    before = [getattr(owner, name) for owner, name, _ in instead]
    with ablation.off(part, ASKED):
        assert [getattr(owner, name) for owner, name, _ in instead] == [new for *_, new in instead]
    assert [getattr(owner, name) for owner, name, _ in instead] == before


@pytest.mark.parametrize("part", ablation.PARTS)
def test_the_estimator_still_flies_without_it(part, monkeypatch):
    monkeypatch.setattr(ablation, "SEEN_S", 6.0)
    figures = dict(zip(ablation.FIGURES, ablation.fly(ASKED, (part, "normal", 3)), strict=True))
    assert 0.5 < figures["over_told"] < 5.0
