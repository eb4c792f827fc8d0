"""Buses that only remember."""

from gcs.contract.messages import Event


class FakeBus:
    def __init__(self):
        self.sent, self.alive = [], []

    def publish(self, subject, message, source=""):
        self.sent.append((subject, source, message))

    def declare_alive(self, source):
        self.alive.append(source)


class SortingBus:
    """Keeps what is published."""

    def __init__(self):
        self.alive, self.raw, self.events = set(), [], []

    def declare_alive(self, source):
        self.alive.add(source)

    def publish(self, subject, message, source=""):
        if isinstance(message, Event):
            assert (subject, source) == ("event", "")
            self.events.append(message.text)
        else:
            assert (subject, source) == ("raw", "ins")
            self.raw.append(message)
