"""Handles: what we set is not taken for a viewer's hand, nor the other way round."""

from types import SimpleNamespace

from web.look.handles import Follower, by_hand


def test_only_a_hand_is_heard():
    heard, calls = [], []
    handle = SimpleNamespace(value="a", on_update=calls.append)
    by_hand(handle, heard.append)
    for client in (None, object()):
        calls[0](SimpleNamespace(client=client, target=handle))
    assert heard == ["a"]


def test_what_a_hand_has_just_set_is_not_overwritten_by_what_was():
    handle = SimpleNamespace(value="NIS")
    follower = Follower(handle)
    handle.value = "plain"  # by hand; what it does comes a moment later
    follower.follow("NIS")
    assert handle.value == "plain"
    follower.follow("plain")
    follower.follow("speed")  # another viewer
    assert handle.value == "speed"
