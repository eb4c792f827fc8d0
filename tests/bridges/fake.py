"""A bus that only remembers."""


class FakeBus:
    def __init__(self):
        self.sent, self.alive = [], []

    def publish(self, subject, message, source=""):
        self.sent.append((subject, source, message))

    def declare_alive(self, source):
        self.alive.append(source)
