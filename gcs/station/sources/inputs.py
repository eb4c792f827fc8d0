"""Which files a run was made of: what a report names, and what proves later that it was these."""

import hashlib
from collections.abc import Mapping
from pathlib import Path


def digests(files: Mapping[str, Path]) -> dict[str, dict]:
    """By what each file is to the run: its path as it was named, its bytes, and its SHA-256."""
    return {role: {"file": str(path)} | digest(path) for role, path in files.items()}


def digest(path: Path) -> dict:
    """Bytes and SHA-256 of one file."""
    with path.open("rb") as file:
        return {"bytes": path.stat().st_size, "sha256": hashlib.file_digest(file, "sha256").hexdigest()}
