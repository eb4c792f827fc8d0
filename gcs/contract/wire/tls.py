"""Mutual TLS on the bus: what a session shows and what it wants to see, as Zenoh's settings."""

from pathlib import Path

import msgspec

from gcs.contract.config import TlsSection
from gcs.contract.messages import InputError


def shown(tls: TlsSection | None, *, listens: bool) -> dict[str, object]:
    """Zenoh's settings by path; none without ``tls``. Raises ``InputError`` for a file that is not there."""
    if tls is None:
        return {}
    for name, path in msgspec.structs.asdict(tls).items():
        if not Path(path).is_file():
            raise InputError(f"[bus] tls.{name}: no such file {path}; docs/security says how to make one")
    side = "listen" if listens else "connect"
    return {
        "transport/link/tls/root_ca_certificate": tls.root_ca,
        "transport/link/tls/enable_mtls": True,
        f"transport/link/tls/{side}_certificate": tls.certificate,
        f"transport/link/tls/{side}_private_key": tls.private_key,
        "transport/link/tls/close_link_on_expiration": True,
    }
